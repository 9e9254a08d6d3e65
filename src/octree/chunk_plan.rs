//! The plan: from a census to the chunks that are indexed one at a time
//! ("Fast Out-of-Core Octree Generation", 4.1, merging of sparse cells).
//!
//! A node becomes a chunk where it holds at most `limit` points and its parent
//! holds more. The plan depends on the counts alone: not on threads, memory or
//! the order of the input.

use super::counting_grid::{CountingGrid, Grid, NO_LINK, REFINED};
use super::node::NodeKey;

/// A node whose points are indexed together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunk {
    pub node: NodeKey,
    pub points: u64,
}

/// Chunks in Morton order, and the table that finds a point's chunk.
#[derive(Debug)]
pub struct ChunkPlan {
    pub chunks: Vec<Chunk>,
    census: CountingGrid,
}

/// Points that a chunk may hold for a cloud of `points`: small enough to keep
/// all cores busy and memory low, large enough that what rises above the chunks
/// stays a small part. A function of the cloud alone, so that the octree's bytes
/// do not depend on the machine.
pub fn chunk_limit(points: u64) -> u64 {
    (points / 64).clamp(200_000, 1_000_000.max(points / 8192))
}

/// Cells of the first grid for a cloud of `points`: at most 2²² (32 MiB), fewer
/// for small clouds.
pub fn census_cells(points: u64) -> u64 {
    (points / 8).clamp(1 << 12, 1 << 22)
}

impl ChunkPlan {
    /// Makes the plan; every cell of the census must hold at most `limit`
    /// points or be indivisible.
    pub fn new(mut census: CountingGrid, limit: u64) -> ChunkPlan {
        let pyramids: Vec<Pyramid> = census.grids.iter().map(Pyramid::new).collect();
        let mut plan = CellWalk { pyramids: &pyramids, limit, chunks: Vec::new(), paint: Vec::new() };
        plan.visit(&census, 0, NodeKey::ROOT);
        let CellWalk { chunks, paint, .. } = plan;
        for grid in &mut census.grids {
            if grid.links.is_empty() {
                grid.links = vec![NO_LINK; grid.dims.iter().map(|d| *d as usize).product()];
            }
        }
        for (chunk, (grid, node)) in paint.into_iter().enumerate() {
            paint_cells(&mut census, grid, node, chunk as u32);
        }
        ChunkPlan { chunks, census }
    }

    /// The chunk of tree coordinates, if the census covers them.
    #[inline]
    pub fn chunk_of(&self, tree: [u32; 3]) -> Option<u32> {
        let (grid, cell) = self.census.find(tree)?;
        let link = self.census.grids[grid].links[cell];
        (link != NO_LINK).then_some(link)
    }
}

/// Sums of a grid's counts for all levels above it, within its box.
struct Pyramid {
    /// From the grid's own level upward.
    floors: Vec<Floor>,
}

/// One level of a pyramid: its box of cells, and the points in each.
struct Floor {
    level: u32,
    origin: [u32; 3],
    dims: [u32; 3],
    sums: Vec<u64>,
}

impl Floor {
    /// The floor above: eight cells become one.
    fn halved(&self) -> Floor {
        let origin = self.origin.map(|c| c >> 1);
        let dims: [u32; 3] =
            std::array::from_fn(|a| ((self.origin[a] + self.dims[a] - 1) >> 1) - origin[a] + 1);
        let mut sums = vec![0u64; dims.iter().map(|d| *d as usize).product()];
        let mut cell = 0;
        for z in 0..self.dims[2] {
            for y in 0..self.dims[1] {
                for x in 0..self.dims[0] {
                    let c = std::array::from_fn(|a| ((self.origin[a] + [x, y, z][a]) >> 1) - origin[a]);
                    sums[flat(c, dims)] += self.sums[cell];
                    cell += 1;
                }
            }
        }
        Floor { level: self.level - 1, origin, dims, sums }
    }
}

impl Pyramid {
    fn new(grid: &Grid) -> Pyramid {
        let cells = grid.dims.iter().map(|d| *d as usize).product();
        let sums = (0..cells).map(|c| grid.count(c)).collect();
        let mut floor = Floor { level: grid.level, origin: grid.origin, dims: grid.dims, sums };
        let mut floors = Vec::new();
        while floor.level > 0 && floor.dims != [1; 3] {
            let above = floor.halved();
            floors.push(std::mem::replace(&mut floor, above));
        }
        floors.push(floor);
        Pyramid { floors }
    }

    /// Points within a node at or above the grid's level; `None` below it.
    fn points(&self, node: NodeKey) -> Option<u64> {
        let up = self.floors[0].level.checked_sub(u32::from(node.level))? as usize;
        let Some(floor) = self.floors.get(up) else {
            // Above the top of the pyramid there is one cell left, in one node.
            let top = &self.floors[self.floors.len() - 1];
            let up = top.level - u32::from(node.level);
            return Some(if top.origin.map(|c| c >> up) == node.at { top.sums[0] } else { 0 });
        };
        let c: [u32; 3] = std::array::from_fn(|a| node.at[a].wrapping_sub(floor.origin[a]));
        let inside = (0..3).all(|a| c[a] < floor.dims[a]);
        Some(if inside { floor.sums[flat(c, floor.dims)] } else { 0 })
    }
}

