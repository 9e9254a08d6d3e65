//! What follows from a job's end, on the real daemon: sources that are put away,
//! hooks that are told.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::daemon_support::{Daemon, fill_folder, las, wait_for};

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// What a job's history says of one kind.
fn history(daemon: &Daemon, id: &serde_json::Value, kind: &str) -> Vec<String> {
    let details = daemon.json(&format!("/api/jobs/{id}"));
    let lines = details["history"].as_array().expect("an array").clone();
    lines
        .iter()
        .filter(|line| line["kind"] == kind)
        .map(|line| line["detail"].as_str().unwrap_or("").to_string())
        .collect()
}

fn wait_history(daemon: &Daemon, id: &serde_json::Value, kind: &str) -> String {
    wait_for(kind, || history(daemon, id, kind).first().cloned())
}

/// A program that the tests can hand over as a hook.
fn program(folder: &Path, name: &str, script: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("written");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("set");
    path
}

#[test]
fn sources_stay_unless_the_configuration_says_otherwise() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), las(1_000, 1)).expect("dropped");
    daemon.wait("a", "done");
    fs::write(daemon.inbox().join("b.las"), las(1_000, 2)).expect("dropped");
    daemon.wait("b", "done");
    assert!(daemon.inbox().join("a.las").exists() && !daemon.root.join("done").exists());
}

#[test]
fn published_sources_are_moved_and_nothing_is_requeued_or_unpublished_for_it() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, &["--on-done", "move", "--patience-seconds", "1"]);
    fs::write(daemon.inbox().join("a b.las"), las(1_000, 1)).expect("dropped");
    daemon.drop_folder("tiles", &[("1.las", las(1_000, 2)), ("2.las", las(1_000, 3))]);
    let marker = br#"{"on_done": "keep"}"#.to_vec();
    daemon.drop_folder("kept", &[("1.las", las(1_000, 4)), ("lodestone.json", marker)]);
    fs::write(daemon.inbox().join("bad.las"), "no points").expect("dropped");
    for name in ["a b", "tiles", "kept"] {
        daemon.wait(name, "done");
    }
    daemon.wait("bad", "failed");
    let done = data.join("done");
    wait_for("the sources to be moved", || {
        (done.join("a b/a b.las").exists() && done.join("tiles/tiles/2.las").exists()).then_some(())
    });
    assert!(!daemon.inbox().join("a b.las").exists() && !daemon.inbox().join("tiles").exists());
    assert!(daemon.inbox().join("kept/1.las").exists(), "its marker says so");
    assert!(daemon.inbox().join("bad.las").exists(), "never on failure");

    // The same once more, as uploads come: known, and put away; one copy is enough.
    let id = daemon.wait("a b", "done")["id"].clone();
    fs::write(daemon.inbox().join("a b.las"), las(1_000, 1)).expect("dropped");
    wait_for("the second to be moved", || (history(&daemon, &id, "sources moved").len() == 2).then_some(()));
    assert!(!daemon.inbox().join("a b.las").exists());
    assert_eq!(fs::read_dir(done.join("a b")).expect("there").count(), 1);
    // Other content of the same name becomes an octree of its own: the first may be
    // all that is left of its source.
    fs::write(daemon.inbox().join("a b.las"), las(1_500, 7)).expect("dropped");
    wait_for("the other to be moved", || done.join("a b-2/a b.las").exists().then_some(()));
    assert!(daemon.octree("a b-2").join("metadata.json").exists());

    // Scans later, and after a start, nothing came of the gap in the inbox.
    assert!(daemon.stop());
    let daemon = Daemon::start(&data);
    wait_for("a scan", || (daemon.json("/api/watch")["last_scan"].as_i64() > Some(0)).then_some(()));
    assert_eq!(daemon.jobs().len(), 5);
    assert_eq!(daemon.jobs().iter().filter(|job| job["state"] == "done").count(), 4);
    assert!(daemon.octree("a b").join("metadata.json").exists());
}

