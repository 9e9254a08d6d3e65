//! A disk that fails at the n-th operation and from then on, for every n until a
//! conversion gets by unharmed: full, or with I/O errors, with torn writes, in
//! core and out of core. The engine lives, the job says why it waits or failed,
//! and when the disk is well again it is done with the same bytes.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::PathBuf;

use crate::daemon_support::{content, las};
use crate::engine_support::{House, arrival, configured, fast_folder};
use lodestone::platform::disk::Disk;
use lodestone::serve::job::{Event, Job, State};
use lodestone::serve::scheduler::converter::Conduct;

/// One cloud in a house on a disk that fails.
struct Test {
    house: House<Conduct>,
    job: i64,
}

impl Test {
    async fn new(memory: u64, disk: Disk) -> Test {
        // On memory, where there is any: only our own faults are wanted.
        let folder = fast_folder();
        let mut config = configured(folder.path(), "disk_reserve = 0\nthreads = 2\nlight_jobs = 1");
        config.memory_limit = memory;
        let house = House::with(folder, config, disk).await;
        let path = house.source("cloud");
        std::fs::write(&path, las(60_000, 5)).unwrap();
        let job = house.tools.store.take_in(&arrival(&path, "content", 60_000), 0).await.unwrap().job();
        Test { house, job }
    }

    async fn job(&self) -> Job {
        self.house.job(self.job).await
    }

    /// Turns the wheel until the job's run has ended, or it is held.
    async fn turn(&mut self) -> Job {
        let ended = |job: &Job| job.state != State::Running && (job.attempts > 0 || job.hold.is_some());
        self.house.turn_until_so(self.job, "ended", ended).await
    }

    fn octree(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        content(&self.house.folder.path().join("octrees/cloud"))
    }
}

/// The bytes of an unharmed run, and whether it needed scratch.
async fn unharmed(memory: u64) -> (BTreeMap<PathBuf, Vec<u8>>, bool) {
    let mut test = Test::new(memory, Disk::new()).await;
    let job = test.turn().await;
    assert_eq!(job.state, State::Done, "{job:?}");
    let scratch = job.result.unwrap()["scratch_bytes"].as_u64().unwrap();
    (test.octree(), scratch > 0)
}

/// Fails the `nth` operation; false where the run never came to it.
async fn one_fault(nth: i64, error: ErrorKind, memory: u64, expected: &BTreeMap<PathBuf, Vec<u8>>) -> bool {
    let disk = Disk::failing_from(nth, error);
    let mut test = Test::new(memory, disk.clone()).await;
    let job = test.turn().await;
    let struck = disk.has_failed();
    match job.state {
        State::Queued | State::Failed => {
            let why = job.error.as_deref().or(job.hold.as_deref()).expect("a reason");
            assert!(
                struck && why.contains(test.house.folder.path().to_str().unwrap()),
                "operation {nth}: {why}"
            );
            assert_eq!(job.strikes, 0, "operation {nth}: a failing disk is no strike: {why}");
        }
        // The fault came in clearing up, when all was done.
        State::Done => {}
        other => panic!("operation {nth}: {other:?}"),
    }
    disk.heal();
    test.house.advance(3_600_000);
    if nth % 2 == 1 {
        // The daemon was started anew meanwhile.
        test.house.crash().await;
    }
    if job.state == State::Failed {
        test.house.tools.store.order(test.job, Event::Retry, 0).await.unwrap();
    }
    while test.job().await.state != State::Done {
        let job = test.turn().await;
        assert_eq!(job.state, State::Done, "operation {nth}, on a healthy disk: {job:?}");
    }
    assert!(test.octree() == *expected, "operation {nth}: other bytes");
    for sub in ["scratch", "octrees/.staged"] {
        let left: Vec<_> = std::fs::read_dir(test.house.folder.path().join(sub)).unwrap().collect();
        assert!(left.is_empty(), "operation {nth}: {left:?}");
    }
    struck
}

async fn every_fault(memory: u64, scratch: bool) {
    let (expected, used_scratch) = unharmed(memory).await;
    assert_eq!(used_scratch, scratch, "whether it is out of core");
    for error in [ErrorKind::StorageFull, ErrorKind::Other] {
        let mut nth = 0;
        while one_fault(nth, error, memory, &expected).await {
            nth += 1;
        }
        assert!(nth > 5, "only {nth} operations were struck");
        eprintln!("{error:?}: {nth} operations, each struck once");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn any_operation_may_fail_in_core() {
    every_fault(1 << 30, false).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn any_operation_may_fail_out_of_core() {
    every_fault(96 << 20, true).await;
}
