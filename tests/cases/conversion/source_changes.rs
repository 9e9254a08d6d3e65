//! Sources that change while they are read: the job fails, says which file and
//! what became of it, may be tried again, and publishes nothing.

use std::fs::{self, File};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::common::judge::{IN_CORE, OUT_OF_CORE};
use crate::common::{context, listing, options_of, request, surface, write_las};
use lodestone::convert::context::Stage;
use lodestone::convert::options::Options;
use lodestone::convert::run;

/// What is done to the source, and what is said about it.
type Change = (&'static str, fn(&Path));

const CHANGES: [Change; 5] = [
    ("now has", |source| {
        let file = File::options().write(true).open(source).unwrap();
        file.set_len(file.metadata().unwrap().len() / 2).unwrap();
    }),
    ("now has 0", |source| drop(File::create(source).unwrap())),
    ("took its place", |source| {
        // As many bytes, the same time: only the file is another.
        let new = source.with_extension("new");
        fs::copy(source, &new).unwrap();
        let time = fs::metadata(source).unwrap().modified().unwrap();
        File::options().write(true).open(&new).unwrap().set_modified(time).unwrap();
        fs::rename(&new, source).unwrap();
    }),
    ("wrote to it", |source| {
        // In place and of the same length, as a copy of another version would.
        let length = fs::metadata(source).unwrap().len();
        let mut file = File::options().write(true).open(source).unwrap();
        file.seek(SeekFrom::Start(length / 3)).unwrap();
        file.write_all(&vec![0x5a; length as usize / 2]).unwrap();
    }),
    ("removed or renamed", |source| fs::rename(source, source.with_extension("moved")).unwrap()),
];

/// Converts, changes the source in a stage, and gives the error; `None` where
/// the conversion was through before the change was made.
fn changed_in(stage: Stage, source: &Path, memory: u64, change: fn(&Path)) -> Option<String> {
    let folder = source.parent().unwrap();
    let out = folder.join("out");
    let _ = fs::remove_dir_all(&out);
    fs::create_dir(&out).unwrap();
    // Long ago, so that a change has another time even on a clock that ticks
    // in hundredths.
    let past = SystemTime::now() - Duration::from_secs(3600);
    File::options().write(true).open(source).unwrap().set_modified(past).unwrap();
    let means = context(&out, 1, memory);
    let wanted = request(&[PathBuf::from(source)], &out.join("octree"), &Options::default());
    let (result, in_time) = std::thread::scope(|scope| {
        let conversion = scope.spawn(|| run::convert(&wanted, &means));
        while means.progress.snapshot().stage < stage && !conversion.is_finished() {
            std::thread::yield_now();
        }
        change(source);
        let in_time = means.progress.snapshot().stage < Stage::Publish && !conversion.is_finished();
        (conversion.join().unwrap(), in_time)
    });
    if !in_time {
        return None;
    }
    let error = result.expect_err("a changed source was published");
    assert!(error.retry_can_help(), "{error}");
    // What is gone may come back, as a mount does, and what is done be of use.
    assert!(listing(&out).is_empty() || !source.exists(), "{error}: {:?} stays", listing(&out));
    assert!(!out.join("octree").exists());
    Some(error.to_string())
}

fn every_change_is_noticed(compressed: bool, memory: u64) {
    let folder = tempfile::tempdir().unwrap();
    let original = folder.path().join("original");
    // In core the changes come at leisure; out of core it must not fit.
    let points = if memory == IN_CORE { 150_000 } else { 300_000 };
    write_las(&original, &options_of(3, compressed), &surface(3, points, 1));
    let source = folder.path().join(if compressed { "cloud.laz" } else { "cloud.las" });
    for stage in [Stage::Survey, Stage::Distribute, Stage::Index] {
        for (word, change) in CHANGES {
            // A machine may be so busy that the change comes too late.
            let error = (0..20).find_map(|_| {
                fs::copy(&original, &source).unwrap();
                changed_in(stage, &source, memory, change)
            });
            let error = error.expect("the change was made in time once");
            assert!(error.contains("cloud.la"), "{stage:?}, {word}: {error}");
            // Points that are not where they were counted may show it first.
            let reason = [word, "became shorter", "let the copy finish"].iter().any(|r| error.contains(r));
            assert!(error.contains("changed while it was") && reason, "{stage:?}, {word}: {error}");
        }
    }
}

#[test]
fn a_las_file_that_changes_in_core() {
    every_change_is_noticed(false, IN_CORE);
}

#[test]
fn a_las_file_that_changes_out_of_core() {
    every_change_is_noticed(false, OUT_OF_CORE);
}

#[test]
fn a_laz_file_that_changes_in_core() {
    every_change_is_noticed(true, IN_CORE);
}

#[test]
fn a_laz_file_that_changes_out_of_core() {
    every_change_is_noticed(true, OUT_OF_CORE);
}
