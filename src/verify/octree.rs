//! An octree opened for checking: its metadata, its nodes, and its points a
//! block at a time. octree.bin is read with positioned reads, never by memory
//! map: it may be anyone's file, and may be cut short while it is read.

use std::collections::HashMap;
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::colours::Colours;
use super::limits::{self, Purse};
use crate::cloud::attribute::Schema;
use crate::disk::others::{Links, read_file};
use crate::format::las::LasFile;
use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::hierarchy::{inspect_hierarchy_file, most_nodes};
use crate::format::potree::{self, Encoding, Metadata, Node, NodeName, PotreeError, files};

/// Points of a block that is read at once, and its bytes.
const BLOCK: usize = 1 << 16;
const MOST_BLOCK: usize = 4 << 20;
/// Bytes of memory for nodes, however little there is for all.
const LEAST_PURSE: u64 = 64 << 20;
/// Bytes of a report at most; it names every input.
const MOST_REPORT: u64 = 64 << 20;

#[derive(Debug)]
pub struct Octree {
    pub metadata: Metadata,
    pub schema: Schema,
    /// The two colours of a point, where coarse levels are averaged.
    pub colours: Option<Colours>,
    /// Sorted by name.
    pub nodes: Vec<Node>,
    pub oddities: Vec<potree::hierarchy::Oddity>,
    /// Size of octree.bin.
    pub bytes: u64,
    /// LAS files beside it with the points that were kept out of it.
    pub set_aside: Vec<PathBuf>,
    /// Points that were left out on request, as the report beside it says.
    pub dropped: u64,
    /// Inputs that were opened beforehand for what can be read of them.
    pub readable: HashMap<PathBuf, Arc<LasFile>>,
    /// Nodes whose points are not read, and why.
    left_out: HashMap<NodeName, &'static str>,
    purse: Purse,
    file: File,
}

/// `set-aside.laz` and its kind in an octree's folder, sorted.
fn set_aside(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase());
            name.is_some_and(|name| {
                name.starts_with("set-aside") && (name.ends_with(".las") || name.ends_with(".laz"))
            })
        })
        .collect();
    files.sort();
    files
}

/// Points that the conversion's report says were dropped, as was asked for. Octrees
/// of other programs have no such report.
fn dropped(folder: &Path) -> u64 {
    let report = read_file(&folder.join("report.json"), Links::Followed, MOST_REPORT).ok();
    let report: Option<serde_json::Value> = report.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    report.and_then(|report| report["points_dropped"].as_u64()).unwrap_or(0)
}

/// How far an octree could be opened.
pub enum Opened {
    Whole(Box<Octree>),
    /// The metadata is readable, the rest is not.
    Metadata(Box<Metadata>, PotreeError),
    Nothing(PotreeError),
}

impl Octree {
    /// Opens an octree for work with so many bytes of memory.
    pub fn open(folder: &Path, memory_limit: u64) -> Opened {
        let metadata = match Metadata::read(folder) {
            Ok(metadata) => metadata,
            Err(error) => return Opened::Nothing(error),
        };
        match Octree::open_rest(folder, &metadata, memory_limit) {
            Ok(octree) => Opened::Whole(Box::new(octree)),
            Err(error) => Opened::Metadata(Box::new(metadata), error),
        }
    }

    fn open_rest(folder: &Path, metadata: &Metadata, memory_limit: u64) -> potree::Result<Octree> {
        let schema = metadata.schema()?;
        let (hierarchy, length) = files::open(folder, potree::HIERARCHY)?;
        let (first, most) = (metadata.hierarchy.first_chunk_size, most_nodes(memory_limit.max(LEAST_PURSE)));
        let (nodes, oddities) = inspect_hierarchy_file(&hierarchy, length, first, most)?;
        let (file, bytes) = files::open(folder, potree::OCTREE)?;
        let (set_aside, dropped) = (set_aside(folder), dropped(folder));
        let (metadata, readable) = (metadata.clone(), HashMap::new());
        let colours = Colours::of(&metadata, &schema);
        let left_out = limits::left_out(&metadata, &schema, &nodes, &files::holes(&file, bytes), bytes);
        let purse = Purse::new((memory_limit / 2).max(LEAST_PURSE));
        Ok(Octree {
            metadata,
            schema,
            colours,
            nodes,
            oddities,
            bytes,
            set_aside,
            dropped,
            readable,
            left_out,
            purse,
            file,
        })
    }

    /// Why the points of a node are not read although its bytes are there.
    pub fn left_out(&self, node: &Node) -> Option<&'static str> {
        self.left_out.get(&node.name).copied()
    }

    /// Whether a node's bytes lie in octree.bin and can be as many points.
    pub fn is_readable(&self, node: &Node) -> bool {
        let end = node.offset.checked_add(node.size);
        let fits = is_believable(&self.schema, self.metadata.encoding, node.points, node.size);
        fits && end.is_some_and(|end| end <= self.bytes)
    }

    /// Records as they are to be compared with those of the inputs.
    pub fn compared<'r>(&self, records: &'r [u8], buffer: &'r mut Vec<u8>) -> &'r [u8] {
        let Some(colours) = &self.colours else { return records };
        colours.without_means(records, self.schema.record_size(), buffer);
        buffer
    }

    /// Hands over the records of a node block by block, in their order.
    pub fn blocks(&self, node: &Node, mut block: impl FnMut(&[u8])) -> potree::Result<()> {
        let damaged = |error: std::io::Error| PotreeError::Points(error.to_string());
        if node.points == 0 {
            return Ok(());
        }
        if let Some(why) = self.left_out(node) {
            return Err(PotreeError::Points(why.to_string()));
        }
        let record_size = self.schema.record_size();
        // Sums and samples of a node are no larger than its records.
        let records = u64::from(node.points).saturating_mul(record_size as u64);
        if self.metadata.encoding == Encoding::Brotli {
            let unpacked = unpacked_size(&self.schema, Encoding::Brotli, node.points);
            let _memory = self.purse.take(node.size + unpacked + 2 * records).ok_or_else(|| {
                let (points, most) = (node.points, self.purse.most);
                PotreeError::Points(format!("{points} points do not fit {most} bytes of memory"))
            })?;
            let mut bytes = files::zeroed(node.size)?;
            self.file.read_exact_at(&mut bytes, node.offset).map_err(damaged)?;
            block(&potree::decode_node(&self.schema, Encoding::Brotli, node.points, &bytes)?);
            return Ok(());
        }
        let block_points = BLOCK.min(MOST_BLOCK / record_size).clamp(1, node.points as usize);
        let mut bytes = files::zeroed((block_points * record_size) as u64)?;
        let (mut offset, end) = (node.offset, node.offset + node.size);
        while offset < end {
            let length = ((end - offset) as usize).min(bytes.len());
            self.file.read_exact_at(&mut bytes[..length], offset).map_err(damaged)?;
            block(&bytes[..length]);
            offset += length as u64;
        }
        Ok(())
    }
}

/// The position at the front of a record.
pub fn position(record: &[u8]) -> [i32; 3] {
    std::array::from_fn(|i| record[4 * i..].first_chunk().map_or(0, |bytes| i32::from_le_bytes(*bytes)))
}
