//! The world of a history: folders with clouds, a clock, and a daemon that is
//! alive or dead.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::future::Future;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::task::Poll;
use std::time::{Duration, SystemTime};

use lodestone::platform::disk::Disk;
use lodestone::serve::config::Config;
use lodestone::serve::job::State;
use lodestone::serve::queue::{EnqueueResult, Store};
use lodestone::serve::scheduler::Engine;
use lodestone::serve::scheduler::enqueue::{self, EnqueueOutcome};
use lodestone::serve::watch::settle::Limits;
use lodestone::serve::watch::{ScanResult, Watcher};
use tokio::runtime::Runtime;

use crate::Broken;
use crate::content;
use crate::desk::{Desk, Script};
use crate::engine_support::{configured, fast_folder, tools};
use crate::laws::Ledger;

/// One heavy job beside two light ones; what waits, waits seconds.
const SETTINGS: &str = "disk_reserve = 0\nlight_bytes = 800\nlight_jobs = 2\nsettle_seconds = 2\n\
                        patience_seconds = 20\nshutdown_seconds = 5\npreview = true\nthreads = 2";

/// The daemon while it lives.
pub struct Life {
    pub runtime: Runtime,
    pub store: Store,
    engine: Engine,
    watcher: Watcher,
    pub desk: Arc<Desk>,
    /// What lay at each path, and in how many scans in a row.
    sights: BTreeMap<PathBuf, (String, u32)>,
}

pub struct World {
    folder: tempfile::TempDir,
    pub config: Arc<Config>,
    pub now: Arc<AtomicI64>,
    pub script: Arc<Script>,
    pub life: Option<Life>,
    /// Whether publishing fails in this life of the daemon.
    pub sick_disk: bool,
    /// Or did in any: a swap whose sync failed is repeated with the conversion.
    pub was_sick: bool,
    lives: u32,
    /// Every file gets a time of its own, as on a real disk it would.
    stamps: i64,
    /// Jobs that an operator called off, or set to work again.
    pub ordered: HashSet<i64>,
    pub ledger: Ledger,
    /// What each octree's name shows.
    pub shown: BTreeMap<String, String>,
    pub trust: Trust,
}

/// What users have, by the hash of its content, and what became of it.
#[derive(Debug, Default)]
pub struct Trust {
    /// Files as they were last written.
    pub files: BTreeMap<PathBuf, String>,
    /// Contents that the daemon removed.
    pub removed: HashSet<String>,
    /// Folders among the octrees that are somebody's own, and what they hold.
    pub foreign: BTreeMap<PathBuf, String>,
    /// Somebody removed octrees by hand, or lost the database.
    pub meddled: bool,
    /// A marker asked for its folder to be removed, or for options of its own.
    pub asked: Asked,
}

#[derive(Debug, Default, Clone, Copy)]
pub struct Asked {
    pub removal: bool,
    pub options: bool,
}

impl World {
    pub fn new(seed: u64) -> World {
        let folder = fast_folder();
        // In every other history the sources are removed.
        let settings =
            if seed % 2 == 1 { format!("{SETTINGS}\non_done = 'delete'") } else { SETTINGS.into() };
        let mut config = configured(&folder.path().canonicalize().expect("a path").join("root"), &settings);
        config.watch = vec![config.root.with_file_name("mount")];
        fs::create_dir(&config.watch[0]).expect("made");
        World {
            folder,
            config: Arc::new(config),
            now: Arc::new(AtomicI64::new(1_700_000_000_000)),
            script: Arc::new(Script { seed, ..Script::default() }),
            life: None,
            sick_disk: false,
            was_sick: false,
            lives: 0,
            stamps: 0,
            ordered: HashSet::new(),
            ledger: Ledger::default(),
            shown: BTreeMap::new(),
            trust: Trust::default(),
        }
    }

    pub fn now(&self) -> i64 {
        self.now.load(Ordering::SeqCst)
    }

    pub fn advance(&self, millis: i64) {
        self.now.fetch_add(millis, Ordering::SeqCst);
    }

    /// The paths that data sets may have: files, a folder, and some of them on a
    /// mount.
    pub fn places(&self) -> Vec<PathBuf> {
        let (inbox, mount) = (self.config.inbox(), &self.config.watch[0]);
        vec![
            inbox.join("a.las"),
            inbox.join("b.las"),
            inbox.join("größe 1.las"),
            inbox.join("tiles"),
            inbox.join("more"),
            mount.join("a.las"),
            mount.join("m.las"),
        ]
    }

    /// Those of them that are folders of tiles.
    pub fn folders(&self) -> [PathBuf; 2] {
        ["tiles", "more"].map(|name| self.config.inbox().join(name))
    }

