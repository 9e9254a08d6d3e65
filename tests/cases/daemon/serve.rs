//! The real daemon on real files: dropped, converted, killed, started again.

use std::fs;
use std::path::Path;
use std::time::Duration;

use crate::daemon_support::{Daemon, content, converted, las, wait_for};

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Points of a cloud that is converted for some seconds by one thread, so that a
/// test can get a word in.
const BIG: u32 = 4_000_000;

#[test]
fn a_dropped_file_becomes_the_octree_that_convert_makes() {
    let root = root();
    let mut daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("größe 1.las"), las(30_000, 1)).expect("dropped");
    let job = daemon.wait("größe 1", "done");
    assert_eq!(job["stage"], "done");
    assert_eq!(job["result"]["points_out"], 30_000);
    assert_eq!(job["attempts"], 1);
    let source = daemon.inbox().join("größe 1.las");
    let expected = converted(&[&source], &root.path().join("größe 1"));
    assert_eq!(content(&daemon.octree("größe 1")), expected);
    assert!(source.exists(), "the source stays");

    // Served to viewers, by its name in a URL, and in parts.
    let url = job["octree"].as_str().expect("an address");
    assert_eq!(daemon.get(url).0, 200);
    let octree = url.replace("metadata.json", "octree.bin");
    let (status, head, body) =
        daemon.ask(&format!("GET {octree}\nRange: bytes=10-29\nOrigin: http://x.example"), "");
    assert_eq!(
        (status, body.as_slice()),
        (206, &expected["octree.bin".as_ref() as &std::path::Path][10..30])
    );
    assert!(head.to_lowercase().contains("access-control-allow-origin: *"), "{head}");

    let details = daemon.json(&format!("/api/jobs/{}", job["id"]));
    assert_eq!(details["inputs"][0]["size"], 30_000 * 20 + 227);
    // The job's result is the report's, but for the inputs, which it has itself.
    let report = fs::read(daemon.octree("größe 1").join("report.json")).expect("a report");
    let mut report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
    let inputs = report.as_object_mut().and_then(|report| report.remove("inputs")).expect("inputs");
    assert_eq!(inputs[0]["blake3"], details["inputs"][0]["hash"]);
    assert_eq!(inputs[0]["blake3"].as_str().map(str::len), Some(64));
    assert!(report["lattice"]["scale"].is_array() && report["cube"].is_number(), "{report}");
    assert_eq!(details["result"], report);
    assert_eq!(details["attempts_log"][0]["outcome"], "succeed");
    let metrics = daemon.wait_metrics(&[
        "lodestone_jobs{state=\"done\"} 1",
        "lodestone_jobs_finished_total{result=\"done\"} 1",
        "lodestone_points_written_total 30000",
        "lodestone_attempts_total 1",
    ]);
    assert!(!metrics.contains("größe"), "no file name ever becomes a label");
    assert!(daemon.get("/").1.contains("größe 1"));
    assert!(daemon.stop(), "an orderly stop is a success");
    assert!(fs::read_dir(root.path().join("data/scratch")).expect("there").next().is_none());
}

#[test]
fn bad_files_fail_with_their_name_and_the_daemon_goes_on() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--patience-seconds", "1"]);
    fs::write(daemon.inbox().join("notes.las"), "these are not points").expect("dropped");
    fs::write(daemon.inbox().join("empty.las"), las(0, 1)).expect("dropped");
    fs::write(daemon.inbox().join("cut.las"), &las(1000, 1)[..10_000]).expect("dropped");
    fs::write(daemon.inbox().join("nothing.laz"), "").expect("dropped");
    for name in ["notes", "empty", "cut", "nothing"] {
        let job = daemon.wait(name, "failed");
        let error = job["error"].as_str().expect("an error");
        assert!(error.contains(&format!("/{name}.la")), "{error}");
        assert!(!daemon.octree(name).exists());
    }
    fs::write(daemon.inbox().join("good.las"), las(1000, 1)).expect("dropped");
    daemon.wait("good", "done");

    // Mended, the same name gets another chance without anybody asking.
    fs::write(daemon.inbox().join("cut.las"), las(1000, 2)).expect("mended");
    let job = daemon.wait("cut", "done");
    assert_eq!(job["revision"], 2);
    assert_eq!(daemon.get("/healthz").0, 200);
    assert_eq!(daemon.get("/readyz").0, 200);
}

