//! Publish: metadata and hierarchy are written beside the points, and what a COPC file
//! has around its points; all is made to last, and the finished folder takes its place by one rename. Until then
//! an older octree of that name stays as it was.

use std::path::Path;

use super::context::{Context, Stage};
use super::copc::{self, CopcOutput};
use super::error::{Result, StageError};
use super::options::{Encoding, LodColor, Options};
use super::values::block::{COPC, NodeEntry, OCTREE};
use super::values::finished_files::{FinishedFile, OctreeContents};
use crate::format::las::GpsEpoch;
use crate::format::potree::metadata::{BoundingBox, HierarchyEntry};
use crate::format::potree::{self, Generator, Metadata, NodeName};
use crate::platform::disk::Disk;

/// What was made, without the report about it.
pub struct Completed {
    /// Nodes of the octree, or where none is written, of the COPC file.
    pub nodes: u64,
    /// Level of the deepest of them.
    pub depth: u32,
    /// Bytes of all files.
    pub bytes: u64,
    pub copc: Option<CopcOutput>,
}

/// Checks the sums and writes what is missing but for the name.
pub fn complete(
    octree: &OctreeContents,
    staging: &Path,
    output: &Path,
    options: &Options,
    context: &Context,
) -> Result<Completed> {
    context.progress.begin(Stage::Publish, octree.survey.points);
    let disk = &context.disk;
    let mut completed = Completed { nodes: 0, depth: 0, bytes: 0, copc: None };
    if let (Some(finished), Some(plan)) = (&octree.files[COPC], &octree.survey.copc) {
        check_sums(octree, finished, finished.end - plan.points_start)?;
        let file = copc::complete(plan, octree, finished)?;
        completed = Completed { nodes: file.nodes, depth: file.depth, bytes: file.bytes, copc: Some(file) };
    }
    if let Some(finished) = &octree.files[OCTREE] {
        check_sums(octree, finished, finished.end)?;
        finished.file.sync()?;
        let nodes: Vec<potree::Node> = finished.nodes.iter().filter_map(potree_node).collect();
        let hierarchy =
            potree::write_hierarchy(&nodes).map_err(|e| StageError::Inconsistent(e.to_string()))?;
        let metadata = metadata(octree, &hierarchy, output, options);
        let json = metadata.to_json();
        for (name, bytes) in
            [(potree::HIERARCHY, hierarchy.bytes.as_slice()), (potree::METADATA, json.as_bytes())]
        {
            let file = disk.create(&staging.join(name))?;
            file.write_all_at(bytes, 0)?;
            file.sync()?;
        }
        (completed.nodes, completed.depth) = (nodes.len() as u64, hierarchy.depth);
        completed.bytes += finished.end + hierarchy.bytes.len() as u64 + json.len() as u64;
    }
    disk.sync_dir(staging)?;
    Ok(completed)
}

/// Every point is in a node, and every byte belongs to one.
fn check_sums(octree: &OctreeContents, finished: &FinishedFile, length: u64) -> Result<()> {
    let points: u64 = finished.nodes.iter().map(|n| u64::from(n.points)).sum();
    let bytes: u64 = finished.nodes.iter().map(|n| n.size).sum();
    if points + octree.aside != octree.survey.points {
        let (expected, aside) = (octree.survey.points, octree.aside);
        return Err(StageError::Inconsistent(format!(
            "{points} of {expected} points are in nodes and {aside} are set aside"
        )));
    }
    if bytes != length {
        return Err(StageError::Inconsistent(format!("{bytes} of {length} bytes are accounted for")));
    }
    Ok(())
}

fn potree_node(entry: &NodeEntry) -> Option<potree::Node> {
    let name = NodeName::from_cell(entry.node.level, entry.node.at.map(u64::from))?;
    // A node without points has no place in the file.
    let offset = if entry.size == 0 { 0 } else { entry.offset };
    Some(potree::Node { name, child_mask: 0, points: entry.points, offset, size: entry.size })
}

fn metadata(
    octree: &OctreeContents,
    hierarchy: &potree::Hierarchy,
    output: &Path,
    options: &Options,
) -> Metadata {
    let survey = octree.survey;
    let (lattice, cube) = (&survey.lattice, &survey.cube);
    let min: [f64; 3] = std::array::from_fn(|a| lattice.world(a, i64::from(cube.corner[a])));
    let schema = &survey.unified.schema;
    let from_folder = || output.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Metadata {
        version: "2.0".into(),
        name: options.name.clone().unwrap_or_else(from_folder),
        description: String::new(),
        points: survey.points - octree.aside,
        projection: survey.projection.clone(),
        crs: survey.crs.clone(),
        gps_time_offset: match survey.gps_time {
            // What all files had before LAS 1.5 needs no word.
            None | Some(GpsEpoch::Week | GpsEpoch::ADJUSTED) => None,
            Some(GpsEpoch::Standard { offset }) => Some(offset),
        },
        hierarchy: HierarchyEntry {
            first_chunk_size: hierarchy.first_chunk_size,
            step_size: 4,
            depth: hierarchy.depth,
        },
        offset: lattice.offset,
        scale: lattice.scale,
        spacing: cube.spacing(),
        bounding_box: BoundingBox { min, max: min.map(|c| c + cube.side()) },
        encoding: match options.encoding {
            Encoding::Default => potree::PotreeEncoding::Default,
            Encoding::Brotli => potree::PotreeEncoding::Brotli,
        },
        generator: Some(Generator {
            name: "lodestone".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            sampling: options.sampling.name().into(),
            lod_color: Some(LodColor::of(schema))
                .filter(|kind| *kind != LodColor::Keep)
                .map(|kind| kind.name().into()),
            left_out: survey.unified.left_out.clone(),
        }),
        attributes: schema
            .attributes
            .iter()
            .zip(&octree.statistics.attributes)
            .map(|(attribute, statistics)| potree::attribute_entry(attribute, statistics))
            .collect(),
    }
}

/// Puts the finished folder in its place; an older octree only where it may.
pub fn swap_in(disk: &Disk, staging: &Path, output: &Path, overwrite: bool) -> Result<()> {
    if overwrite {
        return Ok(disk.replace_dir(staging, output)?);
    }
    match disk.put_where_nothing_is(staging, output)? {
        true => Ok(()),
        false => Err(StageError::OutputExists(output.to_path_buf())),
    }
}