    pub fn mount(&self) -> (PathBuf, PathBuf) {
        (self.config.watch[0].clone(), self.folder.path().join("away"))
    }

    /// Writes a file with a time that no other has.
    pub fn write(&mut self, path: &Path, bytes: &[u8]) {
        if path.parent().is_some_and(|folder| fs::create_dir_all(folder).is_ok()) {
            fs::write(path, bytes).expect("written");
            self.trust.files.insert(path.to_path_buf(), content::hash(bytes));
            self.touch(path);
        }
    }

    pub fn touch(&mut self, path: &Path) {
        self.stamps += 1;
        let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000 + self.stamps as u64);
        let file = fs::OpenOptions::new().append(true).open(path).expect("there");
        file.set_modified(time).expect("set");
    }

    /// The living daemon; it is started where it is dead.
    pub fn life(&mut self, disk: Disk) -> &mut Life {
        if self.life.is_none() {
            let runtime =
                // One thread for what blocks, so that waiting for the last is waiting for all.
                tokio::runtime::Builder::new_current_thread()
                    .max_blocking_threads(1)
                    .enable_all()
                    .build()
                    .expect("a runtime");
            self.lives += 1;
            let desk = Arc::new(Desk::new(self.script.clone()));
            let (config, now) = (self.config.clone(), self.now.clone());
            let owner = format!("life-{}", self.lives);
            let (store, engine, watcher) = runtime.block_on(async {
                let tools = tools(config.clone(), &now, disk, desk.clone()).await;
                let store = tools.store.clone();
                let mut engine = Engine::new(tools, owner);
                engine.recover().await.expect("recovered");
                let known = store.stamps().await.expect("stamps").into_iter().collect();
                let limits = Limits { settle: config.settle, patience: config.patience };
                let roots = vec![config.inbox(), config.watch[0].clone()];
                let watcher = Watcher::new(roots, vec![config.root.clone()], limits, known);
                (store, engine, watcher)
            });
            self.life = Some(Life { runtime, store, engine, watcher, desk, sights: BTreeMap::new() });
        }
        self.life.as_mut().expect("just started")
    }

    /// SIGKILL: no farewell, no conversion goes on.
    pub fn crash(&mut self) {
        let Some(life) = self.life.take() else { return };
        life.desk.die();
        let Life { runtime, store, engine, desk, .. } = life;
        drop(engine);
        // What a statement under way has done it has done before the next life.
        runtime.block_on(store.close());
        drop(runtime);
        while Arc::strong_count(&desk) > 1 {
            std::thread::yield_now();
        }
        self.sick_disk = false;
    }

    /// Nothing is known any more of what was done; what stands is nobody's.
    pub fn forget(&mut self) {
        self.script.runs.lock().expect("no panic").clear();
        self.ordered.clear();
        self.ledger = Ledger::default();
        self.shown.clear();
        self.trust.meddled = true;
        for entry in fs::read_dir(self.config.octrees()).expect("there").flatten() {
            if let Ok(shown) = fs::read_to_string(entry.path().join("metadata.json")) {
                self.trust.foreign.insert(entry.path(), shown);
            }
        }
    }

    /// A shutdown in good order.
    pub fn stop(&mut self) {
        if let Some(life) = &mut self.life {
            life.runtime.block_on(life.engine.stop());
        }
        self.crash();
    }
}

impl Life {
    /// One turn of the wheel, cut off after some `polls`; true where it came to
    /// its end.
    pub fn tick(&mut self, polls: usize) -> Result<bool, Broken> {
        let done = self.runtime.block_on(cut_off(self.engine.tick(), polls));
        let last = async { tokio::task::spawn_blocking(|| ()).await };
        self.runtime.block_on(last).expect("all before it is done");
        match done {
            Some(Err(error)) => return Err(format!("a tick failed: {error}")),
            Some(Ok(_)) => self.wait_for_workers(),
            None => {}
        }
        Ok(done.is_some())
    }

    /// Waits for every conversion that ends by itself to have ended.
    fn wait_for_workers(&self) {
        // One handle here, one in the engine, one a conversion.
        while Arc::strong_count(&self.desk) > 2 + self.desk.hung().len() {
            std::thread::yield_now();
        }
    }

    pub fn let_go(&self, job: i64) {
        self.desk.let_go(job);
        self.wait_for_workers();
    }

