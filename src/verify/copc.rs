//! A COPC file, ours or anybody's: its structure byte by byte, its points, and both beside
//! the inputs. What readers trip over is told too, as notes.

mod readers;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::digest::Sum;
use super::error::VerifyError;
use super::octree::{self, OctreeUnderTest, entry_of};
use super::report::{Check, CheckOutcome, Findings, VerifyReport};
use super::request::VerifyRequest;
use super::{compare_inputs, inputs};
use crate::format::copc::hierarchy::name;
use crate::format::copc::{CopcEntry, CopcError, CopcFile};
use crate::octree::node::NodeKey;
use crate::words::{self, grouped};

/// Checks a COPC file, on the threads of the current rayon pool.
pub fn verify(request: &VerifyRequest, path: &Path, files: &[PathBuf]) -> Result<VerifyReport, VerifyError> {
    let file = match CopcFile::open(path, request.memory_limit) {
        Ok(file) => file,
        Err(error @ (CopcError::Damaged { .. } | CopcError::Las(_))) => {
            let mut report = VerifyReport::empty(request, None);
            report.checks.push(Check::wrong("file", error.to_string()));
            report.checks.push(Check::skipped("all else", "rests on what cannot be read"));
            return Ok(report);
        }
        Err(error) => return Err(error.into()),
    };
    let mut octree = OctreeUnderTest::of_copc(file, request.memory_limit);
    let Some(file) = octree.copc() else { return Ok(VerifyReport::empty(request, None)) };
    let mut report = VerifyReport::empty(request, Some(&octree.metadata));
    report.encoding = format!("LAZ of point format {}", file.front.format());
    report.nodes = octree.nodes.len() as u64;
    report.depth = octree::depth(&octree.nodes);
    report.points = octree::points(&octree.nodes);
    report.bytes = file.bytes();
    report.checks.extend([header(file), pages(file), bytes(file)]);
    report.checks.extend(readers::notes(file));
    if request.damaged {
        octree.readable = inputs::readable(files, &octree.metadata)?;
    }
    let walk = walk(&octree, !files.is_empty());
    if !files.is_empty() {
        report.against = Some(compare_inputs::compare(&octree, &walk.sum, files, request)?);
    }
    report.checks.extend(octree.copc().map(|file| walk.checks(file)).into_iter().flatten());
    report.judge();
    Ok(report)
}

/// The numbers of the header and of COPC's record that need no points.
fn header(file: &CopcFile) -> Check {
    let (front, mut wrong) = (&file.front, Findings::default());
    let mut must = |holds: bool, text: &dyn Fn() -> String| {
        if !holds {
            wrong.add(0, text);
        }
    };
    let info = &front.info;
    must(front.header_size == 375, &|| format!("the header has {} bytes, not 375", front.header_size));
    let exact = 2.0 * info.halfsize / 128.0;
    let is_spacing = info.spacing.is_finite() && info.spacing > 0.0;
    must(is_spacing, &|| format!("the spacing is {}", words::number(info.spacing)));
    must(info.is_rest_zero, &|| "reserved bytes of COPC's record are not 0".to_string());
    let said = front.points == structure_points(file);
    must(said, &|| format!("the header says {} points, nodes have {}", front.points, structure_points(file)));
    must(front.records as usize == file.records.len(), &|| {
        format!("the header says {} records, there is room for {}", front.records, file.records.len())
    });
    must(front.extended as usize == file.extended.len(), &|| {
        format!("the header says {} extended records, there are {}", front.extended, file.extended.len())
    });
    let laszip = file.record("laszip encoded", 22204).ok().flatten().unwrap_or_default();
    must(laszip.get(12..16) == Some(&[0xff; 4]), &|| {
        "the LASzip record does not say variable chunks".to_string()
    });
    must(laszip.get(2..4) == Some(&[0; 2]), &|| "the LASzip record names another coder than 0".to_string());
    let side = words::coordinate(2.0 * info.halfsize, front.scale[0]);
    let [said, usual] = [info.spacing, exact].map(words::number);
    let fine = match said == usual {
        true => format!("cube of {side}, spacing 1/128 of it"),
        false => format!("cube of {side}, spacing {said} (1/128 of it is {usual})"),
    };
    Check::of("header", wrong, fine, "numbers of the header are wrong")
}