#[test]
fn the_same_content_is_not_converted_twice_and_new_content_replaces_the_old() {
    let root = root();
    let mut daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), las(5_000, 1)).expect("dropped");
    let first = daemon.wait("a", "done");
    fs::write(daemon.inbox().join("copy of a.las"), las(5_000, 1)).expect("dropped");
    wait_for("the copy to be recognised", || {
        let history = daemon.json(&format!("/api/jobs/{}", first["id"]))["history"].to_string();
        history.contains("copy of a.las").then_some(())
    });
    fs::write(daemon.inbox().join("a.las"), las(6_000, 2)).expect("dropped");
    wait_for("revision 2", || daemon.jobs().into_iter().find(|j| j["revision"] == 2 && j["state"] == "done"));
    let published = content(&daemon.octree("a"));
    assert_eq!(published, converted(&[&daemon.inbox().join("a.las")], &root.path().join("a")));
    assert_eq!(daemon.jobs()[0]["superseded_by"], 2);
    // The octree that the copy shared is gone; now it has its own.
    daemon.wait("copy of a", "done");

    assert!(daemon.stop());
    let daemon = Daemon::start(&root.path().join("data"));
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(daemon.jobs().len(), 3, "nothing changed, so nothing is done");
    // The old content again: it stands as the copy's octree, but `a` must not go
    // on showing what its source no longer holds.
    fs::write(daemon.inbox().join("a.las"), las(5_000, 1)).expect("dropped");
    wait_for("revision 3", || daemon.jobs().into_iter().find(|j| j["revision"] == 3 && j["state"] == "done"));
    let points = |name: &str| content(&daemon.octree(name))[Path::new("octree.bin")].clone();
    assert!(points("a") == points("copy of a"));
    assert_ne!(content(&daemon.octree("a")), published);
}

#[test]
fn a_folder_is_one_data_set_and_a_marker_names_it() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    let tiles = [("deep/er/b.las", las(2_000, 2)), ("a.las", las(1_000, 1)), ("c.laz.part", vec![7; 99])];
    let folder = daemon.drop_folder("tiles", &tiles);
    std::thread::sleep(Duration::from_millis(2500));
    assert!(daemon.jobs().is_empty(), "a tile is still on its way");
    // The marker first, and at once: else the folder is taken without it on a
    // machine that is busy meanwhile.
    let marker = root.path().join("marker");
    fs::write(&marker, r#"{"name": "city", "options": {"sampling": "random"}}"#).expect("written");
    fs::rename(&marker, folder.join("lodestone.json")).expect("marked");
    fs::remove_file(folder.join("c.laz.part")).expect("removed");
    let job = daemon.wait("city", "done");
    assert_eq!(job["result"]["points_out"], 3_000);
    assert_eq!(job["options"], serde_json::Value::Null, "lists have no options");
    let whole = daemon.json(&format!("/api/jobs/{}", job["id"]));
    assert_eq!(whole["options"]["sampling"], "random");
    assert_eq!(daemon.jobs().len(), 1);
    let metadata = fs::read_to_string(daemon.octree("city").join("metadata.json")).expect("there");
    assert!(metadata.contains("city"), "{metadata}");
}

#[test]
fn files_that_came_while_it_was_down_are_found_and_links_out_are_refused() {
    let root = root();
    let inbox = root.path().join("data/inbox");
    fs::create_dir_all(&inbox).expect("made");
    fs::write(inbox.join("early.las"), las(1_000, 1)).expect("dropped");
    let outside = root.path().join("secret.las");
    fs::write(&outside, las(1_000, 9)).expect("written");
    std::os::unix::fs::symlink(&outside, inbox.join("link.las")).expect("linked");
    let daemon = Daemon::start(&root.path().join("data"));
    daemon.wait("early", "done");
    assert_eq!(daemon.jobs().len(), 1);
    wait_for("the word on the link", || {
        let waiting = daemon.json("/api/watch")["waiting"].to_string();
        (waiting.contains("link.las") && waiting.contains("links are not followed")).then_some(())
    });
    assert_eq!(daemon.jobs().len(), 1);
}

