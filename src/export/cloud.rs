//! What can be exported, under one roof: an octree of Potree, ours or PotreeConverter's,
//! and a COPC file, ours or anybody's.

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::ExportError;
use crate::format::copc::{CopcEntry, CopcFile};
use crate::format::finished::{self, Finished};
use crate::format::las::{GpsEpoch, Vlr};
use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::hierarchy::{inspect_hierarchy_file, most_nodes};
use crate::format::potree::{self, Metadata, PotreeEncoding, PotreeError, decode_node, files};
use crate::octree::attribute::Schema;

/// Seconds of a week: GPS times beyond are none of one.
const WEEK: f64 = 604_800.0;

/// A node with where it lies.
#[derive(Debug, Clone, Copy)]
pub struct PlacedNode {
    pub level: u8,
    pub cell: [u64; 3],
    pub points: u32,
    /// Bytes of the file.
    offset: u64,
    size: u64,
}

/// A cloud, open for reading by many threads.
pub struct CloudReader {
    pub schema: Schema,
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// The root cube: its smallest corner, and its side.
    pub corner: [f64; 3],
    pub side: f64,
    pub crs: Vec<Vlr>,
    pub gps_time: GpsEpoch,
    pub has_averages: bool,
    /// Whether all values are said to fit the point formats 0 to 5.
    pub fits_legacy: bool,
    /// In the order of the file.
    pub nodes: Vec<PlacedNode>,
    body: CloudKind,
}

enum CloudKind {
    Potree { folder: PathBuf, file: File, bytes: u64, encoding: PotreeEncoding },
    Copc(Box<CopcFile>),
}

impl CloudReader {
    /// Opens an octree's folder, the COPC file in a folder without one, or a COPC file.
    pub fn open(path: &Path, memory_limit: u64) -> Result<CloudReader, ExportError> {
        match finished::find(path) {
            Finished::Copc(file) => Ok(of_copc(CopcFile::open(&file, memory_limit)?)),
            Finished::Octree(folder) => of_potree(&folder, memory_limit)
                .map_err(|source| ExportError::Octree { path: folder.clone(), source }),
            // What cannot be opened says why; anything else is no cloud.
            Finished::Neither => match fs::File::open(path) {
                Err(error) => Err(crate::platform::disk::DiskError::new("open", path, error).into()),
                Ok(_) => Err(ExportError::NoCloud(path.to_path_buf())),
            },
        }
    }

    /// Bytes of memory that reading a node takes at most.
    pub fn cost(&self, node: &PlacedNode) -> u64 {
        let records = u64::from(node.points) * self.schema.record_size() as u64;
        match &self.body {
            CloudKind::Potree { encoding, .. } => {
                node.size + unpacked_size(&self.schema, *encoding, node.points) + records
            }
            CloudKind::Copc(_) => node.size + 3 * records,
        }
    }

    /// A node's records in the schema.
    pub fn read(&self, node: &PlacedNode) -> Result<Vec<u8>, ExportError> {
        if node.points == 0 {
            return Ok(Vec::new());
        }
        match &self.body {
            CloudKind::Copc(file) => {
                let mut records = Vec::new();
                if let Some(entry) = file.node_at(node.level, node.cell) {
                    file.reader()?.read(entry, &mut records)?;
                }
                Ok(records)
            }
            CloudKind::Potree { folder, file, bytes, encoding } => {
                let of_octree = |source| ExportError::Octree { path: folder.clone(), source };
                let end = node.offset.checked_add(node.size);
                if !is_believable(&self.schema, *encoding, node.points, node.size)
                    || end.is_none_or(|end| end > *bytes)
                {
                    let (points, size) = (node.points, node.size);
                    let what = format!("{points} points in {size} bytes of octree.bin cannot be");
                    return Err(of_octree(PotreeError::Points(what)));
                }
                let mut stored = files::zeroed(node.size).map_err(of_octree)?;
                file.read_exact_at(&mut stored, node.offset).map_err(|error| {
                    crate::platform::disk::DiskError::new("read", &folder.join(potree::OCTREE), error)
                })?;
                match encoding {
                    PotreeEncoding::Default => Ok(stored),
                    PotreeEncoding::Brotli => {
                        decode_node(&self.schema, *encoding, node.points, &stored).map_err(of_octree)
                    }
                }
            }
        }
    }
}

fn of_copc(file: CopcFile) -> CloudReader {
    let node = |entry: &CopcEntry| PlacedNode {
        level: entry.key.level,
        cell: entry.key.at.map(u64::from),
        points: entry.points,
        offset: entry.offset,
        size: u64::from(entry.size),
    };
    let mut nodes: Vec<PlacedNode> = file.nodes().iter().map(node).collect();
    nodes.sort_by_key(|node| node.offset);
    let cube = file.cube();
    CloudReader {
        schema: file.schema().clone(),
        scale: file.front.scale,
        offset: file.front.offset,
        corner: cube.center.map(|c| c - cube.halfsize),
        side: 2.0 * cube.halfsize,
        crs: file.header.crs_records.clone(),
        gps_time: file.header.gps_time,
        has_averages: file.is_own(),
        fits_legacy: true,
        nodes,
        body: CloudKind::Copc(Box::new(file)),
    }
}

fn of_potree(folder: &Path, memory_limit: u64) -> potree::Result<CloudReader> {
    let metadata = Metadata::read(folder)?;
    metadata.check_numbers()?;
    let schema = metadata.schema()?;
    let (hierarchy, length) = files::open(folder, potree::HIERARCHY)?;
    let most = most_nodes((memory_limit / 4).max(64 << 20));
    let (nodes, _) = inspect_hierarchy_file(&hierarchy, length, metadata.hierarchy.first_chunk_size, most)?;
    let (file, bytes) = files::open(folder, potree::OCTREE)?;
    let node = |node: &potree::Node| PlacedNode {
        level: node.name.level(),
        cell: node.name.cell(),
        points: node.points,
        offset: node.offset,
        size: node.size,
    };
    let mut nodes: Vec<PlacedNode> = nodes.iter().map(node).collect();
    nodes.sort_by_key(|node| node.offset);
    let max = |name: &str| {
        let attribute = metadata.attributes.iter().find(|attribute| attribute.name == name);
        attribute.and_then(|attribute| attribute.max.first().copied()).unwrap_or(0.0)
    };
    let fits = [
        ("return number", 7.0),
        ("number of returns", 7.0),
        ("classification", 31.0),
        ("classification flags", 7.0),
    ];
    let crs = metadata.crs();
    Ok(CloudReader {
        scale: metadata.scale,
        offset: metadata.offset,
        corner: metadata.bounding_box.min,
        side: metadata.bounding_box.max[0] - metadata.bounding_box.min[0],
        crs: if crs.contains('[') { vec![Vlr::wkt(crs)] } else { Vec::new() },
        gps_time: match metadata.gps_time_offset {
            Some(offset) => GpsEpoch::Standard { offset },
            // The octree does not say; no week has more seconds.
            None if max("gps-time") > WEEK => GpsEpoch::ADJUSTED,
            None => GpsEpoch::Week,
        },
        has_averages: metadata.generator.as_ref().is_some_and(|generator| generator.lod_color.is_some()),
        fits_legacy: fits.iter().all(|(name, most)| max(name) <= *most),
        nodes,
        body: CloudKind::Potree { folder: folder.to_path_buf(), file, bytes, encoding: metadata.encoding },
        schema,
    })
}
