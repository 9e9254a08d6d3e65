//! An octree opened for checking: its metadata, its nodes, and its points a
//! block at a time. octree.bin is read with positioned reads, never by memory
//! map: it may be anyone's file, and may be cut short while it is read.

use std::collections::HashMap;
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::color_attributes::ColorAttributes;
use super::limits::{self, Purse};
use crate::format::copc::{CopcCube, CopcEntry, CopcError, CopcFile, hierarchy};
use crate::format::las::LasFile;
use crate::format::potree::Generator;
use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::hierarchy::{inspect_hierarchy_file, most_nodes};
use crate::format::potree::metadata::{BoundingBox, HierarchyEntry};
use crate::format::potree::{self, Metadata, Node, NodeName, PotreeEncoding, PotreeError, files};
use crate::octree::attribute::{RGB_AVERAGE, RGB_ORIGINAL, Schema};
use crate::platform::disk::others::{Links, read_file};

/// Points of a block that is read at once, and its bytes.
const BLOCK: usize = 1 << 16;
const MOST_BLOCK: usize = 4 << 20;
/// Bytes of memory for nodes, however little there is for all.
const LEAST_PURSE: u64 = 64 << 20;
/// Bytes of a report at most; it names every input.
const MOST_REPORT: u64 = 64 << 20;

#[derive(Debug)]
pub struct OctreeUnderTest {
    pub metadata: Metadata,
    pub schema: Schema,
    /// The two colors of a point, where coarse levels are averaged.
    pub colors: Option<ColorAttributes>,
    /// Sorted by name.
    pub nodes: Vec<Node>,
    pub oddities: Vec<potree::hierarchy::HierarchyWarning>,
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
    body: PointStore,
}

/// Where the points are.
#[derive(Debug)]
enum PointStore {
    /// octree.bin.
    Potree(File),
    Copc(Box<CopcFile>),
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
pub enum OpenedOctree {
    Whole(Box<OctreeUnderTest>),
    /// The metadata is readable, the rest is not.
    Metadata(Box<Metadata>, PotreeError),
    Nothing(PotreeError),
}

impl OctreeUnderTest {
    /// Opens an octree for work with so many bytes of memory.
    pub fn open(folder: &Path, memory_limit: u64) -> OpenedOctree {
        let metadata = match Metadata::read(folder) {
            Ok(metadata) => metadata,
            Err(error) => return OpenedOctree::Nothing(error),
        };
        match OctreeUnderTest::open_rest(folder, &metadata, memory_limit) {
            Ok(octree) => OpenedOctree::Whole(Box::new(octree)),
            Err(error) => OpenedOctree::Metadata(Box::new(metadata), error),
        }
    }

    fn open_rest(folder: &Path, metadata: &Metadata, memory_limit: u64) -> potree::Result<OctreeUnderTest> {
        let schema = metadata.schema()?;
        let (hierarchy, length) = files::open(folder, potree::HIERARCHY)?;
        let (first, most) = (metadata.hierarchy.first_chunk_size, most_nodes(memory_limit.max(LEAST_PURSE)));
        let (nodes, oddities) = inspect_hierarchy_file(&hierarchy, length, first, most)?;
        let (file, bytes) = files::open(folder, potree::OCTREE)?;
        let (set_aside, dropped) = (set_aside(folder), dropped(folder));
        let (metadata, readable) = (metadata.clone(), HashMap::new());
        let colors = ColorAttributes::of(&metadata, &schema);
        let left_out = limits::left_out(&metadata, &schema, &nodes, &files::holes(&file, bytes), bytes);
        let purse = Purse::new((memory_limit / 2).max(LEAST_PURSE));
        Ok(OctreeUnderTest {
            metadata,
            schema,
            colors,
            nodes,
            oddities,
            bytes,
            set_aside,
            dropped,
            readable,
            left_out,
            purse,
            body: PointStore::Potree(file),
        })
    }

