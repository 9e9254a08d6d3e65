//! All of a COPC file that is known before its points are, and at the end what stands
//! around them.

use std::path::Path;

use super::super::error::{Result, StageError};
use super::super::folder_names::within_a_name;
use super::super::options::Options;
use super::super::values::block::OCTREE;
use super::super::values::copc_plan::CopcPlan;
use super::super::values::counted_inputs::Survey;
use super::super::values::finished_files::{FinishedFile, OctreeContents};
use super::CopcOutput;
use crate::format::copc::{
    ChunkEncoder, CopcCube, CopcEntry, Described, ENDING, FileTotals, Head, Places, Record, RecordLayout,
    tail,
};
use crate::format::las::{Created, GpsEpoch, LasFile, PassedOn};
use crate::octree::attribute::{Attribute, Scalar, Schema};
use crate::words;

/// The name of the file in the octree's folder: the octree's, as far as a file can have
/// it and is served under it.
pub fn file_name(options: &Options, output: &Path) -> String {
    let from_folder = || output.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let name = options.name.clone().unwrap_or_else(from_folder);
    let kept = |c: char| if matches!(c, '/' | '\\') || words::is_invisible(c) { '_' } else { c };
    let name: String = name.trim().trim_start_matches('.').chars().map(kept).collect();
    let name = if name.is_empty() { "cloud".to_string() } else { name };
    within_a_name(&name) + ENDING
}

impl CopcPlan {
    /// Fails where COPC cannot hold what the octree can. What is odd is noted in the
    /// survey.
    pub fn new(survey: &mut Survey) -> Result<CopcPlan> {
        let schema = &survey.unified.schema;
        let layout = RecordLayout::new(schema, &described(survey))?;
        // Fails for what no chunk can be made of.
        ChunkEncoder::new(&layout)?;
        let files: Vec<&LasFile> = survey.inputs.iter().map(|input| &input.las).collect();
        let mut notes = Vec::new();
        let wkt = Some(survey.crs.clone()).filter(|crs| crs.contains('['));
        if wkt.is_none() {
            notes.push(
                "the COPC file says nothing of where on Earth it lies, and some viewers (iTowns) refuse that; \
                 name its coordinate reference system by `--crs`, as in `--crs EPSG:25832` \
                 (`crs` in lodestone.json for the daemon)"
                    .to_string(),
            );
        }
        let head = Head {
            layout: layout.clone(),
            scale: survey.lattice.scale,
            offset: survey.lattice.offset,
            cube: CopcCube::of(&survey.lattice, &survey.cube),
            wkt,
            global_encoding: global_encoding(survey.gps_time, &files),
            created: created(&files),
            software: format!("lodestone {}", env!("CARGO_PKG_VERSION")),
            system: "OTHER".to_string(),
            shared: shared(&files, &mut notes)?,
        };
        let time_at = position_of(schema, "gps-time", Scalar::F64);
        if time_at.is_none() {
            notes.push("the points have no GPS times; in the COPC file these are 0".to_string());
        }
        survey.notes.extend(notes);
        let points_start = head.bytes_before_points()?;
        Ok(CopcPlan { layout, time_at, points_start, head })
    }
}

/// The descriptions that the inputs have for their extra fields.
fn described(survey: &Survey) -> Described {
    let mut described = Described::default();
    for (number, input) in survey.inputs.iter().enumerate() {
        let names = survey.unified.extra_names(number).iter();
        for (name, descriptor) in names.zip(input.las.extra_descriptors()) {
            descriptor.into_iter().for_each(|bytes| described.insert(name, bytes));
        }
    }
    described
}

/// What the header says of the points.
fn totals(head: &Head, octree: &OctreeContents, tail: Places) -> FileTotals {
    let schema = &octree.survey.unified.schema;
    let of = |name: &str, scalar: Scalar, elements: usize| {
        let is_it = |a: &Attribute| a.name == name && a.scalar == scalar && a.elements == elements;
        schema.attributes.iter().position(is_it).and_then(|at| octree.statistics.attributes.get(at))
    };
    let mut by_return = [0; 15];
    if let Some(counts) = of("return number", Scalar::U8, 1).and_then(|found| found.histogram.as_ref()) {
        // What says that it is no return at all has no place in the header.
        by_return.iter_mut().zip(&counts[1..]).for_each(|(to, count)| *to = *count);
    }
    let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
    if let Some(position) = of("position", Scalar::I32, 3) {
        for axis in 0..3 {
            min[axis] = head.world(axis, position.min[axis] as i32);
            max[axis] = head.world(axis, position.max[axis] as i32);
        }
    }
    let time = of("gps-time", Scalar::F64, 1).map(|time| (time.min[0], time.max[0]));
    let time = time.filter(|(first, last)| first <= last);
    FileTotals { points: octree.survey.points - octree.aside, by_return, min, max, time, tail }
}

