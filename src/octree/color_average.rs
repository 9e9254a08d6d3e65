//! Averaged colours of coarse levels: a sample keeps its position and shows the
//! mean of the colours around it, its own and those of the node's other
//! candidates nearer than the node's spacing ("Interactive Exploration of Point
//! Clouds", 4.3.1). With the colour of one point alone coarse levels alias, and
//! where scans overlap they show whichever came first.
//!
//! A candidate's colour is the one that it has by then. A child's sample is a mean
//! itself, of what lies around it, so this is a mean of means; each stands for
//! about the same area, so all weigh the same. Candidates of the nodes beside this
//! one are not asked: at its faces a mean is taken over the nearer side.
//!
//! Nearer than the spacing, not as near: a point at just the spacing is the next
//! sample on a regular grid. And as samples of Poisson-disk sampling keep the
//! spacing from each other, each then averages points that are not shown.
//!
//! Whole numbers are added up and divided once, so neither the candidates' order
//! nor threads can be seen in the result.

use super::sampling::sampler::IndexedPoint;
use crate::octree::cube::{NodeCube, SPACING_BITS};

/// Cells on an axis: the node's own and an empty layer on each side.
const AXIS: usize = (1 << SPACING_BITS) + 2;
const CELLS: usize = AXIS * AXIS * AXIS;

/// Bytes that an averager takes, and those it takes for each candidate: its colour,
/// and for the quarter of them that surfaces take as samples, sum and mean.
pub const MEMORY: u64 = (CELLS * size_of::<u32>()) as u64;
pub const MEMORY_A_CANDIDATE: u64 =
    (size_of::<Colour>() + (size_of::<AveragedSample>() + size_of::<Mean>()) / 4) as u64;

pub type Colour = [u16; 3];

/// The mean around a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mean {
    /// Which of the candidates' sets the sample is in, and its index there.
    pub set: u8,
    pub index: u32,
    pub colour: Colour,
}

/// Coordinates within the node.
type NodeCoordinates = [i32; 3];

#[derive(Debug, Clone, Copy)]
struct AveragedSample {
    at: NodeCoordinates,
    /// The sample before it in the same cell, counted from 1; 0 for none.
    next: u32,
    /// Of each channel, and how many were added up.
    sum: [u64; 4],
}

impl AveragedSample {
    /// To the nearest, halves up.
    fn mean(&self) -> Colour {
        let [red, green, blue, count] = self.sum;
        // A sample is near to itself, so there is one at least.
        let count = count.max(1);
        [red, green, blue].map(|sum| ((2 * sum + count) / (2 * count)) as u16)
    }
}

/// A sample around the cell in work, and what that cell's candidates add to it.
#[derive(Debug, Clone, Copy)]
struct Near {
    at: NodeCoordinates,
    number: u32,
    sum: [u32; 4],
}

/// Colours that such a sum has room for.
const MOST_ADDED: u32 = u32::MAX / u16::MAX as u32;

/// Averages node after node with the same buffers.
///
/// Samples are looked up in a grid whose cells are as wide as the spacing. Each
/// candidate adds its colour to the samples of the 27 cells around it that are
/// near enough. However many candidates a cell holds (a crowd at one position, a
/// dense leaf), the samples around it are few, for that is what sampling is
/// about: so the time is linear in the candidates everywhere.
#[derive(Default)]
pub struct Averager {
    /// Per cell its newest sample, counted from 1; 0 for none. Empty until used.
    heads: Vec<u32>,
    samples: Vec<AveragedSample>,
    colours: Vec<Colour>,
    near: Vec<Near>,
    means: Vec<Mean>,
}

/// A cell's place in the grid.
#[inline]
fn head_of([x, y, z]: [usize; 3]) -> usize {
    (z * AXIS + y) * AXIS + x
}

#[inline]
fn cell_of(at: NodeCoordinates, shift: u32) -> [usize; 3] {
    at.map(|c| (c >> shift) as usize + 1)
}

#[inline]
fn squared_distance(a: NodeCoordinates, b: NodeCoordinates) -> i64 {
    let d = |i: usize| i64::from(a[i] - b[i]);
    d(0) * d(0) + d(1) * d(1) + d(2) * d(2)
}

