//! What pages cost where there are many jobs, counted in what is read and asked, for
//! a clock tells more of the machine than of the program.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::Duration;

use super::rows;
use crate::daemon_support::{Daemon, las, wait_for};

/// Logs what is asked of the queue, a line each.
const STATEMENTS: [&str; 4] = ["--log", "info,sqlx=debug", "--log-format", "json"];

fn statements(daemon: &Daemon) -> Vec<String> {
    daemon
        .log()
        .lines()
        .filter(|line| line.contains("\"target\":\"sqlx::query\""))
        .map(str::to_string)
        .collect()
}

/// Bytes that the daemon has read from files, cached or not.
fn bytes_read(daemon: &Daemon) -> u64 {
    let io = fs::read_to_string(format!("/proc/{}/io", daemon.child.id())).expect("its figures");
    let line = io.lines().find_map(|line| line.strip_prefix("rchar: ")).expect("a figure");
    line.parse().expect("a number")
}

#[test]
fn pages_read_little_of_many_jobs() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    // Many MB of jobs, most of that in their reports.
    rows::fill(&data, 30_000);
    let size = fs::metadata(data.join("lodestone.db")).expect("there").len();
    assert!(size > 60 << 20, "{size}");
    let daemon = Daemon::start_with(&data, &[&["--settle-seconds", "3600"][..], &STATEMENTS].concat());
    // What it does by itself after its start, as looking for old records, reads all.
    wait_for("a quiet daemon", || {
        let before = bytes_read(&daemon);
        std::thread::sleep(Duration::from_millis(500));
        (bytes_read(&daemon) - before < 100_000).then_some(())
    });
    for (path, most_asked, most_bytes) in [
        ("/", 9, 4 << 20),
        ("/?state=done", 9, 4 << 20),
        ("/?q=tile_4321", 9, 8 << 20),
        ("/?q=not+there", 9, 8 << 20),
        ("/?sort=name", 9, 8 << 20),
        ("/?sort=points", 9, 8 << 20),
        ("/?sort=took-up&state=done", 9, 8 << 20),
        ("/?sort=age-up", 9, 4 << 20),
        // Reads the errors of the latest 5 000, and so their rows.
        ("/?state=failed", 10, 32 << 20),
        ("/jobs/29999", 12, 1 << 20),
        ("/api/jobs", 5, 2 << 20),
        ("/api/jobs/29999", 8, 1 << 20),
    ] {
        // The first time tells what is read once; and the daemon goes on with its own
        // affairs meanwhile, so the least of some tries counts.
        let mut tries = vec![];
        let is_little = |tries: &[(usize, u64)]| {
            let least = |of: fn(&(usize, u64)) -> u64| tries.iter().map(of).min().unwrap_or(u64::MAX);
            least(|(asked, _)| *asked as u64) <= most_asked && least(|(_, read)| *read) <= most_bytes
        };
        while tries.len() < 6 && !is_little(&tries) {
            let (asked, read) = (statements(&daemon).len(), bytes_read(&daemon));
            let (status, body) = daemon.get(path);
            assert!(status == 200 && body.len() < 2 << 20, "{path}: {status}, {} bytes", body.len());
            tries.push((statements(&daemon).len() - asked, bytes_read(&daemon) - read));
        }
        assert!(is_little(&tries), "{path}: statements and bytes read {tries:?} of {size}");
    }
}

/// An open page: its stream, read to the end in the background.
fn open_page(daemon: &Daemon) -> TcpStream {
    let mut stream = TcpStream::connect(&daemon.address).expect("connected");
    let request = format!("GET /live HTTP/1.1\r\nHost: {}\r\n\r\n", daemon.address);
    stream.write_all(request.as_bytes()).expect("sent");
    let mut lines = BufReader::new(stream.try_clone().expect("both ends"));
    let mut first = String::new();
    lines.read_line(&mut first).expect("an answer");
    assert!(first.contains("200"), "{first}");
    std::thread::spawn(move || lines.lines().map_while(Result::ok).count());
    stream
}

/// Looks of the pages' task while it lasts: it asks for the latest line of history.
fn looks(daemon: &Daemon) -> usize {
    statements(daemon).iter().filter(|line| line.contains("coalesce(max(id), 0) AS id FROM event")).count()
}

#[test]
fn many_open_pages_ask_no_more_than_one() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &STATEMENTS);
    let span = Duration::from_secs(3);
    let during = || {
        let before = looks(&daemon);
        std::thread::sleep(span);
        looks(&daemon) - before
    };
    assert_eq!(during(), 0, "nobody is there to be told");
    let one = open_page(&daemon);
    wait_for("the first look", || (looks(&daemon) > 0).then_some(()));
    let for_one = during();
    let others: Vec<TcpStream> = (0..9).map(|_| open_page(&daemon)).collect();
    let for_ten = during();
    assert!(for_one >= 1 && for_ten <= for_one + 4, "{for_one} looks for one, {for_ten} for ten");
    // What happens is told to all by one look: the jobs behind it are asked for once.
    let told = || statements(&daemon).iter().filter(|line| line.contains("event.id > ?")).count();
    let before = told();
    fs::write(daemon.inbox().join("a.las"), las(1_000, 1)).expect("dropped");
    daemon.wait("a", "done");
    wait_for("the news", || (told() > before).then_some(()));
    std::thread::sleep(Duration::from_secs(1));
    assert!(told() - before <= 8, "{} times", told() - before);
    // Without them nobody looks any more.
    for stream in others.iter().chain([&one]) {
        stream.shutdown(std::net::Shutdown::Both).expect("closed");
    }
    wait_for("an end of the looks", || (during() == 0).then_some(()));
}
