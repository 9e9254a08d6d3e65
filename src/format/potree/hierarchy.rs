//! hierarchy.bin: which nodes there are and where their points lie.
//!
//! Chunks of 22-byte records: a chunk holds a root and its descendants up to
//! four levels below, breadth first; nodes exactly four levels below are
//! proxies that point at the chunk of their own. Names are nowhere: they follow
//! from the child masks, so a wrong mask moves points to other places.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read};

use super::error::{PotreeError, Result};
use super::files;
use super::name::NodeName;

/// Bytes of a record: type, mask, u32 points, u64 offset, u64 size.
pub const RECORD: usize = 22;
/// Levels of a chunk.
pub const STEP: u8 = 4;

const NORMAL: u8 = 0;
const LEAF: u8 = 1;
const PROXY: u8 = 2;

/// A node of the octree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node {
    pub name: NodeName,
    /// Bit i: child i exists. [`write_hierarchy`] does not read it but finds it
    /// from the names.
    pub child_mask: u8,
    pub points: u32,
    /// Where the node's points start in octree.bin, and their size, in bytes.
    pub offset: u64,
    pub size: u64,
}

/// The bytes of hierarchy.bin and what metadata.json says of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hierarchy {
    pub bytes: Vec<u8>,
    /// Bytes.
    pub first_chunk_size: u64,
    /// Level of the deepest node.
    pub depth: u32,
}

/// Writes the hierarchy of a tree whose nodes come in any order.
pub fn write_hierarchy(nodes: &[Node]) -> Result<Hierarchy> {
    let mut nodes = nodes.to_vec();
    nodes.sort_unstable_by_key(|node| node.name);
    fill_masks(&mut nodes)?;
    let levels = levels(&nodes);
    let chunks = chunks(&nodes, &levels);
    let mut bytes = Vec::with_capacity(chunks.iter().map(|chunk| chunk.records() * RECORD).sum());
    let starts: Vec<u64> = chunks
        .iter()
        .scan(0u64, |end, chunk| Some(std::mem::replace(end, *end + (chunk.records() * RECORD) as u64)))
        .collect();
    // Proxies appear in the order of the chunks that they point at: both are
    // breadth first.
    let mut next = 1;
    for chunk in &chunks {
        for (step, range) in chunk.ranges.iter().enumerate() {
            for node in &nodes[range.clone()] {
                if step == usize::from(STEP) {
                    let size = (chunks[next].records() * RECORD) as u64;
                    put_record(&mut bytes, PROXY, node, starts[next], size);
                    next += 1;
                } else {
                    let kind = if node.child_mask == 0 { LEAF } else { NORMAL };
                    put_record(&mut bytes, kind, node, node.offset, node.size);
                }
            }
        }
    }
    let first_chunk_size = chunks.first().map_or(0, |chunk| chunk.records() * RECORD) as u64;
    Ok(Hierarchy { bytes, first_chunk_size, depth: levels.len() as u32 - 1 })
}

/// Sets each node's mask from the names of its children; `nodes` are sorted.
fn fill_masks(nodes: &mut [Node]) -> Result<()> {
    if nodes.first().map(|node| node.name) != Some(NodeName::ROOT) {
        return Err(PotreeError::NotATree("it has no root".into()));
    }
    nodes.iter_mut().for_each(|node| node.child_mask = 0);
    let mut parent = 0;
    for child in 1..nodes.len() {
        let name = nodes[child].name;
        if name == nodes[child - 1].name {
            return Err(PotreeError::NotATree(format!("node {name} is there twice")));
        }
        let wanted = name.parent();
        while parent < child && Some(nodes[parent].name) < wanted {
            parent += 1;
        }
        if Some(nodes[parent].name) != wanted {
            return Err(PotreeError::NotATree(format!("node {name} has no parent")));
        }
        nodes[parent].child_mask |= 1 << name.digit();
    }
    Ok(())
}

/// Where each level starts among sorted nodes.
fn levels(nodes: &[Node]) -> Vec<std::ops::Range<usize>> {
    let depth = nodes.last().map_or(0, |node| node.name.level());
    let start = |level: u8| nodes.partition_point(|node| node.name.level() < level);
    (0..=depth).map(|level| start(level)..start(level + 1)).collect()
}

/// A chunk as ranges of the sorted nodes: its root, and the descendants one to
/// four levels below.
struct HierarchyChunk {
    ranges: [std::ops::Range<usize>; STEP as usize + 1],
}

impl HierarchyChunk {
    fn records(&self) -> usize {
        self.ranges.iter().map(|range| range.len()).sum()
    }
}

