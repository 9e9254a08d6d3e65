//! An octree opened for checking: its metadata, its nodes, and its points a
//! block at a time. octree.bin is read with positioned reads, never by memory
//! map: it may be anyone's file, and may be cut short while it is read.

use std::collections::HashMap;
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::colours::Colours;
use crate::cloud::attribute::Schema;
use crate::format::las::LasFile;
use crate::format::potree::{self, Encoding, Metadata, Node, PotreeError};

/// Points of a block that is read at once.
const BLOCK: usize = 1 << 16;

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
    let report = fs::read(folder.join("report.json")).ok();
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
    pub fn open(folder: &Path) -> Opened {
        let metadata = match Metadata::read(folder) {
            Ok(metadata) => metadata,
            Err(error) => return Opened::Nothing(error),
        };
        match Octree::open_rest(folder, &metadata) {
            Ok(octree) => Opened::Whole(Box::new(octree)),
            Err(error) => Opened::Metadata(Box::new(metadata), error),
        }
    }

    fn open_rest(folder: &Path, metadata: &Metadata) -> potree::Result<Octree> {
        let read = |name: &str| {
            let path = folder.join(name);
            move |source| PotreeError::Read { path, source }
        };
        let schema = metadata.schema()?;
        let hierarchy = fs::read(folder.join(potree::HIERARCHY)).map_err(read(potree::HIERARCHY))?;
        let (nodes, oddities) =
            potree::hierarchy::inspect_hierarchy(&hierarchy, metadata.hierarchy.first_chunk_size)?;
        let file = File::open(folder.join(potree::OCTREE)).map_err(read(potree::OCTREE))?;
        let bytes = file.metadata().map_err(read(potree::OCTREE))?.len();
        let (set_aside, dropped) = (set_aside(folder), dropped(folder));
        let (metadata, readable) = (metadata.clone(), HashMap::new());
        let colours = Colours::of(&metadata, &schema);
        Ok(Octree { metadata, schema, colours, nodes, oddities, bytes, set_aside, dropped, readable, file })
    }

    /// Whether a node's bytes lie in octree.bin and can be as many points.
    pub fn is_readable(&self, node: &Node) -> bool {
        let end = node.offset.checked_add(node.size);
        let size = u64::from(node.points) * self.schema.record_size() as u64;
        let fits = match self.metadata.encoding {
            Encoding::Default => node.size == size,
            Encoding::Brotli => (node.size == 0) == (node.points == 0),
        };
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
        if self.metadata.encoding == Encoding::Brotli {
            let mut bytes = vec![0; node.size as usize];
            self.file.read_exact_at(&mut bytes, node.offset).map_err(damaged)?;
            block(&potree::decode_node(&self.schema, Encoding::Brotli, node.points, &bytes)?);
            return Ok(());
        }
        let record_size = self.schema.record_size();
        let mut bytes = vec![0; BLOCK.min(node.points as usize) * record_size];
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
