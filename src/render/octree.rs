//! A finished octree, read by the node and no further: the hierarchy by the
//! chunk of four levels, the points by the byte range. A picture of a thousand
//! million points opens as many chunks as it has to look at, not all of them. Or a COPC
//! file, whose nodes are decoded one at a time.

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::copc::CopcNodes;
use super::error::{RenderError, Result};
use crate::format::crs;
use crate::format::finished::{self, Finished};
use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::{
    self, Metadata, Node, NodeName, PotreeEncoding, PotreeError, Proxy, decode_node, files,
};
use crate::octree::attribute::Schema;

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
    source: NodeSource,
    nodes: HashMap<NodeName, Node>,
    proxies: HashMap<NodeName, Proxy>,
    /// Bytes of hierarchy.bin that no chunk has claimed: chunks in circles end.
    unclaimed: u64,
    bytes_read: AtomicU64,
}

/// Where its nodes come from.
enum NodeSource {
    Potree(PotreeFiles),
    Copc(Box<CopcNodes>),
}

/// The files of a Potree octree.
struct PotreeFiles {
    hierarchy: File,
    hierarchy_bytes: u64,
    points: File,
    points_bytes: u64,
    /// Parts of octree.bin that were never written.
    holes: Vec<Range<u64>>,
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
    /// Opens the octree in a folder, ours or PotreeConverter's; or a COPC file, by its
    /// own name or that of a folder with no octree in it.
    pub fn open(path: &Path) -> Result<Octree> {
        let octree = match finished::find(path) {
            Finished::Copc(file) => Octree::open_copc(&file)?,
            Finished::Octree(folder) => Octree::open_potree(&folder)?,
            // Their errors say what is missing.
            Finished::Neither if path.is_dir() => Octree::open_potree(path)?,
            Finished::Neither => Octree::open_copc(path)?,
        };
        match octree.metadata.points {
            0 => Err(RenderError::Nothing { folder: path.to_path_buf() }),
            _ => Ok(octree),
        }
    }

    fn open_copc(file: &Path) -> Result<Octree> {
        let (source, metadata, nodes) = CopcNodes::open(file)?;
        Ok(Octree {
            folder: file.to_path_buf(),
            unit: unit(&metadata),
            schema: source.schema().clone(),
            metadata,
            source: NodeSource::Copc(Box::new(source)),
            nodes,
            proxies: HashMap::new(),
            unclaimed: 0,
            bytes_read: AtomicU64::new(0),
        })
    }

    fn open_potree(folder: &Path) -> Result<Octree> {
        let of_octree = |source| RenderError::Octree { folder: folder.to_path_buf(), source };
        let metadata = Metadata::read(folder).map_err(of_octree)?;
        metadata.check_numbers().map_err(of_octree)?;
        let schema = metadata.schema().map_err(of_octree)?;
        let (hierarchy, hierarchy_bytes) = files::open(folder, potree::HIERARCHY).map_err(of_octree)?;
        let (points, points_bytes) = files::open(folder, potree::OCTREE).map_err(of_octree)?;
        let first = Proxy::first(metadata.hierarchy.first_chunk_size);
        let holes = files::holes(&points, points_bytes);
        Ok(Octree {
            folder: folder.to_path_buf(),
            unit: unit(&metadata),
            metadata,
            schema,
            source: NodeSource::Potree(PotreeFiles {
                hierarchy,
                hierarchy_bytes,
                points,
                points_bytes,
                holes,
            }),
            nodes: HashMap::new(),
            proxies: HashMap::from([(NodeName::ROOT, first)]),
            unclaimed: hierarchy_bytes,
            bytes_read: AtomicU64::new(0),
        })
    }

