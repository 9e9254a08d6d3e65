//! COPC files to the records of their nodes: ours with the attributes of the octree that
//! they were written from, others' with the LAS fields under the names that viewers have.

use std::path::Path;

use super::descriptor;
use super::file::{CELLS, RecordedAttributes, SCHEMA_ID, SCHEMA_USER};
use super::hierarchy::{self, CopcEntry, CopcHierarchy, HierarchyLimits};
use super::source::{ChunkTable, CopcHeader, CopcSource, RecordPlace, data};
use super::{CopcCube, CopcError, Described, NodeDecoder, RecordLayout};
use crate::format::las::{Header, LasFile};
use crate::octree::attribute::{Attribute, Scalar, Schema};
use crate::octree::node::NodeKey;
use crate::octree::record::{self, UnifiedSchema};

/// Bytes of memory for a node of the hierarchy while it is read.
const BYTES_PER_NODE: u64 = 200;
/// Bytes of a node's records, unpacked, unless told otherwise.
const MAX_NODE_BYTES: u64 = 1 << 30;
/// What a LASzip record says of items of these versions.
const VERSIONS: [u16; 2] = [3, 4];

/// A COPC file, open for reading by any number of threads.
#[derive(Debug)]
pub struct CopcFile {
    source: CopcSource,
    pub front: CopcHeader,
    /// What the file says of itself as LAS: CRS, extra bytes, software.
    pub header: Header,
    pub records: Vec<RecordPlace>,
    pub extended: Vec<RecordPlace>,
    /// Where the chunk table begins; points and bytes of each chunk, or why there is none.
    pub chunk_table: ChunkTable,
    pub hierarchy: CopcHierarchy,
    version: u16,
    kind: RecordKind,
    max_node_bytes: u64,
}

/// How LAS records become records of the schema.
#[derive(Debug)]
enum RecordKind {
    Own(Box<RecordLayout>),
    Other(Box<UnifiedSchema>),
}

impl CopcFile {
    /// Opens a file for work with so many bytes of memory: the hierarchy takes no more than
    /// a quarter of it, a node's points no more than half.
    ///
    /// # Errors
    /// Where it cannot be read, is no COPC, or is too damaged to have nodes.
    pub fn open(path: &Path, memory_limit: u64) -> Result<CopcFile, CopcError> {
        let source = CopcSource::open(path)?;
        let front = CopcHeader::read(&source)?;
        let header = LasFile::open(path)?.header().clone();
        let (records, extended) = (front.plain_records(&source)?, front.extended_records(&source)?);
        let chunk_table = front.chunk_table(&source)?;
        let chunks_end = match &chunk_table.1 {
            Ok(_) => chunk_table.0,
            Err(_) => source.bytes,
        };
        let bounds = HierarchyLimits {
            root: front.info.root,
            chunks: (front.points_at + 8, chunks_end),
            end: source.bytes,
            max_nodes: (memory_limit / 4 / BYTES_PER_NODE).clamp(1 << 16, 1 << 28) as usize,
        };
        let read = |offset, length| source.read(offset, length).map_err(Failed::Copc);
        let hierarchy = hierarchy::read(&bounds, read).map_err(|failed| match failed {
            Failed::Copc(error) => error,
            Failed::Text(reason) => source.damaged(reason),
        })?;
        let version = version(&source, &records)?;
        let kind = match own_layout(&source, &front, &records, &extended)? {
            Some(layout) => RecordKind::Own(Box::new(layout)),
            None => {
                let las = record::RecordFormat {
                    format: front.format(),
                    record_length: front.record_length,
                    extra: header.extra.clone(),
                };
                RecordKind::Other(Box::new(UnifiedSchema::new(
                    &[(las, vec![0xff; front.record_length])],
                    &[],
                    None,
                )))
            }
        };
        let max_node_bytes = MAX_NODE_BYTES.min((memory_limit / 2).max(64 << 20));
        Ok(CopcFile {
            source,
            front,
            header,
            records,
            extended,
            chunk_table,
            hierarchy,
            version,
            kind,
            max_node_bytes,
        })
    }

    pub fn path(&self) -> &Path {
        &self.source.path
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.source.bytes
    }

    /// The attributes of the records that [`NodeReader::read`] gives.
    pub fn schema(&self) -> &Schema {
        match &self.kind {
            RecordKind::Own(layout) => layout.schema(),
            RecordKind::Other(unified) => &unified.schema,
        }
    }

    /// Whether the octree's attributes come back as they were, since the file is ours.
    pub fn is_own(&self) -> bool {
        matches!(self.kind, RecordKind::Own(_))
    }

    pub fn cube(&self) -> CopcCube {
        CopcCube { center: self.front.info.center, halfsize: self.front.info.halfsize }
    }

    /// World length that the root's points keep from each other, more or less.
    pub fn spacing(&self) -> f64 {
        match self.front.info.spacing {
            spacing if spacing.is_finite() && spacing > 0.0 => spacing,
            _ => 2.0 * self.front.info.halfsize / CELLS,
        }
    }

    /// Coarse nodes before fine ones; those without points are among them.
    pub fn nodes(&self) -> &[CopcEntry] {
        &self.hierarchy.nodes
    }

    pub fn node(&self, key: NodeKey) -> Option<&CopcEntry> {
        let nodes = self.nodes();
        let found = nodes.binary_search_by_key(&(key.level, key.at), |entry| (entry.key.level, entry.key.at));
        found.ok().map(|index| &nodes[index])
    }

    /// The node of a level in a cell, as octrees' names give it.
    pub fn node_at(&self, level: u8, cell: [u64; 3]) -> Option<&CopcEntry> {
        self.node(NodeKey { level, at: cell.map(|c| c as u32) })
    }

