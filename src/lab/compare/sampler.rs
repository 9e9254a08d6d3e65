//! What each sampler costs by itself: one tree of a part of the cloud, on one
//! thread, and only the time inside the sampler counts.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::method::Method;
use super::options::CompareOptions;
use super::steps::Steps;
use crate::format::las::LasFile;
use crate::lab::process::{Spread, spread};
use crate::lab::settings::Result;
use crate::octree::cube::{Cube, NodeCube};
use crate::octree::lattice::Lattice;
use crate::octree::local_octree::{LocalOctreeBuilder, NodeSink};
use crate::octree::node::{LEAF_LIMIT, NodeKey};
use crate::octree::record;
use crate::octree::sampling::sampler::{BorderSamples, IndexedPoint, Sampler};

/// Points that are looked at: the first of the first file.
const MOST: usize = 4_000_000;
const SLICE: u32 = 1 << 20;

/// Nanoseconds a point of each sampler, in the order of [`Method::samplers`].
pub fn measure(
    options: &CompareOptions,
    name: &str,
    files: &[PathBuf],
    steps: &Steps,
) -> Result<Vec<Spread>> {
    let (cube, items) = first_points(files)?;
    let mut spent: Vec<Vec<f64>> = vec![Vec::new(); Method::samplers().count()];
    for round in 0..options.means.rounds {
        steps.next(format!("{name}: samplers alone, round {} of {}", round + 1, options.means.rounds));
        for (method, spent) in Method::samplers().zip(&mut spent) {
            let mut sampler = Timed { sampler: method.sampling.sampler(cube.slack()), spent: Duration::ZERO };
            let (mut items, mut spare) = (items.clone(), items.clone());
            let mut builder = LocalOctreeBuilder::new(cube.bits, LEAF_LIMIT, &mut sampler, Nowhere);
            let Ok(_) = builder.build(NodeKey::ROOT, &mut items, &mut spare);
            spent.push(sampler.spent.as_secs_f64() * 1e9 / items.len().max(1) as f64);
            options.means.go_on()?;
        }
    }
    Ok(spent.into_iter().map(|spent| spread(spent.into_iter())).collect())
}

fn first_points(files: &[PathBuf]) -> Result<(Cube, Vec<IndexedPoint>)> {
    let mut positions: Vec<[i32; 3]> = Vec::new();
    let (mut records, mut scale) = (Vec::new(), [1.0; 3]);
    if let Some(path) = files.first() {
        let file = LasFile::open(path)?;
        scale = file.header().scale;
        for slice in file.slices(SLICE) {
            file.read(slice, &mut records)?;
            let read = records.chunks_exact(file.header().record_length);
            positions.extend(read.map(record::raw_position));
            if positions.len() >= MOST {
                break;
            }
        }
    }
    positions.truncate(MOST);
    let bound = |of: fn(i32, i32) -> i32| {
        let all = positions.iter().copied();
        all.reduce(|a, b| std::array::from_fn(|axis| of(a[axis], b[axis]))).unwrap_or_default()
    };
    let (min, max) = (bound(i32::min), bound(i32::max));
    let (offset, exact, finest, too_wide) = ([0.0; 3], [true; 3], scale, [false; 3]);
    let cube = Cube::around(&Lattice { scale, offset, exact, finest, too_wide, min, max });
    let items = positions.iter().zip(0..).map(|(at, index)| IndexedPoint { at: cube.tree(*at), index });
    Ok((cube, items.collect()))
}

/// A sampler under a stopwatch.
struct Timed {
    sampler: Box<dyn Sampler>,
    spent: Duration,
}

impl Sampler for Timed {
    fn begin(&mut self, around: Vec<BorderSamples>) {
        self.sampler.begin(around);
    }

    fn sample(
        &mut self,
        node: NodeKey,
        frame: NodeCube,
        candidates: &[&[IndexedPoint]],
        taken: &mut Vec<bool>,
    ) {
        let started = Instant::now();
        self.sampler.sample(node, frame, candidates, taken);
        self.spent += started.elapsed();
    }
}

/// Where nodes go when only the way there matters.
struct Nowhere;

impl NodeSink for Nowhere {
    type Error = std::convert::Infallible;

    fn node(&mut self, _: NodeKey, _: NodeCube, _: &[IndexedPoint]) -> std::result::Result<(), Self::Error> {
        Ok(())
    }
}
