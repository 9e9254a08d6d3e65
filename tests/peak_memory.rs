//! Peak memory is the process's own: this test has one to itself.

mod common;

use std::fs;

use common::{convert, options_of, surface, write_las};
use lodestone::convert::options::Options;

/// In a daemon, a small job after a huge one.
#[test]
fn a_small_conversion_does_not_report_the_peak_of_what_was_before() {
    if let Err(error) = fs::write("/proc/self/clear_refs", "5") {
        eprintln!("a peak cannot be forgotten here: {error}");
        return;
    }
    let before = vec![1u8; 512 << 20];
    assert_eq!(before[before.len() / 2], 1, "used, so resident");
    drop(before);
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("small.las");
    write_las(&input, &options_of(1, false), &surface(1, 1_000, 1));
    let outcome = convert(&[input], &folder.path().join("octree"), &Options::default()).unwrap();
    let peaks = outcome.peak_bytes_by_stage;
    assert!(!peaks.is_empty() && peaks.values().all(|peak| *peak < 512 << 20), "{peaks:?}");
}