fn position_of(schema: &Schema, name: &str, scalar: Scalar) -> Option<usize> {
    let is_so = schema.attributes.iter().any(|a| a.name == name && a.scalar == scalar && a.elements == 1);
    schema.offset_of(name).filter(|_| is_so)
}

/// What GPS times are, and of the other bits those that all inputs have: waveforms and
/// returns that were made up.
fn global_encoding(gps_time: Option<GpsEpoch>, files: &[&LasFile]) -> u16 {
    const OTHERS: u16 = 0b1110;
    let common = files.iter().fold(OTHERS, |common, file| common & file.header().global_encoding);
    common | u16::from(matches!(gps_time, Some(GpsEpoch::Standard { .. })))
}

/// The latest day on which an input was made; never today, or the same points would be
/// another file tomorrow.
fn created(files: &[&LasFile]) -> Option<Created> {
    files.iter().filter_map(|file| file.header().created).max()
}

/// The records that every input has, word for word.
fn shared(files: &[&LasFile], notes: &mut Vec<String>) -> Result<Vec<Record>> {
    let Some((first, others)) = files.split_first() else { return Ok(Vec::new()) };
    let mut kept: Vec<PassedOn> = first.records_to_pass_on()?;
    let mut left_out = 0;
    for other in others {
        if kept.is_empty() {
            break;
        }
        let records = other.records_to_pass_on()?;
        let before = kept.len();
        kept.retain(|record| records.contains(record));
        left_out += before - kept.len();
    }
    if left_out > 0 {
        notes.push(format!(
            "{left_out} variable length records of the first file are not in all others; the COPC file does not \
             have them"
        ));
    }
    let record = |PassedOn { user, id, description, data }| Record { user, id, description, data };
    Ok(kept.into_iter().map(record).collect())
}

/// Writes what stands before and behind the points, and makes the file last.
pub fn complete(plan: &CopcPlan, octree: &OctreeContents, finished: &FinishedFile) -> Result<CopcOutput> {
    let entries: Vec<CopcEntry> = finished
        .nodes
        .iter()
        .map(|node| CopcEntry {
            key: node.node,
            // Nodes without points have no place.
            offset: if node.points == 0 { 0 } else { node.offset },
            size: node.size as u32,
            points: node.points,
        })
        .collect();
    let tail = tail(&plan.head, finished.end, &entries, octree.statistics, octree.moments)?;
    finished.file.write_all_at(&tail.bytes, finished.end)?;
    finished.file.cut_to(finished.end + tail.bytes.len() as u64)?;
    let head = plan.head.bytes(&totals(&plan.head, octree, tail.places))?;
    if head.len() as u64 != plan.points_start {
        return Err(StageError::Inconsistent(format!(
            "{} bytes stand before the points, not {}",
            head.len(),
            plan.points_start
        )));
    }
    finished.file.write_all_at(&head, 0)?;
    finished.file.sync()?;
    let name = finished.file.path().file_name().map(|name| name.to_string_lossy().into_owned());
    Ok(CopcOutput {
        file: name.unwrap_or_default(),
        bytes: finished.end + tail.bytes.len() as u64,
        alone: octree.files[OCTREE].is_none(),
        nodes: finished.nodes.len() as u64,
        depth: finished.nodes.iter().map(|node| u32::from(node.node.level)).max().unwrap_or(0),
        point_format: plan.layout.point_format(),
        record_length: plan.layout.record_length() as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_names_that_are_served() {
        let named = |name: Option<&str>, folder: &str| {
            file_name(&Options { name: name.map(str::to_string), ..Options::default() }, Path::new(folder))
        };
        assert_eq!(named(None, "/srv/a b"), "a b.copc.laz");
        assert_eq!(named(Some("My city"), "/srv/7"), "My city.copc.laz");
        assert_eq!(named(Some("../../etc/passwd"), "/srv/7"), "_.._etc_passwd.copc.laz");
        assert_eq!(named(Some(" ..\n"), "/srv/7"), "cloud.copc.laz");
        assert!(named(Some(&"x".repeat(400)), "/srv/7").len() < 250);
    }
}