/// All chunks, breadth first. The descendants of one chunk root after the other
/// lie one behind the other in each level, so a cursor a level finds them all.
fn chunks(nodes: &[Node], levels: &[std::ops::Range<usize>]) -> Vec<HierarchyChunk> {
    let mut chunks = Vec::new();
    for top in (0..levels.len()).step_by(usize::from(STEP)) {
        let level = |step: usize| levels.get(top + step).cloned().unwrap_or(nodes.len()..nodes.len());
        let mut cursors: [usize; STEP as usize + 1] = std::array::from_fn(|step| level(step).start);
        for root in levels[top].clone() {
            let name = nodes[root].name;
            let ranges = std::array::from_fn(|step| {
                let (start, end) = (cursors[step], level(step).end);
                let within = |node: &&Node| node.name.ancestor(top as u8) == Some(name);
                cursors[step] += nodes[start..end].iter().take_while(within).count();
                start..cursors[step]
            });
            chunks.push(HierarchyChunk { ranges });
        }
    }
    chunks
}

fn put_record(bytes: &mut Vec<u8>, kind: u8, node: &Node, offset: u64, size: u64) {
    bytes.extend([kind, node.child_mask]);
    bytes.extend(node.points.to_le_bytes());
    bytes.extend(offset.to_le_bytes());
    bytes.extend(size.to_le_bytes());
}

/// What is odd about a hierarchy that could still be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HierarchyWarning {
    /// A record calls itself a leaf and has children, or the other way round.
    WrongType { node: NodeName },
    /// A proxy and the root of its chunk disagree about the children.
    ProxyMask { node: NodeName, proxy: u8, chunk: u8 },
    /// A proxy and the root of its chunk disagree about the number of points.
    ProxyPoints { node: NodeName, proxy: u32, chunk: u32 },
    /// Bytes of hierarchy.bin that no chunk holds.
    Unused { bytes: u64 },
    /// A proxy that does not lie `STEP` levels below its chunk's root.
    ProxyLevel { node: NodeName },
}

/// Reads all nodes, sorted by name (that is breadth first).
pub fn read_hierarchy(bytes: &[u8], first_chunk_size: u64) -> Result<Vec<Node>> {
    inspect_hierarchy(bytes, first_chunk_size).map(|(nodes, _)| nodes)
}

/// Reads all nodes and tells what is odd. Memory is bounded by the bytes given:
/// no record is read twice, so that proxies that point in circles end as an
/// error.
pub fn inspect_hierarchy(bytes: &[u8], first_chunk_size: u64) -> Result<(Vec<Node>, Vec<HierarchyWarning>)> {
    inspect(bytes.len() as u64, first_chunk_size, usize::MAX, |start| {
        bytes.get(usize::try_from(start).unwrap_or(usize::MAX)..).unwrap_or_default()
    })
}

/// Nodes of which the whole list, with what is made of it, fits a part of the memory.
pub fn most_nodes(memory_limit: u64) -> usize {
    const BYTES_A_NODE: u64 = 200;
    usize::try_from(memory_limit / BYTES_A_NODE).unwrap_or(usize::MAX)
}

/// The same of a file, of which no more is read than the tree has, and no more
/// than `most` nodes.
pub fn inspect_hierarchy_file(
    file: &File,
    length: u64,
    first_chunk_size: u64,
    most: usize,
) -> Result<(Vec<Node>, Vec<HierarchyWarning>)> {
    inspect(length, first_chunk_size, most, |at| BufReader::new(files::From { file, at }))
}

/// `from` reads on from a byte of the hierarchy's.
fn inspect<R: Read>(
    length: u64,
    first_chunk_size: u64,
    most: usize,
    from: impl Fn(u64) -> R,
) -> Result<(Vec<Node>, Vec<HierarchyWarning>)> {
    let mut found = Chunks { proxies: vec![Proxy::first(first_chunk_size)], ..Chunks::default() };
    // Records that no chunk has claimed yet.
    let mut unread = length / RECORD as u64;
    while let Some(chunk) = found.proxies.pop() {
        claim(length, &chunk, &mut unread)?;
        found.add(&chunk, from(chunk.start), most)?;
    }
    let unused = unread * RECORD as u64 + length % RECORD as u64;
    if unused > 0 {
        found.oddities.push(HierarchyWarning::Unused { bytes: unused });
    }
    found.nodes.sort_unstable_by_key(|node| node.name);
    Ok((found.nodes, found.oddities))
}

/// A chunk still to be read: where it lies in hierarchy.bin, in bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Proxy {
    /// The root of the chunk.
    pub name: NodeName,
    pub start: u64,
    pub size: u64,
    /// The mask and the number of points that the proxy itself gives.
    record: Option<(u8, u32)>,
}

