//! The octree beside its inputs: the same multiset of points, attribute by
//! attribute and bit by bit.
//!
//! One pass over the inputs sums their records' hashes up, as the walk over the
//! octree did. Only the buckets in which the sums differ are then looked at: in
//! as many passes as the memory limit asks for, the hashes of their records are
//! sorted and counted against each other, which gives exact numbers; a last
//! pass finds some of the records themselves.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;

use rayon::prelude::*;

use super::colors;
use super::digest::{Sum, bucket_of, digest, passes};
use super::error::VerifyError;
use super::inputs::{self, RecordBlock};
use super::octree::{OctreeUnderTest, position};
use super::promises;
use super::report::{Check, Comparison, EXAMPLES, PositionError, plural};
use super::request::VerifyRequest;
use super::value;
use crate::words::grouped;

/// Hashes of a pass: each takes 16 bytes, twice while parts are put together,
/// and half of the memory is for the blocks in work.
const BYTES_PER_HASH: u64 = 64;
/// Differing records of each side that the last pass looks for.
const SOUGHT: usize = 500;

/// What the inputs hold; adds up in any order.
#[derive(Default)]
struct Inputs {
    sum: Sum,
    position: PositionError,
    unreachable: u64,
    /// Points in which a field is not zero that the octree lacks.
    lost: BTreeMap<String, u64>,
    mistyped: BTreeSet<String>,
    by_file: BTreeMap<PathBuf, u64>,
}

impl Inputs {
    fn add(&mut self, block: RecordBlock, record_size: usize) {
        block.records.chunks_exact(record_size).for_each(|record| self.sum.add(record));
        let points = (block.records.len() / record_size) as u64;
        match self.by_file.get_mut(block.input.file.path()) {
            Some(sum) => *sum += points,
            None => drop(self.by_file.insert(block.input.file.path().to_path_buf(), points)),
        }
        self.position.merge(block.converted.position);
        self.unreachable += block.converted.unreachable;
        for ((name, _), count) in block.input.mapping.left.iter().zip(block.converted.lost) {
            *self.lost.entry(name.clone()).or_default() += count;
        }
        self.mistyped.extend(block.input.mapping.mistyped.iter().cloned());
    }

    fn merge(mut self, other: Inputs) -> Inputs {
        self.sum.merge(&other.sum);
        self.position.merge(other.position);
        self.unreachable += other.unreachable;
        other.lost.into_iter().for_each(|(name, count)| *self.lost.entry(name).or_default() += count);
        self.mistyped.extend(other.mistyped);
        other.by_file.into_iter().for_each(|(path, count)| *self.by_file.entry(path).or_default() += count);
        self
    }
}

/// Holds an octree, whose records `sum` has, against its inputs.
pub fn compare(
    octree: &OctreeUnderTest,
    sum: &Sum,
    files: &[PathBuf],
    request: &VerifyRequest,
) -> Result<Comparison, VerifyError> {
    let memory_limit = request.memory_limit;
    let record_size = octree.schema.record_size();
    let found =
        inputs::fold(files, octree, Inputs::default, |i, block| i.add(block, record_size), Inputs::merge)?;
    // What lies beside the octree is not missing from it.
    let aside = inputs::fold(
        &octree.set_aside,
        octree,
        Inputs::default,
        |i, block| i.add(block, record_size),
        Inputs::merge,
    )?;
    let mut there = sum.clone();
    there.merge(&aside.sum);
    let difference = MultisetDifference::find(octree, files, &found.sum.differing(&there), memory_limit)?;
    let examples = difference.examples(octree, files)?;
    let left_out = octree.metadata.generator.as_ref().map_or(&[][..], |generator| &generator.left_out);
    Ok(Comparison {
        files: files.len() as u64,
        points: found.sum.count(),
        set_aside: aside.sum.count(),
        dropped: octree.dropped,
        missing: difference.missing,
        extra: difference.extra,
        position: found.position,
        left_out: left_out.to_vec(),
        checks: [
            points(octree, &found, aside.sum.count(), &difference, examples),
            // Each of those that were dropped may be beyond it on all axes.
            positions(&found, aside.unreachable + 3 * octree.dropped),
            attributes(octree, &found, left_out),
            promises::check(files, &found.by_file, request.damaged),
        ]
        .into_iter()
        .chain(colors::note(octree))
        .collect(),
    })
}

/// Averages come from no input.
fn compared_attributes(octree: &OctreeUnderTest) -> usize {
    octree.schema.attributes.len() - usize::from(octree.colors.is_some())
}

