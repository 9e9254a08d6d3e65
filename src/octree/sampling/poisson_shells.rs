//! Poisson-disk sampling as the paper has it ("Fast Out-of-Core Octree
//! Generation", section 5, figure 6): candidates from the centre outward, each
//! checked against the samples in a shell as thick as the spacing.
//!
//! It is here to be measured against: [`super::poisson`] keeps the same promise
//! with cells instead of shells, several times as fast, and across nodes too.
//! A shell of a dense volume holds hundreds of thousands of samples: there this
//! one's time grows by more than the points.

use super::sampler::{IndexedPoint, Sampler};
use crate::octree::cube::NodeCube;
use crate::octree::node::NodeKey;

#[derive(Default)]
pub struct Shells {
    /// As [`super::poisson::PoissonDisk::with_slack`] has it.
    slack: u32,
    visit: Vec<ShellCandidate>,
    samples: Vec<ShellCandidate>,
}

/// A point seen from the node's centre, in tree units.
#[derive(Debug, Clone, Copy)]
struct ShellCandidate {
    at: [i64; 3],
    squared: u64,
    distance: f64,
    ordinal: u32,
}

impl Shells {
    pub fn with_slack(slack: u32) -> Shells {
        Shells { slack, ..Shells::default() }
    }
}

impl Sampler for Shells {
    fn sample(&mut self, _: NodeKey, frame: NodeCube, candidates: &[&[IndexedPoint]], taken: &mut Vec<bool>) {
        let reach = (1u64 << frame.spacing_shift()) + u64::from(self.slack);
        let centre = (1i64 << frame.side_bits) / 2;
        self.visit.clear();
        let items = candidates.iter().flat_map(|set| set.iter());
        self.visit.extend(items.zip(0..).map(|(item, ordinal)| {
            let at = frame.local(item.at).map(|c| i64::from(c) - centre);
            let squared = squared(at, [0; 3]);
            ShellCandidate { at, squared, distance: (squared as f64).sqrt(), ordinal }
        }));
        self.visit.sort_unstable_by_key(|candidate| (candidate.squared, candidate.ordinal));
        taken.clear();
        taken.resize(self.visit.len(), false);
        self.samples.clear();
        for candidate in &self.visit {
            // Room for what a root is rounded by: a shell too thick is still right.
            let shell = candidate.distance - reach as f64 - 1.0;
            let within = self.samples.iter().rev().take_while(|sample| sample.distance >= shell);
            if within.into_iter().all(|sample| squared(sample.at, candidate.at) >= reach * reach) {
                self.samples.push(*candidate);
                taken[candidate.ordinal as usize] = true;
            }
        }
    }
}

/// Without a sign: three squares of 62 bits fit.
fn squared(a: [i64; 3], b: [i64; 3]) -> u64 {
    (0..3).map(|i| a[i].abs_diff(b[i]).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The same as by comparing with every sample.
        #[test]
        fn shells_leave_nothing_out(
            points in proptest::collection::vec((0u32..1024, 0u32..1024, 0u32..40), 1..400), slack in 0u32..3,
        ) {
            let items: Vec<IndexedPoint> =
                points.iter().zip(0..).map(|((x, y, z), index)| IndexedPoint { at: [*x, *y, *z], index }).collect();
            let mut taken = Vec::new();
            let frame = NodeCube { origin: [0; 3], side_bits: 10 };
            Shells::with_slack(slack).sample(NodeKey::ROOT, frame, &[&items], &mut taken);
            let at = |item: &IndexedPoint| item.at.map(i64::from);
            let mut visit: Vec<&IndexedPoint> = items.iter().collect();
            visit.sort_by_key(|item| squared(at(item), [512; 3]));
            let least = (8 + u64::from(slack)).pow(2);
            let mut samples: Vec<&IndexedPoint> = Vec::new();
            for item in visit {
                let free = samples.iter().all(|other| squared(at(item), at(other)) >= least);
                prop_assert_eq!(taken[item.index as usize], free);
                samples.extend(free.then_some(item));
            }
        }
    }
}
