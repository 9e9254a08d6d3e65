use std::path::{Path, PathBuf};

use super::*;
use crate::format::las::{LasFile, record_length};
use crate::octree::attribute::{ExtraField, Scalar};
use crate::octree::cube::Cube;
use crate::octree::lattice::{SourceGrid, choose};
use crate::octree::moments::Moments;
use crate::octree::node::NodeKey;
use crate::octree::record::{self, UnifiedSchema};
use crate::octree::statistics::Statistics;

/// Points of a small file: enough for a root and its children.
const POINTS: u32 = 3_000;

/// A COPC file with the octree's records by node, as they should be read.
struct Made {
    path: PathBuf,
    nodes: Vec<(NodeKey, Vec<u8>)>,
    layout: RecordLayout,
}

fn extra(format: u8) -> Vec<ExtraField> {
    let mut position = record_length(format).unwrap();
    [("Girth", Scalar::F32, 1), ("Colors", Scalar::U16, 3), ("extra bytes", Scalar::U8, 7)]
        .into_iter()
        .map(|(name, scalar, elements)| {
            let (description, scale, offset) = (String::new(), vec![], vec![]);
            let field =
                ExtraField { name: name.into(), description, scalar, elements, position, scale, offset };
            position += scalar.size() * elements;
            field
        })
        .collect()
}

/// Writes a file of pseudo-random records of a point format: every tenth in the root, the
/// others in its children.
fn make(folder: &Path, format: u8, scale: [f64; 3]) -> Made {
    let extra = extra(format);
    let length = record_length(format).unwrap() + 4 + 6 + 7;
    let mut state = 88_172_645_463_325_252u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut raw: Vec<u8> = (0..POINTS as usize * length).map(|_| random() as u8).collect();
    for record in raw.chunks_exact_mut(length) {
        for axis in 0..3 {
            record[4 * axis..4 * axis + 4].copy_from_slice(&((random() % 1024) as i32 - 500).to_le_bytes());
        }
    }
    let unified = UnifiedSchema::new(
        &[(record::RecordFormat { format, record_length: length, extra }, vec![0xff; length])],
        &[],
        None,
    );
    let size = unified.schema.record_size();
    let mut octree = vec![0; POINTS as usize * size];
    unified.mover(0).apply(&raw, length, &mut octree);
    for (to, from) in octree.chunks_exact_mut(size).zip(raw.chunks_exact(length)) {
        to[..12].copy_from_slice(&from[..12]);
    }
    let grid = SourceGrid { scale, offset: [500_000.0, 4_000_000.25, -3.0], min: [-500; 3], max: [523; 3] };
    let (lattice, _) = choose(&[grid], |_, _| false);
    let cube = Cube::around(&lattice);
    let mut nodes: Vec<(NodeKey, Vec<u8>)> = vec![(NodeKey::ROOT, Vec::new())];
    nodes.extend((0..8).map(|index| (NodeKey::ROOT.child(index), Vec::new())));
    for (number, record) in octree.chunks_exact(size).enumerate() {
        let stored = record::raw_position(record);
        let tree = cube.tree(stored).map(|c| c >> (cube.bits - 1) & 1);
        let child = 1 + (tree[0] << 2 | tree[1] << 1 | tree[2]) as usize;
        nodes[if number % 10 == 0 { 0 } else { child }].1.extend_from_slice(record);
    }
    let layout = RecordLayout::new(&unified.schema, &Described::default()).unwrap();
    let head = Head {
        layout: layout.clone(),
        scale: lattice.scale,
        offset: lattice.offset,
        cube: CopcCube::of(&lattice, &cube),
        wkt: Some("PROJCS[\"x\"]".into()),
        global_encoding: 1,
        created: Some(crate::format::las::Created { year: 2024, day: 60 }),
        software: "test".into(),
        system: "OTHER".into(),
        shared: vec![Record {
            user: "somebody".into(),
            id: 7,
            description: "theirs".into(),
            data: vec![1, 2],
        }],
    };
    let mut file = vec![0; head.bytes_before_points().unwrap() as usize];
    let (mut entries, mut las) = (Vec::new(), Vec::new());
    let mut encoder = ChunkEncoder::new(&layout).unwrap();
    let mut by_return = [0u64; 15];
    for (key, records) in &nodes {
        layout.promote(records, &mut las);
        let offset = file.len() as u64;
        encoder.encode(&las, &mut file).unwrap();
        let points = (records.len() / size) as u32;
        entries.push(CopcEntry { key: *key, offset, size: (file.len() as u64 - offset) as u32, points });
        for record in las.chunks_exact(layout.record_length()) {
            if let Some(count) = usize::from(record[14] & 15).checked_sub(1) {
                by_return[count] += 1;
            }
        }
    }
    let (mut statistics, mut moments) = (Statistics::empty(&unified.schema), Moments::empty(&unified.schema));
    statistics.add(&unified.schema, &octree);
    moments.add(&unified.schema, &octree);
    let tail = tail(&head, file.len() as u64, &entries, &statistics, &moments).unwrap();
    file.extend_from_slice(&tail.bytes);
    let bounds = |values: &[f64]| std::array::from_fn(|axis| head.world(axis, values[axis] as i32));
    let (min, max) = (bounds(&statistics.attributes[0].min), bounds(&statistics.attributes[0].max));
    let totals = FileTotals {
        points: u64::from(POINTS),
        by_return,
        min,
        max,
        time: Some((1.0, 2.0)),
        tail: tail.places,
    };
    let front = head.bytes(&totals).unwrap();
    file[..front.len()].copy_from_slice(&front);
    let path = folder.join("a.copc.laz");
    std::fs::write(&path, file).unwrap();
    Made { path, nodes, layout }
}

