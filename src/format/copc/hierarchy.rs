//! The hierarchy: entries of nodes to pages and back (COPC 1.0, "hierarchy").
//!
//! Readers differ in what they stand, so what we write is what all of them do: the root
//! page comes first, a child page repeats the entry of its own root, and every ancestor of
//! an entry has one, of no points if need be.

use std::collections::{HashMap, HashSet, VecDeque};

use crate::octree::node::NodeKey;

/// Bytes of an entry.
pub const ENTRY: usize = 32;
/// Entries of a page that is not divided: 32 KiB, one request.
const MAX_WHOLE: u64 = 1024;
/// Entries up to which a divided page takes in whole levels.
const MAX_LEVELS: usize = 512;
/// A subtree of so few nodes is no page of its own.
const MIN_PAGE: u64 = 8;
/// No coordinate of a deeper node fits the 31 bits of an entry.
pub const MAX_LEVEL: u8 = 31;
/// Faults that are kept to be told.
const MAX_ODDITIES: usize = 100;

/// A node with where its chunk lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopcEntry {
    pub key: NodeKey,
    /// From the start of the file; 0 if it has no points.
    pub offset: u64,
    /// Bytes.
    pub size: u32,
    pub points: u32,
}

/// The pages of a file's hierarchy.
#[derive(Debug, Clone, PartialEq)]
pub struct Pages {
    /// All of them, the root's first.
    pub bytes: Vec<u8>,
    /// Bytes of the root page.
    pub root_size: u64,
}

struct HierarchyPage {
    entries: Vec<NodeKey>,
    /// The roots of pages below this one; each has an entry in it.
    children: Vec<NodeKey>,
    offset: u64,
}

impl HierarchyPage {
    fn size(&self) -> u64 {
        ((self.entries.len() + self.children.len()) * ENTRY) as u64
    }
}

/// Writes the entries, in whatever order they come, as pages that begin at `at` in the
/// file. Missing ancestors get entries without points.
pub fn pages(entries: &[CopcEntry], at: u64) -> Pages {
    let mut nodes: HashMap<NodeKey, CopcEntry> = entries.iter().map(|entry| (entry.key, *entry)).collect();
    for entry in entries.iter().map(|entry| entry.key).chain([NodeKey::ROOT]) {
        let mut next = Some(entry);
        while let Some(key) = next {
            let known = nodes.contains_key(&key);
            nodes.entry(key).or_insert(CopcEntry { key, offset: 0, size: 0, points: 0 });
            next = if known && key != entry { None } else { key.parent() };
        }
    }
    let mut keys: Vec<NodeKey> = nodes.keys().copied().collect();
    keys.sort_unstable_by_key(|key| std::cmp::Reverse(key.level));
    // Nodes of the subtree of each.
    let mut below: HashMap<NodeKey, u64> = HashMap::new();
    for key in keys {
        let count = *below.entry(key).and_modify(|count| *count += 1).or_insert(1);
        if let Some(parent) = key.parent() {
            *below.entry(parent).or_default() += count;
        }
    }
    let (mut pages, mut offset): (Vec<HierarchyPage>, u64) = (Vec::new(), at);
    let mut waiting = VecDeque::from([NodeKey::ROOT]);
    while let Some(root) = waiting.pop_front() {
        let mut page = divide(root, &below);
        page.offset = offset;
        offset += page.size();
        waiting.extend(&page.children);
        pages.push(page);
    }
    let places: HashMap<NodeKey, (u64, u64)> =
        pages.iter().map(|page| (page.entries[0], (page.offset, page.size()))).collect();
    let mut bytes = Vec::with_capacity((offset - at) as usize);
    for page in &pages {
        for key in &page.entries {
            let entry = nodes[key];
            put(&mut bytes, *key, entry.offset, entry.size as i32, entry.points as i32);
        }
        for key in &page.children {
            let (offset, size) = places[key];
            put(&mut bytes, *key, offset, size as i32, -1);
        }
    }
    Pages { root_size: pages[0].size(), bytes }
}

/// The page of a root: the whole subtree if it is small, else its upper levels.
fn divide(root: NodeKey, below: &HashMap<NodeKey, u64>) -> HierarchyPage {
    let children =
        |key: NodeKey| (0..8).map(move |index| key.child(index)).filter(|key| below.contains_key(key));
    let subtree = |key: &NodeKey| below.get(key).copied().unwrap_or(0);
    let is_whole = subtree(&root) <= MAX_WHOLE;
    let mut page = HierarchyPage { entries: vec![root], children: Vec::new(), offset: 0 };
    let mut level = vec![root];
    while !level.is_empty() {
        level = level.into_iter().flat_map(children).collect();
        if is_whole || page.entries.len() + level.len() <= MAX_LEVELS {
            page.entries.extend(&level);
            continue;
        }
        for key in std::mem::take(&mut level) {
            if subtree(&key) > MIN_PAGE {
                page.children.push(key);
                continue;
            }
            let mut few = vec![key];
            while let Some(key) = few.pop() {
                page.entries.push(key);
                few.extend(children(key));
            }
        }
    }
    page
}

