//! A finished octree, read by the node and no further: the hierarchy by the
//! chunk of four levels, the points by the byte range. A picture of a thousand
//! million points opens as many chunks as it has to look at, not all of them.

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::{RenderError, Result};
use crate::cloud::attribute::Schema;
use crate::format::crs;
use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::{
    self, Encoding, Metadata, Node, NodeName, PotreeError, Proxy, decode_node, files,
};

/// Nodes that are held at a time, from as many chunks as were looked at; pictures
/// look at some thousands.
const MOST_NODES: usize = 1 << 20;
/// Bytes of a node's points, unpacked; a node of millions of points is of no use to a
/// viewer.
const MOST_UNPACKED: u64 = 64 << 20;

/// An octree that is open for reading.
pub struct Octree {
    pub folder: PathBuf,
    pub metadata: Metadata,
    pub schema: Schema,
    /// What a unit of each axis counts in pictures: 1, or of degrees their meters.
    unit: [f64; 3],
    hierarchy: File,
    hierarchy_bytes: u64,
    points: File,
    points_bytes: u64,
    /// Parts of octree.bin that were never written.
    holes: Vec<Range<u64>>,
    nodes: HashMap<NodeName, Node>,
    proxies: HashMap<NodeName, Proxy>,
    /// Bytes of hierarchy.bin that no chunk has claimed: chunks in circles end.
    unclaimed: u64,
    bytes_read: AtomicU64,
}

/// Meters of a degree where the cloud lies, if it counts in degrees: a picture in
/// which heights are meters and widths degrees would show a wall.
fn unit(metadata: &Metadata) -> [f64; 3] {
    let position = metadata.attributes.iter().find(|attribute| attribute.name == "position");
    let latitude = position.and_then(|p| Some((p.min.get(1)? + p.max.get(1)?) / 2.0));
    match latitude.filter(|_| crs::is_geographic(metadata.crs())) {
        None => [1.0; 3],
        Some(latitude) => {
            let angle = latitude.clamp(-89.9, 89.9).to_radians();
            // Series of the ellipsoid of WGS 84, to some centimeters.
            let north = 111_132.95 - 559.85 * (2.0 * angle).cos() + 1.17 * (4.0 * angle).cos();
            let east = 111_412.88 * angle.cos() - 93.5 * (3.0 * angle).cos() + 0.12 * (5.0 * angle).cos();
            [east, north, 1.0]
        }
    }
}

impl Octree {
    /// Opens the octree in a folder, ours or PotreeConverter's.
    pub fn open(folder: &Path) -> Result<Octree> {
        let of_octree = |source| RenderError::Octree { folder: folder.to_path_buf(), source };
        let metadata = Metadata::read(folder).map_err(of_octree)?;
        metadata.check_numbers().map_err(of_octree)?;
        let schema = metadata.schema().map_err(of_octree)?;
        let (hierarchy, hierarchy_bytes) = files::open(folder, potree::HIERARCHY).map_err(of_octree)?;
        let (points, points_bytes) = files::open(folder, potree::OCTREE).map_err(of_octree)?;
        let first = Proxy::first(metadata.hierarchy.first_chunk_size);
        let octree = Octree {
            folder: folder.to_path_buf(),
            unit: unit(&metadata),
            metadata,
            schema,
            hierarchy,
            hierarchy_bytes,
            holes: files::holes(&points, points_bytes),
            points,
            points_bytes,
            nodes: HashMap::new(),
            proxies: HashMap::from([(NodeName::ROOT, first)]),
            unclaimed: hierarchy_bytes,
            bytes_read: AtomicU64::new(0),
        };
        if octree.metadata.points == 0 {
            return Err(RenderError::Nothing { folder: folder.to_path_buf() });
        }
        Ok(octree)
    }

    /// The node of a name; `None` where there is none. Opens its chunk of the
    /// hierarchy where that was not looked at yet.
    pub fn node(&mut self, name: NodeName) -> Result<Option<Node>> {
        if let Some(proxy) = self.proxies.remove(&name) {
            self.claim(&proxy)?;
            let records = BufReader::new(files::From { file: &self.hierarchy, at: proxy.start });
            let most = MOST_NODES.saturating_sub(self.nodes.len());
            let (nodes, proxies) =
                potree::read_chunk(&proxy, records, most).map_err(|source| self.damaged(source))?;
            self.bytes_read.fetch_add(proxy.size, Ordering::Relaxed);
            self.nodes.extend(nodes.into_iter().map(|node| (node.name, node)));
            self.proxies.extend(proxies.into_iter().map(|proxy| (proxy.name, proxy)));
        }
        Ok(self.nodes.get(&name).copied())
    }

