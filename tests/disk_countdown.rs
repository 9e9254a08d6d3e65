//! A disk that fails at the n-th operation and from then on, for every n until a
//! conversion gets by unharmed: full, or with I/O errors, with torn writes, in
//! core and out of core. The engine lives, the job says why it waits or failed,
//! and when the disk is well again it is done with the same bytes.

mod daemon_support;

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use daemon_support::{content, las};
use lodestone::clock::Clock;
use lodestone::config::{Config, Layer};
use lodestone::disk::Disk;
use lodestone::engine::converter::Conduct;
use lodestone::engine::{Engine, Tools};
use lodestone::job::{Event, Input, Job, State};
use lodestone::metrics::Metrics;
use lodestone::store::board::Board;
use lodestone::store::{Arrival, Kind, Store};

struct House {
    folder: tempfile::TempDir,
    tools: Tools,
    engine: Engine,
    now: Arc<AtomicI64>,
    job: i64,
}

impl House {
    async fn new(memory: u64, disk: Disk) -> House {
        // On memory, where there is any: only our own faults are wanted.
        let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
        let layer: Layer = toml::from_str("disk_reserve = 0\nthreads = 2\nlight_jobs = 1").unwrap();
        let mut config = Config::from_layer(layer).unwrap();
        config.root = folder.path().to_path_buf();
        config.memory_limit = memory;
        for sub in ["inbox", "octrees/.staged", "scratch"] {
            std::fs::create_dir_all(config.root.join(sub)).unwrap();
        }
        let now = Arc::new(AtomicI64::new(1_000_000));
        let tools = Tools {
            store: Store::open(&config.database()).await.unwrap(),
            config: Arc::new(config),
            board: Board::default(),
            metrics: Metrics::new().unwrap(),
            clock: Clock::Manual(now.clone()),
            disk,
            converter: Arc::new(Conduct),
            bell: Arc::default(),
        };
        let engine = Engine::new(tools.clone(), "run-0".into());
        let mut house = House { folder, tools, engine, now, job: 0 };
        house.job = house.drop_cloud().await;
        house
    }

    async fn drop_cloud(&self) -> i64 {
        use std::os::unix::fs::MetadataExt;
        let path = self.folder.path().join("inbox/cloud.las");
        std::fs::write(&path, las(60_000, 5)).unwrap();
        let meta = std::fs::metadata(&path).unwrap();
        let mtime_ns = meta.mtime() * 1_000_000_000 + meta.mtime_nsec();
        let arrival = Arrival {
            path: path.clone(),
            kind: Kind::File,
            name: "cloud".into(),
            stamp: "stamp".into(),
            content_key: "content".into(),
            inputs: vec![Input { path, size: meta.len(), mtime_ns, hash: "hash".into() }],
            options: "{}".into(),
            priority: 0,
            points: 60_000,
        };
        self.tools.store.take_in(&arrival, 0).await.unwrap().job()
    }

    async fn job(&self) -> Job {
        self.tools.store.job(self.job).await.unwrap()
    }

    /// Turns the wheel until the job's run has ended.
    async fn turn(&mut self) -> Job {
        for _ in 0..10_000 {
            self.engine.tick().await.expect("the engine lives");
            let job = self.job().await;
            if job.state != State::Running && (job.attempts > 0 || job.hold.is_some()) {
                return job;
            }
            let bell = self.tools.bell.clone();
            let _ = tokio::time::timeout(Duration::from_millis(20), bell.notified()).await;
        }
        panic!("it never ends: {:?}", self.job().await);
    }

    fn octree(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        content(&self.folder.path().join("octrees/cloud"))
    }
}

/// The bytes of an unharmed run, and whether it needed scratch.
async fn unharmed(memory: u64) -> (BTreeMap<PathBuf, Vec<u8>>, bool) {
    let mut house = House::new(memory, Disk::new()).await;
    let job = house.turn().await;
    assert_eq!(job.state, State::Done, "{job:?}");
    let scratch = job.result.unwrap()["scratch_bytes"].as_u64().unwrap();
    (house.octree(), scratch > 0)
}

/// Fails the `nth` operation; false where the run never came to it.
async fn one_fault(nth: i64, error: ErrorKind, memory: u64, expected: &BTreeMap<PathBuf, Vec<u8>>) -> bool {
    let disk = Disk::failing_from(nth, error);
    let mut house = House::new(memory, disk.clone()).await;
    let job = house.turn().await;
    let struck = disk.has_failed();
    match job.state {
        State::Queued | State::Failed => {
            let why = job.error.as_deref().or(job.hold.as_deref()).expect("a reason");
            assert!(struck && why.contains(house.folder.path().to_str().unwrap()), "operation {nth}: {why}");
            assert_eq!(job.strikes, 0, "operation {nth}: a failing disk is no strike: {why}");
        }
        // The fault came in clearing up, when all was done.
        State::Done => {}
        other => panic!("operation {nth}: {other:?}"),
    }
    disk.heal();
    house.now.fetch_add(3_600_000, Ordering::SeqCst);
    if nth % 2 == 1 {
        // The daemon was started anew meanwhile.
        house.engine = Engine::new(house.tools.clone(), "run-1".into());
        house.engine.recover().await.unwrap();
    }
    if job.state == State::Failed {
        house.tools.store.order(house.job, Event::Retry, 0).await.unwrap();
    }
    while house.job().await.state != State::Done {
        let job = house.turn().await;
        assert_eq!(job.state, State::Done, "operation {nth}, on a healthy disk: {job:?}");
    }
    assert!(house.octree() == *expected, "operation {nth}: other bytes");
    for sub in ["scratch", "octrees/.staged"] {
        let left: Vec<_> = std::fs::read_dir(house.folder.path().join(sub)).unwrap().collect();
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
