//! The pages of the daemon, driven in a browser.
//!
//! playwright-core and axe-core come from the npm registry, as the viewer's packages
//! do; what runs is the machine's Chromium. Left out where Chromium or npm is
//! missing, unless LODESTONE_REQUIRE_CHROMIUM is 1.

mod cost;
mod links;
mod looks;
mod odd;
mod orders;
mod rows;
mod uploads;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use crate::daemon_support::held::{self, Held};
use crate::daemon_support::{Daemon, ask, las, wait_for};

const PROGRAMS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
const SCRIPTS: [&str; 10] = [
    "package.json",
    "browser.mjs",
    "steer.mjs",
    "many.mjs",
    "login.mjs",
    "looks.mjs",
    "drop.mjs",
    "prefix.mjs",
    "notify.mjs",
    "viewer.mjs",
];

/// A folder with the scripts and their packages, and the browser, where there are
/// both.
static BROWSER: LazyLock<Option<(PathBuf, PathBuf)>> = LazyLock::new(|| {
    let required = std::env::var_os("LODESTONE_REQUIRE_CHROMIUM").is_some_and(|value| value == "1");
    let found = program().zip(crate::common::scripts("page", "page", &SCRIPTS).ok());
    assert!(found.is_some() || !required, "LODESTONE_REQUIRE_CHROMIUM=1, but Chromium or npm is missing");
    if found.is_none() {
        eprintln!("no Chromium or no npm: the tests of the page in a browser are left out");
    }
    found
});

fn program() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    PROGRAMS
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)))
        .find(|path| path.is_file())
}

/// Runs a script in the browser; false where there is none.
pub(crate) fn drive(script: &str, arguments: &[&str]) -> bool {
    let Some((program, folder)) = &*BROWSER else { return false };
    let run = Command::new("node")
        .arg(script)
        .arg(program)
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("node");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(run.status.success(), "{script}\n{}\n{}", text(&run.stdout), text(&run.stderr));
    true
}

/// The daemon of the tests that hold conversions; by itself it tests nothing.
#[test]
fn the_daemon_that_holds() {
    held::serve();
}

fn held(root: &Path, more: &[&str]) -> Held {
    Held::start_with("page::the_daemon_that_holds", root, more)
}

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

#[test]
fn a_person_drops_watches_cancels_and_retries() {
    let root = root();
    let large = root.path().join("large.las");
    fs::write(&large, las(30_000, 1)).expect("written");
    // Real ones where there are some.
    let real = std::env::var_os("LODESTONE_DATA").map(|data| PathBuf::from(data).join("single"));
    let mut clouds: Vec<PathBuf> = ["ahn_2397_9705.laz", "autzen_trim.laz"]
        .iter()
        .filter_map(|name| real.as_ref().map(|folder| folder.join(name)).filter(|path| path.is_file()))
        .collect();
    if clouds.len() < 2 {
        clouds = (2..4).map(|seed| root.path().join(format!("cloud {seed}.las"))).collect();
        clouds.iter().zip(2..).for_each(|(path, seed)| fs::write(path, las(20_000, seed)).expect("written"));
    }
    let daemon = held(&root.path().join("data"), &["--preview", "true", "--preview-frames", "4"]);
    let hold = daemon.hold("large", 1);
    let address = format!("http://{}", daemon.address);
    let mut arguments = vec![address.as_str(), hold.to_str().expect("UTF-8"), large.to_str().expect("UTF-8")];
    arguments.extend(clouds.iter().map(|path| path.to_str().expect("UTF-8")));
    drive("steer.mjs", &arguments);
}

#[test]
fn among_thousands_of_jobs_one_is_found() {
    let root = root();
    let data = root.path().join("data");
    rows::fill(&data, 5_000);
    // It must not work on what is no real job.
    let daemon = Daemon::start_with(&data, &["--settle-seconds", "3600"]);
    drive("many.mjs", &[&format!("http://{}", daemon.address)]);
}

#[test]
fn a_token_is_asked_for_by_a_form() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "a long secret"]);
    let form = daemon.get("/login?next=%22%3E%3Cscript%3E").1;
    assert!(form.contains("type=\"password\"") && !form.contains("<script>"), "{form}");
    let (address, pid) = (format!("http://{}", daemon.address), daemon.child.id().to_string());
    drive("login.mjs", &[&address, "a long secret", &pid]);
}

#[test]
fn the_browser_tells_of_ends_where_asked() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--patience-seconds", "0.5"]);
    let good = root.path().join("good.las");
    fs::write(&good, las(500, 1)).expect("written");
    let address = format!("http://{}", daemon.address);
    let paths = [daemon.inbox(), good].map(|path| path.to_str().expect("UTF-8").to_string());
    drive("notify.mjs", &[&address, &paths[0], &paths[1]]);
}

#[test]
fn pages_hold_whatever_files_are_called() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--patience-seconds", "0.5"]);
    let name = "<script>alert(1)<!--\"'&";
    // No path can hold a slash, so the tag stays open; escaped it must be all the same.
    fs::write(daemon.inbox().join(format!("{name}.las")), las(500, 1)).expect("dropped");
    fs::write(daemon.inbox().join(format!("{name} 2.las")), "no points").expect("dropped");
    wait_for("both jobs", || {
        (daemon.jobs().iter().filter(|job| job["finished_at"].is_i64()).count() == 2).then_some(())
    });
    for path in ["/", "/?state=failed", "/jobs/1", "/jobs/2", "/?q=%3Cscript%3E"] {
        let (status, head, body) = daemon.ask(&format!("GET {path}"), "");
        let body = String::from_utf8_lossy(&body);
        assert_eq!(status, 200, "{path}");
        assert!(!body.contains("<script>") && !body.contains("alert(1)<"), "{path}: {body}");
        let head = head.to_lowercase();
        assert!(head.contains("default-src 'none'") && !head.contains("unsafe"), "{path}: {head}");
        assert!(head.contains("x-content-type-options: nosniff"), "{head}");
    }
    assert!(daemon.get("/jobs/1").1.contains("&lt;script&gt;alert(1)&lt;!--&quot;"));
}