#[test]
fn killed_at_any_moment_it_ends_with_one_published_octree() {
    let root = root();
    let data = root.path().join("data");
    // Converted before the daemon sees it: the daemon would be done meanwhile.
    let source = root.path().join("big.las");
    fs::write(&source, las(BIG, 3)).expect("written");
    let expected = converted(&[&source], &root.path().join("big"));
    let mut daemon = Daemon::start_with(&data, &["--threads", "1"]);
    fs::copy(&source, daemon.inbox().join("big.las")).expect("dropped");
    // Twice: three crashes would be quarantine.
    for pause in [5, 150] {
        daemon.wait("big", "running");
        std::thread::sleep(Duration::from_millis(pause));
        daemon.kill();
        daemon = Daemon::start_with(&data, &["--threads", "1"]);
    }
    let job = daemon.wait("big", "done");
    assert_eq!(content(&daemon.octree("big")), expected);
    assert_eq!(daemon.jobs().len(), 1);
    let attempts = job["attempts"].as_u64().expect("a number");
    assert!((1..=3).contains(&attempts), "{attempts}");
    daemon.wait_cleared();
    daemon.kill();
    // What is published is never converted again.
    let daemon = Daemon::start_with(&data, &["--threads", "1"]);
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(daemon.jobs()[0]["attempts"], attempts);
    assert_eq!(daemon.jobs().len(), 1);
}

#[test]
fn a_stop_in_the_middle_parks_the_job_and_counts_nothing() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, &["--threads", "1"]);
    fs::write(daemon.inbox().join("big.las"), las(BIG, 4)).expect("dropped");
    daemon.wait("big", "running");
    assert!(daemon.stop());
    let daemon = Daemon::start_with(&data, &["--threads", "1"]);
    let job = daemon.wait("big", "done");
    assert_eq!((job["attempts"].as_u64(), job["strikes"].as_u64()), (Some(1), Some(0)));
}

#[test]
fn orders_are_obeyed_and_nonsense_is_refused() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--threads", "1"]);
    fs::write(daemon.inbox().join("big.las"), las(BIG, 5)).expect("dropped");
    let id = daemon.wait("big", "running")["id"].clone();
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/pause"), "").0, 202);
    daemon.wait("big", "paused");
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/pause"), "").0, 409);
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/priority"), r#"{"priority": 7}"#).0, 200);
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/resume"), "").0, 200);
    daemon.wait("big", "running");
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/cancel"), "").0, 202);
    let job = daemon.wait("big", "cancelled");
    assert_eq!(job["priority"], 7);
    assert!(!daemon.octree("big").exists());
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/retry"), "").0, 200);
    daemon.wait("big", "done");

    for (path, status) in [
        ("/api/jobs/999", 404),
        ("/api/jobs/x", 400),
        ("/api/jobs?state=sleeping", 400),
        ("/octrees/../lodestone.db", 404),
        ("/octrees/%2e%2e/lodestone.db", 404),
        ("/octrees/..%2flodestone.db", 404),
        ("/octrees/.staged/", 404),
        ("/etc/passwd", 404),
    ] {
        assert_eq!(daemon.get(path).0, status, "{path}");
    }
    let foreign = format!("POST /api/jobs/{id}/cancel\nOrigin: https://evil.example");
    assert_eq!(daemon.ask(&foreign, "").0, 403);
    assert_eq!(daemon.ask("GET /api/jobs\nHost: evil.example", "").0, 403);
    let long = format!("{{\"priority\": {}1}}", " ".repeat(100_000));
    assert_eq!(daemon.post(&format!("/api/jobs/{id}/priority"), &long).0, 413);
}

#[test]
fn a_second_daemon_on_the_same_root_is_kept_out() {
    let root = root();
    let data = root.path().join("data");
    let _first = Daemon::start_with(&data, &["--threads", "1"]);
    let second = std::process::Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["serve", "--listen", "127.0.0.1:0", "--root"])
        .arg(&data)
        .output()
        .expect("started");
    assert_eq!(second.status.code(), Some(1));
    let error = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(error.contains("another Lodestone") && error.contains("--root"), "{error}");
}

