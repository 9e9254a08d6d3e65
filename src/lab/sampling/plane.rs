//! Patterns on a plane: what a sampler makes of white noise, as in the paper's
//! figures 7 and 11. Two levels, as in an octree: the second is sampled from
//! what the first left.

use super::evenness::{self, Evenness};
use super::neighbors::Placed;
use super::spectrum::{Spectrum, spectrum};
use crate::convert::options::Sampling;
use crate::octree::cube::{NodeCube, SPACING_BITS};
use crate::octree::local_octree::{LocalOctreeBuilder, NodeSink};
use crate::octree::node::NodeKey;
use crate::octree::sampling::sampler::IndexedPoint;

/// Bits of the square's side.
const BITS: u32 = 20;
/// Spacings along it.
const SPACINGS: u32 = 1 << SPACING_BITS;
/// Points of the noise, a square of the spacing.
const DENSITY: u32 = 32;
/// Points of a leaf: the square is divided twice.
const LEAF: usize = (SPACINGS * SPACINGS * DENSITY / 8) as usize;

/// What a sampler makes of one square of noise.
pub struct SampledPattern {
    /// Where its samples lie in the unit square.
    pub coarse: Vec<[f64; 2]>,
    /// What a viewer shows one level finer, of four nodes that meet in the middle.
    pub fine: Vec<[f64; 2]>,
    /// Of the finer level.
    pub even: Evenness,
}

/// The samples of level 1 that its parent has not taken, and the points below.
#[derive(Default)]
struct Levels {
    samples: Vec<Placed>,
    below: Vec<Placed>,
}

impl NodeSink for Levels {
    type Error = std::convert::Infallible;

    fn node(&mut self, node: NodeKey, _: NodeCube, items: &[IndexedPoint]) -> Result<(), Self::Error> {
        let into = if node.level == 1 { &mut self.samples } else { &mut self.below };
        into.extend(items.iter().map(|item| placed(item.at)));
        Ok(())
    }
}

/// A point of level 1 and the quadrant that it lies in.
fn placed(at: [u32; 3]) -> Placed {
    let [x, y, _] = at.map(|c| c >> (BITS - 1));
    Placed { node: u64::from(2 * x + y), at: at.map(f64::from) }
}

/// Samples a square of white noise; the seed says which.
pub fn pattern(sampling: Sampling, seed: u32) -> SampledPattern {
    let mut items: Vec<IndexedPoint> = noise(seed).collect();
    let mut spare = items.clone();
    let mut sampler = sampling.sampler(0);
    let mut builder = LocalOctreeBuilder::new(BITS, LEAF, &mut *sampler, Levels::default());
    let Ok(root) = builder.build(NodeKey::ROOT, &mut items, &mut spare);
    let Levels { mut samples, below } = builder.emit;
    samples.extend(root.items.iter().map(|item| placed(item.at)));
    let flat = |at: [f64; 3]| [at[0], at[1]].map(|c| c / f64::from(1u32 << BITS));
    SampledPattern {
        coarse: root.items.iter().map(|item| flat(item.at.map(f64::from))).collect(),
        fine: samples.iter().map(|sample| flat(sample.at)).collect(),
        even: evenness::level(f64::from(1u32 << (BITS - SPACING_BITS - 1)), &samples, &samples, &below),
    }
}

/// Points of a plane in the middle of the cube, all different from seed to seed.
fn noise(seed: u32) -> impl Iterator<Item = IndexedPoint> {
    (0..SPACINGS * SPACINGS * DENSITY).map(move |index| {
        let mut h = (u64::from(seed) << 32 | u64::from(index)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        h = (h ^ h >> 32).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        h = (h ^ h >> 32).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        let h = h ^ h >> 32;
        let mask = (1 << BITS) - 1;
        IndexedPoint { at: [h as u32 & mask, (h >> 32) as u32 & mask, 1 << (BITS - 1)], index }
    })
}

/// The mean spectrum of some patterns.
pub fn spectrum_of(patterns: &[SampledPattern]) -> Spectrum {
    let points: Vec<Vec<[f64; 2]>> = patterns.iter().map(|pattern| pattern.coarse.clone()).collect();
    spectrum(&points, SPACINGS)
}

/// The dots of the finer level around the middle, where its nodes meet, so many
/// of its spacings wide, in the unit square.
pub fn cutting(pattern: &SampledPattern, wide: u32) -> Vec<[f64; 2]> {
    let half = f64::from(wide) / f64::from(4 * SPACINGS);
    let inside = pattern.fine.iter().filter(|at| at.iter().all(|c| (c - 0.5).abs() < half));
    inside.map(|at| at.map(|c| (c - 0.5) / (2.0 * half) + 0.5)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_methods_are_told_apart() {
        let of = |sampling| {
            let patterns: Vec<SampledPattern> = (0..2).map(|seed| pattern(sampling, seed)).collect();
            let even = patterns[0].even;
            (even, spectrum_of(&patterns), cutting(&patterns[0], 24).len())
        };
        let (poisson, blue, dots) = of(Sampling::Poisson);
        assert_eq!((poisson.inside, poisson.across), (0, 0));
        assert!(poisson.hole <= 1.0 && blue.low < 0.15 && blue.line < 8.0, "{poisson:?} {}", blue.line);
        assert!((250..650).contains(&dots), "{dots}");

        let (shells, _, _) = of(Sampling::Shells);
        assert_eq!(shells.inside, 0);
        // Two borders of 64 spacings among 64² of four nodes.
        assert!((0.001..0.03).contains(&shells.across_share()), "{}", shells.across_share());

        let (random, noise, _) = of(Sampling::Random);
        assert!(random.inside_share() > 0.5 && noise.low > 2.0 * blue.low, "{random:?} {}", noise.low);

        let (_, lines, _) = of(Sampling::Nearest);
        assert!(lines.line > 50.0, "{}", lines.line);
    }
}