#[test]
fn published_sources_are_deleted_only_as_they_were_converted() {
    let root = root();
    let outside = root.path().join("outside");
    fs::create_dir(&outside).expect("made");
    fs::write(outside.join("mine.las"), las(1_000, 9)).expect("written");
    let daemon =
        Daemon::start_with(&root.path().join("data"), &["--on-done", "delete", "--patience-seconds", "1"]);
    fs::write(daemon.inbox().join("a.las"), las(1_000, 1)).expect("dropped");
    // A tile that is a link is not converted, and nothing is deleted where one lies.
    let linked = root.path().join("linked");
    fill_folder(&linked, &[("1.las", las(1_000, 2))]);
    std::os::unix::fs::symlink("1.las", linked.join("2.las")).expect("linked");
    fs::rename(&linked, daemon.inbox().join("linked")).expect("dropped");
    let job = daemon.wait("a", "done");
    wait_history(&daemon, &job["id"], "sources deleted");
    assert!(!daemon.inbox().join("a.las").exists());
    let linked = daemon.wait("linked", "done");
    let why = wait_history(&daemon, &linked["id"], "sources kept");
    assert!(why.contains("2.las") && why.contains("link"), "{why}");
    assert!(daemon.inbox().join("linked/1.las").exists() && outside.join("mine.las").exists());
    daemon.wait_metrics(&[
        "lodestone_sources_put_away_total{outcome=\"deleted\"} 1",
        "lodestone_sources_put_away_total{outcome=\"kept\"} 1",
    ]);
}

#[test]
fn hooks_are_told_of_ends_and_of_no_secret_and_never_decide_a_job() {
    let root = root();
    let told = root.path().join("told");
    fs::create_dir(&told).expect("made");
    let script = format!(
        "env > \"{0}/$LODESTONE_NAME.tmp\" && mv \"{0}/$LODESTONE_NAME.tmp\" \"{0}/$LODESTONE_NAME\"\necho last words of $LODESTONE_NAME >&2; exit 7",
        told.display()
    );
    let hook = program(root.path(), "tell me", &script);
    let hook = hook.to_str().expect("a path");
    let data = root.path().join("data");
    let more = ["--hook-done", hook, "--hook-failed", hook, "--patience-seconds", "1", "--on-done", "move"];
    let daemon = Daemon::start_with_env(&data, &more, &[("LODESTONE_TOKEN", "a great secret")]);
    let odd = "x'; touch pwned; $(id)";
    fs::write(daemon.inbox().join(format!("{odd}.las")), las(1_000, 1)).expect("dropped");
    fs::write(daemon.inbox().join("bad.las"), "no points").expect("dropped");
    let read = |name: &str| {
        wait_for(name, || fs::read_to_string(told.join(name)).ok())
            .lines()
            .map(str::to_string)
            .collect::<Vec<_>>()
    };
    let environment = read(odd);
    let octree = data.canonicalize().expect("there").join("octrees").join(odd);
    let moved = data.canonicalize().expect("there").join("done").join(odd).join(format!("{odd}.las"));
    for line in [
        format!("LODESTONE_NAME={odd}"),
        "LODESTONE_STATE=done".to_string(),
        format!("LODESTONE_OCTREE={}", octree.display()),
        format!("LODESTONE_SOURCE={}", moved.display()),
        "LODESTONE_ERROR=".to_string(),
        "LODESTONE_POINTS=1000".to_string(),
    ] {
        assert!(environment.contains(&line), "{line} is missing in {environment:#?}");
    }
    assert!(
        !environment.iter().any(|line| line.contains("secret") || line.contains("TOKEN")),
        "{environment:#?}"
    );
    let environment = read("bad");
    assert!(environment.contains(&"LODESTONE_STATE=failed".to_string()), "{environment:#?}");
    assert!(environment.iter().any(|line| line.starts_with("LODESTONE_ERROR=") && line.contains("bad.las")));

    // What it said is in the log; that it failed changes nothing.
    wait_for("its last words", || daemon.log().contains("last words of bad").then_some(()));
    let listed = daemon.ask("GET /api/jobs\nAuthorization: Bearer a great secret", "").2;
    let listed: serde_json::Value = serde_json::from_slice(&listed).expect("JSON");
    let mut states: Vec<_> =
        listed["jobs"].as_array().expect("jobs").iter().map(|j| j["state"].to_string()).collect();
    states.sort();
    assert_eq!(states, ["\"done\"", "\"failed\""]);
    assert!(!data.join("pwned").exists() && !root.path().join("pwned").exists());
}