fn structure_points(file: &CopcFile) -> u64 {
    file.nodes().iter().map(|entry| u64::from(entry.points)).sum()
}

/// Pages and entries, and the chunk table beside them.
fn pages(file: &CopcFile) -> Check {
    let mut wrong = Findings::default();
    for oddity in file.hierarchy.oddities.iter().filter(|oddity| oddity.is_wrong) {
        wrong.add(0, || oddity.text.clone());
    }
    match &file.chunk_table.1 {
        Err(reason) => wrong.add(1, || reason.clone()),
        Ok(table) => {
            let chunks = chunks(file);
            let same = table.len() == chunks.len()
                && table.iter().zip(&chunks).all(|(a, b)| *a == (u64::from(b.points), u64::from(b.size)));
            if !same {
                let (a, b) = (table.len(), chunks.len());
                wrong.add(1, || format!("the chunk table's {a} chunks are not the hierarchy's {b}"));
            }
        }
    }
    let fine = format!("{} pages, their chunks are those of the chunk table", file.hierarchy.pages.len());
    Check::of("hierarchy", wrong, fine, "faults of hierarchy and chunk table")
}

/// Nodes with points, in the order of the file.
fn chunks(file: &CopcFile) -> Vec<CopcEntry> {
    let mut chunks: Vec<CopcEntry> = file.nodes().iter().copied().filter(|entry| entry.points > 0).collect();
    chunks.sort_unstable_by_key(|entry| entry.offset);
    chunks
}

/// Every byte of the file belongs to something, and to one thing alone.
fn bytes(file: &CopcFile) -> Check {
    let front = &file.front;
    let mut parts = vec![(0, front.header_size, "the header".to_string())];
    for place in &file.records {
        parts.push((place.at, place.end(), format!("the record \"{}\" {}", place.user, place.id)));
    }
    parts.push((front.points_at, front.points_at + 8, "the chunk table's place".to_string()));
    for entry in chunks(file) {
        let end = entry.offset + u64::from(entry.size);
        parts.push((entry.offset, end, format!("the chunk of {}", name(entry.key))));
    }
    let extended_at = file.extended.first().map_or(file.bytes(), |place| place.at);
    if file.chunk_table.1.is_ok() {
        parts.push((file.chunk_table.0, extended_at, "the chunk table".to_string()));
    }
    for place in &file.extended {
        parts.push((place.at, place.end(), format!("the extended record \"{}\" {}", place.user, place.id)));
    }
    let mut wrong = Findings::default();
    tiled(&mut wrong, parts, (0, file.bytes()));
    let hierarchy = file.extended.iter().find(|place| place.is("copc", 1000));
    if let Some(place) = hierarchy {
        let pages = file.hierarchy.pages.iter();
        let pages = pages.map(|(at, size)| (*at, at + size, "a page of the hierarchy".to_string()));
        tiled(&mut wrong, pages.collect(), (place.data_at, place.end()));
    } else {
        wrong.add(0, || "there is no extended record of the hierarchy".to_string());
    }
    let fine = format!("each of {} belongs to one thing", grouped(file.bytes()));
    Check::of("bytes", wrong, fine, "places where bytes belong to nothing or to two things")
}

/// Whether parts follow one another from end to end.
fn tiled(wrong: &mut Findings, mut parts: Vec<(u64, u64, String)>, (start, end): (u64, u64)) {
    parts.sort();
    let mut at = start;
    for (index, (from, to, what)) in parts.into_iter().chain([(end, end, "the end".to_string())]).enumerate()
    {
        if from > at {
            wrong.add(index, || {
                format!("{} bytes in front of {what}, at byte {at}, belong to nothing", from - at)
            });
        } else if from < at {
            wrong.add(index, || format!("{what} at byte {from} lies on what is before it"));
        }
        at = at.max(to);
    }
}

