//! The pains of watch folders, as users of such tools told them, each as a test of
//! the real daemon (`docs/needs.md` has the whole list).

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::daemon_support::{Daemon, las, small_disk, wait_for};

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// A recorder that never stops: its file is never taken, and holds up nobody.
#[test]
fn a_file_that_is_written_for_ever_is_never_taken() {
    let root = root();
    // Settling takes so long that a busy machine does not make the writer pause
    // for it.
    let daemon = Daemon::start_with(&root.path().join("data"), &["--settle-seconds", "3"]);
    let (stop, path) = (Arc::new(AtomicBool::new(false)), daemon.inbox().join("endless.las"));
    fs::write(&path, las(100, 1)).expect("begun");
    let stopped = stop.clone();
    let grower = std::thread::spawn(move || {
        while !stopped.load(Ordering::SeqCst) {
            // Opened and closed each time, so that no open file gives it away.
            let mut file = OpenOptions::new().append(true).open(&path).expect("opened");
            file.write_all(&[1; 20]).expect("written");
            drop(file);
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    // Others come and go meanwhile, for several settle times.
    for i in 0..3 {
        fs::write(daemon.inbox().join(format!("other {i}.las")), las(200, 2 + i)).expect("dropped");
        daemon.wait(&format!("other {i}"), "done");
    }
    let waiting = daemon.json("/api/watch")["waiting"].to_string();
    assert!(waiting.contains("endless.las"), "it is told why it is not taken: {waiting}");
    assert!(daemon.jobs().iter().all(|job| job["name"] != "endless"));
    stop.store(true, Ordering::SeqCst);
    grower.join().expect("no panic");
}

#[test]
fn a_download_under_a_partial_name_is_taken_when_it_is_renamed_into_place() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    let endings = ["part", "tmp", "partial", "filepart", "crdownload"];
    for (i, ending) in endings.iter().enumerate() {
        fs::write(daemon.inbox().join(format!("c{i}.las.{ending}")), las(300, i as u64)).expect("begun");
    }
    fs::write(daemon.inbox().join("~syncthing~c9.las.tmp"), las(300, 9)).expect("begun");
    fs::write(daemon.inbox().join("whole.las"), las(300, 99)).expect("dropped");
    daemon.wait("whole", "done");
    assert_eq!(daemon.jobs().len(), 1, "nothing else is taken");
    for (i, ending) in endings.iter().enumerate() {
        let name = daemon.inbox().join(format!("c{i}.las"));
        fs::rename(daemon.inbox().join(format!("c{i}.las.{ending}")), name).expect("renamed");
    }
    fs::rename(daemon.inbox().join("~syncthing~c9.las.tmp"), daemon.inbox().join("c9.las")).expect("renamed");
    for name in ["c0", "c1", "c2", "c3", "c4", "c9"] {
        daemon.wait(name, "done");
    }
    assert_eq!(daemon.jobs().len(), 7);
}

/// The system tells of the folder only, not of what is in it.
#[test]
fn a_folder_that_is_moved_in_whole_is_one_data_set() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--rescan-seconds", "3600"]);
    let outside = root.path().join("tiles");
    fs::create_dir_all(outside.join("north/far")).expect("made");
    for (i, name) in ["a.las", "north/b.las", "north/far/c.las"].iter().enumerate() {
        fs::write(outside.join(name), las(400, i as u64)).expect("written");
    }
    fs::rename(&outside, daemon.inbox().join("tiles")).expect("moved in");
    let job = daemon.wait("tiles", "done");
    assert_eq!(job["result"]["points_out"], 1_200);
    assert_eq!(daemon.jobs().len(), 1);
}

/// The classic race: the file is there before anybody watches its folder.
#[test]
fn a_file_in_folders_that_were_made_a_moment_before_is_found() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--rescan-seconds", "3600"]);
    for i in 0..20 {
        let deep = daemon.inbox().join(format!("set {i}/deep/er"));
        fs::create_dir_all(&deep).expect("made");
        fs::write(deep.join("t.las"), las(100, i)).expect("written at once");
    }
    for i in 0..20 {
        daemon.wait(&format!("set {i}"), "done");
    }
    assert_eq!(daemon.jobs().len(), 20);
}

/// No watches are left, as on a machine whose limit others used up; NFS, SMB and
/// many bind mounts look the same from here: no events come.
#[test]
fn without_file_events_it_says_so_and_polls() {
    if !small_disk::inside("needs::watcher::without_file_events_it_says_so_and_polls") {
        return;
    }
    // Of this namespace alone.
    fs::write("/proc/sys/user/max_inotify_watches", "0").expect("a limit");
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--rescan-seconds", "3600"]);
    wait_for("the mode", || {
        let watched = daemon.json("/api/watch")["watched"][0]["mode"].clone();
        (watched == "polling").then_some(())
    });
    assert!(daemon.log().contains("fs.inotify.max_user_watches"), "what to do about it is told");
    fs::write(daemon.inbox().join("a.las"), las(500, 1)).expect("dropped");
    daemon.wait("a", "done");
    let metrics = daemon.get("/metrics").1;
    assert!(metrics.contains("lodestone_watched_folders{mode=\"polling\"} 1"), "{metrics}");
}

#[test]
fn a_mount_that_is_missing_at_the_start_is_waited_for() {
    let root = root();
    let mount = root.path().join("mount");
    let watch = mount.to_str().expect("UTF-8").to_string();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--watch", &watch]);
    wait_for("the gap to show", || (daemon.get("/readyz").0 == 503).then_some(()));
    assert_eq!(daemon.get("/healthz").0, 200, "a restart would not help");
    fs::write(daemon.inbox().join("here.las"), las(500, 1)).expect("dropped");
    daemon.wait("here", "done");
    fs::create_dir(&mount).expect("mounted");
    fs::write(mount.join("there.las"), las(500, 2)).expect("dropped");
    daemon.wait("there", "done");
    wait_for("readiness", || (daemon.get("/readyz").0 == 200).then_some(()));
}

/// Shared content is shared work, but nobody's content may go with another's file.
#[test]
fn a_twin_lives_on_when_the_file_it_was_recognised_by_gets_new_content() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), las(500, 1)).expect("dropped");
    let first = daemon.wait("a", "done");
    fs::write(daemon.inbox().join("b.las"), las(500, 1)).expect("dropped");
    wait_for("the twin to be recognised", || {
        let history = daemon.json(&format!("/api/jobs/{}", first["id"]))["history"].to_string();
        history.contains("b.las").then_some(())
    });
    fs::write(daemon.inbox().join("a.las"), las(600, 2)).expect("replaced");
    // Its octree stood under the other's name; now it gets one of its own.
    let job = daemon.wait("b", "done");
    assert_eq!(job["result"]["points_out"], 500);
    assert_eq!(daemon.jobs().len(), 3);
}