fn put(bytes: &mut Vec<u8>, key: NodeKey, offset: u64, size: i32, points: i32) {
    let [x, y, z] = key.at.map(|c| c as i32);
    for number in [i32::from(key.level), x, y, z] {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
    bytes.extend_from_slice(&offset.to_le_bytes());
    bytes.extend_from_slice(&size.to_le_bytes());
    bytes.extend_from_slice(&points.to_le_bytes());
}

/// What is odd about a hierarchy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CopcWarning {
    /// Against the specification, or only against what some reader asks for.
    pub is_wrong: bool,
    pub text: String,
}

/// A hierarchy that was read.
#[derive(Debug, Default)]
pub struct CopcHierarchy {
    /// Coarse nodes before fine ones, those of a level by their coordinates.
    pub nodes: Vec<CopcEntry>,
    /// Offset and bytes of every page, as they were met.
    pub pages: Vec<(u64, u64)>,
    /// At most a hundred of them.
    pub oddities: Vec<CopcWarning>,
}

impl CopcHierarchy {
    fn odd(&mut self, is_wrong: bool, text: impl FnOnce() -> String) {
        if self.oddities.len() < MAX_ODDITIES {
            self.oddities.push(CopcWarning { is_wrong, text: text() });
        }
    }
}

/// Where a hierarchy lies and how much of it is read.
#[derive(Debug, Clone, Copy)]
pub struct HierarchyLimits {
    /// The root page.
    pub root: (u64, u64),
    /// The bytes in which chunks lie.
    pub chunks: (u64, u64),
    /// Where the file ends.
    pub end: u64,
    /// Nodes at most.
    pub max_nodes: usize,
}

/// Reads all pages, by a function from offset and length to the bytes of the file. No page
/// is read twice, and no more bytes of them than the file has, whatever they say.
///
/// # Errors
/// Where a page cannot be read, or there are more nodes than were allowed.
pub fn read<E: From<String>>(
    bounds: &HierarchyLimits,
    mut bytes: impl FnMut(u64, u64) -> Result<Vec<u8>, E>,
) -> Result<CopcHierarchy, E> {
    let mut hierarchy = CopcHierarchy::default();
    let mut found: HashMap<NodeKey, CopcEntry> = HashMap::new();
    let mut seen = HashSet::new();
    let mut room = bounds.end;
    let mut waiting = VecDeque::from([(NodeKey::ROOT, bounds.root.0, bounds.root.1)]);
    while let Some((root, offset, size)) = waiting.pop_front() {
        let place = || format!("the page of {} at byte {offset}", name(root));
        if offset.checked_add(size).is_none_or(|end| end > bounds.end) {
            return Err(format!("{} has {size} bytes and reaches past the end of the file", place()).into());
        }
        if !seen.insert(offset) {
            hierarchy.odd(true, || format!("{} is pointed at twice", place()));
            continue;
        }
        let Some(left) = room.checked_sub(size) else {
            return Err("the pages of its hierarchy overlap".to_string().into());
        };
        room = left;
        if size == 0 || !size.is_multiple_of(ENTRY as u64) {
            hierarchy.odd(true, || format!("{} has {size} bytes, which are no whole entries", place()));
        }
        hierarchy.pages.push((offset, size));
        let page = bytes(offset, size)?;
        let mut repeats_root = false;
        for entry in page.chunks_exact(ENTRY) {
            match parse(entry) {
                Err(text) => hierarchy.odd(true, || format!("{}: {text}", place())),
                Ok((key, offset, size, -1)) => waiting.push_back((key, offset, u64::from(size))),
                Ok((key, offset, size, points)) => {
                    repeats_root |= key == root;
                    let entry = CopcEntry { key, offset, size, points: points as u32 };
                    if let Some(text) = fault(&entry, bounds) {
                        hierarchy.odd(true, || text);
                        continue;
                    }
                    if found.insert(key, entry).is_some() {
                        hierarchy.odd(true, || format!("node {} has two entries", name(key)));
                    }
                    if found.len() > bounds.max_nodes {
                        let most = bounds.max_nodes;
                        return Err(format!(
                            "it has more than {most} nodes, all that the memory has room for"
                        )
                        .into());
                    }
                }
            }
        }
        if !repeats_root && root != NodeKey::ROOT {
            hierarchy.odd(false, || format!("{} has no entry for its root, which iTowns asks for", place()));
        }
    }
    hierarchy.nodes = found.values().copied().collect();
    hierarchy.nodes.sort_unstable_by_key(|entry| (entry.key.level, entry.key.at));
    let orphans: Vec<NodeKey> = (hierarchy.nodes.iter().map(|entry| entry.key))
        .filter(|key| key.parent().is_some_and(|parent| !found.contains_key(&parent)))
        .collect();
    for key in orphans {
        hierarchy.odd(true, || format!("node {} has no parent, so viewers do not find it", name(key)));
    }
    if !found.contains_key(&NodeKey::ROOT) {
        hierarchy.odd(true, || "there is no root node".to_string());
    }
    overlaps(&mut hierarchy);
    Ok(hierarchy)
}