#[test]
fn a_hook_that_hangs_is_killed_and_holds_up_neither_jobs_nor_the_stop() {
    let root = root();
    let data = root.path().join("data");
    let hook = program(root.path(), "hang", "sleep 3600");
    let list = serde_json::json!([hook, "--now"]).to_string();
    let mut daemon = Daemon::start_with(&data, &["--hook-done", &list, "--hook-seconds", "0.5"]);
    for (i, name) in ["a", "b", "c", "d", "e", "f"].iter().enumerate() {
        fs::write(daemon.inbox().join(format!("{name}.las")), las(500, i as u64)).expect("dropped");
    }
    let job = daemon.wait("f", "done");
    let said = wait_history(&daemon, &job["id"], "hook");
    assert!(said.contains("killed after 0.5 s"), "{said}");
    assert!(daemon.stop());

    // At a stop it is given what is left of the bound, and told anew at the next start.
    let pid = root.path().join("pid");
    let hook = program(root.path(), "wait", &format!("echo $$ > '{}'; exec sleep 3600", pid.display()));
    let more = ["--hook-done", hook.to_str().expect("a path"), "--shutdown-seconds", "1"];
    let mut daemon = Daemon::start_with(&data, &more);
    fs::write(daemon.inbox().join("g.las"), las(500, 9)).expect("dropped");
    let job = daemon.wait("g", "done");
    let pid = wait_for("the hook", || fs::read_to_string(&pid).ok()?.trim().parse::<u32>().ok());
    assert!(daemon.stop());
    wait_for("its end", || {
        // Dead, it may be listed until somebody looks after it.
        fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default().is_empty().then_some(())
    });
    let told = program(root.path(), "told", "echo heard >&2");
    let daemon = Daemon::start_with(&data, &["--hook-done", told.to_str().expect("a path")]);
    assert!(wait_history(&daemon, &job["id"], "hook").contains("heard"));
}

/// Killed at any moment around publishing, the end is the same.
#[test]
fn a_crash_between_publishing_and_moving_is_made_good_at_the_next_start() {
    let root = root();
    let data = root.path().join("data");
    let hook = program(
        root.path(),
        "told",
        &format!("echo \"$LODESTONE_NAME\" >> '{}/told'", root.path().display()),
    );
    let more = ["--on-done", "move", "--hook-done", hook.to_str().expect("a path")];
    let mut daemon = Daemon::start_with(&data, &more);
    for round in 0..8u64 {
        let name = format!("n{round}");
        fs::write(daemon.inbox().join(format!("{name}.las")), las(1_000, round)).expect("dropped");
        wait_for("the octree", || daemon.octree(&name).exists().then_some(()));
        std::thread::sleep(Duration::from_millis(3 * round));
        daemon.kill();
        daemon = Daemon::start_with(&data, &more);
    }
    for round in 0..8u64 {
        let name = format!("n{round}");
        let job = daemon.wait(&name, "done");
        assert_eq!(job["attempts"], 1, "converted once");
        wait_for("its source to be moved", || {
            data.join(format!("done/{name}/{name}.las")).exists().then_some(())
        });
        assert!(!daemon.inbox().join(format!("{name}.las")).exists());
        assert_eq!(fs::read_dir(data.join("done").join(&name)).expect("there").count(), 1, "once");
        wait_for("its hook", || {
            fs::read_to_string(root.path().join("told")).ok()?.lines().any(|line| line == name).then_some(())
        });
    }
}
