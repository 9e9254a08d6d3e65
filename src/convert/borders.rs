//! Who honours whom: units of work (chunks, steps of the merge) whose nodes touch
//! keep their samples' distance too, although they are sampled on different
//! threads.
//!
//! Of two units that touch, the later one is handed the samples of the earlier
//! one along their border, and waits for them if it must. The order is fixed
//! beforehand by the units alone, so the result does not depend on the threads;
//! and it goes by the parity of the nodes' places (eight colours, as those of a
//! chessboard), so that units which follow each other seldom touch and hardly
//! anybody ever waits.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::checkpoint::receipt::ByteRange;
use super::checkpoint::scratch::Scratch;
use super::context::Cancel;
use super::error::{Result, StageError};
use crate::octree::node::NodeKey;
use crate::octree::sampling::sampler::BorderSamples;

/// How often one who waits looks whether all was called off.
const LOOK: Duration = Duration::from_millis(100);

/// Where a unit's samples along its border are: in memory, or out of core in the
/// scratch.
#[derive(Debug, Clone)]
pub enum StoredBorder {
    Memory(Vec<BorderSamples>),
    Scratch(ByteRange),
}

/// See the module. Units are numbered in the order in which they honour each
/// other.
pub struct BorderExchange {
    bits: u32,
    scratch: Option<Arc<Scratch>>,
    nodes: Vec<NodeKey>,
    state: Mutex<BorderState>,
    changed: Condvar,
}

#[derive(Default)]
struct BorderState {
    kept: Vec<Option<StoredBorder>>,
    failed: bool,
}

/// A unit that is at work; dropped before it is done, it has failed.
pub struct UnitBorder<'h> {
    halos: &'h BorderExchange,
    unit: usize,
    done: bool,
}

/// The order in which nodes take their turns, as numbers of theirs.
pub fn order(nodes: &[NodeKey]) -> Vec<usize> {
    let colour = |node: &NodeKey| node.at.iter().fold(0, |colour, c| colour << 1 | c & 1);
    let mut order: Vec<usize> = (0..nodes.len()).collect();
    order.sort_by_key(|number| colour(&nodes[*number]));
    order
}

impl BorderExchange {
    /// No units yet. `bits` are those of the root cube.
    pub fn new(bits: u32, scratch: Option<Arc<Scratch>>) -> BorderExchange {
        BorderExchange { bits, scratch, nodes: Vec::new(), state: Mutex::default(), changed: Condvar::new() }
    }

    /// More units, behind all that are there.
    pub fn add(&mut self, nodes: impl IntoIterator<Item = NodeKey>) {
        self.nodes.extend(nodes);
        self.lock().kept.resize_with(self.nodes.len(), || None);
    }

