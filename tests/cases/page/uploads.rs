//! Files that are handed in by the page.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;

use crate::daemon_support::{Daemon, ask, content, converted, las, wait_for};

const BOUNDARY: &str = "----a boundary";

/// A form with these files.
fn form(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, bytes) in files {
        let head = format!(
            "--{BOUNDARY}\r\nContent-Disposition: form-data; name=\"files\"; filename=\"{name}\"\r\n\
             Content-Type: application/octet-stream\r\n\r\n"
        );
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(bytes);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    body
}

fn begin(address: &str, length: u64) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("connected");
    let head = format!(
        "POST /upload HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nAccept: application/json\r\n\
         Content-Type: multipart/form-data; boundary=\"{BOUNDARY}\"\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).expect("sent");
    stream
}

fn answer(mut stream: TcpStream) -> (u16, String) {
    let mut text = Vec::new();
    let _ = stream.read_to_end(&mut text);
    let text = String::from_utf8_lossy(&text).into_owned();
    (text.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0), text)
}

fn send(daemon: &Daemon, files: &[(&str, &[u8])]) -> (u16, String) {
    let body = form(files);
    let mut stream = begin(&daemon.address, body.len() as u64);
    // A refused one is not read to its end.
    let _ = stream.write_all(&body);
    answer(stream)
}

fn left(inbox: &Path) -> Vec<String> {
    let folder = inbox.join(".uploads");
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn uploads_become_what_convert_makes() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let (a, b, c) = (las(20_000, 1), las(9_000, 2), las(8_000, 3));
    let (status, text) = send(&daemon, &[("größe 1.las", &a)]);
    assert_eq!(status, 200, "{text}");
    let (status, text) =
        send(&daemon, &[("tiles/b.las", &b), ("tiles/deep/c.las", &c), ("tiles/read me.txt", b"no")]);
    assert!(status == 200 && text.contains("\"passed_over\":1"), "{text}");
    daemon.wait("größe 1", "done");
    daemon.wait("tiles", "done");
    let source = daemon.inbox().join("größe 1.las");
    assert_eq!(fs::read(&source).expect("there"), a);
    assert_eq!(content(&daemon.octree("größe 1")), converted(&[&source], &root.path().join("größe 1")));
    assert!(!daemon.inbox().join("tiles/read me.txt").exists());
    assert_eq!(left(&daemon.inbox()), Vec::<String>::new());
    // Names lead nowhere else.
    let (status, _) = send(&daemon, &[("../../../escaped.las", &b)]);
    assert_eq!(status, 200);
    assert!(daemon.inbox().join("escaped.las").exists() && !root.path().join("escaped.las").exists());
}

#[test]
fn a_cut_upload_leaves_nothing() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let body = form(&[("a.las", &las(50_000, 1))]);
    let mut stream = begin(&daemon.address, body.len() as u64);
    stream.write_all(&body[..600_000]).expect("sent");
    wait_for("its beginning", || (!left(&daemon.inbox()).is_empty()).then_some(()));
    drop(stream);
    wait_for("nothing to be left", || left(&daemon.inbox()).is_empty().then_some(()));
    // One that claims to be whole, and is not.
    let short = &body[..600_000];
    let mut stream = begin(&daemon.address, short.len() as u64);
    stream.write_all(short).expect("sent");
    let (status, text) = answer(stream);
    assert!(status == 400 && text.contains("broke off"), "{text}");
    assert!(left(&daemon.inbox()).is_empty() && daemon.jobs().is_empty());
    // And it works the second time.
    assert_eq!(send(&daemon, &[("a.las", &las(50_000, 1))]).0, 200);
    daemon.wait("a", "done");
}

#[test]
fn what_a_dead_daemon_left_is_cleared() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    let rest = data.join("inbox/.uploads/1-0");
    fs::create_dir_all(&rest).expect("made");
    fs::write(rest.join("a.las"), las(100, 1)).expect("written");
    let daemon = Daemon::start(&data);
    assert!(!rest.exists() && daemon.jobs().is_empty());
}

#[test]
fn uploads_have_a_limit_and_a_switch() {
    let root = tempfile::tempdir().expect("a folder");
    let cloud = las(10_000, 1);
    let daemon = Daemon::start_with(&root.path().join("a"), &["--upload-limit", "100k"]);
    let (status, text) = send(&daemon, &[("a.las", &cloud)]);
    assert!(status == 413 && text.contains("upload_limit"), "{text}");
    // Nobody need say how long it is.
    let mut stream = TcpStream::connect(&daemon.address).expect("connected");
    let head = format!(
        "POST /upload HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nAccept: application/json\r\n\
         Content-Type: multipart/form-data; boundary=\"{BOUNDARY}\"\r\nTransfer-Encoding: chunked\r\n\r\n",
        daemon.address
    );
    let body = form(&[("a.las", &cloud)]);
    stream.write_all(format!("{head}{:x}\r\n", body.len()).as_bytes()).expect("sent");
    let _ = stream.write_all(&body).and_then(|()| stream.write_all(b"\r\n0\r\n\r\n"));
    assert_eq!(answer(stream).0, 413);
    let (status, text) = send(&daemon, &[("notes.e57", b"x")]);
    assert!(status == 415 && text.contains("PDAL"), "{text}");
    assert!(left(&daemon.inbox()).is_empty());

    let daemon = Daemon::start_with(&root.path().join("b"), &["--upload", "false"]);
    let (status, text) = send(&daemon, &[("a.las", &cloud)]);
    assert!(status == 403 && text.contains("upload = false"), "{text}");
    assert!(!daemon.get("/").1.contains("id=\"drop\""));
}

#[test]
fn an_upload_needs_the_token() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "a long secret"]);
    assert_eq!(send(&daemon, &[("a.las", &las(100, 1))]).0, 401);
    assert_eq!(ask(&daemon.address, "GET /live", "").0, 401);
}

/// Two gigabytes: by hand, with LODESTONE_LARGE_UPLOAD=1.
#[test]
fn a_large_upload_takes_flat_memory() {
    if std::env::var_os("LODESTONE_LARGE_UPLOAD").is_none() {
        eprintln!("skipped: set LODESTONE_LARGE_UPLOAD=1 to hand in two gigabytes");
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--settle-seconds", "3600"]);
    let resident = || {
        let status = fs::read_to_string(format!("/proc/{}/status", daemon.child.id())).expect("alive");
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("a peak");
        line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") / 1024
    };
    let before = resident();
    let (head, block, blocks) = (form(&[("large.las", b"")]), vec![7u8; 1 << 20], 2048u64);
    let at = head.windows(4).position(|four| four == b"\r\n\r\n").expect("a head") + 4;
    let send = |until: u64| {
        let mut stream = begin(&daemon.address, head.len() as u64 + (blocks << 20));
        stream.write_all(&head[..at]).expect("sent");
        for _ in 0..until {
            stream.write_all(&block).expect("sent");
        }
        stream
    };
    drop(send(blocks / 2));
    wait_for("nothing to be left", || left(&daemon.inbox()).is_empty().then_some(()));
    let mut stream = send(blocks);
    stream.write_all(&head[at..]).expect("sent");
    assert_eq!(answer(stream).0, 200);
    let size = fs::metadata(daemon.inbox().join("large.las")).expect("there").len();
    assert_eq!(size, blocks << 20);
    let after = resident();
    eprintln!("{before} MiB before, {after} MiB at most while 2 GiB came in");
    assert!(after < before + 32, "{before} to {after} MiB");
}