const MEMORY: u64 = 256 << 20;

#[test]
fn octree_records_come_back_from_every_format() {
    for format in 0..=10 {
        let folder = tempfile::tempdir().unwrap();
        let made = make(folder.path(), format, [0.01; 3]);
        assert!(is_copc(&made.path));
        let file = CopcFile::open(&made.path, MEMORY).unwrap();
        assert!(file.is_own(), "format {format}");
        assert_eq!(file.schema(), made.layout.schema());
        assert_eq!(file.hierarchy.oddities, []);
        let mut reader = file.reader().unwrap();
        let mut records = Vec::new();
        for (key, expected) in &made.nodes {
            reader.read(file.node(*key).unwrap(), &mut records).unwrap();
            assert!(records == *expected, "format {format}, node {key}");
        }
        let (at, table) = &file.chunk_table;
        let sizes: Vec<_> = file.nodes().iter().map(|e| (u64::from(e.points), u64::from(e.size))).collect();
        assert_eq!(table.as_ref().unwrap(), &sizes);
        assert!(*at > file.front.points_at);
        assert_eq!(file.header.crs.as_ref().unwrap().text, "PROJCS[\"x\"]");
        assert_eq!(file.header.created.unwrap().day, 60);
        assert!(file.header.notes.is_empty(), "{:?}", file.header.notes);
        assert_eq!(file.record("somebody", 7).unwrap().unwrap(), [1, 2]);
        let json: serde_json::Value =
            serde_json::from_slice(&file.record("qgis", 0).unwrap().unwrap()).unwrap();
        assert_eq!(json["stats"]["X"]["count"], POINTS);
        let last = file.extended.last().unwrap();
        assert_eq!(last.end(), file.bytes(), "extended records end the file");
    }
}

