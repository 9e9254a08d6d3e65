//! What the tests of queue and engine share: a house with folders, a queue in a
//! real SQLite file, an engine that is turned by hand, and a clock that is set by
//! hand. The conversions are each test's own.

#![allow(dead_code, reason = "each test file uses a part")]

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

use lodestone::platform::clock::Clock;
use lodestone::platform::disk::Disk;
use lodestone::serve::config::{Config, Layer};
use lodestone::serve::job::{Job, QueuedFile, State};
use lodestone::serve::metrics::Metrics;
use lodestone::serve::queue::progress::ProgressRegistry;
use lodestone::serve::queue::{DataSetKind, EnqueueResult, NewDataSet, Store};
use lodestone::serve::scheduler::converter::Converter;
use lodestone::serve::scheduler::{Engine, EngineContext};

/// However busy the machine is, what has not come by then does not come.
pub const PATIENCE: Duration = Duration::from_secs(150);

/// A configuration with its folders made under `root`.
pub fn configured(root: &Path, settings: &str) -> Config {
    let mut layer: Layer = toml::from_str(settings).expect("settings");
    // Pictures are beside the point of most tests.
    layer.preview = layer.preview.or(Some(false));
    let mut config = Config::from_layer(layer).expect("a configuration");
    config.root = root.to_path_buf();
    for sub in ["inbox", "octrees/.staged", "scratch"] {
        std::fs::create_dir_all(root.join(sub)).expect("made");
    }
    config
}

/// On memory, where there is any: for tests that would sync too often, or want no
/// faults but their own.
pub fn fast_folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

pub async fn tools(
    config: Arc<Config>,
    now: &Arc<AtomicI64>,
    disk: Disk,
    converter: Arc<dyn Converter>,
) -> EngineContext {
    EngineContext {
        store: Store::open(&config.database()).await.expect("the queue opens"),
        config,
        board: ProgressRegistry::default(),
        metrics: Metrics::new().expect("metrics"),
        clock: Clock::Manual(now.clone()),
        disk,
        converter,
        bell: Arc::default(),
    }
}

/// A file as the watcher hands it over. Its name is the octree's, and what it
/// holds its fingerprint.
pub fn arrival(path: &Path, content: &str, points: u64) -> NewDataSet {
    let meta = std::fs::metadata(path).expect("there");
    let mtime_ns = meta.mtime() * 1_000_000_000 + meta.mtime_nsec();
    NewDataSet {
        path: path.to_path_buf(),
        kind: DataSetKind::File,
        name: path.file_stem().expect("a name").to_str().expect("UTF-8").into(),
        stamp: format!("{mtime_ns}"),
        content_key: format!("key of {content}"),
        inputs: vec![QueuedFile {
            path: path.to_path_buf(),
            size: meta.len(),
            mtime_ns,
            hash: content.into(),
            inode: meta.ino(),
            ctime_ns: meta.ctime() * 1_000_000_000 + meta.ctime_nsec(),
        }],
        options: "{}".into(),
        priority: 0,
        points,
        doubt: None,
        refusal: None,
        octrees: path.parent().and_then(Path::parent).expect("a root").join("octrees"),
    }
}

/// Waits until `is`, with an eye on real time.
pub async fn wait(what: &str, mut is: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is() {
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

pub struct House<C> {
    pub folder: tempfile::TempDir,
    pub tools: EngineContext,
    pub engine: Engine,
    pub converter: Arc<C>,
    pub now: Arc<AtomicI64>,
    lives: u32,
}

impl<C: Converter + Default> House<C> {
    pub async fn new(settings: &str) -> House<C> {
        let folder = tempfile::tempdir().expect("a folder");
        let config = configured(folder.path(), settings);
        House::with(folder, config, Disk::new()).await
    }

    pub async fn with(folder: tempfile::TempDir, config: Config, disk: Disk) -> House<C> {
        let (converter, now) = (Arc::new(C::default()), Arc::new(AtomicI64::new(1_000_000_000)));
        let tools = tools(Arc::new(config), &now, disk, converter.clone()).await;
        let engine = Engine::new(tools.clone(), "life-0".into());
        House { folder, tools, engine, converter, now, lives: 0 }
    }

    /// The daemon dies and is started again: a new engine on the same queue. The
    /// old one's threads go on, as nothing of a real process would: a test that
    /// looks at folders sees to it that they are past their first steps.
    pub async fn crash(&mut self) {
        self.lives += 1;
        self.engine = Engine::new(self.tools.clone(), format!("life-{}", self.lives));
        self.engine.recover().await.expect("recovered");
    }

    pub fn source(&self, name: &str) -> PathBuf {
        self.folder.path().join("inbox").join(format!("{name}.las"))
    }

    pub async fn drop_file(&self, name: &str, content: &str) -> EnqueueResult {
        self.arrive(name, content, |_| {}).await
    }

    pub async fn arrive(
        &self,
        name: &str,
        content: &str,
        change: impl FnOnce(&mut NewDataSet),
    ) -> EnqueueResult {
        let path = self.source(name);
        std::fs::write(&path, content).expect("dropped");
        let mut arrival = arrival(&path, content, 10);
        change(&mut arrival);
        self.tools.store.take_in(&arrival, self.tools.clock.now()).await.expect("taken in")
    }

    pub async fn job(&self, id: i64) -> Job {
        self.tools.store.job(id).await.expect("a job")
    }

    pub fn advance(&self, millis: i64) {
        self.now.fetch_add(millis, Ordering::SeqCst);
    }

    /// Turns the wheel until the job is as it `is` to be. It is looked at after
    /// each turn, so no state is missed: only a turn changes it.
    pub async fn turn_until_so(&mut self, id: i64, what: &str, is: impl Fn(&Job) -> bool) -> Job {
        let start = Instant::now();
        loop {
            self.engine.tick().await.expect("the engine lives");
            let job = self.job(id).await;
            if is(&job) {
                return job;
            }
            assert!(start.elapsed() < PATIENCE, "never {what}: {job:?}");
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }

    pub async fn turn_until(&mut self, id: i64, state: State) -> Job {
        self.turn_until_so(id, state.name(), |job| job.state == state).await
    }
}
