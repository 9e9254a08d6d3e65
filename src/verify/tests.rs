//! What the checker must find. Each test damages a right octree in one way and
//! expects the check that is there for it to say so.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use proptest::prelude::*;

use super::tests_support::{Draft, draft, schema};
use super::*;
use crate::format::las::{LasOptions, LasWriter};
use crate::format::potree::hierarchy::RECORD;
use crate::format::potree::{HIERARCHY, METADATA, OCTREE, PotreeEncoding};
use crate::octree::attribute::{ExtraField, Scalar};

/// Exponent of the lattice that the test clouds lie on.
const EXPONENT: i32 = 12;

/// Records of the test schema: a crumpled sheet with a clump and duplicates.
fn cloud(points: usize) -> Vec<Vec<u8>> {
    let mut state = 88172645463325252u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let record = |i: usize| {
        let (x, y) = (random() % 4096, random() % 4096);
        let position = match i % 10 {
            0 => [x / 64, y / 64, 4000],
            1 => [77, 78, 79],
            _ => [x, y, (x + y) / 3 + random() % 30],
        };
        let mut record: Vec<u8> = position.iter().flat_map(|&p| (p as i32).to_le_bytes()).collect();
        record.extend((random() as u16).to_le_bytes());
        record.extend([(random() % 8) as u8, (random() % 8) as u8, (random() % 32) as u8]);
        record.extend([random() as u8, random() as u8]);
        record.extend((random() as u16).to_le_bytes());
        record.extend((i as f64 * 0.25 - 3.0).to_le_bytes());
        record.extend(random().to_le_bytes());
        record
    };
    (0..points).map(record).collect()
}

static CLOUD: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| cloud(3000));
static DRAFT: LazyLock<Draft> = LazyLock::new(|| draft(schema(), &CLOUD, EXPONENT, 200));

/// The same points as a LAS file of format 1 with an extra field.
fn write_las(path: &Path, records: &[Vec<u8>]) {
    let serial = ExtraField {
        name: "serial".into(),
        description: String::new(),
        scalar: Scalar::U64,
        elements: 1,
        position: 28,
        scale: vec![],
        offset: vec![],
    };
    let options = LasOptions {
        version: (1, 4),
        point_format: 1,
        scale: [0.5; 3],
        offset: [10.0; 3],
        compressed: false,
        extra: vec![serial],
        crs: Vec::new(),
        software: String::new(),
    };
    let raw = records.iter().flat_map(|r| {
        let returns = r[14] | r[15] << 3;
        [&r[..14], &[returns, r[16], r[17], r[18]], &r[19..21], &r[21..29], &r[29..]].concat()
    });
    let mut writer = LasWriter::create(path, &options).unwrap();
    writer.write(&raw.collect::<Vec<u8>>()).unwrap();
    writer.finish().unwrap();
}

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// An octree that `change` may have spoiled before it was written, and the
    /// file that it was made of.
    fn with(encoding: PotreeEncoding, change: impl FnOnce(&mut Draft)) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        write_las(&folder.path().join("in.las"), &CLOUD);
        let mut draft = DRAFT.clone();
        assert!(draft.nodes.len() > 40);
        change(&mut draft);
        draft.write(&folder.path().join("octree"), encoding);
        Bench { folder }
    }

    fn right() -> Bench {
        Bench::with(PotreeEncoding::Default, |_| {})
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("octree").join(name)
    }

    /// Changes bytes of one of the octree's files.
    fn damage(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = fs::read(self.file(name)).unwrap();
        change(&mut bytes);
        fs::write(self.file(name), bytes).unwrap();
    }

    fn verify_with(&self, memory_limit: u64) -> VerifyReport {
        let request = VerifyRequest {
            octree: self.folder.path().join("octree"),
            against: vec![self.folder.path().join("in.las")],
            damaged: false,
            memory_limit,
            spacing: SpacingRule::Auto,
        };
        verify(&request).unwrap()
    }

    fn verify(&self) -> VerifyReport {
        self.verify_with(1 << 30)
    }
}

fn is_wrong(report: &VerifyReport, name: &str) -> bool {
    let compared = report.against.iter().flat_map(|against| &against.checks);
    let check = report
        .checks
        .iter()
        .chain(compared)
        .find(|check| check.name == name && check.outcome == CheckOutcome::Wrong);
    assert!(!report.ok || check.is_none());
    check.is_some()
}

/// Missing and extra points, and the first example.
fn difference(report: &VerifyReport) -> (u64, u64, String) {
    let against = report.against.as_ref().unwrap();
    let example = against.checks[0].examples.first().cloned().unwrap_or_default();
    (against.missing, against.extra, example)
}

#[test]
fn a_right_octree_is_right() {
    for encoding in [PotreeEncoding::Default, PotreeEncoding::Brotli] {
        let report = Bench::with(encoding, |_| {}).verify();
        assert!(report.ok, "{report}");
        assert_eq!((report.points, difference(&report)), (3000, (0, 0, String::new())));
        assert!(report.checks.iter().all(|check| check.outcome == CheckOutcome::Ok), "{report}");
    }
}

