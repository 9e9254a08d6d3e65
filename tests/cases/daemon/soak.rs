//! The real daemon, killed with SIGKILL again and again while it converts, at
//! random moments and in every stage. What it publishes is what an undisturbed
//! conversion makes, to the last byte; nothing is converted again after it was
//! published; and a kill never costs a unit of work that was done.
//!
//! `LODESTONE_KILLS` says how often; a dozen where it does not. On real files
//! where `LODESTONE_DATA` names some.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::daemon_support::{Daemon, content, converted, las};
use lodestone::convert::checkpoint::journal;
use lodestone::convert::checkpoint::receipt::{JournalEntry, WorkUnit};

/// So little memory that the large data set is converted out of core.
const ARGUMENTS: &[&str] = &["--memory-limit", "240M", "--threads", "2", "--max-strikes", "1000000"];

/// Stages in which a kill is aimed; every other kill is at random.
const STAGES: [&str; 5] = ["survey", "distribute", "index", "merge", "publish"];

type Octree = BTreeMap<PathBuf, Vec<u8>>;

/// What is dropped: files and folders by the name of their octree, and the octree.
struct Drops {
    folder: tempfile::TempDir,
    octrees: BTreeMap<String, Octree>,
}

impl Drops {
    fn new() -> Drops {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("large")).expect("made");
        match std::env::var_os("LODESTONE_DATA").map(PathBuf::from) {
            Some(data) => {
                for tile in fs::read_dir(data.join("tiles/bcts")).expect("real tiles") {
                    let tile = tile.expect("an entry").path();
                    fs::copy(&tile, at("large").join(tile.file_name().expect("a name"))).expect("copied");
                }
            }
            None => fs::write(at("large/a.las"), las(4_000_000, 1)).expect("written"),
        }
        for seed in 2..5 {
            fs::write(at(&format!("small {seed}.las")), las(40_000, seed)).expect("written");
        }
        fs::write(at("middling.las"), las(900_000, 9)).expect("written");
        let names = ["large", "middling.las", "small 2.las", "small 3.las", "small 4.las"];
        let work = tempfile::tempdir().expect("a folder");
        let octrees = names.into_iter().map(|name| {
            let octree = name.trim_end_matches(".las").to_string();
            let bytes = converted(&[&at(name)], &work.path().join(&octree));
            (octree, bytes)
        });
        let octrees = octrees.collect();
        Drops { folder, octrees }
    }

    fn drop_into(&self, inbox: &Path) {
        for entry in fs::read_dir(self.folder.path()).expect("there") {
            let from = entry.expect("an entry").path();
            let to = inbox.join(from.file_name().expect("a name"));
            if from.is_dir() {
                fs::create_dir(&to).expect("made");
                for tile in fs::read_dir(&from).expect("there") {
                    let tile = tile.expect("an entry").path();
                    fs::copy(&tile, to.join(tile.file_name().expect("a name"))).expect("copied");
                }
            } else {
                fs::copy(&from, &to).expect("copied");
            }
        }
    }
}

/// Numbers that look like chance and are the same every time.
struct Chance(u64);

impl Chance {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }
}

/// What is known of one root over all its kills.
#[derive(Default)]
struct Watch {
    /// Units with receipts by job.
    units: BTreeMap<String, BTreeSet<WorkUnit>>,
    /// Jobs whose journal the janitor has taken: they must be done.
    cleared: BTreeSet<i64>,
    /// Attempts of a job when it was first seen done.
    done: BTreeMap<i64, i64>,
}

impl Watch {
    /// Looks at the journals of a dead daemon: receipts come once, and stay.
    fn look_at_receipts(&mut self, root: &Path) {
        for entry in fs::read_dir(root.join("scratch")).expect("there").flatten() {
            let job = entry.file_name().to_string_lossy().into_owned();
            let journal = entry.path().join("journal");
            if !journal.exists() && self.units.remove(&job).is_some() {
                self.cleared.insert(job.trim_start_matches("job-").parse().expect("a number"));
            }
            let receipts = journal::read(&journal).expect("a journal");
            let units: Vec<WorkUnit> = receipts.iter().filter_map(JournalEntry::unit).collect();
            let known: BTreeSet<WorkUnit> = units.iter().copied().collect();
            assert_eq!(known.len(), units.len(), "{job} did a unit twice: {units:?}");
            let before = self.units.insert(job.clone(), known.clone()).unwrap_or_default();
            assert!(known.is_superset(&before), "{job} lost a receipt");
        }
    }