/// What a walk over all points found; adds up in any order.
#[derive(Default)]
struct CopcPass {
    undecodable: Findings,
    outside: Findings,
    min: Option<[i32; 3]>,
    max: Option<[i32; 3]>,
    /// From return 0 on.
    returns: [u64; 16],
    /// Points whose return number is larger than their number of returns.
    beyond: u64,
    time: Option<(f64, f64)>,
    sum: Sum,
}

impl CopcPass {
    fn merge(mut self, other: CopcPass) -> CopcPass {
        self.undecodable.merge(other.undecodable);
        self.outside.merge(other.outside);
        let join = |a: Option<[i32; 3]>, b: Option<[i32; 3]>, pick: fn(i32, i32) -> i32| match (a, b) {
            (Some(a), Some(b)) => Some([0, 1, 2].map(|axis| pick(a[axis], b[axis]))),
            (a, b) => a.or(b),
        };
        (self.min, self.max) = (join(self.min, other.min, i32::min), join(self.max, other.max, i32::max));
        self.returns.iter_mut().zip(other.returns).for_each(|(a, b)| *a += b);
        self.beyond += other.beyond;
        self.time = match (self.time, other.time) {
            (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
            (a, b) => a.or(b),
        };
        self.sum.merge(&other.sum);
        self
    }

    fn add(&mut self, index: usize, node: &Boxes, file: &CopcFile, las: &[u8]) {
        for record in las.chunks_exact(file.front.record_length) {
            let stored = super::octree::position(record);
            let world = [0, 1, 2].map(|axis| file.front.world(axis, stored[axis]));
            if !node.hold(world) {
                self.outside
                    .add(index, || format!("{}: {world:?} is not in {:?}", name(node.key), node.stepped));
            }
            let (min, max) = (self.min.get_or_insert(stored), self.max.get_or_insert(stored));
            for axis in 0..3 {
                (min[axis], max[axis]) = (min[axis].min(stored[axis]), max[axis].max(stored[axis]));
            }
            self.returns[usize::from(record[14] & 15)] += 1;
            self.beyond += u64::from(record[14] & 15 > record[14] >> 4);
            let time = f64::from_le_bytes(std::array::from_fn(|byte| record[22 + byte]));
            if time.is_finite() {
                let (first, last) = self.time.get_or_insert((time, time));
                (*first, *last) = (first.min(time), last.max(time));
            }
        }
    }

    fn checks(self, file: &CopcFile) -> Vec<Check> {
        let front = &file.front;
        let readable = self.undecodable.count == 0;
        let mut checks = vec![
            Check::of("decoding", self.undecodable, "every node decodes", "nodes do not decode"),
            Check::of(
                "boxes",
                self.outside,
                "every point lies in its node's box, however a reader computes it",
                "points lie outside their node's box",
            ),
        ];
        if !readable {
            checks.push(Check::skipped("totals", "not all points could be read"));
            return checks;
        }
        let mut wrong = Findings::default();
        if let (Some(min), Some(max)) = (self.min, self.max) {
            for axis in 0..3 {
                let (a, b) = (front.world(axis, min[axis]), front.world(axis, max[axis]));
                let (low, high) = (a.min(b), a.max(b));
                // As much as decimals of text can lose.
                let unit = front.scale[axis].abs() / 2.0;
                let said = (front.min[axis], front.max[axis]);
                if (said.0 - low).abs() > unit || (said.1 - high).abs() > unit {
                    let axis = ["x", "y", "z"][axis];
                    let [from, to, low, high] = [said.0, said.1, low, high].map(words::number);
                    wrong.add(0, || {
                        format!("{axis} is said to go from {from} to {to}, it goes from {low} to {high}")
                    });
                }
            }
        }
        if front.by_return != self.returns[1..] {
            let (said, found) = (&front.by_return, &self.returns[1..]);
            wrong.add(1, || format!("points by return are said to be {said:?}, they are {found:?}"));
        }
        let time = self.time.unwrap_or((0.0, 0.0));
        let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-6 || a == b;
        if !is_near(time.0, front.info.time.0) || !is_near(time.1, front.info.time.1) {
            let said = front.info.time;
            let [from, to, first, last] = [said.0, said.1, time.0, time.1].map(words::number);
            wrong.add(2, || {
                format!("GPS times are said to go from {from} to {to}, they go from {first} to {last}")
            });
        }
        let fine = "box, points by return and GPS times are those of the points";
        checks.push(Check::of("totals", wrong, fine, "totals of the header are not those of the points"));
        checks.extend(returns(self.returns[0], self.beyond));
        debug_assert!(checks.iter().all(|check| check.outcome != CheckOutcome::Skipped));
        checks
    }
}

/// Return numbers that cannot be, which are the inputs'; nothing where there are none.
fn returns(zeros: u64, beyond: u64) -> Option<Check> {
    let odd = [
        (zeros, "have return number 0"),
        (beyond, "have a return number larger than their number of returns"),
    ];
    let odd = odd.into_iter().filter(|(count, _)| *count > 0);
    let told: Vec<String> = odd.map(|(count, what)| format!("{} points {what}", grouped(count))).collect();
    let text = format!("{}; copc-validator objects to that", told.join(", "));
    (!told.is_empty()).then(|| Check { count: zeros + beyond, ..Check::note("returns", text) })
}

/// A node's box as readers compute it.
struct Boxes {
    key: NodeKey,
    /// By halving the cube once a level, as copc.js does.
    stepped: [(f64, f64); 3],
    /// By multiples of a side, as copc-lib does.
    multiplied: [(f64, f64); 3],
}

impl Boxes {
    fn new(file: &CopcFile, key: NodeKey) -> Boxes {
        let cube = file.cube();
        let side = 2.0 * cube.halfsize / f64::from(key.level).exp2();
        let of = |axis: usize| {
            let (mut low, mut high) = (cube.center[axis] - cube.halfsize, cube.center[axis] + cube.halfsize);
            let from = low + side * f64::from(key.at[axis]);
            for bit in (0..key.level).rev() {
                let middle = low + (high - low) / 2.0;
                match key.at[axis] >> bit & 1 {
                    0 => high = middle,
                    _ => low = middle,
                }
            }
            ((low, high), (from, from + side))
        };
        let all = [0, 1, 2].map(of);
        Boxes { key, stepped: all.map(|both| both.0), multiplied: all.map(|both| both.1) }
    }