impl Averager {
    /// The means of the candidates that a node takes. `has_below` says whether
    /// there are nodes below its children; `colour` gives that of the candidate
    /// of an index in a set.
    ///
    /// None where nothing stays below: such a node shows its part of the cloud in
    /// full, each point for itself.
    pub fn means(
        &mut self,
        frame: NodeCube,
        has_below: bool,
        candidates: &[&[IndexedPoint]],
        taken: &[bool],
        colour: impl Fn(usize, u32) -> Colour,
    ) -> &[Mean] {
        self.means.clear();
        if !has_below && !taken.contains(&false) {
            return &self.means;
        }
        self.place(frame, candidates, taken);
        // Colours first: they lie far apart, and these reads wait for nothing but
        // themselves.
        self.colours.clear();
        self.colours.extend(numbered(candidates).map(|(set, item)| colour(set, item.index)));
        self.add_up(frame, candidates);
        for sample in &self.samples {
            self.heads[head_of(cell_of(sample.at, frame.spacing_shift()))] = 0;
        }
        let samples = taken_of(candidates, taken).zip(self.samples.drain(..));
        self.means.extend(samples.map(|((set, item), sample)| Mean {
            set: set as u8,
            index: item.index,
            colour: sample.mean(),
        }));
        &self.means
    }

    /// Puts the samples into the grid.
    fn place(&mut self, frame: NodeCube, candidates: &[&[IndexedPoint]], taken: &[bool]) {
        if self.heads.is_empty() {
            self.heads = vec![0; CELLS];
        }
        for (_, item) in taken_of(candidates, taken) {
            let at = frame.local(item.at).map(|c| c as i32);
            let head = &mut self.heads[head_of(cell_of(at, frame.spacing_shift()))];
            self.samples.push(AveragedSample { at, next: *head, sum: [0; 4] });
            *head = self.samples.len() as u32;
        }
    }

    /// Adds each candidate's colour to the samples that it is near to.
    fn add_up(&mut self, frame: NodeCube, candidates: &[&[IndexedPoint]]) {
        let Averager { heads, samples, colours, near, .. } = self;
        let shift = frame.spacing_shift();
        let squared = 1i64 << (2 * shift);
        let (mut cell, mut added) = ([usize::MAX; 3], 0);
        let mut colours = colours.iter();
        for set in candidates {
            for (item, colour) in set.iter().zip(colours.by_ref()) {
                let at = frame.local(item.at).map(|c| c as i32);
                let own = cell_of(at, shift);
                // Candidates of a cell come together, so this is once a cell.
                if own != cell || added == MOST_ADDED {
                    settle(near, samples);
                    gather(heads, samples, own, near);
                    (cell, added) = (own, 0);
                }
                added += 1;
                let [red, green, blue] = colour.map(u32::from);
                // About every third is near, by no pattern: so nothing branches.
                for other in near.iter_mut() {
                    let mask = if squared_distance(at, other.at) < squared { u32::MAX } else { 0 };
                    for (sum, value) in other.sum.iter_mut().zip([red, green, blue, 1]) {
                        *sum += value & mask;
                    }
                }
            }
        }
        settle(near, samples);
    }
}

/// Adds to the samples what the candidates of a cell have added.
fn settle(near: &mut Vec<Near>, samples: &mut [AveragedSample]) {
    for near in near.drain(..) {
        let sample = &mut samples[near.number as usize];
        for (sum, more) in sample.sum.iter_mut().zip(near.sum) {
            *sum += u64::from(more);
        }
    }
}

/// The samples of the 27 cells around a cell.
fn gather(heads: &[u32], samples: &[AveragedSample], [x, y, z]: [usize; 3], near: &mut Vec<Near>) {
    // First the cells that hold some, which are few: each is written down, and then
    // counted if it does.
    let (mut occupied, mut count) = ([0; 27], 0);
    for row in 0..9 {
        let first = head_of([x - 1, y + row % 3 - 1, z + row / 3 - 1]);
        for head in &heads[first..first + 3] {
            occupied[count] = *head;
            count += usize::from(*head != 0);
        }
    }
    for head in &occupied[..count] {
        let mut next = *head;
        while let Some(number) = next.checked_sub(1) {
            let sample = &samples[number as usize];
            near.push(Near { at: sample.at, number, sum: [0; 4] });
            next = sample.next;
        }
    }
}

/// Candidates with their set's number, of which there are at most eight.
fn numbered<'c>(candidates: &'c [&'c [IndexedPoint]]) -> impl Iterator<Item = (usize, &'c IndexedPoint)> {
    candidates.iter().enumerate().flat_map(|(set, items)| items.iter().map(move |item| (set, item)))
}

/// Those of them that the node takes.
fn taken_of<'c>(
    candidates: &'c [&'c [IndexedPoint]],
    taken: &'c [bool],
) -> impl Iterator<Item = (usize, &'c IndexedPoint)> {
    numbered(candidates).zip(taken).filter(|(_, taken)| **taken).map(|(candidate, _)| candidate)
}

#[cfg(test)]
mod tests {
    use super::super::local_octree::{LocalOctreeBuilder, NodeSink};
    use super::super::sampling::poisson::PoissonDisk;
    use super::super::sampling::sampler::Sampler;
    use super::*;
    use crate::octree::node::NodeKey;
    use proptest::prelude::*;
    use std::collections::HashMap;

