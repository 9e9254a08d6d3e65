//! potree-core in a browser, on a page of another origin, draws an octree from the
//! daemon: straight, and through the proxies of `deploy/`. Runs where
//! LODESTONE_VIEWER=1 is set, as it needs npm, and where there is a Chromium.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::LazyLock;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use serde_json::Value;

use crate::daemon_support::{Daemon, ask, las, wait_for};

use super::header;

const TOKEN: &str = "correct-horse-battery";
const READER: &str = "only-for-the-eyes";

/// What runs in the browser, and what drives it.
const SCRIPTS: [&str; 6] =
    ["package.json", "elsewhere.html", "elsewhere.mjs", "loaded.html", "loaded.mjs", "reload.mjs"];

pub fn is_there(program: &str, variable: &str) -> bool {
    let there = Command::new(program).arg(if program == "nginx" { "-v" } else { "version" }).output().is_ok();
    let required = std::env::var(variable).is_ok_and(|value| value == "1");
    assert!(there || !required, "{variable}=1, but there is no {program}");
    if !there {
        eprintln!("skipped: no {program}");
    }
    there
}

/// The folder with the viewer's page and its packages; none where it is not wanted.
pub fn viewer() -> Option<PathBuf> {
    static FOLDER: LazyLock<Option<PathBuf>> = LazyLock::new(install);
    FOLDER.clone()
}

fn install() -> Option<PathBuf> {
    let is_wanted = std::env::var("LODESTONE_VIEWER").is_ok_and(|value| value == "1");
    if !is_wanted || !is_there("chromium", "LODESTONE_REQUIRE_CHROMIUM") {
        eprintln!("skipped: set LODESTONE_VIEWER=1 to draw octrees in Chromium");
        return None;
    }
    Some(crate::common::scripts("elsewhere", "viewer", &SCRIPTS).expect("packages"))
}

/// Ends its process when it goes.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Serves the viewer's page, and hands on what the page saw.
pub struct Pages {
    pub address: String,
    seen: Receiver<Value>,
}

impl Pages {
    pub fn serve(folder: PathBuf) -> Pages {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let (to, seen) = channel();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (folder, to) = (folder.clone(), to.clone());
                std::thread::spawn(move || answer(stream, &folder, &to));
            }
        });
        Pages { address, seen }
    }

    /// What a browser saw of an octree.
    fn open(&self, octree: &str, token: Option<&str>) -> Value {
        let profile = tempfile::tempdir().expect("a folder");
        let token = token.map(|token| format!("&token={token}")).unwrap_or_default();
        let page = format!("http://{}/elsewhere.html?url={octree}{token}", self.address);
        let browser = Command::new("chromium")
            .args(["--headless", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(page)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("started");
        let _browser = Running(browser);
        self.seen.recv_timeout(Duration::from_secs(150)).expect("what the page saw")
    }
}

fn answer(stream: TcpStream, folder: &Path, to: &std::sync::mpsc::Sender<Value>) {
    let Ok(mut out) = stream.try_clone() else { return };
    let mut lines = BufReader::new(stream);
    let (mut first, mut length) = (String::new(), 0);
    let _ = lines.read_line(&mut first);
    loop {
        let mut line = String::new();
        if lines.read_line(&mut line).unwrap_or(0) == 0 || line == "\r\n" {
            break;
        }
        if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
            length = value.trim().parse().unwrap_or(0);
        }
    }
    let path = first.split(' ').nth(1).unwrap_or("/").split('?').next().unwrap_or("/").to_string();
    if first.starts_with("POST") {
        let mut body = vec![0; length];
        let _ = lines.read_exact(&mut body);
        let _ = to.send(serde_json::from_slice(&body).unwrap_or_default());
    }
    let bytes = fs::read(folder.join(path.trim_start_matches('/'))).unwrap_or_default();
    let kind = if path.ends_with(".html") { "text/html" } else { "text/javascript" };
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        bytes.len()
    );
    let _ = out.write_all(head.as_bytes()).and_then(|()| out.write_all(&bytes));
}