fn points(
    octree: &OctreeUnderTest,
    found: &Inputs,
    aside: u64,
    difference: &MultisetDifference,
    examples: Vec<String>,
) -> Check {
    let attributes = compared_attributes(octree);
    let set_aside = match aside {
        0 => String::new(),
        count => format!(", {} of them set aside", grouped(count)),
    };
    let dropped = match octree.dropped {
        0 => String::new(),
        count => format!(" ({} were dropped on request)", grouped(count)),
    };
    let summary = format!(
        "{} missing{dropped}, {} extra, of {} points with {attributes} attributes{set_aside}",
        grouped(difference.missing),
        grouped(difference.extra),
        grouped(found.sum.count())
    );
    match difference.missing + difference.extra {
        0 => Check::ok("points", summary),
        // Which ones were dropped nobody wrote down; their number must be right.
        count if difference.extra == 0 && difference.missing == octree.dropped => {
            Check { count, ..Check::note("points", summary) }
        }
        count => Check { count, examples, ..Check::wrong("points", summary) },
    }
}

fn positions(found: &Inputs, aside: u64) -> Check {
    let PositionError { world, octree_units, input_units } = found.position;
    // Outliers that were set aside may lie beyond it.
    if found.unreachable > aside {
        let count = found.unreachable - aside;
        let text = format!("{} coordinates are beyond what the octree's lattice reaches", grouped(count));
        return Check { count, ..Check::wrong("positions", text) };
    }
    if octree_units == 0.0 {
        return Check::ok("positions", "exact, every one");
    }
    let text = format!(
        "moved by at most {octree_units:.4} of the octree's unit, {input_units:.4} of the inputs' ({:.3e}, {:.3e}, {:.3e})",
        world[0], world[1], world[2]
    );
    Check::ok("positions", text)
}

fn attributes(octree: &OctreeUnderTest, found: &Inputs, left_out: &[String]) -> Check {
    let lost: Vec<(&String, &u64)> = found.lost.iter().filter(|(_, count)| **count > 0).collect();
    let is_excused = |name: &String| {
        let base = name.split_once(" (").map_or(name.as_str(), |(base, _)| base);
        left_out.iter().any(|left| left == name || left == base)
    };
    let unexcused = lost.iter().filter(|(name, _)| !is_excused(name));
    let mut examples: Vec<String> = unexcused
        .map(|(name, count)| {
            format!(
                "'{name}' is not in the octree and not 0 in {} {}",
                grouped(**count),
                plural(**count, "point", "points")
            )
        })
        .collect();
    examples
        .extend(found.mistyped.iter().map(|name| format!("'{name}' is not of the type that LAS gives it")));
    if !examples.is_empty() {
        let count = examples.len() as u64;
        let text = format!("{count} {} of the inputs lost", plural(count, "attribute", "attributes"));
        return Check { count, examples, ..Check::wrong("attributes", text) };
    }
    let all = compared_attributes(octree);
    match left_out.len() {
        0 => Check::ok(
            "attributes",
            format!("all {all}; fields of the files that are not among them are 0 throughout"),
        ),
        _ => Check::note("attributes", format!("{all}; left out on request: {}", left_out.join(", "))),
    }
}

/// The exact difference of two multisets of records.
#[derive(Default)]
struct MultisetDifference {
    /// In the inputs more often than in the octree, and the other way round.
    missing: u64,
    extra: u64,
    /// Some of their hashes.
    sought: HashMap<u128, bool>,
    sought_missing: usize,
    sought_extra: usize,
}

impl MultisetDifference {
    fn find(
        octree: &OctreeUnderTest,
        files: &[PathBuf],
        differing: &[(usize, u64)],
        memory_limit: u64,
    ) -> Result<MultisetDifference, VerifyError> {
        let mut difference = MultisetDifference::default();
        for buckets in passes(differing, memory_limit / BYTES_PER_HASH) {
            let mut inputs = hashes_of_inputs(octree, files, &buckets)?;
            let mut nodes = hashes_of_octree(octree, &buckets);
            nodes.extend(hashes_of_inputs(octree, &octree.set_aside, &buckets)?);
            inputs.par_sort_unstable();
            nodes.par_sort_unstable();
            difference.count(&inputs, &nodes);
        }
        Ok(difference)
    }

    /// Merges two sorted lists and counts what only one of them has.
    fn count(&mut self, inputs: &[u128], nodes: &[u128]) {
        let (mut i, mut n) = (0, 0);
        while i < inputs.len() || n < nodes.len() {
            match (inputs.get(i), nodes.get(n)) {
                (Some(a), Some(b)) if a == b => (i, n) = (i + 1, n + 1),
                (Some(&a), b) if b.is_none_or(|&b| a < b) => {
                    self.missing += 1;
                    self.sought_missing += 1;
                    if self.sought_missing <= SOUGHT {
                        self.sought.insert(a, true);
                    }
                    i += 1;
                }
                (_, Some(&b)) => {
                    self.extra += 1;
                    self.sought_extra += 1;
                    if self.sought_extra <= SOUGHT {
                        self.sought.insert(b, false);
                    }
                    n += 1;
                }
                _ => return,
            }
        }
    }

