//! What the tests of the daemon share: a LAS file made of numbers, the real
//! daemon as a child process, and just enough of an HTTP client to talk to it.

#![allow(dead_code, reason = "each test file uses a part")]

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

pub mod held;
pub mod small_disk;

/// The bytes of a LAS 1.2 file with `points` points of format 0, spread evenly
/// and always the same for the same `seed`.
pub fn las(points: u32, seed: u64) -> Vec<u8> {
    let mut header = vec![0u8; 227];
    header[..4].copy_from_slice(b"LASF");
    (header[24], header[25]) = (1, 2);
    header[94..96].copy_from_slice(&227u16.to_le_bytes());
    header[96..100].copy_from_slice(&227u32.to_le_bytes());
    header[105..107].copy_from_slice(&20u16.to_le_bytes());
    header[107..111].copy_from_slice(&points.to_le_bytes());
    for (at, value) in
        [(131, 0.001f64), (139, 0.001), (147, 0.001), (179, 1000.0), (195, 1000.0), (211, 100.0)]
    {
        header[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    let mut bytes = header;
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = |below: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below) as i32
    };
    for _ in 0..points {
        for below in [1_000_000, 1_000_000, 100_000] {
            bytes.extend_from_slice(&next(below).to_le_bytes());
        }
        bytes.extend_from_slice(&[1, 0, 0b0000_1001, 2, 0, 0, 0, 0]);
    }
    bytes
}

/// Makes a folder with these files.
pub fn fill_folder(folder: &Path, files: &[(&str, Vec<u8>)]) {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        std::fs::write(path, bytes).expect("written");
    }
}

