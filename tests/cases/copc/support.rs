//! A COPC file, read plainly by the specification.

use std::fs;
use std::path::{Path, PathBuf};

use lodestone::format::copc::{Described, NodeDecoder, RecordLayout};
use lodestone::format::potree::Metadata;
use lodestone::octree::node::NodeKey;

/// The only COPC file in a folder.
pub fn copc_in(folder: &Path) -> PathBuf {
    let names = super::super::common::listing(folder);
    let files: Vec<&String> = names.iter().filter(|name| name.ends_with(".copc.laz")).collect();
    assert_eq!(files.len(), 1, "{names:?}");
    folder.join(files[0])
}

pub fn copc_bytes(folder: &Path) -> Vec<u8> {
    fs::read(copc_in(folder)).unwrap()
}

fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn half(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// An entry of the hierarchy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    pub key: NodeKey,
    pub offset: u64,
    pub bytes: usize,
    pub points: usize,
}

/// All nodes, by following the pages from the root's.
pub fn nodes(file: &[u8]) -> Vec<Node> {
    assert_eq!(&file[377..381], b"copc");
    let mut pages = vec![(word(file, 429 + 40), word(file, 429 + 48))];
    let mut nodes = Vec::new();
    while let Some((at, size)) = pages.pop() {
        for entry in file[at as usize..(at + size) as usize].chunks_exact(32) {
            let [level, x, y, z] = [0, 4, 8, 12].map(|at| half(entry, at) as u32);
            let key = NodeKey { level: level as u8, at: [x, y, z] };
            let (offset, bytes, points) = (word(entry, 16), half(entry, 24), half(entry, 28));
            match points {
                -1 => pages.push((offset, bytes as u64)),
                points => {
                    nodes.push(Node { key, offset, bytes: bytes as usize, points: points as usize });
                }
            }
        }
    }
    nodes
}

/// A node's points as records of the octree whose metadata this is.
pub fn octree_records(file: &[u8], node: &Node, metadata: &Metadata) -> Vec<u8> {
    let layout = RecordLayout::new(&metadata.schema().unwrap(), &Described::default()).unwrap();
    let mut decoder = NodeDecoder::new(layout.point_format(), layout.extra_bytes(), 3).unwrap();
    let (mut las, mut records) = (Vec::new(), Vec::new());
    let chunk = &file[node.offset as usize..][..node.bytes];
    decoder.decode(chunk, node.points as u64, &mut las).unwrap();
    layout.demote(&las, &mut records);
    records
}