    /// Finds the records behind some of the differing hashes and tells them.
    fn examples(&self, octree: &OctreeUnderTest, files: &[PathBuf]) -> Result<Vec<String>, VerifyError> {
        if self.sought.is_empty() {
            return Ok(Vec::new());
        }
        let record_size = octree.schema.record_size();
        type Found = Vec<(Vec<u8>, String)>;
        let concat = |mut a: Found, b: Found| {
            a.extend(b);
            a
        };
        let take = |found: &mut Found, records: &[u8], is_missing: bool, place: &dyn Fn() -> String| {
            for record in records.chunks_exact(record_size) {
                if found.len() < 4 * SOUGHT && self.sought.get(&digest(record)) == Some(&is_missing) {
                    found.push((record.to_vec(), place()));
                }
            }
        };
        let missing = inputs::fold(
            files,
            octree,
            Found::new,
            |found, block| {
                take(found, block.records, true, &|| block.input.file.path().display().to_string());
            },
            concat,
        )?;
        let extra = fold_octree(
            octree,
            Found::new,
            |found, node, records| {
                take(found, records, false, &|| format!("node {}", octree.nodes[node].name));
            },
            concat,
        );
        Ok(tell(octree, missing, extra))
    }
}

/// Examples in words. A missing record and an extra one at the same position are
/// the same point with an attribute changed.
fn tell(
    octree: &OctreeUnderTest,
    mut missing: Vec<(Vec<u8>, String)>,
    mut extra: Vec<(Vec<u8>, String)>,
) -> Vec<String> {
    missing.sort();
    extra.sort();
    let mut texts = Vec::new();
    let mut paired = vec![false; extra.len()];
    let mut lonely = Vec::new();
    for (record, place) in &missing {
        let at = position(record);
        let partner = (0..extra.len()).find(|&e| !paired[e] && position(&extra[e].0) == at);
        let Some(partner) = partner else {
            lonely.push(format!("missing: {} ({place})", point(octree, record)));
            continue;
        };
        paired[partner] = true;
        let changes = value::differences(&octree.schema, record, &extra[partner].0).join(", ");
        texts.push(format!(
            "changed: {} in {}: {changes} ({place})",
            point(octree, record),
            extra[partner].1
        ));
    }
    texts.extend(lonely.into_iter().take(EXAMPLES));
    let unpaired = extra.iter().zip(&paired).filter(|(_, paired)| !**paired);
    texts.extend(
        unpaired
            .take(EXAMPLES)
            .map(|((record, place), _)| format!("extra: {} ({place})", point(octree, record))),
    );
    texts.truncate(2 * EXAMPLES);
    texts
}

/// A record's position as a person reads it.
fn point(octree: &OctreeUnderTest, record: &[u8]) -> String {
    let at = position(record);
    let world: [f64; 3] =
        std::array::from_fn(|a| f64::from(at[a]) * octree.metadata.scale[a] + octree.metadata.offset[a]);
    format!("{at:?} = ({:.4}, {:.4}, {:.4})", world[0], world[1], world[2])
}

fn hashes_of_inputs(
    octree: &OctreeUnderTest,
    files: &[PathBuf],
    buckets: &[bool],
) -> Result<Vec<u128>, VerifyError> {
    let record_size = octree.schema.record_size();
    let each =
        |hashes: &mut Vec<u128>, block: RecordBlock| push_hashes(hashes, block.records, record_size, buckets);
    inputs::fold(files, octree, Vec::new, each, concat_hashes)
}

fn hashes_of_octree(octree: &OctreeUnderTest, buckets: &[bool]) -> Vec<u128> {
    let record_size = octree.schema.record_size();
    let each = |hashes: &mut Vec<u128>, _: usize, records: &[u8]| {
        push_hashes(hashes, records, record_size, buckets);
    };
    fold_octree(octree, Vec::new, each, concat_hashes)
}

fn push_hashes(hashes: &mut Vec<u128>, records: &[u8], record_size: usize, buckets: &[bool]) {
    hashes.extend(records.chunks_exact(record_size).map(digest).filter(|&hash| buckets[bucket_of(hash)]));
}

fn concat_hashes(mut a: Vec<u128>, b: Vec<u128>) -> Vec<u128> {
    a.extend(b);
    a
}

/// Folds the readable nodes' records, as they are to be compared. A node that does not decode was told by
/// the walk; here its points are simply not there.
fn fold_octree<A: Send>(
    octree: &OctreeUnderTest,
    start: impl Fn() -> A + Sync + Send,
    each: impl Fn(&mut A, usize, &[u8]) + Sync + Send,
    merge: impl Fn(A, A) -> A + Sync + Send,
) -> A {
    let nodes = octree.nodes.par_iter().enumerate().filter(|(_, node)| octree.is_readable(node));
    nodes
        .fold(&start, |mut state, (index, node)| {
            let mut buffer = Vec::new();
            let _ =
                octree.blocks(node, |records| each(&mut state, index, octree.compared(records, &mut buffer)));
            state
        })
        .reduce(&start, merge)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multisets_are_counted_one_by_one() {
        let mut difference = MultisetDifference::default();
        difference.count(&[1, 2, 2, 3, 9], &[2, 3, 3, 4, 4]);
        assert_eq!((difference.missing, difference.extra), (3, 3));
    }
}