impl Proxy {
    /// The chunk of the root.
    pub fn first(first_chunk_size: u64) -> Proxy {
        Proxy { name: NodeName::ROOT, record: None, start: 0, size: first_chunk_size }
    }
}

/// One chunk of hierarchy.bin for those who need only a part of the tree: its
/// nodes, breadth first, and where it goes on. `records` reads from where `chunk`
/// points at; more than `most` nodes are an error.
pub fn read_chunk(chunk: &Proxy, records: impl Read, most: usize) -> Result<(Vec<Node>, Vec<Proxy>)> {
    let mut parsed = Chunks::default();
    parsed.add(chunk, records, most)?;
    Ok((parsed.nodes, parsed.proxies))
}

/// What was found in the chunks read so far.
#[derive(Default)]
struct Chunks {
    nodes: Vec<Node>,
    proxies: Vec<Proxy>,
    oddities: Vec<HierarchyWarning>,
}

impl Chunks {
    /// Reads record by record, and ends where the tree does: whatever size a chunk
    /// is said to have, memory and time grow with what it really holds.
    fn add(&mut self, chunk: &Proxy, mut records: impl Read, most: usize) -> Result<()> {
        let count = chunk.size / RECORD as u64;
        if count == 0 || !chunk.size.is_multiple_of(RECORD as u64) {
            return Err(damaged(chunk, "its size is not a whole number of records"));
        }
        let mut names = VecDeque::from([chunk.name]);
        let mut named = 1u64;
        let mut record = [0; RECORD];
        for index in 0..count {
            let Some(name) = names.pop_front() else {
                return Err(damaged(chunk, "it has more records than its masks have children"));
            };
            records
                .read_exact(&mut record)
                .map_err(|e| damaged(chunk, &format!("it cannot be read: {e}")))?;
            let (kind, node) = parse_record(name, &record);
            if index == 0 {
                self.compare_with_proxy(chunk, &node);
            }
            if self.nodes.len() + self.proxies.len() >= most {
                return Err(damaged(chunk, &format!("more than {most} nodes do not fit the memory limit")));
            }
            match kind {
                PROXY if index > 0 => {
                    if name.level() - chunk.name.level() != STEP {
                        self.oddities.push(HierarchyWarning::ProxyLevel { node: name });
                    }
                    let record = Some((node.child_mask, node.points));
                    self.proxies.push(Proxy { name, record, start: node.offset, size: node.size });
                    continue;
                }
                NORMAL | LEAF => {
                    if (kind == LEAF) != (node.child_mask == 0) {
                        self.oddities.push(HierarchyWarning::WrongType { node: name });
                    }
                }
                _ => return Err(damaged(chunk, &format!("node {name} has type {kind}"))),
            }
            for digit in (0..8).filter(|digit| node.child_mask >> digit & 1 == 1) {
                names.push_back(name.child(digit).ok_or_else(|| damaged(chunk, "it is too deep"))?);
                named += 1;
            }
            if named > count {
                return Err(damaged(chunk, "its masks have more children than it has records"));
            }
            self.nodes.push(node);
        }
        Ok(())
    }

    fn compare_with_proxy(&mut self, chunk: &Proxy, root: &Node) {
        let Some((mask, points)) = chunk.record else { return };
        let node = root.name;
        if mask != root.child_mask {
            self.oddities.push(HierarchyWarning::ProxyMask { node, proxy: mask, chunk: root.child_mask });
        }
        if points != root.points {
            self.oddities.push(HierarchyWarning::ProxyPoints { node, proxy: points, chunk: root.points });
        }
    }
}

/// Claims the bytes of a chunk, so that no other chunk can have as many.
fn claim(length: u64, chunk: &Proxy, unread: &mut u64) -> Result<()> {
    if chunk.start.checked_add(chunk.size).is_none_or(|end| end > length) {
        return Err(damaged(chunk, &format!("it ends behind the file's {length} bytes")));
    }
    *unread = (unread.checked_sub(chunk.size / RECORD as u64))
        .ok_or_else(|| damaged(chunk, "chunks overlap or point in circles"))?;
    Ok(())
}

fn parse_record(name: NodeName, record: &[u8]) -> (u8, Node) {
    let number = |at: usize, bytes: usize| {
        record[at..at + bytes].iter().rev().fold(0u64, |value, &byte| value << 8 | u64::from(byte))
    };
    let node = Node {
        name,
        child_mask: record[1],
        points: number(2, 4) as u32,
        offset: number(6, 8),
        size: number(14, 8),
    };
    (record[0], node)
}

