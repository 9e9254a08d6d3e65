//! Thousands of connections that mean no good: silent ones, half a head, downloads
//! and events that nobody reads.

use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::daemon_support::{Daemon, wait_for};

const MANY: usize = 5_000;

/// How many files this process may open, once it has asked for all it may have.
fn files() -> usize {
    let limit = getrlimit(Resource::Nofile);
    let most = limit.maximum.map_or(MANY as u64 * 2, |most| most.min(MANY as u64 * 2));
    if limit.current.is_some_and(|now| now < most) {
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(most), maximum: limit.maximum });
    }
    getrlimit(Resource::Nofile).current.map_or(usize::MAX, |now| usize::try_from(now).unwrap_or(usize::MAX))
}

/// Opens a connection and says this on it; none where the daemon has no place.
fn open(address: &SocketAddr, said: &str) -> Option<TcpStream> {
    let mut stream = TcpStream::connect_timeout(address, Duration::from_secs(10)).ok()?;
    stream.write_all(said.as_bytes()).ok()?;
    Some(stream)
}

/// Asks in a connection of its own; the status and how long it took.
fn probe(address: &SocketAddr, path: &str) -> (u16, Duration) {
    let start = Instant::now();
    let Some(mut stream) =
        open(address, &format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"))
    else {
        return (0, start.elapsed());
    };
    let _ = stream.set_read_timeout(Some(Duration::from_secs(30)));
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let status = String::from_utf8_lossy(&answer).split(' ').nth(1).and_then(|status| status.parse().ok());
    (status.unwrap_or(0), start.elapsed())
}

#[test]
fn thousands_of_hostile_connections_leave_room() {
    let many = MANY.min(files().saturating_sub(200));
    if many < 1_000 {
        eprintln!("skipped: only {many} files may be open");
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    // Large, and none of it on the disk.
    std::fs::create_dir_all(data.join("octrees/a")).expect("made");
    File::create(data.join("octrees/a/octree.bin")).and_then(|file| file.set_len(1 << 30)).expect("made");
    let daemon = Daemon::start(&data);
    let address: SocketAddr = daemon.address.parse().expect("an address");
    let host = "Host: localhost\r\n";
    let download = format!("GET /octrees/a/octree.bin HTTP/1.1\r\n{host}\r\n");
    let events = format!("GET /api/events HTTP/1.1\r\n{host}\r\n");
    let half = format!("GET /api/jobs HTTP/1.1\r\n{host}X-More: ");
    let kinds = ["", half.as_str(), download.as_str(), events.as_str()];
    let mut held = Vec::new();
    for number in 0..many {
        held.extend(open(&address, kinds[number % kinds.len()]));
        if number % 500 == 499 {
            // Amidst the flood.
            assert_eq!(probe(&address, "/healthz").0, 200, "after {number}");
        }
    }
    assert!(held.len() > many / 2, "{} of {many}", held.len());
    for path in ["/healthz", "/readyz", "/healthz"] {
        let (status, time) = probe(&address, path);
        eprintln!("{path} beside {} connections: {status} after {time:?}", held.len());
        assert_eq!(status, 200, "{path}");
        // A second where nobody else is at work.
        assert!(time < Duration::from_secs(10), "{path}: {time:?}");
    }
    // And everybody else is served again soon, though none of these went away.
    wait_for("the API to answer", || (probe(&address, "/api/jobs").0 == 200).then_some(()));
    wait_for("a download", || (probe(&address, "/octrees/a/none").0 == 404).then_some(()));
    drop(held);
    assert_eq!(probe(&address, "/api/jobs").0, 200);
}

#[test]
fn silence_and_half_a_head_are_ended() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let address: SocketAddr = daemon.address.parse().expect("an address");
    let silent = open(&address, "").expect("open");
    let half = open(&address, "GET / HTTP/1.1\r\nHost: loc").expect("open");
    for mut stream in [silent, half] {
        stream.set_read_timeout(Some(Duration::from_secs(100))).expect("set");
        // The end, or a reset.
        let mut rest = Vec::new();
        let ended = stream.read_to_end(&mut rest);
        assert!(ended.is_ok() || ended.is_err_and(|e| e.kind() != std::io::ErrorKind::WouldBlock));
    }
    assert_eq!(daemon.get("/healthz").0, 200);
}

#[test]
fn lists_carry_no_options() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let names: Vec<String> = (0..4_000).map(|i| format!("attribute_{i}")).collect();
    let marker = |attributes: &[String]| {
        serde_json::json!({ "options": { "attributes": attributes } }).to_string().into_bytes()
    };
    let cloud = crate::daemon_support::las(500, 1);
    daemon.drop_folder("fine", &[("a.las", cloud.clone()), ("lodestone.json", marker(&names[..2_000]))]);
    wait_for("the job", || (daemon.jobs().first()?["state"] != "queued").then_some(()));
    let list = daemon.get("/api/jobs").1;
    assert!(!list.contains("attribute_1") && list.len() < 20_000, "{} bytes", list.len());
    let whole = daemon.get("/api/jobs/1").1;
    assert!(whole.contains("attribute_1999"), "{whole}");
}