    fn hold(&self, world: [f64; 3]) -> bool {
        let holds =
            |bounds: &[(f64, f64); 3]| (0..3).all(|a| bounds[a].0 <= world[a] && world[a] <= bounds[a].1);
        holds(&self.stepped) && holds(&self.multiplied)
    }
}

/// Reads all nodes. Records are summed up only if they will be compared.
fn walk(octree: &OctreeUnderTest, with_sum: bool) -> CopcPass {
    let Some(file) = octree.copc() else { return CopcPass::default() };
    let size = octree.schema.record_size();
    let fold = |mut walk: CopcPass, index: usize| {
        let node = &octree.nodes[index];
        let Some(entry) = entry_of(file, node.name).filter(|entry| entry.points > 0) else { return walk };
        // The memory for it is accounted for by the octree's own reading of it.
        let mut read = || -> Result<(), String> {
            let mut reader = file.reader().map_err(|error| error.to_string())?;
            let las = reader.read_las(entry).map_err(|error| error.to_string())?;
            walk.add(index, &Boxes::new(file, entry.key), file, las);
            if with_sum {
                let (mut records, mut buffer) = (Vec::new(), Vec::new());
                file.convert(las, &mut records);
                octree.compared(&records, &mut buffer).chunks_exact(size).for_each(|r| walk.sum.add(r));
            }
            Ok(())
        };
        if let Err(reason) = read() {
            walk.undecodable.add(index, || format!("{}: {reason}", name(entry.key)));
        }
        walk
    };
    let nodes = (0..octree.nodes.len()).into_par_iter().with_min_len(4);
    nodes.fold(CopcPass::default, fold).reduce(CopcPass::default, CopcPass::merge)
}