#[test]
fn points_lie_strictly_inside_of_every_box() {
    for scale in [[0.01; 3], [0.001, 0.001, 0.0001], [1e-7, 1e-7, 0.01], [0.01, 0.01, 0.004]] {
        let folder = tempfile::tempdir().unwrap();
        let made = make(folder.path(), 6, scale);
        let file = CopcFile::open(&made.path, MEMORY).unwrap();
        let CopcCube { center, halfsize } = file.cube();
        assert_eq!(file.front.info.spacing, 2.0 * halfsize / 128.0);
        let mut reader = file.reader().unwrap();
        for entry in file.nodes() {
            let side = 2.0 * halfsize / f64::from(1 << entry.key.level);
            for record in reader.read_las(entry).unwrap().chunks_exact(file.front.record_length) {
                for (axis, stored) in record::raw_position(record).into_iter().enumerate() {
                    let low = center[axis] - halfsize + side * f64::from(entry.key.at[axis]);
                    let world = file.front.world(axis, stored);
                    assert!(low < world && world < low + side, "{scale:?} {entry:?} {axis} {world}");
                }
            }
        }
    }
}

#[test]
fn others_files_have_the_las_fields_under_viewers_names() {
    let folder = tempfile::tempdir().unwrap();
    let made = make(folder.path(), 3, [0.01; 3]);
    // Another program passes our record on and changes a field.
    let mut bytes = std::fs::read(&made.path).unwrap();
    let at = bytes.windows(6).position(|w| w == b"Girth\0").unwrap();
    bytes[at] = b'B';
    std::fs::write(&made.path, bytes).unwrap();
    let file = CopcFile::open(&made.path, MEMORY).unwrap();
    assert!(!file.is_own());
    let names: Vec<&str> = file.schema().attributes.iter().map(|a| a.name.as_str()).collect();
    for name in ["position", "scan angle", "gps-time", "rgb", "Birth", "Colors0", "Colors2", "extra bytes"] {
        assert!(names.contains(&name), "{name} in {names:?}");
    }
    let mut records = Vec::new();
    file.reader().unwrap().read(file.node(NodeKey::ROOT).unwrap(), &mut records).unwrap();
    let size = file.schema().record_size();
    assert_eq!(records.len() / size, made.nodes[0].1.len() / made.layout.schema().record_size());
    assert_eq!(records[..12], made.nodes[0].1[..12]);
}

#[test]
fn it_is_a_laz_file_like_any() {
    let folder = tempfile::tempdir().unwrap();
    let made = make(folder.path(), 8, [0.01; 3]);
    let las = LasFile::open(&made.path).unwrap();
    let (mut all, mut records) = (Vec::new(), Vec::new());
    for slice in las.slices(1_000) {
        las.read(slice, &mut records).unwrap();
        all.extend_from_slice(&records);
    }
    let octree: Vec<u8> = made.nodes.iter().flat_map(|(_, records)| records.iter().copied()).collect();
    let mut expected = Vec::new();
    made.layout.promote(&octree, &mut expected);
    assert!(all == expected);
}

#[test]
fn damage_is_an_error_or_told_and_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let made = make(folder.path(), 7, [0.01; 3]);
    let whole = std::fs::read(&made.path).unwrap();
    let path = folder.path().join("b.copc.laz");
    let mut state = 1u64;
    for round in 0..300 {
        let mut bytes = whole.clone();
        for _ in 0..1 + round % 4 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Header and records, or what lies behind the points.
            let at = match state >> 33 & 1 {
                0 => (state >> 34) as usize % 1_500,
                _ => bytes.len() - 1 - (state >> 34) as usize % 2_500,
            };
            bytes[at] = (state >> 20) as u8;
        }
        if round % 10 == 0 {
            bytes.truncate(bytes.len() * (round + 1) / 301);
        }
        std::fs::write(&path, bytes).unwrap();
        let Ok(file) = CopcFile::open(&path, MEMORY) else { continue };
        let Ok(mut reader) = file.reader() else { continue };
        let mut records = Vec::new();
        for entry in file.nodes() {
            let _ = reader.read(entry, &mut records);
        }
    }
}
