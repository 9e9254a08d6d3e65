//! Small octrees for the tests, built by hand: a sample for inner nodes is
//! chosen the slow way, so that nothing of the converter is needed.

use std::fs;
use std::path::Path;

use crate::format::potree::metadata::{BoundingBox, HierarchyEntry};
use crate::format::potree::{
    Generator, HIERARCHY, METADATA, Metadata, MetadataAttribute, Node, NodeName, OCTREE, PotreeEncoding,
    attribute_entry, encode_brotli, write_hierarchy,
};
use crate::octree::attribute::{Attribute, Scalar, Schema};
use crate::verify::recomputed_statistics::RecomputedStatistics;

/// Metadata of a lattice with a unit of 1 and a cube of 2^`exponent` units.
pub fn metadata(exponent: i32) -> Metadata {
    let side = f64::from(exponent).exp2();
    Metadata {
        version: "2.0".into(),
        name: "test".into(),
        description: String::new(),
        points: 0,
        projection: String::new(),
        crs: String::new(),
        gps_time_offset: None,
        hierarchy: HierarchyEntry { first_chunk_size: 0, step_size: 4, depth: 0 },
        offset: [0.0; 3],
        scale: [1.0; 3],
        spacing: side / 128.0,
        bounding_box: BoundingBox { min: [0.0; 3], max: [side; 3] },
        encoding: PotreeEncoding::Default,
        generator: Some(Generator {
            name: "lodestone".into(),
            version: "0".into(),
            sampling: "poisson".into(),
            lod_color: None,
            left_out: Vec::new(),
        }),
        attributes: Vec::new(),
    }
}

/// A schema of points like those of LAS format 1 with an extra field.
pub fn schema() -> Schema {
    let position = Attribute {
        scale: vec![0.5; 3],
        offset: vec![10.0; 3],
        ..Attribute::new("position", Scalar::I32, 3)
    };
    Schema {
        attributes: vec![
            position,
            Attribute::new("intensity", Scalar::U16, 1),
            Attribute::new("return number", Scalar::U8, 1),
            Attribute::new("number of returns", Scalar::U8, 1),
            Attribute::new("classification", Scalar::U8, 1),
            Attribute::new("scan angle rank", Scalar::U8, 1),
            Attribute::new("user data", Scalar::U8, 1),
            Attribute::new("point source id", Scalar::U16, 1),
            Attribute::new("gps-time", Scalar::F64, 1),
            Attribute::new("serial", Scalar::U64, 1),
        ],
    }
}

/// An octree in the making: nodes with their records.
#[derive(Clone)]
pub struct Draft {
    pub schema: Schema,
    pub metadata: Metadata,
    pub nodes: Vec<(Node, Vec<u8>)>,
}

/// Builds the tree of records (on a lattice of 2^`exponent`, positions from 0)
/// with leaves of at most `capacity` points, each inner node with a Poisson
/// sample of what lies below.
pub fn draft(schema: Schema, records: &[Vec<u8>], exponent: i32, capacity: usize) -> Draft {
    let mut metadata = metadata(exponent);
    metadata.scale = [0.5; 3];
    metadata.offset = [10.0; 3];
    metadata.bounding_box = BoundingBox { min: [10.0; 3], max: [10.0 + f64::from(exponent - 1).exp2(); 3] };
    metadata.spacing = f64::from(exponent - 1).exp2() / 128.0;
    let mut nodes = Vec::new();
    split(NodeName::ROOT, exponent, records.to_vec(), capacity, &mut nodes);
    Draft { schema, metadata, nodes }
}

fn split(
    name: NodeName,
    exponent: i32,
    records: Vec<Vec<u8>>,
    capacity: usize,
    nodes: &mut Vec<(Node, Vec<u8>)>,
) {
    let side = exponent - i32::from(name.level());
    let node = |records: &[Vec<u8>]| {
        let node = Node { name, child_mask: 0, points: records.len() as u32, offset: 0, size: 0 };
        (node, records.concat())
    };
    if records.len() <= capacity || side == 0 {
        return nodes.push(node(&records));
    }
    let place = |record: &[u8]| super::octree::position(record);
    let limit = f64::from(side - 7).exp2().powi(2);
    let mut sample: Vec<Vec<u8>> = Vec::new();
    let mut below: Vec<Vec<Vec<u8>>> = vec![Vec::new(); 8];
    for record in records {
        let at = place(&record);
        let far = |other: &Vec<u8>| {
            let other = place(other);
            (0..3).map(|a| f64::from(at[a] - other[a]).powi(2)).sum::<f64>() >= limit
        };
        // Leave something for the children, so that no leaf is empty.
        if sample.len() < capacity / 2 && sample.iter().all(far) {
            sample.push(record);
        } else {
            let bit = |axis: usize| (at[axis] >> (side - 1) & 1) as usize;
            below[bit(0) << 2 | bit(1) << 1 | bit(2)].push(record);
        }
    }
    nodes.push(node(&sample));
    for (digit, records) in below.into_iter().enumerate().filter(|(_, records)| !records.is_empty()) {
        split(name.child(digit as u8).unwrap(), exponent, records, capacity, nodes);
    }
}

impl Draft {
    /// Gives nodes their bytes and metadata its statistics, and writes all.
    pub fn write(mut self, folder: &Path, encoding: PotreeEncoding) {
        let mut bytes = Vec::new();
        let mut tally = RecomputedStatistics::new(&self.schema);
        for (node, records) in &mut self.nodes {
            tally.add(&self.schema, records);
            node.offset = bytes.len() as u64;
            match encoding {
                PotreeEncoding::Default => bytes.extend_from_slice(records),
                PotreeEncoding::Brotli => encode_brotli(&self.schema, records, 6, &mut bytes).unwrap(),
            }
            node.size = bytes.len() as u64 - node.offset;
        }
        let nodes: Vec<Node> = self.nodes.iter().map(|(node, _)| *node).collect();
        let hierarchy = write_hierarchy(&nodes).unwrap();
        self.metadata.encoding = encoding;
        self.metadata.points = nodes.iter().map(|node| u64::from(node.points)).sum();
        self.metadata.hierarchy.first_chunk_size = hierarchy.first_chunk_size;
        self.metadata.hierarchy.depth = hierarchy.depth;
        let entries = self.schema.attributes.iter().zip(tally.columns());
        self.metadata.attributes =
            entries.map(|(a, s)| attribute_entry(a, s)).collect::<Vec<MetadataAttribute>>();
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join(METADATA), self.metadata.to_json()).unwrap();
        fs::write(folder.join(HIERARCHY), hierarchy.bytes).unwrap();
        fs::write(folder.join(OCTREE), bytes).unwrap();
    }
}
