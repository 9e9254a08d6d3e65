//! What an octree of unknown making may cost: no byte of octree.bin is read for two
//! nodes, none that was never written, and all nodes together are no larger than the
//! file can stand for; and no more nodes are in memory at a time than fit.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use crate::format::potree::encoding::{is_believable, unpacked_size};
use crate::format::potree::{Metadata, Node, NodeName};
use crate::octree::attribute::Schema;

/// Bytes of unpacked nodes that are believed of any file.
const ALWAYS_BELIEVED: u64 = 256 << 20;
/// Beyond that, bytes that a byte of octree.bin may stand for, all nodes together.
const MOST_RATIO: u64 = 1000;

/// Nodes whose points are not to be read, with the reason. `holes` are sorted.
pub(super) fn left_out(
    metadata: &Metadata,
    schema: &Schema,
    nodes: &[Node],
    holes: &[Range<u64>],
    bytes: u64,
) -> HashMap<NodeName, &'static str> {
    let mut left_out = HashMap::new();
    let fits =
        |node: &&Node| node.points > 0 && is_believable(schema, metadata.encoding, node.points, node.size);
    let mut sorted: Vec<&Node> = nodes.iter().filter(fits).collect();
    sorted.sort_by_key(|node| (node.offset, node.name));
    let (mut end, mut hole) = (0, 0);
    for node in &sorted {
        let Some(stop) = node.offset.checked_add(node.size).filter(|stop| *stop <= bytes) else { continue };
        while holes.get(hole).is_some_and(|hole| hole.end <= node.offset) {
            hole += 1;
        }
        if node.offset < end {
            left_out.insert(node.name, "its bytes are another node's, too");
        } else if holes.get(hole).is_some_and(|hole| hole.start < stop) {
            left_out.insert(node.name, "a part of its bytes was never written; the file is sparse");
        }
        end = end.max(stop);
    }
    let most = bytes.saturating_mul(MOST_RATIO).saturating_add(ALWAYS_BELIEVED);
    let mut sum = 0u64;
    for node in sorted {
        if left_out.contains_key(&node.name) {
            continue;
        }
        sum = sum.saturating_add(unpacked_size(schema, metadata.encoding, node.points));
        if sum > most {
            left_out.insert(node.name, "all nodes together are more than the file can hold");
        }
    }
    left_out
}

/// Bytes of memory that threads take and give back. Who waits for some holds none,
/// so all get theirs in turn.
#[derive(Debug)]
pub(super) struct Purse {
    pub most: u64,
    left: Mutex<u64>,
    more: Condvar,
}

/// A part of a purse; given back when it is dropped.
pub(super) struct Reservation<'a> {
    purse: &'a Purse,
    bytes: u64,
}

impl Purse {
    pub fn new(most: u64) -> Purse {
        Purse { most, left: Mutex::new(most), more: Condvar::new() }
    }

    /// Waits for so many bytes; nothing where there are never as many.
    pub fn take(&self, bytes: u64) -> Option<Reservation<'_>> {
        if bytes > self.most {
            return None;
        }
        let mut left = self.lock();
        while *left < bytes {
            left = self.more.wait(left).unwrap_or_else(PoisonError::into_inner);
        }
        *left -= bytes;
        Some(Reservation { purse: self, bytes })
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        *self.purse.lock() += self.bytes;
        self.purse.more.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_purse_is_never_overdrawn() {
        let purse = Purse::new(10);
        assert!(purse.take(11).is_none());
        std::thread::scope(|scope| {
            for bytes in [3, 10, 7, 1, 9] {
                let purse = &purse;
                scope.spawn(move || {
                    for _ in 0..100 {
                        let taken = purse.take(bytes).expect("it waits");
                        assert!(*purse.lock() <= 10 - bytes);
                        drop(taken);
                    }
                });
            }
        });
        assert_eq!(*purse.lock(), 10);
    }
}