    /// The node of a name; `None` where there is none. Opens its chunk of the
    /// hierarchy where that was not looked at yet.
    pub fn node(&mut self, name: NodeName) -> Result<Option<Node>> {
        if let (NodeSource::Potree(files), Some(proxy)) = (&self.source, self.proxies.remove(&name)) {
            self.unclaimed = self.claim(&proxy, files.hierarchy_bytes)?;
            let records = BufReader::new(files::From { file: &files.hierarchy, at: proxy.start });
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
    fn claim(&self, proxy: &Proxy, hierarchy_bytes: u64) -> Result<u64> {
        let end = proxy.start.checked_add(proxy.size);
        let left = self.unclaimed.checked_sub(proxy.size);
        let (Some(left), true) = (left, end.is_some_and(|end| end <= hierarchy_bytes)) else {
            let what = format!("the chunk of node {} ends behind the file, or chunks overlap", proxy.name);
            return Err(self.damaged(PotreeError::Hierarchy(what)));
        };
        Ok(left)
    }

    /// The records of the first `take` points of a node as it is stored; of a node of a
    /// COPC file, which is in the order of the flight line, those of as many that lie
    /// evenly among its points. Compressed nodes are read whole, as there is no other
    /// way.
    pub fn records(&self, node: &Node, take: u32) -> Result<Vec<u8>> {
        let files = match &self.source {
            NodeSource::Potree(files) => files,
            NodeSource::Copc(copc) => {
                self.bytes_read.fetch_add(node.size, Ordering::Relaxed);
                return copc.records(node, take);
            }
        };
        let size = match self.metadata.encoding {
            PotreeEncoding::Default => u64::from(take.min(node.points)) * self.schema.record_size() as u64,
            PotreeEncoding::Brotli => node.size,
        };
        let end = node.offset.checked_add(node.size);
        let unpacked = unpacked_size(&self.schema, self.metadata.encoding, take.min(node.points));
        if !is_believable(&self.schema, self.metadata.encoding, node.points, node.size)
            || unpacked > MOST_UNPACKED
            || end.is_none_or(|end| end > files.points_bytes)
            || files
                .holes
                .iter()
                .any(|hole| hole.start < node.offset.saturating_add(size) && node.offset < hole.end)
        {
            let (name, points, size, bytes) = (node.name, node.points, node.size, files.points_bytes);
            let what = format!(
                "node {name} is said to hold {points} points in {size} bytes of the {bytes} of octree.bin, \
                 which is not believable"
            );
            return Err(self.damaged(PotreeError::Points(what)));
        }
        let mut bytes = files::zeroed(size).map_err(|source| self.damaged(source))?;
        files
            .points
            .read_exact_at(&mut bytes, node.offset)
            .map_err(|source| RenderError::Read { path: self.folder.join(potree::OCTREE), source })?;
        self.bytes_read.fetch_add(size, Ordering::Relaxed);
        match self.metadata.encoding {
            PotreeEncoding::Default => Ok(bytes),
            PotreeEncoding::Brotli => decode_node(&self.schema, PotreeEncoding::Brotli, node.points, &bytes)
                .map_err(|source| self.damaged(source)),
        }
    }

    /// A part of a node's records, by their places in an order of which every beginning is
    /// an even subsample where [`Octree::has_prefixes`]. Places that are not there are left
    /// out.
    ///
    /// # Errors
    /// Where they cannot be read, or what is said of them is not believable.
    pub fn range(&self, node: &Node, places: Range<u32>) -> Result<Vec<u8>> {
        let size = self.schema.record_size();
        let places = places.start.min(node.points)..places.end.min(node.points);
        if places.is_empty() {
            return Ok(Vec::new());
        }
        let bytes = places.start as usize * size..places.end as usize * size;
        if let NodeSource::Copc(copc) = &self.source {
            // In the order of the flight line.
            let all = copc.records(node, node.points)?;
            let order = even_order(node.points).skip(places.start as usize).take(places.len());
            let records =
                order.filter_map(|place| all.get(place as usize * size..(place as usize + 1) * size));
            return Ok(records.flatten().copied().collect());
        }
        let mut records = self.records(node, places.end)?;
        records.truncate(bytes.end);
        records.drain(..bytes.start.min(records.len()));
        Ok(records)
    }

    /// Forgets the nodes that were looked at, and their chunks, which are read again.
    pub fn forget_nodes(&mut self) {
        if let NodeSource::Potree(files) = &self.source {
            self.nodes = HashMap::new();
            let first = Proxy::first(self.metadata.hierarchy.first_chunk_size);
            self.proxies = HashMap::from([(NodeName::ROOT, first)]);
            self.unclaimed = files.hierarchy_bytes;
        }
    }

    /// Nodes that are held.
    pub fn nodes_held(&self) -> usize {
        self.nodes.len()
    }

    /// A node that is held by now.
    pub fn held(&self, name: NodeName) -> Option<Node> {
        let is_open = !self.proxies.contains_key(&name);
        self.nodes.get(&name).copied().filter(|_| is_open)
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

    /// Whether [`Octree::records`] gives an even subsample of a node, however many of its
    /// points are taken.
    pub fn has_prefixes(&self) -> bool {
        if matches!(self.source, NodeSource::Copc(_)) {
            return true;
        }
        let ours = self.metadata.generator.as_ref().is_some_and(|made| made.name == "lodestone");
        ours && self.metadata.encoding == PotreeEncoding::Default
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

    /// Whether all axes count the same, so that a node's cube is a cube in the picture.
    pub fn has_cubes(&self) -> bool {
        self.unit.iter().all(|unit| *unit == self.unit[0])
    }

    /// The greatest spacing of a level along any axis, as positions count.
    pub fn spacing(&self, level: u8) -> f64 {
        let unit = self.unit.iter().copied().fold(0.0, f64::max);
        self.metadata.spacing * unit / 2f64.powi(i32::from(level))
    }
}

/// All places below a number, in an order of which every beginning is spread evenly: by
/// their bits from the last to the first.
fn even_order(places: u32) -> impl Iterator<Item = u32> {
    let bits = u32::BITS - places.saturating_sub(1).leading_zeros();
    let reversed = move |n: u64| ((n as u32).reverse_bits()).checked_shr(u32::BITS - bits).unwrap_or(0);
    (0..1u64 << bits).map(reversed).filter(move |place| *place < places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_beginning_of_the_order_is_even() {
        for places in [1u32, 2, 3, 7, 64, 1000] {
            let order: Vec<u32> = even_order(places).collect();
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..places).collect::<Vec<_>>(), "each once");
            for taken in [places / 4, places / 2].into_iter().filter(|taken| *taken > 2) {
                let mut first = order[..taken as usize].to_vec();
                first.sort_unstable();
                let widest = first.windows(2).map(|pair| pair[1] - pair[0]).max().expect("two");
                assert!(widest <= 4 * places.div_ceil(taken), "{places} {taken}: {widest}");
            }
        }
        assert_eq!(even_order(0).count(), 0);
    }
}