fn flat(c: [u32; 3], dims: [u32; 3]) -> usize {
    (c[2] as usize * dims[1] as usize + c[1] as usize) * dims[0] as usize + c[0] as usize
}

struct CellWalk<'a> {
    pyramids: &'a [Pyramid],
    limit: u64,
    chunks: Vec<Chunk>,
    /// For each chunk the grid that it was found in.
    paint: Vec<(usize, NodeKey)>,
}

impl CellWalk<'_> {
    /// Visits a node through the grid that resolves it; depth is bounded by the
    /// cube's bits.
    fn visit(&mut self, census: &CountingGrid, grid: usize, node: NodeKey) {
        let points = self.pyramids[grid].points(node).unwrap_or(0);
        if points == 0 {
            return;
        }
        let g = &census.grids[grid];
        let at_grid = u32::from(node.level) == g.level;
        let finer = if at_grid { refinement(census, grid, node) } else { None };
        if points <= self.limit || (at_grid && finer.is_none()) {
            self.chunks.push(Chunk { node, points });
            self.paint.push((grid, node));
            return;
        }
        for index in 0..8 {
            self.visit(census, finer.unwrap_or(grid), node.child(index));
        }
    }
}

/// The grid that refines a cell.
fn refinement(census: &CountingGrid, grid: usize, node: NodeKey) -> Option<usize> {
    let g = &census.grids[grid];
    let c: [u32; 3] = std::array::from_fn(|a| node.at[a] - g.origin[a]);
    match g.links.get(flat(c, g.dims)) {
        Some(link) if *link != NO_LINK && link & REFINED != 0 => Some((link & !REFINED) as usize),
        _ => None,
    }
}

/// Links all cells of a grid within a node to a chunk.
fn paint_cells(census: &mut CountingGrid, grid: usize, node: NodeKey, chunk: u32) {
    let g = &mut census.grids[grid];
    let down = g.level - u32::from(node.level);
    let low: [u32; 3] = std::array::from_fn(|a| (node.at[a] << down).max(g.origin[a]) - g.origin[a]);
    let high: [u32; 3] = std::array::from_fn(|a| {
        let end = (u64::from(node.at[a]) + 1) << down;
        (end.min(u64::from(g.origin[a]) + u64::from(g.dims[a])) - u64::from(g.origin[a])) as u32
    });
    for z in low[2]..high[2] {
        for y in low[1]..high[1] {
            let row = flat([0, y, z], g.dims);
            g.links[row + low[0] as usize..row + high[0] as usize].fill(chunk);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plan_of(points: &[[u32; 3]], bits: u32, cells: u64, limit: u64) -> ChunkPlan {
        let low = |a: usize| points.iter().map(|p| p[a]).min().unwrap();
        let high = |a: usize| points.iter().map(|p| p[a]).max().unwrap();
        let mut census =
            CountingGrid::new(bits, [low(0), low(1), low(2)], [high(0), high(1), high(2)], cells);
        assert_eq!(census.count(points.iter().copied()), 0);
        while census.refine(limit) {
            census.count(points.iter().copied());
        }
        ChunkPlan::new(census, limit)
    }

    #[test]
    fn a_small_cloud_is_one_chunk() {
        let plan = plan_of(&[[1, 2, 3], [900, 4, 5]], 10, 512, 10);
        assert_eq!(plan.chunks, vec![Chunk { node: NodeKey::ROOT, points: 2 }]);
    }

    proptest! {
        /// Every point has exactly one chunk, the chunk's node holds it, counts
        /// agree, no chunk is too large unless it is a single position, and no
        /// two sibling sets could have been one chunk.
        #[test]
        fn chunks_partition_the_cloud(
            points in proptest::collection::vec(
                prop_oneof![(0u32..1024, 0u32..64, 0u32..1024), (500u32..504, 3u32..6, 9u32..10)], 1..400),
            cells in prop_oneof![Just(1u64), Just(64), Just(4096)],
            limit in 1u64..50,
        ) {
            let points: Vec<[u32; 3]> = points.into_iter().map(|(x, y, z)| [x, y, z]).collect();
            let plan = plan_of(&points, 10, cells, limit);
            let mut counts = vec![0u64; plan.chunks.len()];
            for p in &points {
                let chunk = plan.chunk_of(*p).expect("every point has a chunk") as usize;
                let node = plan.chunks[chunk].node;
                prop_assert_eq!(p.map(|c| c >> (10 - node.level)), node.at);
                counts[chunk] += 1;
            }
            for (chunk, count) in plan.chunks.iter().zip(&counts) {
                prop_assert_eq!(chunk.points, *count);
                prop_assert!(*count <= limit || chunk.node.level == 10);
                if let Some(parent) = chunk.node.parent() {
                    let in_parent = points.iter()
                        .filter(|p| p.map(|c| c >> (10 - parent.level)) == parent.at).count();
                    prop_assert!(in_parent as u64 > limit);
                }
            }
        }
    }
}
