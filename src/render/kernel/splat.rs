//! The two passes over the splats: the nearest depth, then the colours.

use super::project::Projected;
use crate::render::frame::NO_DEPTH;

/// What a pixel adds up: weight, red, green, blue, and how far behind the front.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(C)]
pub struct Sums {
    pub weight: u64,
    pub color: [u64; 3],
    /// In sixteenths of a pixel, from [`FRONT`].
    pub behind: u64,
}

/// Weight of a splat's middle; it falls to 1 at the edge of the fringe.
pub const HEAVIEST: u32 = 64;
/// What stands for the front itself among the depths that are added up, which
/// are counted in sixteenths of a pixel; they go from 0 to twice as much.
pub const FRONT: u32 = 128;

/// A rectangle of pixels that is drawn at once, with its buffers.
pub struct Tile<'a> {
    /// Of its top left pixel.
    pub left: i32,
    pub top: i32,
    /// Pixels a row, and rows; the buffers are row by row.
    pub width: i32,
    pub height: i32,
    pub depths: &'a mut [u32],
    pub sums: &'a mut [Sums],
}

impl Tile<'_> {
    /// The pixels of the tile whose centres may lie within `reach` of a splat's.
    #[inline(always)]
    fn around(&self, splat: &Projected, reach: i32) -> [std::ops::Range<i32>; 2] {
        let low = |at: i32, start: i32| ((at - reach - 8 + 15) >> 4).max(start) - start;
        let high = |at: i32, start: i32, size: i32| (((at + reach - 8) >> 4) + 1 - start).min(size);
        [
            low(splat.x, self.left)..high(splat.x, self.left, self.width),
            low(splat.y, self.top)..high(splat.y, self.top, self.height),
        ]
    }

    /// From a splat's centre to that of a pixel, along one axis, in sixteenths.
    #[inline(always)]
    fn offset(start: i32, pixel: i32, centre: i32) -> i32 {
        ((start + pixel) << 4) + 8 - centre
    }

    /// Where a stretch of a row lies in the buffers.
    #[inline(always)]
    fn stretch(&self, y: i32, columns: &std::ops::Range<i32>) -> std::ops::Range<usize> {
        let row = y * self.width;
        (row + columns.start) as usize..(row + columns.end) as usize
    }
}

/// The nearest depth of every pixel, by the cores of the splats.
#[inline]
pub fn depth(tile: &mut Tile, splat: &Projected) {
    let [columns, rows] = tile.around(splat, splat.core);
    if columns.is_empty() {
        return;
    }
    let limit = splat.core * splat.core;
    let first = Tile::offset(tile.left, columns.start, splat.x);
    for y in rows {
        let dy = Tile::offset(tile.top, y, splat.y);
        let stretch = tile.stretch(y, &columns);
        let mut dx = first;
        for pixel in &mut tile.depths[stretch] {
            if dx * dx + dy * dy <= limit {
                *pixel = splat.depth.min(*pixel);
            }
            dx += 16;
        }
    }
}

/// Adds a splat's colour where it is not behind the front by more than its
/// blend depth. What reaches over the edge of the front surface from before or
/// from beside is added too: edges become smooth.
#[inline]
pub fn shade(tile: &mut Tile, splat: &Projected, fringe: i32, blended: bool) {
    let reach = splat.core + fringe;
    let limit = reach * reach;
    let [columns, rows] = tile.around(splat, reach);
    if columns.is_empty() {
        return;
    }
    let slope = (HEAVIEST << 16) / limit.max(1) as u32;
    let [r, g, b, _] = splat.color.to_le_bytes().map(u64::from);
    let first = Tile::offset(tile.left, columns.start, splat.x);
    for y in rows {
        let dy = Tile::offset(tile.top, y, splat.y);
        let stretch = tile.stretch(y, &columns);
        let mut dx = first - 16;
        for (&front, sums) in tile.depths[stretch.clone()].iter().zip(&mut tile.sums[stretch]) {
            dx += 16;
            let square = dx * dx + dy * dy;
            if square > limit {
                continue;
            }
            let shown =
                if blended { splat.depth <= front.saturating_add(splat.blend) } else { splat.depth == front };
            if !shown {
                continue;
            }
            let weight = u64::from((((limit - square) as u32 * slope) >> 16).max(1));
            sums.weight += weight;
            sums.color[0] += weight * r;
            sums.color[1] += weight * g;
            sums.color[2] += weight * b;
            sums.behind += weight * u64::from(behind(splat, front));
        }
    }
}

/// How far a splat lies behind the front, in sixteenths of a pixel from
/// [`FRONT`].
#[inline(always)]
fn behind(splat: &Projected, front: u32) -> u32 {
    if front == NO_DEPTH {
        return FRONT;
    }
    let depths = (splat.depth as i32 - front as i32) as f32;
    let pixels = (depths * splat.steepness).max(-(FRONT as f32)).min(FRONT as f32);
    (FRONT as i32 + pixels as i32) as u32
}