fn damaged(chunk: &Proxy, what: &str) -> PotreeError {
    let Proxy { name, start, size, .. } = chunk;
    PotreeError::Hierarchy(format!("the chunk of node {name} (byte {start}, {size} bytes): {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A tree from paths: all of their ancestors too.
    fn tree(paths: Vec<Vec<u8>>) -> Vec<Node> {
        let mut names: Vec<NodeName> = vec![NodeName::ROOT];
        for path in &paths {
            let name = NodeName::from_digits(path).unwrap();
            names.extend((0..=name.level()).filter_map(|level| name.ancestor(level)));
        }
        names.sort_unstable();
        names.dedup();
        let mask = |name: NodeName| {
            let children = names.iter().filter(|n| n.parent() == Some(name));
            children.fold(0, |mask, child| mask | 1u8 << child.digit())
        };
        let node = |(i, &name): (usize, &NodeName)| Node {
            name,
            child_mask: mask(name),
            points: i as u32 * 3,
            offset: i as u64 * 100,
            size: i as u64 * 42,
        };
        names.iter().enumerate().map(node).collect()
    }

    fn trees() -> impl Strategy<Value = Vec<Node>> {
        let path = proptest::collection::vec(prop_oneof![0u8..8, Just(0u8)], 0..14);
        proptest::collection::vec(path, 0..60).prop_map(tree)
    }

    proptest! {
        #[test]
        fn trees_come_back_whatever_their_order(nodes in trees(), seed in any::<u64>()) {
            let mut mixed = nodes.clone();
            mixed.sort_by_key(|node| (u64::from(node.points) + 1).wrapping_mul(seed | 1));
            let hierarchy = write_hierarchy(&mixed).unwrap();
            let (read, oddities) = inspect_hierarchy(&hierarchy.bytes, hierarchy.first_chunk_size).unwrap();
            prop_assert_eq!(&read, &nodes);
            prop_assert_eq!(oddities, vec![]);
            prop_assert_eq!(hierarchy.depth, nodes.iter().map(|n| u32::from(n.name.level())).max().unwrap());
        }

        /// Whatever byte is changed: an error, an oddity, or other numbers in the
        /// nodes; never a panic, and never more nodes than there are records.
        #[test]
        fn damage_is_noticed(nodes in trees(), at in any::<prop::sample::Index>(), xor in 1u8..=255, cut in 0usize..40) {
            let hierarchy = write_hierarchy(&nodes).unwrap();
            let mut bytes = hierarchy.bytes;
            let at = at.index(bytes.len());
            bytes[at] ^= xor;
            bytes.truncate(bytes.len() - cut.saturating_sub(20).min(bytes.len()));
            if let Ok((read, oddities)) = inspect_hierarchy(&bytes, hierarchy.first_chunk_size) {
                prop_assert!(read != nodes || !oddities.is_empty());
                prop_assert!(read.len() * RECORD <= bytes.len());
            }
        }

        #[test]
        fn noise_is_read_without_harm(bytes in proptest::collection::vec(any::<u8>(), 0..2000), first in 0u64..3000) {
            let _ = read_hierarchy(&bytes, first);
        }
    }

    #[test]
    fn chunks_hold_four_levels_and_proxies() {
        let hierarchy = write_hierarchy(&tree(vec![vec![7; 5]])).unwrap();
        let kinds: Vec<u8> = hierarchy.bytes.chunks_exact(RECORD).map(|record| record[0]).collect();
        assert_eq!(kinds, [NORMAL, NORMAL, NORMAL, NORMAL, PROXY, NORMAL, LEAF]);
        assert_eq!(hierarchy.first_chunk_size, 5 * RECORD as u64);
        let (_, proxy) = parse_record(NodeName::ROOT, &hierarchy.bytes[4 * RECORD..5 * RECORD]);
        assert_eq!((proxy.offset, proxy.size), (5 * RECORD as u64, 2 * RECORD as u64));
    }

    #[test]
    fn circles_end() {
        let mut bytes = write_hierarchy(&tree(vec![vec![7; 5]])).unwrap().bytes;
        bytes[4 * RECORD + 6..4 * RECORD + 14].copy_from_slice(&0u64.to_le_bytes());
        bytes[4 * RECORD + 14..5 * RECORD].copy_from_slice(&(5 * RECORD as u64).to_le_bytes());
        let error = read_hierarchy(&bytes, 5 * RECORD as u64).unwrap_err();
        assert!(error.to_string().contains("circles"), "{error}");
    }

    #[test]
    fn what_is_no_tree_is_not_written() {
        let mut nodes = tree(vec![vec![1, 2, 3]]);
        let orphaned: Vec<Node> = nodes.iter().copied().filter(|n| n.name.level() != 2).collect();
        assert!(write_hierarchy(&orphaned).is_err());
        nodes.push(nodes[1]);
        assert!(write_hierarchy(&nodes).is_err());
        assert!(write_hierarchy(&[]).is_err());
    }
}