    /// No two chunks have the same bytes, or chunks in circles would never end.
    fn claim(&mut self, proxy: &Proxy) -> Result<()> {
        let end = proxy.start.checked_add(proxy.size);
        let left = self.unclaimed.checked_sub(proxy.size);
        let (Some(left), true) = (left, end.is_some_and(|end| end <= self.hierarchy_bytes)) else {
            let what = format!("the chunk of node {} ends behind the file, or chunks overlap", proxy.name);
            return Err(self.damaged(PotreeError::Hierarchy(what)));
        };
        self.unclaimed = left;
        Ok(())
    }

    /// The records of the first `take` points of a node as it is stored.
    /// Compressed nodes are read whole, as there is no other way.
    pub fn records(&self, node: &Node, take: u32) -> Result<Vec<u8>> {
        let size = match self.metadata.encoding {
            Encoding::Default => u64::from(take.min(node.points)) * self.schema.record_size() as u64,
            Encoding::Brotli => node.size,
        };
        let end = node.offset.checked_add(node.size);
        let unpacked = unpacked_size(&self.schema, self.metadata.encoding, take.min(node.points));
        if !is_believable(&self.schema, self.metadata.encoding, node.points, node.size)
            || unpacked > MOST_UNPACKED
            || end.is_none_or(|end| end > self.points_bytes)
            || self
                .holes
                .iter()
                .any(|hole| hole.start < node.offset.saturating_add(size) && node.offset < hole.end)
        {
            let (name, points, size, bytes) = (node.name, node.points, node.size, self.points_bytes);
            let what = format!(
                "node {name} is said to hold {points} points in {size} bytes of the {bytes} of octree.bin, \
                 which is not believable"
            );
            return Err(self.damaged(PotreeError::Points(what)));
        }
        let mut bytes = files::zeroed(size).map_err(|source| self.damaged(source))?;
        self.points
            .read_exact_at(&mut bytes, node.offset)
            .map_err(|source| RenderError::Read { path: self.folder.join(potree::OCTREE), source })?;
        self.bytes_read.fetch_add(size, Ordering::Relaxed);
        match self.metadata.encoding {
            Encoding::Default => Ok(bytes),
            Encoding::Brotli => decode_node(&self.schema, Encoding::Brotli, node.points, &bytes)
                .map_err(|source| self.damaged(source)),
        }
    }

    /// The position of a record in the picture's world: the octree's, or of one in
    /// degrees, meters.
    pub fn position(&self, record: &[u8]) -> [f64; 3] {
        let (scale, offset) = (&self.metadata.scale, &self.metadata.offset);
        std::array::from_fn(|i| {
            let bytes = record.get(4 * i..).and_then(|bytes| bytes.first_chunk());
            let stored = bytes.map_or(0, |bytes| i32::from_le_bytes(*bytes));
            (f64::from(stored) * scale[i] + offset[i]) * self.unit[i]
        })
    }

    fn damaged(&self, source: PotreeError) -> RenderError {
        RenderError::Octree { folder: self.folder.clone(), source }
    }

    /// Whether any prefix of a node's points is an even subsample of it.
    pub fn has_prefixes(&self) -> bool {
        let ours = self.metadata.generator.as_ref().is_some_and(|made| made.name == "lodestone");
        ours && self.metadata.encoding == Encoding::Default
    }

    /// Bytes of hierarchy and points that were read so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// The cube of a node, as positions count: its lower corner and its sides, which
    /// differ where axes have other units.
    pub fn cube(&self, name: NodeName) -> ([f64; 3], [f64; 3]) {
        let root = &self.metadata.bounding_box;
        let side = (root.max[0] - root.min[0]) / 2f64.powi(i32::from(name.level()));
        let cell = name.cell();
        let corner = |axis: usize| (root.min[axis] + cell[axis] as f64 * side) * self.unit[axis];
        (std::array::from_fn(corner), self.unit.map(|unit| side * unit))
    }

    /// A corner of the world as positions count.
    pub fn world(&self, corner: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| corner[axis] * self.unit[axis])
    }

    /// The least spacing of a level along any axis.
    pub fn least_spacing(&self, level: u8) -> f64 {
        let unit = self.unit.iter().copied().fold(f64::INFINITY, f64::min);
        self.metadata.spacing * unit / 2f64.powi(i32::from(level))
    }

    /// The greatest spacing of a level along any axis, as positions count.
    pub fn spacing(&self, level: u8) -> f64 {
        let unit = self.unit.iter().copied().fold(0.0, f64::max);
        self.metadata.spacing * unit / 2f64.powi(i32::from(level))
    }
}