    /// The same of a COPC file, described as if it were an octree of Potree.
    pub fn of_copc(file: CopcFile, memory_limit: u64) -> OctreeUnderTest {
        let schema = file.schema().clone();
        let folder = file.path().parent().unwrap_or(Path::new("")).to_path_buf();
        // What lies beside others' files has nothing to do with them.
        let (set_aside, dropped) = match file.is_own() {
            true => (set_aside(&folder), dropped(&folder)),
            false => (Vec::new(), 0),
        };
        let nodes = copc_nodes(&file);
        let metadata = copc_metadata(&file, &folder, depth(&nodes));
        OctreeUnderTest {
            colors: ColorAttributes::of(&metadata, &schema),
            metadata,
            schema,
            nodes,
            oddities: Vec::new(),
            bytes: file.bytes(),
            set_aside,
            dropped,
            readable: HashMap::new(),
            left_out: HashMap::new(),
            purse: Purse::new((memory_limit / 2).max(LEAST_PURSE)),
            body: PointStore::Copc(Box::new(file)),
        }
    }

    /// The COPC file that this is.
    pub fn copc(&self) -> Option<&CopcFile> {
        match &self.body {
            PointStore::Copc(file) => Some(file),
            PointStore::Potree(_) => None,
        }
    }

    /// Why the points of a node are not read although its bytes are there.
    pub fn left_out(&self, node: &Node) -> Option<&'static str> {
        self.left_out.get(&node.name).copied()
    }

    /// Whether a node's bytes lie in octree.bin and can be as many points.
    pub fn is_readable(&self, node: &Node) -> bool {
        if self.copc().is_some() {
            return true;
        }
        let end = node.offset.checked_add(node.size);
        let fits = is_believable(&self.schema, self.metadata.encoding, node.points, node.size);
        fits && end.is_some_and(|end| end <= self.bytes)
    }

    /// Records as they are to be compared with those of the inputs.
    pub fn compared<'r>(&self, records: &'r [u8], buffer: &'r mut Vec<u8>) -> &'r [u8] {
        let Some(colors) = &self.colors else { return records };
        colors.without_means(records, self.schema.record_size(), buffer);
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
        let file = match &self.body {
            PointStore::Potree(file) => file,
            PointStore::Copc(copc) => return self.copc_block(copc, node, records, block),
        };
        if self.metadata.encoding == PotreeEncoding::Brotli {
            let unpacked = unpacked_size(&self.schema, PotreeEncoding::Brotli, node.points);
            let _memory = self.purse.take(node.size + unpacked + 2 * records).ok_or_else(|| {
                let (points, most) = (node.points, self.purse.most);
                PotreeError::Points(format!("{points} points do not fit {most} bytes of memory"))
            })?;
            let mut bytes = files::zeroed(node.size)?;
            file.read_exact_at(&mut bytes, node.offset).map_err(damaged)?;
            block(&potree::decode_node(&self.schema, PotreeEncoding::Brotli, node.points, &bytes)?);
            return Ok(());
        }
        let block_points = BLOCK.min(MOST_BLOCK / record_size).clamp(1, node.points as usize);
        let mut bytes = files::zeroed((block_points * record_size) as u64)?;
        let (mut offset, end) = (node.offset, node.offset + node.size);
        while offset < end {
            let length = ((end - offset) as usize).min(bytes.len());
            file.read_exact_at(&mut bytes[..length], offset).map_err(damaged)?;
            block(&bytes[..length]);
            offset += length as u64;
        }
        Ok(())
    }
}

impl OctreeUnderTest {
    /// A chunk is decoded whole: its bytes, its records as LAS, and those of the octree.
    fn copc_block(
        &self,
        copc: &CopcFile,
        node: &Node,
        records: u64,
        mut block: impl FnMut(&[u8]),
    ) -> potree::Result<()> {
        let damaged = |error: CopcError| PotreeError::Points(error.to_string());
        let _memory = self.purse.take(node.size + 3 * records).ok_or_else(|| {
            let (points, most) = (node.points, self.purse.most);
            PotreeError::Points(format!("{points} points do not fit {most} bytes of memory"))
        })?;
        let Some(entry) = entry_of(copc, node.name) else { return Ok(()) };
        let mut decoded = Vec::new();
        copc.reader().and_then(|mut reader| reader.read(entry, &mut decoded)).map_err(damaged)?;
        block(&decoded);
        Ok(())
    }
}