/// All files of a folder by their path in it; but for an octree's report, which
/// tells how long it took.
pub fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap_or_else(|e| panic!("{}: {e}", at.display())) {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.file_name().is_some_and(|name| name != "report.json") {
                let name = path.strip_prefix(folder).expect("below").to_path_buf();
                files.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    files
}

/// What `lodestone convert` makes of the same inputs.
pub fn converted(inputs: &[&Path], output: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .arg("convert")
        .args(inputs)
        .arg("-o")
        .arg(output)
        .args(["--progress", "none"])
        .output()
        .expect("started");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    content(output)
}

/// Waits until `ask` answers, and fails with `what` after a minute or two.
pub fn wait_for<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(150) {
        if let Some(answer) = ask() {
            return answer;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("waited in vain for {what}");
}

/// Sends a request; the answer's status, head and body.
pub fn ask(address: &str, head: &str, body: &str) -> (u16, String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(Duration::from_secs(120))).expect("set");
    let (first, more) = head.split_once('\n').unwrap_or((head, ""));
    let more = more.lines().map(|line| format!("{line}\r\n")).collect::<String>();
    let host = if more.contains("Host:") { String::new() } else { format!("Host: {address}\r\n") };
    let length = body.len();
    let text = format!(
        "{first} HTTP/1.1\r\n{host}Connection: close\r\nContent-Length: {length}\r\n{more}\r\n{body}"
    );
    stream.write_all(text.as_bytes()).expect("sent");
    let mut answer = Vec::new();
    // A refused request may end in a reset after the answer.
    let _ = stream.read_to_end(&mut answer);
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap_or(answer.len());
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    (status, head, answer[(end + 4).min(answer.len())..].to_vec())
}

/// The flags of `serve`: these, and where they are silent, what suits tests.
fn arguments(root: &Path, more: &[&str]) -> Vec<String> {
    let mut all = vec!["--root".to_string(), root.to_str().expect("UTF-8").to_string()];
    for (flag, value) in [
        ("--listen", "127.0.0.1:0"),
        ("--settle-seconds", "0.4"),
        ("--rescan-seconds", "1"),
        // Pictures are work that most tests need not wait for.
        ("--preview", "false"),
        ("--disk-reserve", "1M"),
        ("--retry-seconds", "0.2"),
    ] {
        if !more.contains(&flag) {
            all.extend([flag, value].map(str::to_string));
        }
    }
    all.extend(more.iter().map(|flag| flag.to_string()));
    all
}

/// The real daemon.
pub struct Daemon {
    pub child: Child,
    pub address: String,
    pub root: PathBuf,
    log: PathBuf,
}

impl Daemon {
    pub fn start(root: &Path) -> Daemon {
        Daemon::start_with(root, &[])
    }

    pub fn start_with(root: &Path, more: &[&str]) -> Daemon {
        Daemon::start_by(&[], root, more, &[])
    }

    pub fn start_with_env(root: &Path, more: &[&str], variables: &[(&str, &str)]) -> Daemon {
        Daemon::start_by(&[], root, more, variables)
    }

    /// Started by another program, as one that sets limits.
    pub fn start_by(wrapper: &[&str], root: &Path, more: &[&str], variables: &[(&str, &str)]) -> Daemon {
        let line: Vec<&str> = wrapper.iter().copied().chain([env!("CARGO_BIN_EXE_lodestone")]).collect();
        let mut command = Command::new(line[0]);
        command.args(&line[1..]).arg("serve").args(arguments(root, more)).envs(variables.iter().copied());
        Daemon::begin(command, root)
    }

    /// Runs a command that is a daemon on this root, until it says where it listens.
    fn begin(mut command: Command, root: &Path) -> Daemon {
        let log = root.with_extension(format!("{}.log", std::process::id()));
        let errors = std::fs::OpenOptions::new().create(true).append(true).open(&log).expect("a log");
        let mut child = command.stdout(Stdio::piped()).stderr(errors).spawn().expect("started");
        let mut address = None;
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines().map_while(Result::ok);
        for line in lines.by_ref() {
            if let Some((_, rest)) = line.split_once("http://") {
                address = Some(rest.trim_end_matches('/').to_string());
                break;
            }
        }
        let Some(address) = address else {
            panic!("it did not start: {}", std::fs::read_to_string(&log).unwrap_or_default());
        };
        // Whatever else it says has a reader until its end.
        std::thread::spawn(move || lines.for_each(drop));
        Daemon { child, address, root: root.to_path_buf(), log }
    }

    pub fn inbox(&self) -> PathBuf {
        self.root.join("inbox")
    }

    /// Drops a folder all at once. Made file by file in the inbox, half of it would
    /// be taken where the machine is busy for as long as settling takes.
    pub fn drop_folder(&self, name: &str, files: &[(&str, Vec<u8>)]) -> PathBuf {
        let coming = self.root.with_extension("coming");
        fill_folder(&coming, files);
        let folder = self.inbox().join(name);
        std::fs::rename(&coming, &folder).expect("dropped");
        folder
    }

    pub fn octree(&self, name: &str) -> PathBuf {
        self.root.join("octrees").join(name)
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Sends a request; the answer's status, head and body.
    pub fn ask(&self, head: &str, body: &str) -> (u16, String, Vec<u8>) {
        ask(&self.address, head, body)
    }

    pub fn get(&self, path: &str) -> (u16, String) {
        let (status, _, body) = self.ask(&format!("GET {path}"), "");
        (status, String::from_utf8_lossy(&body).into_owned())
    }

    pub fn json(&self, path: &str) -> Value {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {body}");
        serde_json::from_str(&body).unwrap_or_else(|e| panic!("{path}: {e}: {body}"))
    }

    pub fn post(&self, path: &str, body: &str) -> (u16, String) {
        let (status, _, body) = self.ask(&format!("POST {path}\nContent-Type: application/json"), body);
        (status, String::from_utf8_lossy(&body).into_owned())
    }

    /// All jobs, the oldest first.
    pub fn jobs(&self) -> Vec<Value> {
        let mut jobs = self.json("/api/jobs")["jobs"].as_array().expect("an array").clone();
        jobs.reverse();
        jobs
    }

    /// Waits until a job of this name is in this state.
    pub fn wait(&self, name: &str, state: &str) -> Value {
        wait_for(&format!("{name} to be {state}; {}", self.root.display()), || {
            self.jobs().into_iter().rev().find(|job| job["name"] == name && job["state"] == state)
        })
    }

    /// Waits until the metrics have all these lines, and gives the metrics. They
    /// count what the queue has recorded already, so they come a moment after it.
    pub fn wait_metrics(&self, lines: &[&str]) -> String {
        wait_for(&format!("metrics with {lines:?}"), || {
            let metrics = self.get("/metrics").1;
            lines.iter().all(|line| metrics.lines().any(|l| l == *line)).then_some(metrics)
        })
    }

    /// Waits until nothing is left in scratch and staging; a job's end is recorded
    /// before its remains are cleared.
    pub fn wait_cleared(&self) {
        for folder in ["scratch", "octrees/.staged"] {
            wait_for(&format!("{folder} to be cleared"), || {
                std::fs::read_dir(self.root.join(folder)).ok()?.next().is_none().then_some(())
            });
        }
    }

    pub fn kill(&mut self) {
        self.child.kill().expect("SIGKILL");
        self.child.wait().expect("gone");
    }

    /// Asks it to stop in good order; true where it did.
    pub fn stop(&mut self) -> bool {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).expect("sent");
        self.child.wait().expect("gone").success()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            eprintln!("--- the daemon's log\n{}", self.log());
        }
        let _ = std::fs::remove_file(&self.log);
    }
}