    /// The data of a record, plain or extended, if there is such.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn record(&self, user: &str, id: u16) -> Result<Option<Vec<u8>>, CopcError> {
        match data(&self.source, &self.records, user, id)? {
            Some(found) => Ok(Some(found)),
            None => data(&self.source, &self.extended, user, id),
        }
    }

    /// Reads nodes, one after the other; one for each thread.
    ///
    /// # Errors
    /// Where the points are compressed in a way that is not known.
    pub fn reader(&self) -> Result<NodeReader<'_>, CopcError> {
        let format = self.front.format();
        let extra = self.front.record_length - crate::format::las::record_length(format).unwrap_or(0);
        let decoder = NodeDecoder::new(format, extra, self.version).ok_or_else(|| {
            self.source.damaged(format!("version {} of its LAZ compression is not known", self.version))
        })?;
        Ok(NodeReader { file: self, decoder, las: Vec::new() })
    }
}

/// What reading pages fails with.
enum Failed {
    Copc(CopcError),
    Text(String),
}

impl From<String> for Failed {
    fn from(reason: String) -> Failed {
        Failed::Text(reason)
    }
}

/// Decodes nodes and keeps its memory between them.
#[derive(Debug)]
pub struct NodeReader<'a> {
    file: &'a CopcFile,
    decoder: NodeDecoder,
    las: Vec<u8>,
}

impl NodeReader<'_> {
    /// The node's records as LAS has them, in the file's order.
    ///
    /// # Errors
    /// Where its chunk cannot be read, decoded, or held in memory.
    pub fn read_las(&mut self, entry: &CopcEntry) -> Result<&[u8], CopcError> {
        let points = u64::from(entry.points);
        if points * self.file.front.record_length as u64 > self.file.max_node_bytes {
            let reason = format!("they do not fit {} bytes of memory", self.file.max_node_bytes);
            return Err(CopcError::Chunk { points, reason });
        }
        let chunk = match points {
            0 => Vec::new(),
            _ => self.file.source.read(entry.offset, u64::from(entry.size))?,
        };
        self.decoder.decode(&chunk, points, &mut self.las)?;
        Ok(&self.las)
    }

    /// The node's records with the attributes of [`CopcFile::schema`]; what was in `records`
    /// is replaced.
    ///
    /// # Errors
    /// As [`NodeReader::read_las`].
    pub fn read(&mut self, entry: &CopcEntry, records: &mut Vec<u8>) -> Result<(), CopcError> {
        self.read_las(entry)?;
        self.file.convert(&self.las, records);
        Ok(())
    }
}

impl CopcFile {
    /// Records of the schema from LAS records of this file.
    pub fn convert(&self, las: &[u8], records: &mut Vec<u8>) {
        let unified = match &self.kind {
            RecordKind::Own(layout) => return layout.demote(las, records),
            RecordKind::Other(unified) => unified,
        };
        let (length, size) = (self.front.record_length, unified.schema.record_size());
        records.clear();
        records.resize(las.len() / length * size, 0);
        unified.mover(0).apply(las, length, records);
        for (from, to) in las.chunks_exact(length).zip(records.chunks_exact_mut(size)) {
            to[..12].copy_from_slice(&from[..12]);
        }
    }
}

/// The version of the items that the LASzip record names first.
fn version(source: &CopcSource, records: &[RecordPlace]) -> Result<u16, CopcError> {
    let record = data(source, records, "laszip encoded", 22204)?;
    // Behind 34 bytes: type, size and version of each item.
    let version = record.as_ref().and_then(|data| Some(u16::from_le_bytes([*data.get(38)?, *data.get(39)?])));
    match version.filter(|version| VERSIONS.contains(version)) {
        Some(version) => Ok(version),
        None => Err(source.damaged("it has no LASzip record of a known version")),
    }
}

/// The layout that our own record tells, if the file is still what it was written as:
/// another program may have passed the record on.
fn own_layout(
    source: &CopcSource,
    front: &CopcHeader,
    records: &[RecordPlace],
    extended: &[RecordPlace],
) -> Result<Option<RecordLayout>, CopcError> {
    let find = |user: &str, id: u16| match data(source, records, user, id) {
        Ok(None) => data(source, extended, user, id),
        found => found,
    };
    let Some(json) = find(SCHEMA_USER, SCHEMA_ID)? else { return Ok(None) };
    let Ok(told) = serde_json::from_slice::<RecordedAttributes>(&json) else { return Ok(None) };
    let schema = Schema { attributes: told.attributes.into_owned() };
    if !is_sound(&schema) {
        return Ok(None);
    }
    let Ok(layout) = RecordLayout::of_format(&schema, &Described::default(), front.format()) else {
        return Ok(None);
    };
    let described = find("LASF_Spec", 4)?.unwrap_or_default();
    let is_same =
        layout.record_length() == front.record_length && descriptor::names(&described) == told.fields;
    Ok(is_same.then_some(layout))
}

/// Whether a schema is one that can be: it is anybody's JSON.
fn is_sound(schema: &Schema) -> bool {
    const MAX_ATTRIBUTES: usize = 1 << 14;
    let is_position = |a: &Attribute| (a.name.as_str(), a.scalar, a.elements) == ("position", Scalar::I32, 3);
    let elements = |a: &Attribute| (1..=usize::from(u16::MAX)).contains(&a.elements);
    schema.attributes.first().is_some_and(is_position)
        && schema.attributes.len() <= MAX_ATTRIBUTES
        && schema
            .attributes
            .iter()
            .all(|a| elements(a) && a.scale.len() == a.elements && a.offset.len() == a.elements)
        && schema.record_size() <= 1 << 17
}