/// The entry of a node in the file's hierarchy.
pub fn entry_of(file: &CopcFile, name: NodeName) -> Option<&CopcEntry> {
    file.node_at(name.level(), name.cell())
}

fn copc_nodes(file: &CopcFile) -> Vec<Node> {
    let mut nodes: Vec<Node> = (file.nodes().iter())
        .filter_map(|entry| {
            let name = NodeName::from_cell(entry.key.level, entry.key.at.map(u64::from))?;
            let child_mask = (0..8).filter(|&index| {
                entry.key.level < hierarchy::MAX_LEVEL && file.node(entry.key.child(index)).is_some()
            });
            let child_mask = child_mask.fold(0, |mask, index| mask | 1 << index);
            let (points, offset, size) = (entry.points, entry.offset, u64::from(entry.size));
            Some(Node { name, child_mask, points, offset, size })
        })
        .collect();
    nodes.sort_unstable_by_key(|node| node.name);
    nodes
}

fn copc_metadata(file: &CopcFile, folder: &Path, depth: u32) -> Metadata {
    let CopcCube { center, halfsize } = file.cube();
    let has = |name: &str| file.schema().attributes.iter().any(|attribute| attribute.name == name);
    let lod_color = match (has(RGB_AVERAGE), has(RGB_ORIGINAL)) {
        _ if !file.is_own() => None,
        (true, _) => Some("attribute".to_string()),
        (_, true) => Some("average".to_string()),
        _ => None,
    };
    let left_out = if file.is_own() { left_out(folder) } else { Vec::new() };
    let name = file.path().file_name().map(|name| name.to_string_lossy().into_owned());
    Metadata {
        version: "2.0".to_string(),
        name: name.unwrap_or_default(),
        description: String::new(),
        points: file.front.points,
        projection: String::new(),
        crs: file.header.crs.as_ref().map(|crs| crs.text.clone()).unwrap_or_default(),
        gps_time_offset: None,
        hierarchy: HierarchyEntry { first_chunk_size: 0, step_size: 4, depth },
        offset: file.front.offset,
        scale: file.front.scale,
        spacing: file.spacing(),
        bounding_box: BoundingBox { min: center.map(|c| c - halfsize), max: center.map(|c| c + halfsize) },
        encoding: PotreeEncoding::Default,
        generator: Some(Generator {
            name: file.header.software.clone(),
            version: String::new(),
            sampling: String::new(),
            lod_color,
            left_out,
        }),
        attributes: Vec::new(),
    }
}

/// Attributes that were left out on request, as the conversion's report says.
fn left_out(folder: &Path) -> Vec<String> {
    let report = read_file(&folder.join("report.json"), Links::Followed, MOST_REPORT).ok();
    let report: Option<serde_json::Value> = report.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let names = report.and_then(|report| report["left_out"].as_array().cloned()).unwrap_or_default();
    names.iter().filter_map(|name| name.as_str().map(str::to_string)).collect()
}

/// The position at the front of a record.
pub fn position(record: &[u8]) -> [i32; 3] {
    std::array::from_fn(|i| record[4 * i..].first_chunk().map_or(0, |bytes| i32::from_le_bytes(*bytes)))
}

/// Level of the deepest node; the root's is 0.
pub fn depth(nodes: &[Node]) -> u32 {
    nodes.iter().map(|node| u32::from(node.name.level())).max().unwrap_or(0)
}

/// Points that nodes hold together.
pub fn points(nodes: &[Node]) -> u64 {
    nodes.iter().map(|node| u64::from(node.points)).sum()
}
