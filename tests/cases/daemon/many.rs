//! Many small files at once: each done once, none skipped, the database small and
//! the memory flat. 300 files; `LODESTONE_MANY=2000` for more. The rate is printed,
//! not asserted.

use std::collections::HashSet;
use std::fs;
use std::time::Instant;

use crate::daemon_support::{Daemon, las, wait_for};
use serde_json::Value;

/// What the process holds in memory now, in MiB.
fn resident(daemon: &Daemon) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", daemon.child.id())).expect("alive");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a figure");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") >> 10
}

fn all_jobs(daemon: &Daemon) -> Vec<Value> {
    let mut jobs: Vec<Value> = vec![];
    loop {
        let before = jobs.last().map_or(String::new(), |job| format!("&before={}", job["id"]));
        let page = daemon.json(&format!("/api/jobs?limit=1000{before}"));
        let page = page["jobs"].as_array().expect("jobs");
        if page.is_empty() {
            return jobs;
        }
        jobs.extend(page.iter().cloned());
    }
}

#[test]
fn many_small_files_at_once_are_all_done_once() {
    let many: usize = std::env::var("LODESTONE_MANY").map_or(300, |text| text.parse().expect("a number"));
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let before = resident(&daemon);
    let start = Instant::now();
    for i in 0..many {
        fs::write(daemon.inbox().join(format!("file {i:04}.las")), las(500, i as u64)).expect("dropped");
    }
    let dropped = start.elapsed();
    let done = |daemon: &Daemon| {
        let metrics = daemon.get("/metrics").1;
        let line = metrics.lines().find_map(|line| line.strip_prefix("lodestone_jobs{state=\"done\"} "));
        line.expect("a figure").parse::<usize>().expect("a number")
    };
    let mut midway = 0;
    let mut last = (0, Instant::now());
    // As long as it gets on, it may take its time.
    while last.0 < many {
        let now = wait_for("further jobs", || Some(done(&daemon)).filter(|done| *done > last.0));
        last = (now, Instant::now());
        if midway == 0 && now >= many / 2 {
            midway = resident(&daemon);
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    let jobs = all_jobs(&daemon);
    assert_eq!(jobs.len(), many, "one job a file");
    let names: HashSet<&str> = jobs.iter().filter_map(|job| job["name"].as_str()).collect();
    assert_eq!(names.len(), many);
    for job in &jobs {
        assert_eq!((&job["state"], &job["attempts"]), (&"done".into(), &1.into()), "{job}");
        assert!(daemon.octree(job["name"].as_str().expect("a name")).join("metadata.json").exists());
    }
    let after = resident(&daemon);
    let database: u64 = ["lodestone.db", "lodestone.db-wal"]
        .iter()
        .filter_map(|name| fs::metadata(daemon.root.join(name)).ok())
        .map(|meta| meta.len())
        .sum();
    eprintln!(
        "{many} files, dropped in {:.1} s, done in {seconds:.1} s: {:.1} a second; memory {before}, {midway}, \
         {after} MiB at start, midway and end; database {} KiB",
        dropped.as_secs_f64(),
        many as f64 / seconds,
        database >> 10
    );
    // Some kilobytes a job, and a log that SQLite folds back at 4 MiB.
    assert!(database < (8 << 20) + many as u64 * (8 << 10), "{database} bytes of database");
    assert!(after < midway + 64, "memory grows with the number of jobs: {midway} MiB, then {after} MiB");
}