#[test]
fn a_lost_point_is_missing() {
    let report = Bench::with(PotreeEncoding::Default, |draft| {
        let (node, records) = draft.nodes.last_mut().unwrap();
        node.points -= 1;
        records.truncate(records.len() - draft.schema.record_size());
    })
    .verify();
    let (missing, extra, example) = difference(&report);
    assert_eq!((missing, extra, report.ok), (1, 0, false));
    assert!(example.starts_with("missing: ["), "{example}");
}

#[test]
fn a_doubled_point_is_extra() {
    let report = Bench::with(PotreeEncoding::Brotli, |draft| {
        let (node, records) = draft.nodes.last_mut().unwrap();
        node.points += 1;
        records.extend_from_within(..draft.schema.record_size());
    })
    .verify();
    let (missing, extra, example) = difference(&report);
    assert_eq!((missing, extra, report.ok), (0, 1, false));
    assert!(example.starts_with("extra: ["), "{example}");
}

/// As many points as before, and each of them an input's: sums of counts see
/// nothing, and neither would a set.
#[test]
fn a_point_replaced_by_another_is_found() {
    let report = Bench::with(PotreeEncoding::Default, |draft| {
        let size = draft.schema.record_size();
        draft.nodes.last_mut().unwrap().1.copy_within(..size, size);
    })
    .verify();
    assert_eq!((difference(&report).0, difference(&report).1), (1, 1));
}

#[test]
fn one_bit_in_any_byte_of_a_record_is_found() {
    let names = schema().attributes.into_iter().flat_map(|a| vec![a.name.clone(); a.size()]);
    for (byte, name) in names.enumerate() {
        let bit = byte % 8;
        let bench = Bench::right();
        bench.damage(OCTREE, |bytes| {
            let last = bytes.len() - schema().record_size();
            bytes[last + byte] ^= 1 << bit;
        });
        let report = bench.verify();
        let (missing, extra, example) = difference(&report);
        assert_eq!((missing, extra, report.ok), (1, 1, false), "byte {byte}");
        // The point is told with its attribute, or as another point if it moved.
        match name.as_str() {
            "position" => assert!(example.starts_with("missing: "), "{example}"),
            _ => assert!(
                example.starts_with("changed: ") && example.contains(&format!(": {name}: ")),
                "{example}"
            ),
        }
    }
}

/// Little memory makes more passes, not other numbers.
#[test]
fn counts_do_not_depend_on_memory() {
    let bench = Bench::right();
    bench.damage(OCTREE, |bytes| bytes.iter_mut().step_by(500).for_each(|byte| *byte ^= 1));
    let plenty = bench.verify();
    let scarce = bench.verify_with(1);
    assert!(difference(&plenty).0 > 100);
    assert_eq!(difference(&plenty), difference(&scarce));
}

#[test]
fn a_wrong_mask_is_found() {
    let records = fs::read(Bench::right().file(HIERARCHY)).unwrap().len() / RECORD;
    for record in 0..records {
        let bench = Bench::right();
        bench.damage(HIERARCHY, |bytes| bytes[record * RECORD + 1] ^= 1 << (record % 8));
        let report = bench.verify();
        assert!(!report.ok, "record {record}: {report}");
    }
}

#[test]
fn overlaps_and_holes_of_ranges_are_found() {
    let bench = Bench::right();
    bench.damage(HIERARCHY, |bytes| {
        let offset = bytes[6..14].to_vec();
        bytes[RECORD + 6..RECORD + 14].copy_from_slice(&offset);
    });
    assert!(is_wrong(&bench.verify(), "bytes"));
    let bench = Bench::right();
    bench.damage(OCTREE, |bytes| bytes.push(0));
    let report = bench.verify();
    assert!(is_wrong(&report, "bytes"));
    assert_eq!((difference(&report).0, difference(&report).1), (0, 0));
    let bench = Bench::right();
    bench.damage(OCTREE, |bytes| bytes.truncate(bytes.len() - 1));
    assert!(is_wrong(&bench.verify(), "bytes"));
}

#[test]
fn points_outside_their_box_are_found() {
    let report = Bench::with(PotreeEncoding::Default, |draft| {
        let leaves: Vec<usize> = (1..draft.nodes.len()).collect();
        let (a, b) = (leaves[0], leaves[leaves.len() - 1]);
        let points = draft.nodes[a].0.points;
        (draft.nodes[a].0.points, draft.nodes[b].0.points) = (draft.nodes[b].0.points, points);
        let records = std::mem::take(&mut draft.nodes[a].1);
        draft.nodes[a].1 = std::mem::replace(&mut draft.nodes[b].1, records);
    })
    .verify();
    assert!(is_wrong(&report, "boxes"), "{report}");
    assert_eq!((difference(&report).0, difference(&report).1), (0, 0));
}