    /// A unit's turn begins.
    pub fn turn(&self, unit: usize) -> UnitBorder<'_> {
        UnitBorder { halos: self, unit, done: false }
    }

    fn lock(&self) -> MutexGuard<'_, BorderState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl UnitBorder<'_> {
    /// The borders of earlier units that touch this one, down to a level. Waits
    /// until they are there; each is at work already, or done.
    pub fn around(&self, deepest: u8, cancel: &Cancel) -> Result<Vec<BorderSamples>> {
        let BorderExchange { bits, scratch, nodes, .. } = self.halos;
        let own = nodes[self.unit];
        let mut rims = Vec::new();
        for (unit, _) in nodes[..self.unit].iter().enumerate().filter(|(_, node)| touch(*bits, own, **node)) {
            let kept = match (self.wait(unit, cancel)?, scratch) {
                (StoredBorder::Memory(kept), _) => kept,
                (StoredBorder::Scratch(span), Some(scratch)) => from_bytes(&scratch.fetch(span)?)?,
                (StoredBorder::Scratch(_), None) => {
                    return Err(StageError::Inconsistent("samples of a border are nowhere".into()));
                }
            };
            rims.extend(kept.into_iter().filter(|rim| rim.node.level <= deepest));
        }
        Ok(rims)
    }

    fn wait(&self, unit: usize, cancel: &Cancel) -> Result<StoredBorder> {
        let mut state = self.halos.lock();
        loop {
            // What failed elsewhere is told there.
            if cancel.is_cancelled() || state.failed {
                return Err(StageError::Cancelled);
            }
            if let Some(kept) = &state.kept[unit] {
                return Ok(kept.clone());
            }
            let waited = self.halos.changed.wait_timeout(state, LOOK);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The unit is done, and this is its border.
    pub fn done(mut self, kept: StoredBorder) {
        self.done = true;
        self.halos.lock().kept[self.unit] = Some(kept);
        self.halos.changed.notify_all();
    }
}

impl Drop for UnitBorder<'_> {
    fn drop(&mut self) {
        if !self.done {
            self.halos.lock().failed = true;
            self.halos.changed.notify_all();
        }
    }
}

/// Whether the cubes of two nodes have a point in common, be it a corner.
fn touch(bits: u32, a: NodeKey, b: NodeKey) -> bool {
    let span = |node: NodeKey, axis: usize| {
        let side = bits - u32::from(node.level);
        let low = u64::from(node.at[axis]) << side;
        (low, low + (1 << side))
    };
    (0..3).all(|axis| {
        let ((a_low, a_high), (b_low, b_high)) = (span(a, axis), span(b, axis));
        a_low <= b_high && b_low <= a_high
    })
}

/// As bytes for the scratch: of each node its level, place and count, and then
/// its samples; all numbers of four bytes.
pub fn to_bytes(rims: &[BorderSamples]) -> Vec<u8> {
    let numbers = rims.iter().flat_map(|rim| {
        let head = [u32::from(rim.node.level), rim.node.at[0], rim.node.at[1], rim.node.at[2]];
        head.into_iter().chain([rim.samples.len() as u32]).chain(rim.samples.iter().flatten().copied())
    });
    numbers.flat_map(u32::to_le_bytes).collect()
}

fn from_bytes(bytes: &[u8]) -> Result<Vec<BorderSamples>> {
    let mut numbers = bytes.as_chunks().0.iter().map(|number| u32::from_le_bytes(*number));
    let mut rims = Vec::new();
    while let Some(level) = numbers.next() {
        let mut three = || Some([numbers.next()?, numbers.next()?, numbers.next()?]);
        let at = three();
        let count = numbers.next();
        let mut three = || Some([numbers.next()?, numbers.next()?, numbers.next()?]);
        let samples: Option<Vec<[u32; 3]>> = count.and_then(|count| (0..count).map(|_| three()).collect());
        match (u8::try_from(level), at, samples) {
            (Ok(level), Some(at), Some(samples)) => {
                rims.push(BorderSamples { node: NodeKey { level, at }, samples })
            }
            _ => return Err(StageError::Inconsistent("samples of a border were cut".into())),
        }
    }
    Ok(rims)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn node(level: u8, at: [u32; 3]) -> NodeKey {
        NodeKey { level, at }
    }

    #[test]
    fn corners_touch_and_gaps_do_not() {
        let a = node(2, [1, 1, 0]);
        for (b, expected) in [
            (node(2, [2, 2, 1]), true),
            (node(2, [3, 1, 0]), false),
            (node(3, [4, 4, 2]), true),
            (node(3, [5, 4, 2]), false),
            (node(1, [1, 1, 1]), false),
            (node(1, [1, 1, 0]), true),
            (NodeKey::ROOT, true),
        ] {
            assert_eq!((touch(10, a, b), touch(10, b, a)), (expected, expected), "{b}");
        }
    }

    #[test]
    fn those_that_follow_each_other_do_not_touch() {
        let nodes: Vec<NodeKey> = (0..256).map(|i| node(4, [i % 16, i / 16, 0])).collect();
        let order = order(&nodes);
        let touching = order.windows(2).filter(|pair| touch(10, nodes[pair[0]], nodes[pair[1]])).count();
        assert!(touching <= 3, "only where a colour ends: {touching}");
        let mut sorted = order;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..256));
    }

    /// Whoever waits gets what the other brings, and is let go when that one fails.
    #[test]
    fn a_turn_waits_for_those_before_and_not_for_ever() {
        let mut halos = BorderExchange::new(10, None);
        halos.add([node(2, [0; 3]), node(2, [3; 3]), node(2, [1, 0, 0])]);
        let rim = BorderSamples { node: node(3, [1, 0, 0]), samples: vec![[7; 3]] };
        let deep = BorderSamples { node: node(9, [1, 0, 0]), samples: vec![[8; 3]] };
        let (cancel, waited) = (Cancel::default(), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            let first = halos.turn(0);
            let last = scope.spawn(|| {
                let turn = halos.turn(2);
                let around = turn.around(5, &cancel).unwrap();
                assert_eq!(waited.load(Ordering::SeqCst), 1);
                turn.done(StoredBorder::Memory(Vec::new()));
                around
            });
            waited.store(1, Ordering::SeqCst);
            first.done(StoredBorder::Memory(vec![rim.clone(), deep]));
            // That which does not touch it (unit 1) was not there yet.
            assert_eq!(last.join().unwrap(), vec![rim]);
        });
        halos.add([node(2, [2, 2, 3])]);
        std::thread::scope(|scope| {
            let second = halos.turn(1);
            let waiting = scope.spawn(|| halos.turn(3).around(5, &cancel).is_err());
            drop(second);
            assert!(waiting.join().unwrap());
        });
    }

    proptest! {
        #[test]
        fn borders_come_back_and_cut_ones_are_told(
            samples in proptest::collection::vec(proptest::collection::vec(any::<[u32; 3]>(), 0..5), 0..5),
        ) {
            let rims: Vec<BorderSamples> = samples.into_iter().zip(0..)
                .map(|(samples, i)| BorderSamples { node: node(i as u8, [i, 2, 3]), samples }).collect();
            let bytes = to_bytes(&rims);
            prop_assert_eq!(&from_bytes(&bytes).unwrap(), &rims);
            if bytes.len() >= 4 {
                prop_assert!(from_bytes(&bytes[..bytes.len() - 4]).is_err());
            }
        }
    }
}