    /// Looks at the jobs of a living daemon; true where all are done.
    fn look_at_jobs(&mut self, daemon: &Daemon, all: usize) -> bool {
        let jobs = daemon.jobs();
        for job in jobs.iter().filter(|job| job["state"] == "done") {
            let (id, attempts) =
                (job["id"].as_i64().expect("an id"), job["attempts"].as_i64().expect("a count"));
            let then = *self.done.entry(id).or_insert(attempts);
            assert_eq!(attempts, then, "{} was converted again after it was published", job["name"]);
        }
        for job in jobs.iter().filter(|job| self.cleared.contains(&job["id"].as_i64().expect("an id"))) {
            assert_eq!(job["state"], "done", "{} lost its receipts", job["name"]);
        }
        jobs.len() == all && jobs.iter().all(|job| job["state"] == "done")
    }
}

/// The stage of whichever job runs; nothing where the daemon does not answer.
fn stages(daemon: &Daemon) -> Vec<String> {
    let running = daemon.jobs().into_iter().filter(|job| job["state"] == "running");
    running.filter_map(|job| job["stage"].as_str().map(str::to_string)).collect()
}

#[test]
fn killed_at_any_moment_it_publishes_the_same_bytes_and_nothing_twice() {
    let kills: usize = std::env::var("LODESTONE_KILLS").map_or(12, |n| n.parse().expect("a number"));
    let drops = Drops::new();
    let start = Instant::now();
    let mut chance = Chance(0x1234_5678_9ABC_DEF1);
    let (mut killed, mut rounds) = (0, 0);
    let mut by_stage: BTreeMap<String, usize> = BTreeMap::new();
    while killed < kills {
        let home = tempfile::tempdir().expect("a folder");
        let root = home.path().join("data");
        fs::create_dir_all(root.join("inbox")).expect("made");
        drops.drop_into(&root.join("inbox"));
        let mut watch = Watch::default();
        rounds += 1;
        loop {
            let mut daemon = Daemon::start_with(&root, ARGUMENTS);
            let all_done = aim(&daemon, &mut watch, killed, &mut chance, drops.octrees.len());
            if all_done || killed >= kills {
                finish(&mut daemon, &mut watch, &drops);
                break;
            }
            for stage in stages(&daemon) {
                *by_stage.entry(stage).or_default() += 1;
            }
            daemon.kill();
            killed += 1;
            watch.look_at_receipts(&root);
        }
    }
    println!(
        "{killed} kills in {rounds} rounds and {:.0} s; running jobs by stage: {by_stage:?}",
        start.elapsed().as_secs_f64()
    );
}

/// Waits for the moment of the next kill; true where all jobs are done instead.
fn aim(daemon: &Daemon, watch: &mut Watch, kill: usize, chance: &mut Chance, all: usize) -> bool {
    let aimed = (kill % 2 == 1).then(|| STAGES[kill / 2 % STAGES.len()]);
    let moment =
        Instant::now() + Duration::from_millis(if aimed.is_some() { 10_000 } else { chance.below(1_500) });
    while Instant::now() < moment {
        if watch.look_at_jobs(daemon, all) {
            return true;
        }
        if aimed.is_some_and(|stage| stages(daemon).iter().any(|at| at == stage)) {
            std::thread::sleep(Duration::from_millis(chance.below(60)));
            break;
        }
        std::thread::sleep(Duration::from_millis(3));
    }
    false
}

/// Lets the daemon end its work in peace, and looks at all of it.
fn finish(daemon: &mut Daemon, watch: &mut Watch, drops: &Drops) {
    for name in drops.octrees.keys() {
        daemon.wait(name, "done");
    }
    assert!(watch.look_at_jobs(daemon, drops.octrees.len()), "one job for each data set");
    for job in daemon.jobs() {
        let details = daemon.json(&format!("/api/jobs/{}", job["id"]));
        let log = details["attempts_log"].as_array().expect("a log");
        assert_eq!(log.iter().filter(|attempt| attempt["outcome"] == "succeed").count(), 1, "{details}");
    }
    for (name, expected) in &drops.octrees {
        assert!(content(&daemon.octree(name)) == *expected, "{name} is not what convert makes");
    }
    assert!(daemon.stop());
    daemon.wait_cleared();
}
