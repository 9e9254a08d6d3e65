//! The scratch folder of a conversion that does not fit the memory: runs of
//! records, chunks' roots until the merge, blocks that wait for their turn, and
//! the journal of receipts for all of it.
//!
//! Three laws: data first, its receipt after; a unit writes only at places that
//! are its own, so that doing it again does no harm; and nothing here is removed
//! before what was made of it is in its place.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::journal::{self, Journal};
use super::receipt::{ByteRange, ConversionKey, JournalEntry, RequiredLengths, ResumeState, StoredUnit};
use crate::convert::error::{Result, StageError};
use crate::convert::values::block::{COPC, Each, OCTREE};
use crate::convert::values::counting_result::CountingResult;
use crate::platform::disk::{DirLock, Disk, DiskFile};

const JOURNAL: &str = "journal";
const RUNS: &str = "runs.bin";
const RISEN: &str = "risen.bin";

/// What a fallen machine (not a killed process) may cost at most, about.
const SYNC_EVERY: Duration = Duration::from_secs(30);

/// See the module.
pub struct Scratch {
    disk: Disk,
    pub folder: PathBuf,
    identity: ConversionKey,
    journal: Mutex<Journal>,
    /// Records of every slice, at places known beforehand.
    pub runs: Arc<DiskFile>,
    /// Records of chunks' roots and samples along their borders, one behind the
    /// other as they come.
    risen: DiskFile,
    risen_end: AtomicU64,
    /// What earlier runs of this conversion did.
    pub past: ResumeState,
    /// Blocks that lie in files of their own.
    findings: Mutex<Option<CountingResult>>,
    spilled: Mutex<BTreeSet<u32>>,
    points: Mutex<Vec<Arc<DiskFile>>>,
    synced_at: Mutex<Instant>,
    pub lock: Arc<DirLock>,
}

impl Scratch {
    /// Opens the folder of a conversion, or makes it. What another conversion,
    /// another program or other options left in it is cleared.
    pub fn open(disk: &Disk, folder: PathBuf, identity: ConversionKey) -> Result<Scratch> {
        let lock = disk.lock_dir(&folder)?.ok_or_else(|| StageError::Busy(folder.clone()))?;
        let (journal, past) = Journal::open(disk, &folder.join(JOURNAL), identity)?;
        let mut scratch = Scratch {
            disk: disk.clone(),
            identity,
            journal: Mutex::new(journal),
            runs: Arc::new(disk.reopen(&folder.join(RUNS))?),
            risen: disk.reopen(&folder.join(RISEN))?,
            risen_end: AtomicU64::new(0),
            past: ResumeState::default(),
            findings: Mutex::default(),
            spilled: Mutex::default(),
            points: Mutex::default(),
            synced_at: Mutex::new(Instant::now()),
            folder,
            lock: Arc::new(lock),
        };
        match past {
            Some(past) => scratch.take_up(past)?,
            None => scratch.clear()?,
        }
        Ok(scratch)
    }

    /// Goes on from what is there, unless less is there than was receipted.
    fn take_up(&mut self, past: ResumeState) -> Result<()> {
        let RequiredLengths { runs, risen, .. } = past.ends();
        if self.risen.length()? < risen || self.runs.length()? < runs {
            tracing::warn!(folder = %self.folder.display(), "intermediate files were cut; beginning anew");
            return self.clear();
        }
        self.risen_end = AtomicU64::new(risen);
        self.past = past;
        *lock(&self.findings) = self.past.surveyed.take();
        // A block whose file is gone or cut is made again.
        let waiting = self
            .past
            .built
            .iter()
            .filter(|(_, b)| b.at.is_none())
            .map(|(n, b)| (*n, b.bytes.iter().sum::<u64>()));
        for (number, bytes) in waiting.collect::<Vec<_>>() {
            let file = std::fs::metadata(self.block_file(number));
            if file.is_ok_and(|meta| meta.len() == bytes) {
                lock(&self.spilled).insert(number);
            } else {
                self.past.built.remove(&number);
            }
        }
        Ok(())
    }

    /// Begins anew.
    pub fn clear(&mut self) -> Result<()> {
        lock(&self.journal).clear(self.identity)?;
        self.past = ResumeState::default();
        self.risen_end = AtomicU64::new(0);
        *lock(&self.findings) = None;
        lock(&self.spilled).clear();
        for file in [&*self.runs, &self.risen] {
            file.cut_to(0)?;
        }
        Ok(())
    }

