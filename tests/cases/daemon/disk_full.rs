//! A real daemon on real small disks that are filled to the brim, or made
//! read-only, while it works: it lives, the job waits and says what for, and when
//! there is room again it is done with the right bytes. Needs `unshare` and
//! `mount`, as root or where users may have namespaces; LODESTONE_SMALL_DISKS=1
//! insists.

use std::fs;
use std::path::Path;

use crate::daemon_support::{Daemon, content, converted, las, small_disk, wait_for};
use serde_json::Value;

/// Points of a cloud that takes a second or two, packed by one thread.
const POINTS: u32 = 900_000;
/// What preflight wants for it, and a little.
const ROOMY: &str = "80m";
const SLOW: [&str; 4] = ["--threads", "1", "--encoding", "brotli"];

/// A cloud in a watched folder that is on no small disk, and its octree.
struct Setting {
    root: tempfile::TempDir,
    expected: std::collections::BTreeMap<std::path::PathBuf, Vec<u8>>,
}

impl Setting {
    fn new() -> Setting {
        let root = tempfile::tempdir().expect("a folder");
        let source = root.path().join("big.las");
        fs::write(&source, las(POINTS, 3)).expect("written");
        fs::create_dir(root.path().join("watched")).expect("made");
        let run = std::process::Command::new(env!("CARGO_BIN_EXE_lodestone"))
            .args(["convert", "--encoding", "brotli", "--progress", "none", "-o"])
            .arg(root.path().join("big"))
            .arg(&source)
            .output()
            .expect("run");
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let expected = content(&root.path().join("big"));
        Setting { root, expected }
    }

    fn start(&self, more: &[&str]) -> Daemon {
        let watched = self.root.path().join("watched").to_str().expect("UTF-8").to_string();
        let all: Vec<&str> = SLOW.iter().chain(more).copied().chain(["--watch", &watched]).collect();
        Daemon::start_with(&self.root.path().join("data"), &all)
    }

    fn drop_cloud(&self) {
        let watched = self.root.path().join("watched/big.las");
        fs::rename(self.root.path().join("big.las"), watched).expect("dropped");
    }
}

/// The only job, when it waits and its hold or its error speaks of the folder.
fn waits_for(daemon: &Daemon, folder: &Path) -> Value {
    wait_for("the job to say what it waits for", || {
        let job = daemon.jobs().into_iter().next()?;
        let says = format!("{} {}", job["hold"], job["error"]);
        let named = says.contains(folder.to_str().expect("UTF-8"));
        (job["state"] == "queued" && job["attempts"] != 0 && named).then_some(job)
    })
}

fn ends_well(setting: &Setting, daemon: &Daemon) {
    let job = daemon.wait("big", "done");
    assert!(content(&daemon.octree("big")) == setting.expected, "other bytes than convert's");
    assert_eq!((daemon.jobs().len(), job["strikes"].as_u64()), (1, Some(0)), "a full disk is no strike");
    wait_for("readiness", || (daemon.get("/readyz").0 == 200).then_some(()));
    daemon.wait_cleared();
}

fn filled_while_it_converts(folder: &str, more: &[&str]) {
    let setting = Setting::new();
    let small = setting.root.path().join("data").join(folder);
    small_disk::mount_small(&small, ROOMY);
    let daemon = setting.start(more);
    setting.drop_cloud();
    daemon.wait("big", "running");
    let ballast = small_disk::fill(&small);
    let job = waits_for(&daemon, &small);
    assert_eq!(daemon.get("/healthz").0, 200, "a restart would not help: {job}");
    assert!(!daemon.octree("big").exists());
    fs::remove_file(ballast).expect("removed");
    ends_well(&setting, &daemon);
}

#[test]
fn octrees_filled_to_the_brim_while_it_converts() {
    if small_disk::inside("daemon::disk_full::octrees_filled_to_the_brim_while_it_converts") {
        filled_while_it_converts("octrees", &[]);
    }
}

#[test]
fn scratch_filled_to_the_brim_while_it_converts() {
    if small_disk::inside("daemon::disk_full::scratch_filled_to_the_brim_while_it_converts") {
        // So little memory that it needs its scratch.
        filled_while_it_converts("scratch", &["--memory-limit", "128M", "--light-jobs", "1"]);
    }
}

