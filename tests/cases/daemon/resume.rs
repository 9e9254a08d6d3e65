//! A large job goes on from its receipts after an orderly stop and after a pause,
//! and leaves nothing when it is cancelled.

use std::fs;
use std::path::Path;

use crate::daemon_support::{Daemon, content, converted, las, wait_for};
use lodestone::convert::checkpoint::scratch::units_done;
use serde_json::Value;

/// So little memory that the cloud is converted out of core, by one thread, so
/// that it takes its time.
const ARGUMENTS: &[&str] = &["--memory-limit", "192M", "--threads", "1"];
const POINTS: u32 = 4_000_000;

fn dropped(root: &Path) -> Daemon {
    let daemon = Daemon::start_with(&root.join("data"), ARGUMENTS);
    fs::write(daemon.inbox().join("city.las"), las(POINTS, 1)).expect("dropped");
    daemon
}

/// Waits until the running job has some receipts.
fn with_receipts(daemon: &Daemon, more_than: u64) -> u64 {
    wait_for("receipts", || {
        let done = units_done(&daemon.root.join("scratch/job-1"));
        (done > more_than).then_some(done)
    })
}

fn resumed(job: &Value) -> u64 {
    job["result"]["units_resumed"].as_u64().expect("a count")
}

#[test]
fn stopped_or_paused_a_large_job_goes_on_from_its_receipts() {
    let root = tempfile::tempdir().expect("a folder");
    let mut daemon = dropped(root.path());
    with_receipts(&daemon, 5);
    assert!(daemon.stop());
    let parked = units_done(&daemon.root.join("scratch/job-1"));
    assert!(parked > 5, "an orderly stop keeps what is done");

    let daemon = Daemon::start_with(&root.path().join("data"), ARGUMENTS);
    with_receipts(&daemon, parked + 5);
    assert_eq!(daemon.post("/api/jobs/1/pause", "").0, 202);
    daemon.wait("city", "paused");
    let paused = units_done(&daemon.root.join("scratch/job-1"));
    assert!(paused > parked);
    assert_eq!(daemon.post("/api/jobs/1/resume", "").0, 200);

    let job = daemon.wait("city", "done");
    assert_eq!(resumed(&job), paused, "nothing that was done was done again");
    let expected = converted(&[&daemon.inbox().join("city.las")], &root.path().join("city"));
    assert!(content(&daemon.octree("city")) == expected);
    daemon.wait_cleared();
}

#[test]
fn a_cancelled_job_leaves_no_intermediate_files() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = dropped(root.path());
    with_receipts(&daemon, 5);
    assert_eq!(daemon.post("/api/jobs/1/cancel", "").0, 202);
    daemon.wait("city", "cancelled");
    daemon.wait_cleared();
    // Told to try again, it begins anew.
    assert_eq!(daemon.post("/api/jobs/1/retry", "").0, 200);
    assert_eq!(resumed(&daemon.wait("city", "done")), 0);
}