fn drawn(seen: &Value) -> bool {
    let statuses: Vec<u64> =
        seen["statuses"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    seen["nodes"].as_u64() > Some(0) && seen["pixels"].as_u64() > Some(500) && statuses.contains(&206)
}

#[test]
fn a_viewer_on_another_page_draws_octrees() {
    let Some(folder) = viewer() else { return };
    let pages = Pages::serve(folder);
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("open"));
    fs::write(daemon.inbox().join("a.las"), las(20_000, 1)).expect("dropped");
    daemon.wait("a", "done");
    let url = format!("http://{}/octrees/a/metadata.json", daemon.address);
    let seen = pages.open(&url, None);
    assert!(drawn(&seen), "{seen}");
    drop(daemon);

    let args = ["--token", TOKEN, "--read-token", READER];
    let daemon = Daemon::start_with(&root.path().join("open"), &args);
    let url = format!("http://{}/octrees/a/metadata.json", daemon.address);
    let seen = pages.open(&url, Some(READER));
    assert!(drawn(&seen), "{seen}");
    // The refusal can be read by the page: it is an answer, not an error of the network.
    let seen = pages.open(&url, Some("a-wrong-token"));
    assert_eq!((&seen["statuses"][0], drawn(&seen)), (&401.into(), false), "{seen}");
    let (_, _, link) = daemon.ask(&format!("POST /api/jobs/1/links\nAuthorization: Bearer {TOKEN}"), "");
    let link: Value = serde_json::from_slice(&link).expect("JSON");
    let shared = link["file"].as_str().expect("an address");
    let seen = pages.open(&format!("http://{}{shared}", daemon.address), None);
    assert!(drawn(&seen), "{seen}");
}

pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a port").port()
}

fn deployed(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(name)).expect("deployed")
}

/// Replaces what must be there to be replaced.
fn change(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "nothing says {from}");
    text.replace(from, to)
}

pub fn nginx(folder: &Path, port: u16, daemon: &str) -> Child {
    let server = change(&deployed("nginx.conf"), "127.0.0.1:7700", daemon);
    let server = change(&server, "listen 80;", &format!("listen 127.0.0.1:{port};"));
    let server = change(&server, "server_name scans.example.com;", "server_name 127.0.0.1;");
    let at = folder.display();
    let temporary = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|kind| format!("{kind}_temp_path {at}/{kind};"));
    let whole = format!(
        "daemon off; master_process off; pid {at}/pid; error_log stderr; worker_processes 1; events {{}}\n\
         http {{ access_log off; {} {server} }}",
        temporary.join(" ")
    );
    let config = folder.join("nginx.conf");
    fs::write(&config, whole).expect("written");
    Command::new("nginx")
        .args(["-e", "stderr", "-c"])
        .arg(&config)
        .stderr(Stdio::null())
        .spawn()
        .expect("started")
}

fn caddy(folder: &Path, port: u16, daemon: &str) -> Child {
    let site = change(&deployed("Caddyfile"), "127.0.0.1:7700", daemon);
    let site = change(&site, "scans.example.com {", &format!("http://127.0.0.1:{port} {{"));
    let config = folder.join("Caddyfile");
    fs::write(&config, format!("{{\n\tadmin off\n\tauto_https off\n}}\n{site}")).expect("written");
    Command::new("caddy")
        .args(["run", "--adapter", "caddyfile", "--config"])
        .arg(&config)
        .env("XDG_DATA_HOME", folder)
        .env("XDG_CONFIG_HOME", folder)
        .stderr(Stdio::null())
        .spawn()
        .expect("started")
}