    fn items(points: &[[u32; 3]]) -> Vec<IndexedPoint> {
        points.iter().zip(0..).map(|(at, index)| IndexedPoint { at: *at, index }).collect()
    }

    /// By comparing all with all.
    fn plainly(
        frame: NodeCube,
        items: &[IndexedPoint],
        taken: &[bool],
        colours: &[Colour],
    ) -> HashMap<u32, Colour> {
        let squared = 1i64 << (2 * frame.spacing_shift());
        let local = |item: &IndexedPoint| frame.local(item.at).map(|c| c as i32);
        let samples = items.iter().zip(taken).filter(|(_, taken)| **taken);
        samples
            .map(|(sample, _)| {
                let near: Vec<&IndexedPoint> = items
                    .iter()
                    .filter(|item| squared_distance(local(item), local(sample)) < squared)
                    .collect();
                let mean = |channel: usize| {
                    let values = near.iter().map(|item| f64::from(colours[item.index as usize][channel]));
                    (values.sum::<f64>() / near.len() as f64 + 0.5).floor() as u16
                };
                (sample.index, [mean(0), mean(1), mean(2)])
            })
            .collect()
    }

    fn by_index(means: &[Mean]) -> HashMap<u32, Colour> {
        means.iter().map(|mean| (mean.index, mean.colour)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// The same as by comparing all with all, in any order of the candidates,
        /// and one node after the other with the same buffers.
        #[test]
        fn means_are_those_of_what_is_nearer_than_the_spacing(
            points in proptest::collection::vec(
                ((0u32..1024, 0u32..200, 0u32..40), any::<[u16; 3]>(), 0u32..4), 2..300),
            side_bits in 6u32..12,
            part in 0.0f64..1.0,
            turn in 0usize..300,
        ) {
            let squeeze = 10 - side_bits.min(10);
            let at: Vec<[u32; 3]> =
                points.iter().map(|((x, y, z), ..)| [x >> squeeze, y >> squeeze, z >> squeeze]).collect();
            let colours: Vec<Colour> = points.iter().map(|(_, colour, _)| *colour).collect();
            let origin = [1 << side_bits; 3];
            let frame = NodeCube { origin, side_bits };
            let at: Vec<[u32; 3]> = at.iter().map(|p| p.map(|c| c + (1 << side_bits))).collect();
            let items = items(&at);
            let mut taken: Vec<bool> = points.iter().map(|(.., dice)| *dice == 0).collect();
            taken[0] = false;
            let expected = plainly(frame, &items, &taken, &colours);
            let mut averager = Averager::default();
            let colour = |_: usize, index: u32| colours[index as usize];
            let (left, right) = items.split_at((items.len() as f64 * part) as usize);
            let means = averager.means(frame, false, &[left, right], &taken, colour);
            prop_assert!(means.iter().all(|mean| mean.set == u8::from(mean.index as usize >= left.len())));
            prop_assert_eq!(by_index(means), expected.clone());
            let (mut turned, mut flags) = (items.clone(), taken.clone());
            turned.rotate_left(turn % items.len());
            flags.rotate_left(turn % items.len());
            turned.reverse();
            flags.reverse();
            prop_assert_eq!(by_index(averager.means(frame, false, &[&turned], &flags, colour)), expected);
        }
    }

    /// A hundred thousand at one position weigh as many, in a number that holds
    /// their sum, and cost one look each at the sample among them.
    #[test]
    fn a_crowd_is_summed_up_whole() {
        let crowd = 100_000;
        let mut at = vec![[500; 3]; crowd];
        at.push([505; 3]);
        let items = items(&at);
        let mut taken = vec![false; items.len()];
        (taken[7], taken[crowd]) = (true, true);
        let colour =
            |_: usize, index: u32| if index as usize == crowd { [0; 3] } else { [65_535, 65_535, 1] };
        let mut averager = Averager::default();
        let means = by_index(averager.means(
            NodeCube { origin: [0; 3], side_bits: 10 },
            false,
            &[&items],
            &taken,
            colour,
        ));
        // 5√3 is more than the spacing of 8.
        assert_eq!(means[&7], [65_535, 65_535, 1]);
        assert_eq!(means[&(crowd as u32)], [0; 3]);
        let near = by_index(averager.means(
            NodeCube { origin: [0; 3], side_bits: 11 },
            false,
            &[&items],
            &taken,
            colour,
        ));
        assert_eq!(near[&7], [65_534, 65_534, 1]);
    }

    #[test]
    fn halves_are_rounded_up_and_a_node_that_shows_all_averages_nothing() {
        let items = items(&[[0; 3], [1, 0, 0]]);
        let frame = NodeCube { origin: [0; 3], side_bits: 10 };
        let colour = |_: usize, index: u32| [index as u16, 3 * index as u16, 10];
        let mut averager = Averager::default();
        let one = averager.means(frame, false, &[&items], &[true, false], colour);
        assert_eq!(one, [Mean { set: 0, index: 0, colour: [1, 2, 10] }]);
        assert!(averager.means(frame, false, &[&items], &[true, true], colour).is_empty());
        assert_eq!(averager.means(frame, true, &[&items], &[true, true], colour).len(), 2);
    }

    /// Colours as a tree's nodes get them.
    struct Painted {
        averager: Averager,
        colours: Vec<Colour>,
        nodes: HashMap<NodeKey, Vec<(u32, Colour)>>,
    }

    impl Painted {
        fn put(&mut self, node: NodeKey, items: &[IndexedPoint]) {
            let painted = items.iter().map(|item| (item.index, self.colours[item.index as usize]));
            self.nodes.insert(node, painted.collect());
        }
    }

    impl NodeSink for Painted {
        type Error = std::convert::Infallible;

        fn sampled(
            &mut self,
            frame: NodeCube,
            has_below: bool,
            candidates: &[&[IndexedPoint]],
            taken: &[bool],
        ) {
            let colours = &mut self.colours;
            let colour = |_: usize, index: u32| colours[index as usize];
            let means = self.averager.means(frame, has_below, candidates, taken, colour);
            means.iter().for_each(|mean| colours[mean.index as usize] = mean.colour);
        }

        fn node(&mut self, node: NodeKey, _: NodeCube, items: &[IndexedPoint]) -> Result<(), Self::Error> {
            self.put(node, items);
            Ok(())
        }
    }

    fn painted(points: &[[u32; 3]], colours: &[Colour], sampler: &mut dyn Sampler) -> Painted {
        let mut items = items(points);
        let mut spare = items.clone();
        let emit =
            Painted { averager: Averager::default(), colours: colours.to_vec(), nodes: HashMap::new() };
        let mut builder = LocalOctreeBuilder::new(10, 40, sampler, emit);
        let root = builder.build(NodeKey::ROOT, &mut items, &mut spare).unwrap();
        let mut painted = builder.emit;
        painted.put(NodeKey::ROOT, &root.items);
        painted
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        /// Nodes with nothing below them show their points' own colours; all
        /// others stay within what they average.
        #[test]
        fn leaves_keep_their_colours_and_means_stay_within_the_cloud_s(
            points in proptest::collection::vec(((0u32..1024, 0u32..1024, 0u32..64), 100u16..9000), 1..900),
            random in any::<bool>(),
        ) {
            let at: Vec<[u32; 3]> = points.iter().map(|((x, y, z), _)| [*x, *y, *z]).collect();
            let colours: Vec<Colour> = points.iter().map(|(_, c)| [*c, 9000 - c, 77]).collect();
            let painted = if random {
                painted(&at, &colours, &mut super::super::sampling::random_in_grid::RandomInGrid)
            } else {
                painted(&at, &colours, &mut PoissonDisk::default())
            };
            let bounds = |channel: usize| {
                let values = colours.iter().map(|colour| colour[channel]);
                (values.clone().min().unwrap(), values.max().unwrap())
            };
            for (node, points) in &painted.nodes {
                let is_leaf = (0..8).all(|child| !painted.nodes.contains_key(&node.child(child)));
                for (index, colour) in points {
                    prop_assert!(!is_leaf || *colour == colours[*index as usize], "{node}");
                    for channel in 0..3 {
                        let (low, high) = bounds(channel);
                        prop_assert!((low..=high).contains(&colour[channel]));
                    }
                }
            }
        }
    }

    /// Two scans of one wall, the first all red, the second all blue: samples of
    /// the first alone would be red. Their means are some of each.
    #[test]
    fn coarse_levels_show_both_of_two_scans() {
        let wall = |shift: u32| (0..10_000u32).map(move |i| [i % 100 * 10 + shift, i / 100 * 10, 8]);
        let at: Vec<[u32; 3]> = wall(0).chain(wall(4)).collect();
        let colours: Vec<Colour> =
            (0..at.len()).map(|i| if i < 10_000 { [1000, 0, 0] } else { [0, 0, 1000] }).collect();
        let painted = painted(&at, &colours, &mut PoissonDisk::default());
        let root = &painted.nodes[&NodeKey::ROOT];
        assert!(root.len() > 1000);
        let blue = root.iter().map(|(_, colour)| u64::from(colour[2])).sum::<u64>() / root.len() as u64;
        assert!((250..=750).contains(&blue), "{blue}");
    }
}