#[test]
fn forms_of_other_sites_steer_nothing() {
    let root = root();
    let data = root.path().join("data");
    rows::fill(&data, 40);
    let daemon = Daemon::start_with(&data, &["--settle-seconds", "3600"]);
    let form = "Content-Type: application/x-www-form-urlencoded";
    let before = daemon.json("/api/jobs")["jobs"].to_string();
    for foreign in ["Origin: https://evil.example", "Origin: null", "Host: evil.example:7700"] {
        for (path, body) in [
            ("/queue/order", "mode=drain"),
            ("/jobs/order", "all=failed&order=dismiss"),
            ("/jobs/4/order", "order=retry"),
            ("/upload", ""),
        ] {
            let (status, _, _) = ask(&daemon.address, &format!("POST {path}\n{form}\n{foreign}"), body);
            assert!((400..500).contains(&status), "{path} {foreign}: {status}");
        }
    }
    assert_eq!(daemon.json("/api/jobs")["jobs"].to_string(), before);
    assert!(!daemon.get("/").1.contains("Draining"));
    // A page of our own may.
    let own = format!("Origin: http://{}", daemon.address);
    let (status, head, _) = ask(&daemon.address, &format!("POST /queue/order\n{form}\n{own}"), "mode=drain");
    assert!(status == 303 && head.contains("/?said=mode-drain"), "{head}");
    assert!(daemon.get("/").1.contains("Draining"));
    // And reading changes nothing.
    assert_eq!(daemon.get("/queue/order?mode=run").0, 405);
}

#[test]
fn orders_by_form_answer_with_the_page() {
    let root = root();
    let data = root.path().join("data");
    rows::fill(&data, 40);
    let daemon = Daemon::start_with(&data, &["--settle-seconds", "3600"]);
    let post = |path: &str, body: &str| {
        let (status, head, body) =
            daemon.ask(&format!("POST {path}\nContent-Type: application/x-www-form-urlencoded"), body);
        (status, head, String::from_utf8_lossy(&body).into_owned())
    };
    daemon.post("/queue/order", "");
    assert_eq!(post("/queue/order", "mode=pause").0, 303);
    let (status, head, _) = post("/jobs/order", "job=4&job=8&job=3&job=999&order=dismiss&state=failed");
    assert!(status == 303 && head.contains("/?said=dismiss&n=2&state=failed"), "{head}");
    let (_, head, _) = post("/jobs/order", "all=failed&order=retry");
    assert!(head.contains("said=retry&n=8"), "{head}");
    let (status, head, _) = post("/jobs/12/order", "order=priority&priority=7");
    assert!(status == 303 && head.contains("/jobs/12?said=priority"), "{head}");
    assert_eq!(daemon.json("/api/jobs/12")["priority"], 7);
    // What means nothing is said on a page.
    for (path, form, status, text) in [
        ("/jobs/3/order", "order=cancel", 409, "job 3 is done"),
        ("/jobs/3/order", "order=explode", 400, "none of the page"),
        ("/jobs/12/order", "order=priority&priority=high", 400, "whole number"),
        ("/jobs/777/order", "order=retry", 404, "no job 777"),
        ("/queue/order", "mode=fly", 400, "none of the page"),
    ] {
        let (got, head, body) = post(path, form);
        assert_eq!(got, status, "{path} {form}: {body}");
        assert!(head.to_lowercase().contains("text/html") && body.contains(text), "{path} {form}: {body}");
    }
}

#[test]
fn pausing_all_returns_what_runs_and_draining_lets_it_end() {
    let root = root();
    let daemon = held(&root.path().join("data"), &[]);
    let hold = daemon.hold("a", 30);
    let set = |mode: &str| {
        let head = "POST /queue/order\nContent-Type: application/x-www-form-urlencoded";
        assert_eq!(daemon.ask(head, &format!("mode={mode}")).0, 303);
    };
    fs::write(daemon.inbox().join("a.las"), las(9_000, 1)).expect("dropped");
    daemon.wait("a", "running");
    set("pause");
    let parked = daemon.wait("a", "queued");
    assert_eq!((&parked["attempts"], &parked["strikes"]), (&0.into(), &0.into()), "it does not count");
    fs::write(daemon.inbox().join("b.las"), las(1_000, 2)).expect("dropped");
    daemon.wait("b", "queued");
    set("run");
    daemon.wait("a", "running");
    daemon.wait("b", "done");
    set("drain");
    fs::write(daemon.inbox().join("c.las"), las(1_000, 3)).expect("dropped");
    daemon.wait("c", "queued");
    fs::remove_file(hold).expect("removed");
    daemon.wait("a", "done");
    assert_eq!(daemon.jobs()[2]["state"], "queued", "nothing new is started");
    set("run");
    daemon.wait("c", "done");
    wait_for("its lines of the log", || {
        let lines = daemon.json("/api/jobs/1/log")["lines"].to_string();
        (lines.contains("everything is paused") && lines.contains("published")).then_some(())
    });
    assert!(daemon.get("/jobs/1").1.contains("everything is paused"));
    assert_eq!(daemon.json("/api/queue")["mode"], "run");
}
