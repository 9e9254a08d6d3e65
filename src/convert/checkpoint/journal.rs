//! The journal: receipts one behind the other in a file, each in a frame with
//! its length and a checksum. It lies beside the data it vouches for, so that
//! receipts and data live and die together, for the daemon and for `convert`
//! alike.
//!
//! What may be believed of it: a process that is killed loses nothing that it
//! wrote, for the system keeps it. When the machine itself went down, data may
//! be missing though its receipt is there; so all is synced now and then, the
//! journal notes up to where, and after another boot only that far is believed.

use std::path::Path;

use super::receipt::{ConversionKey, JournalEntry, ResumeState};
use crate::convert::error::{Result, StageError};
use crate::platform::disk::{Disk, DiskError, DiskFile};

/// Length (4 bytes) and checksum (8 bytes) before every receipt.
const HEAD: usize = 12;

#[derive(Debug)]
pub struct Journal {
    file: DiskFile,
    end: u64,
    boot: String,
}

impl Journal {
    /// Opens the journal of a conversion: with its past, where an earlier run of
    /// the same conversion left one that can be believed.
    pub fn open(disk: &Disk, path: &Path, identity: ConversionKey) -> Result<(Journal, Option<ResumeState>)> {
        Journal::open_in(disk, path, identity, boot())
    }

    fn open_in(
        disk: &Disk,
        path: &Path,
        identity: ConversionKey,
        boot: String,
    ) -> Result<(Journal, Option<ResumeState>)> {
        let file = disk.reopen(path)?;
        let mut bytes = vec![0; file.length()? as usize];
        file.read_exact_at(&mut bytes, 0)?;
        let mut frames = frames(&bytes);
        let same_boot = last_boot(&frames).is_some_and(|last| last == boot && !boot.is_empty());
        if !same_boot {
            let synced = frames.iter().filter_map(|(receipt, _)| match receipt {
                JournalEntry::Synced { upto } => Some(*upto),
                _ => None,
            });
            let upto = synced.max().unwrap_or(0);
            frames.retain(|(_, end)| *end <= upto);
        }
        let ours =
            matches!(frames.first(), Some((JournalEntry::Begun { identity: of, .. }, _)) if *of == identity);
        let end = if ours { frames.last().map_or(0, |(_, end)| *end) } else { 0 };
        file.cut_to(end)?;
        let mut journal = Journal { file, end, boot: boot.clone() };
        journal.append(&JournalEntry::Begun { identity, boot })?;
        let past = ours
            .then(|| ResumeState::of(frames.into_iter().map(|(receipt, _)| receipt).collect(), same_boot));
        Ok((journal, past))
    }

    /// Begins anew: nothing that was there counts.
    pub fn clear(&mut self, identity: ConversionKey) -> Result<()> {
        self.file.cut_to(0)?;
        self.end = 0;
        let boot = self.boot.clone();
        self.append(&JournalEntry::Begun { identity, boot })
    }

    /// Adds a receipt, for data that is written already.
    pub fn append(&mut self, receipt: &JournalEntry) -> Result<()> {
        let payload = postcard::to_allocvec(receipt)
            .map_err(|e| StageError::Inconsistent(format!("a receipt could not be written: {e}")))?;
        let mut frame = Vec::with_capacity(HEAD + payload.len());
        frame.extend_from_slice(&(payload.len() as u32).to_le_bytes());
        frame.extend_from_slice(&checksum(&payload));
        frame.extend_from_slice(&payload);
        self.file.write_all_at(&frame, self.end)?;
        self.end += frame.len() as u64;
        Ok(())
    }

    /// Where the next receipt will stand.
    pub fn end(&self) -> u64 {
        self.end
    }

    pub fn sync(&self) -> Result<()> {
        Ok(self.file.sync()?)
    }
}

/// The receipts of a journal, for whoever only looks; none where there is none.
pub fn read(path: &Path) -> Result<Vec<JournalEntry>> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(frames(&bytes).into_iter().map(|(receipt, _)| receipt).collect()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(DiskError::new("read", path, error).into()),
    }
}

