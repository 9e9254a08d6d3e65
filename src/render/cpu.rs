//! The renderer for every machine: the kernels over tiles of the picture, one
//! thread a tile, so that no two threads ever write the same pixel and no
//! pixel needs an atomic.

use rayon::prelude::*;

use super::frame::{Drawing, NO_DEPTH, Picture, Splat};
use super::kernel::splat::Tile;
use super::kernel::{self, Projected, Sums, Surface};
use super::scene::Scene;

/// Pixels of a tile's side.
const SIDE: u32 = 64;
/// Splats that are put on the screen at a time; of more, those for the first
/// pass are forgotten and made again for the second.
const PIECE: usize = 1 << 21;
/// Splats that a thread projects at a time.
const BATCH: usize = 1 << 14;

/// Buffers that are kept from frame to frame.
#[derive(Default)]
pub struct Cpu {
    tiles: Vec<TileBuffers>,
    across: u32,
    surface: Vec<Surface>,
    other: Vec<Surface>,
}

/// The pixels of a tile.
struct TileBuffers {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    depths: Vec<u32>,
    sums: Vec<Sums>,
}

/// Splats of one batch, sorted by the tiles that they reach into.
struct Bins {
    splats: Vec<Projected>,
    /// Of each tile, and the end of the last.
    starts: Vec<u32>,
}

impl Cpu {
    /// Draws a scene.
    pub fn draw(&mut self, drawing: &Drawing, scene: &Scene) -> Picture {
        let splats = &scene.splats;
        self.clear(drawing);
        if splats.len() <= PIECE {
            let bins = self.project(drawing, splats);
            self.depth(&bins);
            self.shade(drawing, &bins);
        } else {
            splats.chunks(PIECE).for_each(|piece| {
                let bins = self.project(drawing, piece);
                self.depth(&bins);
            });
            splats.chunks(PIECE).for_each(|piece| {
                let bins = self.project(drawing, piece);
                self.shade(drawing, &bins);
            });
        }
        self.resolve(drawing);
        (0..drawing.fill).for_each(|_| self.fill(drawing));
        self.light(drawing)
    }

    fn clear(&mut self, drawing: &Drawing) {
        let (width, height) = (drawing.frame.width, drawing.frame.height);
        let (across, down) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let fits = self.across == across
            && self.tiles.len() as u32 == across * down
            && self.surface.len() == (width * height) as usize;
        if !fits {
            let tile = |number: u32| {
                let (left, top) = (number % across * SIDE, number / across * SIDE);
                let (width, height) = ((width - left).min(SIDE), (height - top).min(SIDE));
                let pixels = (width * height) as usize;
                let (depths, sums) = (vec![NO_DEPTH; pixels], vec![Sums::default(); pixels]);
                TileBuffers { left, top, width, height, depths, sums }
            };
            self.tiles = (0..across * down).map(tile).collect();
            self.across = across;
            self.surface = vec![Surface::EMPTY; (width * height) as usize];
            self.other = self.surface.clone();
        } else {
            self.tiles.par_iter_mut().for_each(|tile| {
                tile.depths.fill(NO_DEPTH);
                tile.sums.fill(Sums::default());
            });
        }
    }

    fn project(&self, drawing: &Drawing, splats: &[Splat]) -> Vec<Bins> {
        let (across, tiles) = (self.across, self.tiles.len());
        splats.par_chunks(BATCH).map(|batch| bins(drawing, batch, across, tiles)).collect()
    }

    fn depth(&mut self, bins: &[Bins]) {
        self.over_tiles(bins, kernel::depth);
    }

    fn shade(&mut self, drawing: &Drawing, bins: &[Bins]) {
        let (fringe, blended) = (drawing.frame.fringe as i32, drawing.frame.blended == 1);
        self.over_tiles(bins, move |tile, splat| kernel::shade(tile, splat, fringe, blended));
    }

    fn over_tiles(&mut self, bins: &[Bins], draw: impl Fn(&mut Tile, &Projected) + Sync) {
        self.tiles.par_iter_mut().enumerate().for_each(|(number, buffers)| {
            let mut tile = buffers.tile();
            for batch in bins {
                let of_tile = batch.starts[number] as usize..batch.starts[number + 1] as usize;
                batch.splats[of_tile].iter().for_each(|splat| draw(&mut tile, splat));
            }
        });
    }