#[test]
fn points_too_close_in_an_inner_node_are_found() {
    // A point of a leaf, put into the root beside one that is there.
    let spoil = |draft: &mut Draft| {
        let size = draft.schema.record_size();
        let mut close = draft.nodes[0].1[..size].to_vec();
        close[0] ^= 1;
        draft.nodes[0].1.extend(close);
        draft.nodes[0].0.points += 1;
    };
    let ours = Bench::with(PotreeEncoding::Default, spoil).verify();
    assert!(is_wrong(&ours, "spacing"), "{ours}");
    // Another's octree is not held to our rule.
    let bench = Bench::with(PotreeEncoding::Default, |draft| {
        spoil(draft);
        draft.metadata.generator = None;
    });
    let foreign = bench.verify();
    let check = foreign.checks.iter().find(|check| check.name == "spacing").unwrap();
    assert_eq!((check.outcome, check.count), (CheckOutcome::Note, 1));
}

#[test]
fn crowded_cells_of_a_grid_sample_are_found() {
    let random = |draft: &mut Draft| draft.metadata.generator.as_mut().unwrap().sampling = "random".into();
    let crowd = |draft: &mut Draft| {
        let size = draft.schema.record_size();
        draft.nodes[0].1.extend_from_within(..size);
        draft.nodes[0].0.points += 1;
    };
    let crowded = |draft: &mut Draft| {
        random(draft);
        crowd(draft);
    };
    // Two points a spacing apart can share a cell, so the Poisson sample of the
    // bench breaks this rule too: one point more is one breach more.
    let breaches =
        |report: VerifyReport| report.checks.iter().find(|check| check.name == "spacing").unwrap().count;
    let before = breaches(Bench::with(PotreeEncoding::Default, random).verify());
    let report = Bench::with(PotreeEncoding::Default, crowded).verify();
    assert!(is_wrong(&report, "spacing"));
    assert_eq!(breaches(report), before + 1);
}

#[test]
fn wrong_numbers_in_the_metadata_are_found() {
    let change = |from: &str, to: &str| {
        let bench = Bench::right();
        bench.damage(METADATA, |bytes| {
            let text = String::from_utf8(bytes.clone()).unwrap();
            assert!(text.contains(from), "{from} in {text}");
            *bytes = text.replacen(from, to, 1).into_bytes();
        });
        bench.verify()
    };
    assert!(is_wrong(&change("\"points\": 3000", "\"points\": 3001"), "points"));
    assert!(is_wrong(&change("\"depth\": ", "\"depth\": 1"), "hierarchy"));
    assert!(is_wrong(&change("\"version\": \"2.0\"", "\"version\": \"1.8\""), "metadata"));
    assert!(is_wrong(&change("\"spacing\": ", "\"spacing\": -"), "metadata"));
    assert!(is_wrong(&change("\"max\": [2058.0, ", "\"max\": [2059.0, "), "metadata"));
    assert!(is_wrong(&change("\"histogram\": [", "\"histogram\": [1"), "statistics"));
    assert!(is_wrong(&change("\"name\": \"gps-time\"", "\"name\": \"gps_time\""), "attributes"));
}

/// An attribute that the octree lacks may be zero throughout, or left out on
/// request, and nothing else.
#[test]
fn lost_attributes_are_found() {
    let without = |left_out: &[&str]| {
        let bench = Bench::with(PotreeEncoding::Default, |draft| {
            let size = draft.schema.record_size();
            draft.schema.attributes.pop();
            for (_, records) in &mut draft.nodes {
                *records = records.chunks(size).flat_map(|record| record[..size - 8].to_vec()).collect();
            }
            let generator = draft.metadata.generator.as_mut().unwrap();
            generator.left_out = left_out.iter().map(|name| name.to_string()).collect();
        });
        bench.verify()
    };
    assert!(is_wrong(&without(&[]), "attributes"));
    assert!(is_wrong(&without(&["intensity"]), "attributes"));
    let excused = without(&["serial"]);
    assert!(excused.ok, "{excused}");
    assert_eq!(difference(&excused), (0, 0, String::new()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever byte of whatever file changes: a report, never a panic; and no
    /// change of a point goes unseen.
    #[test]
    fn damage_never_panics(
        which in 0usize..3,
        brotli in any::<bool>(),
        at in any::<prop::sample::Index>(),
        xor in 1u8..=255,
    ) {
        let bench = Bench::with(if brotli { PotreeEncoding::Brotli } else { PotreeEncoding::Default }, |_| {});
        let name = [METADATA, HIERARCHY, OCTREE][which];
        bench.damage(name, |bytes| {
            let at = at.index(bytes.len());
            bytes[at] ^= xor;
        });
        let report = bench.verify();
        // In metadata.json a letter of a description may change.
        prop_assert!(which == 0 || !report.ok, "{}", report);
    }
}