/// The queue itself cannot be written: nothing can be recorded, and all the more
/// nothing may be lost.
#[test]
fn the_queue_s_disk_filled_to_the_brim_while_it_converts() {
    if !small_disk::inside("daemon::disk_full::the_queue_s_disk_filled_to_the_brim_while_it_converts") {
        return;
    }
    let setting = Setting::new();
    let data = setting.root.path().join("data");
    small_disk::mount_small(&data, "8m");
    for folder in ["inbox", "octrees", "scratch"] {
        small_disk::mount_small(&data.join(folder), ROOMY);
    }
    let daemon = setting.start(&[]);
    setting.drop_cloud();
    daemon.wait("big", "running");
    let ballast = small_disk::fill(&data);
    wait_for("the end of the conversion that cannot be recorded", || {
        let (status, why) = daemon.get("/readyz");
        (status == 503 && why.contains("queue")).then_some(())
    });
    // What is dropped meanwhile waits too.
    fs::write(daemon.inbox().join("late.las"), las(1_000, 9)).expect("dropped");
    wait_for("the take that fails", || daemon.log().contains("could not be queued").then_some(()));
    assert_eq!(daemon.get("/healthz").0, 200);
    fs::remove_file(ballast).expect("removed");
    daemon.wait("late", "done");
    let job = daemon.wait("big", "done");
    assert_eq!(job["attempts"], 1, "it was converted once, and recorded when that could be done");
    assert!(content(&daemon.octree("big")) == setting.expected, "other bytes than convert's");
    wait_for("readiness", || (daemon.get("/readyz").0 == 200).then_some(()));
}

/// Everything on one small disk, as on a small machine.
#[test]
fn the_whole_root_filled_to_the_brim_while_it_converts() {
    if !small_disk::inside("daemon::disk_full::the_whole_root_filled_to_the_brim_while_it_converts") {
        return;
    }
    let setting = Setting::new();
    let data = setting.root.path().join("data");
    small_disk::mount_small(&data, ROOMY);
    let daemon = setting.start(&[]);
    setting.drop_cloud();
    daemon.wait("big", "running");
    let ballast = small_disk::fill(&data);
    wait_for("the full disk to be told", || {
        let log = daemon.log();
        (log.contains("No space left on device") || log.contains("full")).then_some(())
    });
    assert_eq!(daemon.get("/healthz").0, 200);
    fs::remove_file(ballast).expect("removed");
    ends_well(&setting, &daemon);
}

#[test]
fn octrees_become_read_only_while_it_converts() {
    if !small_disk::inside("daemon::disk_full::octrees_become_read_only_while_it_converts") {
        return;
    }
    let setting = Setting::new();
    let octrees = setting.root.path().join("data/octrees");
    small_disk::mount_small(&octrees, ROOMY);
    let daemon = setting.start(&[]);
    small_disk::remount(&octrees, "ro");
    setting.drop_cloud();
    // Not even tried: it would fail.
    let held = wait_for("the job to be held", || {
        let job = daemon.jobs().into_iter().next()?;
        job["hold"].is_string().then_some(job)
    });
    let why = held["hold"].as_str().expect("a reason");
    assert!(why.contains(octrees.to_str().expect("UTF-8")) && why.contains("Read-only"), "{why}");
    assert_eq!(held["attempts"], 0);
    assert_eq!(daemon.get("/healthz").0, 200);
    small_disk::remount(&octrees, "rw");
    ends_well(&setting, &daemon);
}

/// 256 open files are few; many jobs, and a data set of many tiles, must do.
#[test]
fn few_file_handles_are_enough_for_many_jobs() {
    let root = tempfile::tempdir().expect("a folder");
    let inbox = root.path().join("data/inbox");
    fs::create_dir_all(inbox.join("tiles")).expect("made");
    for i in 0..60 {
        fs::write(inbox.join(format!("f{i}.las")), las(500, i)).expect("dropped");
    }
    for i in 0..400 {
        fs::write(inbox.join(format!("tiles/t{i:03}.las")), las(50, 1000 + i)).expect("dropped");
    }
    let limits = ["prlimit", "--nofile=256:256"];
    let daemon = Daemon::start_by(&limits, &root.path().join("data"), &["--light-jobs", "4"], &[]);
    wait_for("all jobs", || {
        let jobs = daemon.json("/api/jobs?limit=1000")["jobs"].as_array().expect("jobs").clone();
        (jobs.len() == 61 && jobs.iter().all(|job| job["state"] == "done")).then_some(())
    });
    let expected = converted(&[&inbox.join("tiles")], &root.path().join("tiles"));
    assert!(content(&daemon.octree("tiles")) == expected, "other bytes than convert's");
    assert_eq!(daemon.get("/healthz").0, 200);
}
