//! Every reader of bytes that come from elsewhere, as a function of bytes: it may
//! refuse them, but must not panic, hang, or take memory that they do not justify.
//! What it accepts must hold together; that is asserted.
//!
//! Shared by the targets of cargo-fuzz and by `tests/fuzz_smoke.rs`, which runs
//! without it.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use lodestone::convert::checkpoint::journal::{self, Journal};
use lodestone::convert::checkpoint::receipt::{ResumeState, units_in};
use lodestone::format::las::{Checked, LasFile};
use lodestone::format::potree::{self, Metadata};
use lodestone::platform::disk::Disk;
use lodestone::serve::watch::marker::{self, Marker};

/// Points that are decoded of one input; a few bytes can be millions.
const MOST_POINTS: u64 = 200_000;

/// What the last panic said: those that a reader catches are no news.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

thread_local! {
    /// Whether a reader is at work on this thread.
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// To be called once, before the first input.
pub fn start() {
    let others = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| match READING.get() {
        true => *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = panic.to_string(),
        false => others(panic),
    }));
}

/// What a reader's panic says, if it panics.
pub fn attempt(reader: fn(&[u8]), bytes: &[u8]) -> Result<(), String> {
    READING.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| reader(bytes)));
    READING.set(false);
    result.map_err(|_| LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone())
}

/// Puts the bytes into a file of this thread's own.
fn with_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    thread_local! {
        static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
    }
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| {
            // In memory where that can be had: a fuzzer writes thousands a second.
            let memory = Path::new("/dev/shm");
            let at = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
            tempfile::tempdir_in(at).expect("a folder")
        });
        let path: PathBuf = folder.path().join(name);
        std::fs::write(&path, bytes).expect("written");
        read(&path);
    });
}

/// LAS headers and variable length records, in all three ways of reading.
pub fn las_header(bytes: &[u8]) {
    with_file("x.las", bytes, |path| {
        for open in [LasFile::open, LasFile::open_strictly, LasFile::open_readable] {
            match open(path) {
                Ok(file) => {
                    let header = file.header();
                    let standard = lodestone::format::las::record_length(header.point_format);
                    assert!(standard.is_some_and(|length| length <= header.record_length));
                    assert!(header.scale.iter().all(|scale| *scale != 0.0 && scale.is_finite()));
                    if !header.compressed {
                        assert!(header.points * header.record_length as u64 <= bytes.len() as u64);
                    }
                }
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
    });
}

/// LAS and LAZ to the last point; and what can be read of a broken one can be.
pub fn laz(bytes: &[u8]) {
    with_file("x.laz", bytes, |path| {
        if let Ok(file) = LasFile::open(path) {
            let _ = read_all(&file);
        }
        let Ok(mut file) = LasFile::open_readable(path) else { return };
        let promised = file.header().points + file.header().missing;
        let mut looked_at = 0;
        let sound = on_one_thread(|| {
            let seen = Mutex::new(&mut looked_at);
            file.leave_out_damaged(|points| {
                let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                **seen += points;
                **seen <= MOST_POINTS
            })
        });
        if sound.is_ok_and(|checked| checked == Checked::Whole) {
            assert_eq!(file.header().points + file.header().missing, promised);
            read_all(&file).expect("what is left can be read");
        }
    });
}

fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    thread_local! {
        static POOL: rayon::ThreadPool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .start_handler(|_| READING.set(true))
            .build()
            .expect("a thread");
    }
    POOL.with(|pool| pool.install(work))
}

fn read_all(file: &LasFile) -> Result<(), lodestone::format::las::LasError> {
    let (mut points, mut records) = (0, Vec::new());
    // Before it is cut up: a small LAZ can say that it holds billions.
    if file.header().points > 100 * MOST_POINTS {
        return Ok(());
    }
    for slice in file.slices(10_000) {
        points += u64::from(slice.points);
        if points > MOST_POINTS {
            return Ok(());
        }
        file.read(slice, &mut records)?;
        assert_eq!(records.len(), slice.points as usize * file.header().record_length);
    }
    assert_eq!(points, file.header().points);
    Ok(())
}

/// hierarchy.bin, behind eight bytes that say how long its first chunk is.
pub fn hierarchy(bytes: &[u8]) {
    let Some((first, bytes)) = bytes.split_first_chunk() else { return };
    for first in [u64::from_le_bytes(*first), bytes.len() as u64] {
        if let Ok((nodes, _)) = potree::hierarchy::inspect_hierarchy(bytes, first) {
            assert!(nodes.len() <= bytes.len() / 22 + 1);
        }
        if let Ok(nodes) = potree::read_hierarchy(bytes, first) {
            assert!(nodes.len() <= bytes.len() / 22 + 1);
        }
    }
}

/// metadata.json; what was read is written and read again as the same.
pub fn metadata(bytes: &[u8]) {
    with_file(potree::METADATA, bytes, |path| {
        let folder = path.parent().expect("in a folder");
        let Ok(metadata) = Metadata::read(folder) else { return };
        if let Ok(schema) = metadata.schema() {
            assert!(schema.record_size() > 0);
        }
        std::fs::write(path, metadata.to_json()).expect("written");
        let again = Metadata::read(folder).expect("reads what it wrote");
        assert_eq!(again.to_json(), metadata.to_json());
    });
}

/// lodestone.json.
pub fn marker(bytes: &[u8]) {
    with_file(marker::NAME, bytes, |path| {
        if let Err(message) = Marker::read(path) {
            assert!(message.contains(marker::NAME), "{message}");
        }
    });
}

/// A conversion's journal: as it lies there, and with the bytes as the payloads
/// of frames whose checksums are right.
pub fn journal(bytes: &[u8]) {
    read_journal(bytes);
    let (mut framed, mut rest) = (Vec::new(), bytes);
    while let Some((length, more)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes(*length)).min(more.len());
        let (payload, more) = more.split_at(length);
        framed.extend_from_slice(&(length as u32).to_le_bytes());
        framed.extend_from_slice(&blake3::hash(payload).as_bytes()[..8]);
        framed.extend_from_slice(payload);
        rest = more;
    }
    read_journal(&framed);
}

fn read_journal(bytes: &[u8]) {
    with_file("journal", bytes, |path| {
        let receipts = journal::read(path).expect("a file that is there");
        let units = units_in(&receipts);
        let past = ResumeState::of(receipts, true);
        assert_eq!(past.units, units);
        let _ = (past.ends(), past.has_records(0));
        if let Ok((mut journal, _)) = Journal::open(&Disk::new(), path, [0; 32]) {
            assert!(journal.clear([1; 32]).is_ok());
        }
    });
}