#[test]
fn a_vanished_folder_deletes_nothing_and_its_return_is_noticed() {
    let root = root();
    let (mount, away) = (root.path().join("mount"), root.path().join("away"));
    fs::create_dir(&mount).expect("made");
    fs::write(mount.join("a.las"), las(1_000, 1)).expect("dropped");
    let watch = mount.to_str().expect("a path").to_string();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--watch", &watch]);
    daemon.wait("a", "done");
    fs::rename(&mount, &away).expect("gone");
    wait_for("the gap to show", || (daemon.get("/readyz").0 == 503).then_some(()));
    assert_eq!(daemon.get("/healthz").0, 200, "a restart would not help");
    fs::write(away.join("b.las"), las(1_000, 2)).expect("dropped");
    fs::rename(&away, &mount).expect("back");
    daemon.wait("b", "done");
    assert_eq!(daemon.jobs().len(), 2, "what was known is not done again");
    wait_for("readiness", || (daemon.get("/readyz").0 == 200).then_some(()));
}

fn lodestone(arguments: &[&str]) -> (Option<i32>, String, String) {
    let run =
        std::process::Command::new(env!("CARGO_BIN_EXE_lodestone")).args(arguments).output().expect("run");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (run.status.code(), text(&run.stdout), text(&run.stderr))
}

#[test]
fn the_command_line_reads_and_orders_beside_a_running_daemon() {
    let root = root();
    let data = root.path().join("data");
    let daemon = Daemon::start_with(&data, &["--threads", "1"]);
    let at = data.to_str().expect("a path");
    fs::write(daemon.inbox().join("big.las"), las(BIG, 6)).expect("dropped");
    let id = daemon.wait("big", "running")["id"].to_string();
    let (code, table, _) = lodestone(&["jobs", "--root", at, "list"]);
    assert_eq!(code, Some(0));
    assert!(table.contains("big") && table.contains("running") && table.contains("4 000 000"), "{table}");
    assert_eq!(lodestone(&["jobs", "--root", at, "cancel", &id]).0, Some(0));
    daemon.wait("big", "cancelled");
    let (code, _, error) = lodestone(&["jobs", "--root", at, "pause", &id]);
    assert_eq!(code, Some(1));
    assert!(error.contains("is cancelled"), "{error}");
    let (_, json, _) = lodestone(&["jobs", "--root", at, "--json", "show", &id]);
    let job: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(job["state"], "cancelled");
    assert_eq!(lodestone(&["jobs", "--root", at, "show", "77"]).0, Some(1));
    let nowhere = root.path().join("nowhere");
    let (code, _, error) = lodestone(&["jobs", "--root", nowhere.to_str().expect("a path"), "list"]);
    assert_eq!(code, Some(1));
    assert!(error.contains("nowhere"), "{error}");
}

#[test]
fn a_token_is_asked_for_and_the_probes_stay_open() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "a great secret"]);
    assert_eq!(daemon.get("/api/jobs").0, 401);
    assert_eq!(daemon.get("/octrees/x/metadata.json").0, 401);
    assert_eq!(daemon.ask("GET /api/jobs\nAuthorization: Bearer a great secre", "").0, 401);
    assert_eq!(daemon.ask("GET /api/jobs\nAuthorization: Bearer a great secret", "").0, 200);
    assert_eq!(daemon.get("/healthz").0, 200);
}

#[test]
fn the_configuration_is_checked_at_start_and_told_on_request() {
    let root = root();
    let file = root.path().join("lodestone.toml");
    fs::write(&file, "settle_seconds = 2.5\nheavy_jobs = 3\n").expect("written");
    let at = file.to_str().expect("a path");
    let (code, text, _) = lodestone(&["config", "--config", at, "--heavy-jobs", "2"]);
    assert_eq!(code, Some(0));
    assert!(text.contains("settle_seconds = 2.5") && text.contains("heavy_jobs = 2"), "{text}");
    fs::write(&file, "setle_seconds = 2.5\n").expect("written");
    let (code, _, error) = lodestone(&["serve", "--config", at]);
    assert_eq!(code, Some(2));
    assert!(error.contains("setle_seconds"), "{error}");
    let (code, _, error) = lodestone(&["serve", "--listen", "0.0.0.0:0"]);
    assert_eq!(code, Some(2));
    assert!(error.contains("open_to_network"), "{error}");
}