    /// One scan, and what it found into the queue, cut off after some `polls`.
    pub fn scan(&mut self, config: &Config, now: i64, polls: usize) -> Result<Option<ScanResult>, Broken> {
        // As the daemon's watching loop does it.
        let again =
            self.runtime.block_on(self.store.to_look_at_again()).map_err(|error| error.to_string())?;
        again.iter().for_each(|path| self.watcher.forget(path));
        self.look(config);
        let mut report = self.watcher.scan(now);
        for found in std::mem::take(&mut report.found) {
            let held = content::on_disk(&found.path);
            let taking = enqueue::take_in(&self.store, found, config, now);
            match self.runtime.block_on(cut_off(taking, polls)) {
                None => return Ok(None),
                Some(Err(error)) => return Err(format!("not taken in: {error}")),
                Some(Ok(EnqueueOutcome::Hollow { path, stamp, not_yet })) => {
                    self.watcher.doubt(&path, &stamp, not_yet);
                    report.unsettled = true;
                }
                Some(Ok(EnqueueOutcome::Moving)) => return Err("nobody moves a file during a scan".into()),
                Some(Ok(EnqueueOutcome::In { path, stamp, admission })) => {
                    let times = self.sights.get(&path).map_or(0, |(_, times)| *times);
                    if times < 2 && !is_closed(&path) {
                        return Err(format!("{} was taken at first sight: {admission:?}", path.display()));
                    }
                    let inputs = self.runtime.block_on(self.store.inputs(admission.job()));
                    let inputs = inputs.map_err(|error| error.to_string())?;
                    let hashes: Vec<&str> = inputs.iter().map(|input| &input.hash[..16]).collect();
                    // What is being removed is less by and by.
                    let left =
                        held.as_ref().is_some_and(|held| held.split(',').all(|file| hashes.contains(&file)));
                    let is_known = matches!(admission, EnqueueResult::Known(_)) && left;
                    if Some(hashes.join(",")) != held && !is_known {
                        return Err(format!("{} became {admission:?} of other content", path.display()));
                    }
                    self.watcher.taken(&path, stamp);
                }
            }
        }
        Ok(Some(report))
    }

    /// Counts how often in a row each data set was seen the same.
    fn look(&mut self, config: &Config) {
        let before = std::mem::take(&mut self.sights);
        for root in [config.inbox(), config.watch[0].clone()] {
            for entry in fs::read_dir(root).into_iter().flatten().flatten() {
                let (path, seen) = (entry.path(), listing(&entry.path()));
                let times =
                    before.get(&path).filter(|(then, _)| *then == seen).map_or(0, |(_, times)| *times);
                self.sights.insert(path, (seen, times + 1));
            }
        }
    }

    pub fn jobs(&self) -> Vec<lodestone::serve::job::Job> {
        self.runtime.block_on(self.store.jobs(None, None, 10_000)).expect("jobs")
    }

    pub fn jobs_in(&self, state: State) -> Vec<i64> {
        self.jobs().iter().filter(|job| job.state == state).map(|job| job.id).collect()
    }
}

/// Polls a future so many times and no more: what a process does that dies.
async fn cut_off<T>(future: impl Future<Output = T>, polls: usize) -> Option<T> {
    let mut future = pin!(future);
    let mut left = polls;
    std::future::poll_fn(|cx| {
        if left == 0 {
            return Poll::Ready(None);
        }
        left -= 1;
        future.as_mut().poll(cx).map(Some)
    })
    .await
}

/// What belongs to a data set, with sizes and times; names of what is no part of it
/// left out.
fn parts(path: &Path) -> Vec<(PathBuf, fs::Metadata)> {
    let mut parts = vec![path.to_path_buf()];
    if path.is_dir() {
        parts = fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        let is_junk = |part: &Path| part.ends_with("._t1.las") || part.ends_with(".DS_Store");
        parts.retain(|part| part.is_file() && !is_junk(part));
        parts.sort();
    }
    parts.into_iter().filter_map(|part| Some((part.clone(), fs::metadata(part).ok()?))).collect()
}

fn listing(path: &Path) -> String {
    let line = |(part, meta): (PathBuf, fs::Metadata)| {
        format!("{part:?} {} {:?} {} {}\n", meta.len(), meta.modified().ok(), meta.ctime(), meta.ctime_nsec())
    };
    parts(path).into_iter().map(line).collect()
}

/// Whether a folder's marker came after everything else in it.
fn is_closed(path: &Path) -> bool {
    let changed = |meta: &fs::Metadata| (meta.ctime(), meta.ctime_nsec());
    let (marker, tiles): (Vec<_>, Vec<_>) =
        parts(path).into_iter().partition(|(part, _)| part.ends_with("lodestone.json"));
    marker.iter().any(|(_, marker)| tiles.iter().all(|(_, tile)| changed(tile) < changed(marker)))
}
