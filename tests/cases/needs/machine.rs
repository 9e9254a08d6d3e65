//! The pains of machines that fail, each as a test of the real daemon; full disks
//! are in `disk_full.rs`, kills in `daemon_soak.rs` and `resume.rs`
//! (`docs/needs.md` has the whole list).

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::daemon_support::{Daemon, content, converted, las, wait_for};

/// Temporary files of another run poison nothing, and do not stay.
#[test]
fn what_a_dead_run_left_in_scratch_is_cleared_and_never_used() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    for stale in ["scratch/job-1", "scratch/job-77", "octrees/.staged/1", "octrees/.staged/77"] {
        fs::create_dir_all(data.join(stale)).expect("made");
        for name in ["octree.bin", "journal", "runs", "metadata.json"] {
            fs::write(data.join(stale).join(name), "of another run, another version, another cloud")
                .expect("written");
        }
    }
    fs::create_dir_all(data.join("scratch/not ours")).expect("made");
    let daemon = Daemon::start(&data);
    wait_for("the start to clear", || (!data.join("scratch/job-77").exists()).then_some(()));
    assert!(!data.join("octrees/.staged/77").exists());
    assert!(data.join("scratch/not ours").exists(), "what is not ours stays");
    fs::write(daemon.inbox().join("a.las"), las(20_000, 1)).expect("dropped");
    daemon.wait("a", "done");
    let expected = converted(&[&daemon.inbox().join("a.las")], &root.path().join("a"));
    assert!(content(&daemon.octree("a")) == expected, "other bytes than convert's");
    assert!(daemon.log().contains("cleared what a job left behind"), "and says so");
}

/// systemd is told that it is ready, and then again and again that it lives.
#[test]
fn the_watchdog_is_fed_as_long_as_the_wheel_turns() {
    let root = tempfile::tempdir().expect("a folder");
    let path = root.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    socket.set_read_timeout(Some(Duration::from_secs(60))).expect("set");
    let told = format!("NOTIFY_SOCKET={}", path.display());
    let mut daemon = Daemon::start_by(&["env", &told], &root.path().join("data"), &[], &[]);
    let hear = || {
        let mut bytes = [0; 1024];
        let length = socket.recv(&mut bytes).expect("a word within a minute");
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    let until = |word: &str| while !hear().contains(word) {};
    until("READY=1");
    for _ in 0..3 {
        until("WATCHDOG=1");
    }
    assert!(daemon.stop());
    until("STOPPING=1");
}

/// What makes the program somebody else's than root's, who reads everything: the
/// front of its command line. It is a copy, for others may not reach the original.
/// Who insists on small disks insists on this: it takes the same rights.
fn as_nobody(folder: &Path) -> Option<Vec<String>> {
    fs::set_permissions(folder, fs::Permissions::from_mode(0o777)).expect("opened");
    // By a process of its own: what this one has open for writing, another test's
    // child may hold for a moment, and then it cannot be started.
    let copied =
        Command::new("cp").arg(env!("CARGO_BIN_EXE_lodestone")).arg(folder.join("lodestone")).status();
    assert!(copied.is_ok_and(|status| status.success()));
    let copy = folder.join("lodestone").to_str().expect("a path").to_string();
    let by = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"].map(String::from).to_vec();
    let probe = Command::new(&by[0]).args(&by[1..]).args([&copy, "--version"]).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        assert!(std::env::var_os("LODESTONE_SMALL_DISKS").is_none(), "nobody else can be had here");
        eprintln!("nobody else can be had here: not run");
        return None;
    }
    // The program that is named behind is left out, and the copy started instead.
    Some([by, ["sh", "-c", "shift; exec \"$0\" \"$@\"", &copy].map(String::from).to_vec()].concat())
}

/// By hand it is an error.
#[test]
fn an_unreadable_file_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(by) = as_nobody(folder.path()) else { return };
    let at = |name: &str| folder.path().join(name);
    fs::write(at("open.las"), las(500, 2)).expect("written");
    fs::write(at("secret.las"), las(500, 1)).expect("written");
    let convert = || {
        Command::new(&by[0])
            .args(&by[1..])
            .args(["lodestone", "convert", "--progress", "none", "--overwrite", "-o"])
            .args([at("octree"), at("open.las"), at("secret.las")])
            .output()
            .expect("started")
    };
    let readable = convert();
    assert!(readable.status.success(), "{}", String::from_utf8_lossy(&readable.stderr));
    fs::remove_dir_all(at("octree")).expect("removed");
    fs::set_permissions(at("secret.las"), fs::Permissions::from_mode(0o600)).expect("closed");
    let refused = convert();
    let error = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{error}");
    assert!(error.contains("secret.las") && error.contains("ermission"), "{error}");
    assert!(!at("octree").exists());
}

/// A file that may not be read is told, and taken when it may be; it does not fail.
#[test]
fn an_unreadable_file_is_told_and_taken_when_it_becomes_readable() {
    let root = tempfile::tempdir().expect("a folder");
    let Some(by) = as_nobody(root.path()) else { return };
    let by: Vec<&str> = by.iter().map(String::as_str).collect();
    let data = root.path().join("data");
    fs::create_dir(&data).expect("made");
    fs::set_permissions(&data, fs::Permissions::from_mode(0o777)).expect("opened");
    let daemon = Daemon::start_by(&by, &data, &["--patience-seconds", "0.5"], &[]);
    // Closed before it is dropped, or it might be taken in between.
    let (outside, secret) = (root.path().join("secret.las"), daemon.inbox().join("secret.las"));
    fs::write(&outside, las(500, 1)).expect("written");
    fs::set_permissions(&outside, fs::Permissions::from_mode(0o600)).expect("closed");
    fs::rename(&outside, &secret).expect("dropped");
    fs::write(daemon.inbox().join("open.las"), las(500, 2)).expect("dropped");
    daemon.wait("open", "done");
    wait_for("the word on it", || {
        let waiting = daemon.json("/api/watch")["waiting"].to_string();
        (waiting.contains("secret.las") && waiting.contains("cannot be read")).then_some(())
    });
    // Longer than any patience.
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(daemon.jobs().len(), 1, "it is not failed for that");
    fs::set_permissions(&secret, fs::Permissions::from_mode(0o644)).expect("opened");
    daemon.wait("secret", "done");
}
