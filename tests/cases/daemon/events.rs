//! `/api/events` as a raw client sees it, and purging through the API and the
//! command line.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Command;
use std::time::Duration;

use crate::daemon_support::{Daemon, las, wait_for};
use serde_json::Value;

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Points of a cloud that takes some seconds, packed by one thread: it must be seen
/// to run, and how far it is.
const BIG: u32 = 1_000_000;
const SLOW: [&str; 4] = ["--threads", "1", "--encoding", "brotli"];

/// One event as it came.
#[derive(Debug, Clone)]
struct Event {
    kind: String,
    id: Option<i64>,
    data: Value,
}

/// A client that knows nothing but lines, and HTTP's chunks.
struct Listener {
    lines: BufReader<Box<dyn Read>>,
    status: u16,
}

/// Takes the chunks' lengths out.
struct Chunks {
    from: BufReader<TcpStream>,
    left: usize,
}

impl Read for Chunks {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        if self.left == 0 {
            let mut line = String::new();
            while line.trim().is_empty() {
                line.clear();
                if self.from.read_line(&mut line)? == 0 {
                    return Ok(0);
                }
            }
            self.left = usize::from_str_radix(line.trim(), 16).expect("a chunk's length");
            if self.left == 0 {
                return Ok(0);
            }
        }
        let most = to.len().min(self.left);
        let read = self.from.read(&mut to[..most])?;
        self.left -= read;
        Ok(read)
    }
}

impl Listener {
    fn open(daemon: &Daemon, path: &str, more: &str) -> Listener {
        let mut stream = TcpStream::connect(&daemon.address).expect("connected");
        stream.set_read_timeout(Some(Duration::from_secs(120))).expect("set");
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {}\r\n{more}\r\n", daemon.address).expect("sent");
        let mut from = BufReader::new(stream);
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            assert!(from.read_line(&mut head).expect("a head") > 0, "{head}");
        }
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).expect("a status");
        if status == 200 {
            assert!(head.contains("text/event-stream"), "{head}");
        }
        Listener { lines: BufReader::new(Box::new(Chunks { from, left: 0 })), status }
    }

    /// The next event; nothing where the stream ends.
    fn next(&mut self) -> Option<Event> {
        let mut event = Event { kind: String::new(), id: None, data: Value::Null };
        loop {
            let mut line = String::new();
            if self.lines.read_line(&mut line).expect("a line in time") == 0 {
                return None;
            }
            match line.trim_end_matches('\n').split_once(": ") {
                Some(("event", kind)) => event.kind = kind.to_string(),
                Some(("id", id)) => event.id = Some(id.parse().expect("a number")),
                Some(("data", data)) => event.data = serde_json::from_str(data).expect("JSON in one line"),
                Some(("retry" | "", _)) => {}
                None if line == "\n" && !event.kind.is_empty() => return Some(event),
                None if line == "\n" => {}
                other => panic!("no event stream: {other:?}"),
            }
        }
    }

    fn until(&mut self, what: &str, is: impl Fn(&Event) -> bool) -> Vec<Event> {
        let mut events = Vec::new();
        while let Some(event) = self.next() {
            let done = is(&event);
            events.push(event);
            if done {
                return events;
            }
        }
        panic!("it ended before {what}: {events:#?}");
    }
}