    /// The slices' runs and the finished files of points are what later receipts
    /// vouch for; such a file is named once it is open.
    pub fn vouch_for(&self, points: Arc<DiskFile>) {
        lock(&self.points).push(points);
    }

    /// Adds the receipt of something that is written. Now and then this makes
    /// all that was written so far last.
    pub fn receipt(&self, receipt: &JournalEntry) -> Result<()> {
        lock(&self.journal).append(receipt)?;
        let due = match self.synced_at.try_lock() {
            Ok(mut at) if at.elapsed() >= SYNC_EVERY => {
                *at = Instant::now();
                true
            }
            _ => false,
        };
        if due { self.sync() } else { Ok(()) }
    }

    /// Makes all that has a receipt last.
    pub fn sync(&self) -> Result<()> {
        let upto = lock(&self.journal).end();
        self.runs.sync()?;
        self.risen.sync()?;
        let files = lock(&self.points).clone();
        for points in files {
            points.sync()?;
            if let Some(folder) = points.path().parent() {
                self.disk.sync_dir(folder)?;
            }
        }
        let spilled: Vec<u32> = lock(&self.spilled).iter().copied().collect();
        for number in spilled {
            // One that was placed meanwhile is gone, and that is fine.
            self.disk.sync_file(&self.block_file(number))?;
        }
        self.disk.sync_dir(&self.folder)?;
        let mut journal = lock(&self.journal);
        journal.append(&JournalEntry::Synced { upto })?;
        journal.sync()
    }

    /// What the survey of an earlier run found, to be taken once.
    pub fn take_findings(&self) -> Option<CountingResult> {
        lock(&self.findings).take()
    }

    /// Notes what the survey found, and makes all of it last: from here on slices
    /// are overwritten in place.
    pub fn surveyed(&self, findings: CountingResult) -> Result<CountingResult> {
        let receipt = JournalEntry::Surveyed(findings);
        self.receipt(&receipt)?;
        self.sync()?;
        match receipt {
            JournalEntry::Surveyed(findings) => Ok(findings),
            _ => Err(StageError::Inconsistent("a receipt changed".into())),
        }
    }

    /// Keeps bytes until the merge: records of a node, or samples along a border.
    pub fn keep(&self, bytes: &[u8]) -> Result<ByteRange> {
        let offset = self.risen_end.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.risen.write_all_at(bytes, offset)?;
        Ok(ByteRange { offset, bytes: bytes.len() as u64 })
    }

    /// Bytes that were kept.
    pub fn fetch(&self, span: ByteRange) -> Result<Vec<u8>> {
        let mut bytes = vec![0; span.bytes as usize];
        self.risen.read_exact_at(&mut bytes, span.offset)?;
        Ok(bytes)
    }

    /// Puts blocks that must wait for their turn into a file of their own, one behind
    /// the other, with their receipt.
    pub fn spill(&self, number: u32, blocks: Each<&[u8]>, built: StoredUnit) -> Result<()> {
        let file = self.disk.create(&self.block_file(number))?;
        file.write_all_at(blocks[OCTREE], 0)?;
        file.write_all_at(blocks[COPC], blocks[OCTREE].len() as u64)?;
        lock(&self.spilled).insert(number);
        self.receipt(&JournalEntry::Built { number, built: StoredUnit { at: None, ..built } })
    }

    pub fn unspill(&self, number: u32, bytes: u64) -> Result<Vec<u8>> {
        let mut block = vec![0; bytes as usize];
        self.disk.reopen(&self.block_file(number))?.read_exact_at(&mut block, 0)?;
        Ok(block)
    }

    /// A spilled block is in its place now.
    pub fn placed(&self, number: u32, at: Each<u64>) -> Result<()> {
        self.receipt(&JournalEntry::Placed { number, at })?;
        lock(&self.spilled).remove(&number);
        Ok(self.disk.remove_file(&self.block_file(number))?)
    }

    fn block_file(&self, number: u32) -> PathBuf {
        self.folder.join(format!("block-{number}"))
    }

    /// Bytes of the intermediate files, without what waits for a moment.
    pub fn bytes(&self) -> Result<u64> {
        Ok(self.runs.length()? + self.risen.length()?)
    }
}

/// Units of work that have receipts in a scratch folder: what tells a job that
/// gets on, crash by crash, from one that dies at the same place each time.
pub fn units_done(folder: &std::path::Path) -> u64 {
    match journal::read(&folder.join(JOURNAL)) {
        Ok(receipts) => super::receipt::units_in(&receipts),
        Err(error) => {
            tracing::warn!(%error, "the journal of a conversion");
            0
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