/// All whole frames with their ends; the first that is torn ends it.
fn frames(bytes: &[u8]) -> Vec<(JournalEntry, u64)> {
    let mut frames = Vec::new();
    let mut at = 0;
    while let Some((head, rest)) = bytes[at..].split_first_chunk::<HEAD>() {
        let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some(payload) = rest.get(..length) else { break };
        if checksum(payload) != head[4..] {
            break;
        }
        let Ok(receipt) = postcard::from_bytes(payload) else { break };
        at += HEAD + length;
        frames.push((receipt, at as u64));
    }
    frames
}

fn last_boot(frames: &[(JournalEntry, u64)]) -> Option<&str> {
    frames.iter().rev().find_map(|(receipt, _)| match receipt {
        JournalEntry::Begun { boot, .. } => Some(boot.as_str()),
        _ => None,
    })
}

fn checksum(payload: &[u8]) -> [u8; 8] {
    let hash = blake3::hash(payload);
    std::array::from_fn(|i| hash.as_bytes()[i])
}

/// Names this boot of the machine; empty where the system does not tell.
fn boot() -> String {
    let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    id.trim().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ME: ConversionKey = [1; 32];

    fn spool(unit: u32) -> JournalEntry {
        JournalEntry::Spooled { unit, end: 0 }
    }

    fn spooled(past: &ResumeState) -> Vec<u32> {
        (0..100).filter(|unit| past.has_records(*unit)).collect()
    }

    fn written(path: &Path, receipts: &[JournalEntry]) {
        let (mut journal, past) = Journal::open_in(&Disk::new(), path, ME, "a".into()).expect("opened");
        assert!(past.is_none());
        for receipt in receipts {
            journal.append(receipt).expect("appended");
        }
    }

    fn past(path: &Path, identity: ConversionKey, boot: &str) -> Option<ResumeState> {
        Journal::open_in(&Disk::new(), path, identity, boot.into()).expect("opened").1
    }

    #[test]
    fn a_killed_process_is_believed_and_a_fallen_machine_as_far_as_was_synced() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        written(&path, &[spool(3)]);
        let upto = std::fs::metadata(&path).expect("there").len();
        let (mut journal, _) = Journal::open_in(&Disk::new(), &path, ME, "a".into()).expect("opened");
        journal.append(&JournalEntry::Synced { upto }).expect("appended");
        journal.append(&spool(5)).expect("appended");
        assert_eq!(spooled(&past(&path, ME, "a").expect("a past")), [3, 5]);
        // What was not synced is gone for good, also for those who come later.
        assert_eq!(spooled(&past(&path, ME, "b").expect("a past")), [3]);
        assert_eq!(spooled(&past(&path, ME, "b").expect("a past")), [3]);
    }

    #[test]
    fn without_a_name_of_the_boot_only_what_was_synced_is_believed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        drop(Journal::open_in(&Disk::new(), &path, ME, String::new()).expect("opened"));
        assert!(past(&path, ME, "").is_none());
    }

    #[test]
    fn receipts_of_another_conversion_count_for_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        written(&path, &[spool(3)]);
        assert!(past(&path, [2; 32], "a").is_none());
        assert!(past(&path, ME, "a").is_none(), "the other conversion has begun there");
    }

    #[test]
    fn a_torn_or_changed_end_is_cut_off_wherever_it_is_torn() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        written(&path, &[spool(3), spool(4)]);
        let whole = std::fs::read(&path).expect("read");
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).expect("written");
            let units = past(&path, ME, "a").map(|p| spooled(&p)).unwrap_or_default();
            assert!(units.is_empty() || units == [3], "cut at {cut}: {units:?}");
        }
        for at in 0..whole.len() {
            let mut changed = whole.clone();
            changed[at] ^= 0x10;
            std::fs::write(&path, &changed).expect("written");
            let units = past(&path, ME, "a").map(|p| spooled(&p)).unwrap_or_default();
            assert!(units.len() < 2, "changed at {at}: {units:?}");
        }
    }

    #[test]
    fn a_slice_that_was_being_overwritten_is_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        written(&path, &[spool(1), spool(2), JournalEntry::Bucketing { unit: 1 }]);
        assert_eq!(spooled(&past(&path, ME, "a").expect("a past")), [2]);
        let (mut journal, _) = Journal::open_in(&Disk::new(), &path, ME, "a".into()).expect("opened");
        journal.append(&JournalEntry::Bucketed { unit: 1, end: 0, counts: vec![(0, 9)] }).expect("appended");
        assert_eq!(spooled(&past(&path, ME, "a").expect("a past")), [1, 2]);
    }
}