/// No byte belongs to two chunks; of chunks that share some, the later ones are left out.
fn overlaps(hierarchy: &mut CopcHierarchy) {
    let mut chunks: Vec<CopcEntry> =
        hierarchy.nodes.iter().copied().filter(|entry| entry.points > 0).collect();
    chunks.sort_unstable_by_key(|entry| (entry.offset, entry.key.level, entry.key.at));
    let (mut end, mut dropped) = (0, HashSet::new());
    for entry in chunks {
        if entry.offset < end {
            hierarchy.odd(true, || format!("the chunk of node {} lies on another's", name(entry.key)));
            dropped.insert(entry.key);
        } else {
            end = entry.offset + u64::from(entry.size);
        }
    }
    hierarchy.nodes.retain(|entry| !dropped.contains(&entry.key));
}

/// What is wrong with where a node's points are said to lie.
fn fault(entry: &CopcEntry, bounds: &HierarchyLimits) -> Option<String> {
    let CopcEntry { key, offset, size, points } = *entry;
    if points == 0 {
        return None;
    }
    let end = offset.checked_add(u64::from(size));
    let lies_there = offset >= bounds.chunks.0 && end.is_some_and(|end| end <= bounds.chunks.1);
    match lies_there && size > 0 {
        true => None,
        false => Some(format!(
            "the chunk of node {} is said to have {size} bytes at byte {offset}, where no chunks are",
            name(key)
        )),
    }
}

/// Key, offset, bytes, points or -1 for a page.
fn parse(entry: &[u8]) -> Result<(NodeKey, u64, u32, i32), String> {
    let word = |at: usize| {
        let mut bytes = [0; 4];
        bytes.copy_from_slice(&entry[at..at + 4]);
        i32::from_le_bytes(bytes)
    };
    let (level, at) = (word(0), [word(4), word(8), word(12)]);
    let (size, points) = (word(24), word(28));
    let text =
        || format!("an entry {level}-{}-{}-{} of {points} points in {size} bytes", at[0], at[1], at[2]);
    let side = u8::try_from(level).ok().filter(|level| *level <= MAX_LEVEL).map(|level| 1i64 << level);
    if side.is_none_or(|side| at.iter().any(|c| *c < 0 || i64::from(*c) >= side)) {
        return Err(format!("{} is of no node", text()));
    }
    if points < -1 || size < 0 {
        return Err(format!("{} cannot be", text()));
    }
    let mut offset = [0; 8];
    offset.copy_from_slice(&entry[16..24]);
    let key = NodeKey { level: level as u8, at: at.map(|c| c as u32) };
    Ok((key, u64::from_le_bytes(offset), size as u32, points))
}

