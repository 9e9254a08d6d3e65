//! A COPC file as an octree to draw: its nodes under the names that octrees have, their
//! points thinned evenly where a picture needs few of them.

use std::collections::HashMap;
use std::path::Path;

use super::error::Result;
use crate::format::copc::{CopcEntry, CopcFile};
use crate::format::potree::metadata::{BoundingBox, HierarchyEntry};
use crate::format::potree::{Generator, Metadata, Node, NodeName, PotreeEncoding, attribute_entry};
use crate::octree::attribute::{RGB_AVERAGE, Schema};
use crate::octree::statistics::AttributeStatistics;

/// Memory for the nodes of a file, and for a node's points.
const MEMORY: u64 = 512 << 20;

/// An open file.
pub struct CopcNodes {
    file: CopcFile,
}

/// Nodes by their names.
type Nodes = HashMap<NodeName, Node>;

impl CopcNodes {
    /// Opens a file; gives what an octree's metadata would say of it, and all nodes.
    ///
    /// # Errors
    /// Where it is no COPC, or damaged.
    pub fn open(path: &Path) -> Result<(CopcNodes, Metadata, Nodes)> {
        let file = CopcFile::open(path, MEMORY)?;
        let mut nodes: Nodes = file.nodes().iter().filter_map(node).map(|node| (node.name, node)).collect();
        for entry in file.nodes() {
            let (Some(parent), digit) = (entry.key.parent(), entry.key.index_in_parent()) else { continue };
            let parent = NodeName::from_cell(parent.level, parent.at.map(u64::from));
            if let Some(parent) = parent.and_then(|name| nodes.get_mut(&name)) {
                parent.child_mask |= 1 << digit;
            }
        }
        let metadata = metadata(&file);
        Ok((CopcNodes { file }, metadata, nodes))
    }

    pub fn schema(&self) -> &Schema {
        self.file.schema()
    }

    /// So many of a node's records, spread evenly over it.
    pub fn records(&self, node: &Node, take: u32) -> Result<Vec<u8>> {
        let Some(entry) = self.file.node_at(node.name.level(), node.name.cell()) else {
            return Ok(Vec::new());
        };
        let mut records = Vec::new();
        self.file.reader()?.read(entry, &mut records)?;
        let size = self.schema().record_size();
        let (points, take) = (records.len() / size, take as usize);
        if take >= points {
            return Ok(records);
        }
        let mut thinned = Vec::with_capacity(take * size);
        for number in 0..take {
            let at = number * points / take * size;
            thinned.extend_from_slice(&records[at..at + size]);
        }
        Ok(thinned)
    }
}

fn node(entry: &CopcEntry) -> Option<Node> {
    let name = NodeName::from_cell(entry.key.level, entry.key.at.map(u64::from))?;
    let (points, offset, size) = (entry.points, entry.offset, u64::from(entry.size));
    Some(Node { name, child_mask: 0, points, offset, size })
}

/// What pictures ask an octree's metadata for.
fn metadata(file: &CopcFile) -> Metadata {
    let (header, cube) = (&file.header, file.cube());
    let schema = file.schema();
    let has_averages = schema.offset_of(RGB_AVERAGE).is_some();
    let attributes = schema.attributes.iter().map(|attribute| {
        let mut entry =
            attribute_entry(attribute, &AttributeStatistics::empty(attribute.scalar, attribute.elements));
        if attribute.name == "position" {
            (entry.min, entry.max) = (header.min.to_vec(), header.max.to_vec());
        }
        entry
    });
    Metadata {
        version: "2.0".into(),
        name: String::new(),
        description: String::new(),
        points: header.points,
        projection: String::new(),
        crs: header.crs.as_ref().map(|crs| crs.text.clone()).unwrap_or_default(),
        gps_time_offset: None,
        hierarchy: HierarchyEntry { first_chunk_size: 0, step_size: 4, depth: 0 },
        offset: header.offset,
        scale: header.scale,
        spacing: file.spacing(),
        bounding_box: BoundingBox {
            min: cube.center.map(|center| center - cube.halfsize),
            max: cube.center.map(|center| center + cube.halfsize),
        },
        encoding: PotreeEncoding::Default,
        generator: has_averages.then(|| Generator {
            name: String::new(),
            version: String::new(),
            sampling: String::new(),
            lod_color: Some("attribute".into()),
            left_out: Vec::new(),
        }),
        attributes: attributes.collect(),
    }
}