    fn resolve(&mut self, drawing: &Drawing) {
        let (frame, across, tiles) = (&drawing.frame, self.across, &self.tiles);
        rows(&mut self.surface, frame.width).for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let tile = &tiles[(y / SIDE * across + x as u32 / SIDE) as usize];
                let index = ((y - tile.top) * tile.width + x as u32 - tile.left) as usize;
                *pixel = kernel::resolve(frame, tile.depths[index], &tile.sums[index]);
            }
        });
    }

    fn fill(&mut self, drawing: &Drawing) {
        let (frame, before) = (&drawing.frame, &self.surface);
        rows(&mut self.other, frame.width).for_each(|(y, row)| {
            let at = pixels(before, frame.width, frame.height);
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = kernel::fill(frame, &at, x as i32, y as i32);
            }
        });
        std::mem::swap(&mut self.surface, &mut self.other);
    }

    fn light(&self, drawing: &Drawing) -> Picture {
        let frame = &drawing.frame;
        let (width, height) = (frame.width, frame.height);
        let mut picture = Picture { width, height, pixels: vec![[0; 4]; (width * height) as usize] };
        let at = pixels(&self.surface, width, height);
        rows(&mut picture.pixels, width).for_each(|(y, row)| {
            let behind = drawing.background.row(y, height);
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = kernel::light(frame, &at, x as i32, y as i32, behind);
            }
        });
        picture
    }
}

impl TileBuffers {
    fn tile(&mut self) -> Tile<'_> {
        Tile {
            left: self.left as i32,
            top: self.top as i32,
            width: self.width as i32,
            height: self.height as i32,
            depths: &mut self.depths,
            sums: &mut self.sums,
        }
    }
}

/// The tiles that a splat reaches into: the first, how many to the right of it,
/// and how many below. Hardly ever more than the first.
#[derive(Clone, Copy)]
struct Reached {
    first: u32,
    right: u16,
    below: u16,
}

impl Reached {
    fn new(splat: &Projected, fringe: i32, [width, height]: [u32; 2], across: u32) -> Reached {
        let reach = splat.core + fringe;
        let tile = |at: i32, side: u32| ((at >> 4).clamp(0, side as i32 - 1) as u32) / SIDE;
        let (left, right) = (tile(splat.x - reach, width), tile(splat.x + reach, width));
        let (top, bottom) = (tile(splat.y - reach, height), tile(splat.y + reach, height));
        Reached { first: top * across + left, right: (right - left) as u16, below: (bottom - top) as u16 }
    }

    #[inline(always)]
    fn each(self, across: u32, mut of: impl FnMut(usize)) {
        for row in 0..=u32::from(self.below) {
            for column in 0..=u32::from(self.right) {
                of((self.first + row * across + column) as usize);
            }
        }
    }
}

/// Projects a batch and sorts it by tile, in two passes as counting sorts are.
fn bins(drawing: &Drawing, batch: &[Splat], across: u32, tiles: usize) -> Bins {
    let frame = &drawing.frame;
    let mut projected: Vec<(Projected, Reached)> = Vec::with_capacity(batch.len());
    let mut starts = vec![0u32; tiles + 1];
    for splat in batch {
        if let Some(splat) = kernel::project(frame, &drawing.radii, splat) {
            let reached = Reached::new(&splat, frame.fringe as i32, [frame.width, frame.height], across);
            reached.each(across, |tile| starts[tile + 1] += 1);
            projected.push((splat, reached));
        }
    }
    for tile in 0..tiles {
        starts[tile + 1] += starts[tile];
    }
    let mut next = starts.clone();
    let mut splats = vec![Projected::default(); starts[tiles] as usize];
    for (splat, reached) in &projected {
        reached.each(across, |tile| {
            splats[next[tile] as usize] = *splat;
            next[tile] += 1;
        });
    }
    Bins { splats, starts }
}

fn rows<T: Send>(pixels: &mut [T], width: u32) -> impl IndexedParallelIterator<Item = (u32, &mut [T])> {
    pixels.par_chunks_mut(width as usize).enumerate().map(|(y, row)| (y as u32, row))
}

fn pixels(surface: &[Surface], width: u32, height: u32) -> impl Fn(i32, i32) -> Surface + Sync {
    move |x, y| match (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
        true => surface[(y as u32 * width + x as u32) as usize],
        false => Surface::EMPTY,
    }
}