#[test]
fn who_listens_is_told_the_present_and_then_every_change_without_asking() {
    let root = root();
    let mut daemon = Daemon::start_with(&root.path().join("data"), &SLOW);
    fs::write(daemon.inbox().join("first.las"), las(1_000, 1)).expect("dropped");
    daemon.wait("first", "done");
    let mut all = Listener::open(&daemon, "/api/events", "");
    let first = all.until("the present", |event| event.kind == "job");
    assert_eq!((&first[0].data["name"], &first[0].data["state"]), (&"first".into(), &"done".into()));

    // A name with a line break must not break out of its event.
    let odd = "big\nevent: fake\ndata: {}";
    fs::write(daemon.inbox().join(format!("{odd}.las")), las(BIG, 2)).expect("dropped");
    let events = all.until("its end", |event| {
        event.kind == "job" && event.data["id"] == 2 && event.data["state"] == "done"
    });
    let states: Vec<_> = events
        .iter()
        .filter(|e| e.kind == "job" && e.data["id"] == 2)
        .map(|e| e.data["state"].clone())
        .collect();
    assert!(states.contains(&"running".into()), "{states:?}");
    let progress: Vec<_> = events.iter().filter(|event| event.kind == "progress").collect();
    assert!(!progress.is_empty() && progress.iter().all(|event| event.data["id"] == 2), "{events:#?}");
    assert!(
        progress.iter().all(|event| event.data["stage"].is_string() && event.data["percent"].is_number())
    );
    assert!(events.iter().all(|event| ["job", "progress"].contains(&event.kind.as_str())), "{events:#?}");

    // One job's own stream, and one that does not exist.
    let mut one = Listener::open(&daemon, "/api/jobs/1/events", "");
    assert_eq!(one.next().expect("the present").data["name"], "first");
    assert_eq!(Listener::open(&daemon, "/api/jobs/77/events", "").status, 404);

    // Whoever comes back is told what it missed, and no more.
    let seen = events.iter().rev().find_map(|event| event.id).expect("a number");
    assert_eq!(daemon.post("/api/jobs/1/priority", r#"{"priority": 7}"#).0, 200);
    let mut again = Listener::open(&daemon, "/api/events", &format!("Last-Event-ID: {seen}\r\n"));
    let missed = again.next().expect("an event");
    assert_eq!((&missed.data["id"], &missed.data["priority"]), (&1.into(), &7.into()));
    assert!(missed.id > Some(seen));

    // The streams end with the daemon, and do not hold it up.
    assert!(daemon.stop());
    while again.next().is_some() {}
    assert!(all.next().is_none_or(|event| event.kind == "job"));
}

#[test]
fn event_streams_are_few_and_guarded_and_a_place_comes_free() {
    let root = root();
    let data = root.path().join("data");
    let daemon = Daemon::start_with_env(&data, &[], &[("LODESTONE_TOKEN", "a great secret")]);
    let bearer = "Authorization: Bearer a great secret\r\n";
    assert_eq!(Listener::open(&daemon, "/api/events", "").status, 401);
    assert_eq!(Listener::open(&daemon, "/api/events", "Authorization: Bearer x\r\n").status, 401);
    let open = || Listener::open(&daemon, "/api/events", bearer);
    let mut listeners: Vec<_> =
        std::iter::repeat_with(open).take_while(|l| l.status == 200).take(200).collect();
    assert!((8..200).contains(&listeners.len()), "{}", listeners.len());
    assert_eq!(Listener::open(&daemon, "/api/events", bearer).status, 503);
    listeners.truncate(1);
    wait_for("a free place", || (open().status == 200).then_some(()));
}

#[test]
fn the_page_listens_to_the_events_and_needs_nothing_from_elsewhere() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("<img src=x onerror=alert(1)>.las"), las(500, 1)).expect("dropped");
    wait_for("the job", || (daemon.jobs().first()?["state"] == "done").then_some(()));
    let (_, head, body) = daemon.ask("GET /", "");
    let body = String::from_utf8_lossy(&body);
    assert!(
        head.to_lowercase().contains("default-src 'none'") && !head.contains("script-src 'unsafe"),
        "{head}"
    );
    assert!(body.contains("&lt;img src=x") && !body.contains("<img src=x"), "{body}");
    assert!(!body.contains("<script>"), "no script within: {body}");
    let (_, rest) = body.split_once("src=\"").expect("a script");
    let url = rest.split('"').next().expect("its address").replace("page.js", "live.js");
    let (status, script) = daemon.get(&url);
    assert_eq!(status, 200);
    assert!(script.contains("new EventSource(") && !script.contains("innerHTML"), "{script}");
}

#[test]
fn old_records_are_purged_by_command_and_by_request_and_octrees_stay_known() {
    let root = root();
    let data = root.path().join("data");
    let daemon = Daemon::start_with(&data, &["--patience-seconds", "0.5"]);
    fs::write(daemon.inbox().join("bad.las"), "no points").expect("dropped");
    fs::write(daemon.inbox().join("worse.las"), "none either").expect("dropped");
    let (bad, worse) = (daemon.wait("bad", "failed"), daemon.wait("worse", "failed"));
    fs::write(daemon.inbox().join("good.las"), las(1_000, 1)).expect("dropped");
    let good = daemon.wait("good", "done")["id"].clone();
    let purge = |age: &str| {
        let run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
            .args(["jobs", "purge", "--older-than", age, "--root"])
            .arg(&data)
            .output()
            .expect("run");
        (run.status.code(), String::from_utf8_lossy(&run.stdout).into_owned())
    };
    assert_eq!(purge("30d"), (Some(0), "0 records removed\n".to_string()));
    assert_eq!(purge("soon").0, Some(2));
    assert_eq!(daemon.post("/api/jobs/purge", "").1, r#"{"purged":0}"#);
    assert_eq!(daemon.post("/api/jobs/purge", r#"{"older_than": "soon"}"#).0, 422);
    assert_eq!(daemon.post("/api/jobs/purge", r#"{"older_then": "1d"}"#).0, 422);

    // Not before the ends are cleared that no hook is to be told of.
    wait_for("both to go", || {
        assert_eq!(daemon.post("/api/jobs/purge", r#"{"older_than": "0d"}"#).0, 200);
        (daemon.jobs().len() == 1).then_some(())
    });
    assert_eq!(purge("0d").1, "0 records removed\n");
    for job in [bad, worse] {
        assert_eq!(daemon.get(&format!("/api/jobs/{}", job["id"])).0, 404);
    }
    // The files lie there as before; they are no news, and neither is good content.
    fs::write(daemon.inbox().join("copy.las"), las(1_000, 1)).expect("dropped");
    wait_for("the copy to be known", || {
        let history = daemon.json(&format!("/api/jobs/{good}"))["history"].to_string();
        history.contains("copy.las").then_some(())
    });
    assert_eq!(daemon.jobs().len(), 1, "nothing was queued again");
    assert_eq!(daemon.jobs()[0]["name"], "good");
}