/// All that a browser does, through a proxy of `deploy/`.
fn through(name: &str, proxy: fn(&Path, u16, &str) -> Child) {
    if !is_there(name, "LODESTONE_REQUIRE_PROXIES") {
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let port = free_port();
    let public = format!("http://127.0.0.1:{port}");
    let url = format!("{public}/lodestone");
    let args = ["--token", TOKEN, "--read-token", READER, "--public-url", &url];
    let daemon = Daemon::start_with(&root.path().join("data"), &args);
    let _proxy = Running(proxy(root.path(), port, &daemon.address));
    let front = format!("127.0.0.1:{port}");
    wait_for("the proxy", || TcpStream::connect(&front).ok());
    fs::write(daemon.inbox().join("a.las"), las(20_000, 1)).expect("dropped");

    // A person is led to the form, logs in, and gives an order.
    let (status, head, _) = ask(&front, "GET /lodestone/\nAccept: text/html", "");
    assert_eq!(
        (status, header(&head, "location").as_str()),
        (303, "/lodestone/login?next=/lodestone/"),
        "{name}: {head}"
    );
    let form = "POST /lodestone/login\nContent-Type: application/x-www-form-urlencoded";
    let (status, head, _) = ask(&front, &format!("{form}\nOrigin: {public}"), &format!("token={TOKEN}"));
    assert_eq!((status, header(&head, "location").as_str()), (303, "/lodestone/"), "{name}: {head}");
    assert_eq!(
        ask(&front, &format!("{form}\nOrigin: https://evil.example"), &format!("token={TOKEN}")).0,
        403
    );
    let cookie = header(&head, "set-cookie").split(';').next().unwrap_or("").to_string();
    let with = |request: &str| ask(&front, &format!("{request}\nCookie: {cookie}"), "");
    assert_eq!(with("GET /lodestone/\nAccept: text/html").0, 200, "{name}");
    assert_eq!(with(&format!("POST /lodestone/api/jobs/77/retry\nOrigin: {public}")).0, 404, "{name}");
    assert_eq!(with("POST /lodestone/api/jobs/77/retry\nOrigin: https://evil.example").0, 403, "{name}");
    let job = wait_for("the octree", || {
        let jobs: Value = serde_json::from_slice(&with("GET /lodestone/api/jobs").2).ok()?;
        Some(jobs["jobs"][0].clone()).filter(|job| job["state"] == "done")
    });
    let octree = job["octree"].as_str().expect("an address").replace("metadata.json", "octree.bin");
    let (status, _, part) = with(&format!("GET {octree}\nRange: bytes=10-29"));
    assert_eq!((status, part.len()), (206, 20), "{name}");
    // Events come through as they happen, not when the stream ends.
    let mut events = TcpStream::connect(&front).expect("connected");
    events.set_read_timeout(Some(Duration::from_secs(60))).expect("set");
    let request = format!("GET /lodestone/api/events HTTP/1.1\r\nHost: {front}\r\nCookie: {cookie}\r\n\r\n");
    events.write_all(request.as_bytes()).expect("sent");
    let lines = BufReader::new(events).lines().map_while(Result::ok);
    assert!(lines.take(100).any(|line| line.contains("event: job")), "{name}: no event");

    let Some(folder) = viewer() else { return };
    let pages = Pages::serve(folder);
    let metadata = job["octree"].as_str().expect("an address");
    let seen = pages.open(&format!("{public}{metadata}"), Some(READER));
    assert!(drawn(&seen), "{name}: {seen}");
    let (_, _, link) = with(&format!("POST /lodestone/api/jobs/{}/links\nOrigin: {public}", job["id"]));
    let link: Value = serde_json::from_slice(&link).expect("JSON");
    let shared = link["file"].as_str().expect("an address");
    let seen = pages.open(&format!("{public}{shared}"), None);
    assert!(drawn(&seen), "{name}: {seen}");
}

#[test]
fn nginx_stands_in_front_as_documented() {
    through("nginx", nginx);
}

#[test]
fn caddy_stands_in_front_as_documented() {
    through("caddy", caddy);
}