/// A node as COPC's readers name it.
pub fn name(key: NodeKey) -> String {
    let [x, y, z] = key.at;
    format!("{}-{x}-{y}-{z}", key.level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOUNDS: HierarchyLimits =
        HierarchyLimits { root: (0, 0), chunks: (1_000, 1_000_000_000), end: 1 << 40, max_nodes: 1 << 20 };

    fn entry(key: NodeKey, number: u64) -> CopcEntry {
        CopcEntry { key, offset: 1_000 + number * 10, size: 10, points: 5 }
    }

    fn reread(bytes: &[u8], at: u64, root_size: u64, max_nodes: usize) -> Result<CopcHierarchy, String> {
        let bounds =
            HierarchyLimits { root: (at, root_size), end: at + bytes.len() as u64, max_nodes, ..BOUNDS };
        read(&bounds, |offset, size| {
            let start = offset.checked_sub(at).ok_or("in front of the pages")? as usize;
            Ok(bytes[start..start + size as usize].to_vec())
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]
        #[test]
        fn entries_come_back_with_their_ancestors(
            paths in proptest::collection::hash_set(proptest::collection::vec(0u8..8, 0..7), 1..3000),
        ) {
            let keys = paths.iter().map(|path| path.iter().fold(NodeKey::ROOT, |key, index| key.child(*index)));
            let entries: Vec<CopcEntry> = keys.zip(0..).map(|(key, number)| entry(key, number)).collect();
            let pages = pages(&entries, 77);
            let read = reread(&pages.bytes, 77, pages.root_size, 1 << 20).unwrap();
            prop_assert_eq!(&read.oddities, &[]);
            let with_points: HashSet<_> = read.nodes.iter().filter(|e| e.points > 0).map(|e| (e.key, e.offset, e.size)).collect();
            prop_assert_eq!(with_points, entries.iter().map(|e| (e.key, e.offset, e.size)).collect());
            prop_assert_eq!(read.pages.iter().map(|page| page.1).sum::<u64>(), pages.bytes.len() as u64);
            prop_assert_eq!(read.pages[0], (77, pages.root_size));
            prop_assert!(read.pages.iter().all(|page| page.1 <= 4096 * ENTRY as u64 + 16384));
            if entries.len() < 100 {
                prop_assert_eq!(read.pages.len(), 1);
            }
        }

        /// Damage never costs more than the bytes that are there, and never hangs.
        #[test]
        fn damage_is_told_and_bounded(
            flips in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
        ) {
            let mut keys = vec![NodeKey::ROOT];
            for key in 0..200 {
                let key: NodeKey = keys[key];
            keys.extend((0..8).map(|index| key.child(index)));
            }
            let entries: Vec<CopcEntry> = keys.into_iter().zip(0..).map(|(key, number)| entry(key, number)).collect();
            let mut pages = pages(&entries, 0);
            for (at, byte) in flips {
                let at = at.index(pages.bytes.len());
                pages.bytes[at] = byte;
            }
            let bytes = pages.bytes.clone();
            if let Ok(read) = reread(&bytes, 0, pages.root_size, 1 << 20) {
                prop_assert!(read.nodes.len() <= bytes.len() / ENTRY);
                let mut ends: Vec<_> = read.nodes.iter().filter(|e| e.points > 0).map(|e| (e.offset, u64::from(e.size))).collect();
                ends.sort_unstable();
                prop_assert!(ends.windows(2).all(|pair| pair[0].0 + pair[0].1 <= pair[1].0));
            }
        }
    }

    #[test]
    fn large_hierarchies_have_pages_within_pages() {
        let mut keys = vec![NodeKey::ROOT];
        for key in 0..2_000 {
            let key: NodeKey = keys[key];
            keys.extend((0..8).map(|index| key.child(index)));
        }
        let entries: Vec<CopcEntry> = keys.iter().zip(0..).map(|(key, number)| entry(*key, number)).collect();
        let pages = pages(&entries, 0);
        let read = reread(&pages.bytes, 0, pages.root_size, 1 << 20).unwrap();
        assert!(read.oddities.is_empty() && read.pages.len() > 10, "{}", read.pages.len());
        assert_eq!(read.nodes.len(), keys.len());
        let error = reread(&pages.bytes, 0, pages.root_size, 1_000).unwrap_err();
        assert!(error.contains("more than 1000 nodes"), "{error}");
    }

    fn raw(entries: &[(NodeKey, u64, i32, i32)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        entries.iter().for_each(|(key, offset, size, points)| put(&mut bytes, *key, *offset, *size, *points));
        bytes
    }

    fn oddities(bytes: &[u8], root_size: u64) -> Vec<(bool, String)> {
        let read = reread(bytes, 0, root_size, 100).unwrap();
        read.oddities.into_iter().map(|odd| (odd.is_wrong, odd.text)).collect()
    }

    #[test]
    fn cycles_orphans_and_shared_bytes_are_told() {
        let (root, child) = (NodeKey::ROOT, NodeKey::ROOT.child(3));
        let cycle = raw(&[(root, 1_000, 10, 5), (child, 0, 64, -1)]);
        assert!(oddities(&cycle, 64)[0].1.contains("pointed at twice"));
        let orphan = raw(&[(root, 1_000, 10, 5), (child.child(1), 1_010, 10, 5)]);
        assert!(oddities(&orphan, 64)[0].1.contains("2-0-2-3 has no parent"), "{:?}", oddities(&orphan, 64));
        let shared = raw(&[(root, 1_000, 10, 5), (child, 1_009, 10, 5)]);
        assert!(oddities(&shared, 64)[0].1.contains("lies on another's"));
        let far = raw(&[(root, 999, 10, 5)]);
        assert!(oddities(&far, 32)[0].1.contains("where no chunks are"));
        let twice = raw(&[(root, 1_000, 10, 5), (root, 1_010, 10, 5)]);
        assert!(oddities(&twice, 64)[0].1.contains("two entries"));
        let rootless = raw(&[(root, 1_000, 10, 5), (child, 64, 32, -1), (child.child(0), 1_010, 10, 5)]);
        let told = oddities(&rootless, 64);
        assert!(!told[0].0 && told[0].1.contains("iTowns"), "{told:?}");
        assert!(reread(&cycle, 0, 96, 100).is_err());
    }
}
