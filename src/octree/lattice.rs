//! The lattice: the one place where positions are rounded.
//!
//! LAS positions are 32-bit integers with a scale and an offset per file. A
//! data set gets one lattice (one scale and offset per axis), chosen so that
//! every input position falls on it exactly wherever the inputs allow it;
//! otherwise positions are rounded once, here, by at most half a unit.
//! (DESIGN.md, decision 1. Converters that keep the bounding box minimum
//! as their offset move nearly every point instead.)

use serde::{Deserialize, Serialize};

use crate::words;

/// How one file stores positions, and the box of the integers it really holds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SourceGrid {
    /// Never 0; below 0, the integers are a mirror of the world.
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// Smallest and largest stored integer per axis.
    pub min: [i32; 3],
    pub max: [i32; 3],
}

impl SourceGrid {
    /// The integers of a box of world coordinates. A negative scale mirrors them;
    /// a box that is none, as headers have, becomes a point.
    pub fn around(scale: [f64; 3], offset: [f64; 3], low: [f64; 3], high: [f64; 3]) -> SourceGrid {
        let raw = |world: [f64; 3]| -> [i32; 3] {
            std::array::from_fn(|a| ((world[a] - offset[a]) / scale[a]).round() as i32)
        };
        let (low, high) = (raw(low), raw(high));
        let is_mirrored = |a: usize| scale[a] < 0.0;
        let min: [i32; 3] = std::array::from_fn(|a| if is_mirrored(a) { high[a] } else { low[a] });
        let max = std::array::from_fn(|a| if is_mirrored(a) { low[a] } else { high[a] }.max(min[a]));
        SourceGrid { scale, offset, min, max }
    }
}

/// World = stored integer × scale + offset, per axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// Per axis, whether every input position lies on the lattice.
    pub exact: [bool; 3],
    /// Finest scale of the inputs.
    pub finest: [f64; 3],
    /// Per axis, whether the inputs share a lattice on which they do not fit into
    /// 32 bits.
    pub too_wide: [bool; 3],
    /// Box of the stored integers of all inputs.
    pub min: [i32; 3],
    pub max: [i32; 3],
}

impl Lattice {
    /// World coordinate of a stored integer.
    pub fn world(&self, axis: usize, stored: i64) -> f64 {
        (stored as f64).mul_add(self.scale[axis], self.offset[axis])
    }

    pub fn is_exact(&self) -> bool {
        self.exact.iter().all(|e| *e)
    }

    /// Most that a position can have moved along an axis, as a length.
    pub fn error(&self, axis: usize) -> f64 {
        if self.exact[axis] { 0.0 } else { 0.5 * self.scale[axis] }
    }

    /// The same in units of the finest input, along the axis where it is most.
    pub fn error_in_units(&self) -> f64 {
        (0..3).map(|axis| self.error(axis) / self.finest[axis]).fold(0.0, f64::max)
    }

    /// Says of axes that are not exact how far positions moved, and why.
    pub fn notes(&self) -> Vec<String> {
        let inexact = (0..3).filter(|axis| !self.exact[*axis]);
        let told = inexact.map(|axis| {
            let (scale, finest, error) = (self.scale[axis], self.finest[axis], self.error(axis));
            let why = match self.too_wide[axis] {
                true => "the inputs reach too far for 32-bit integers of a finer scale",
                false => "the inputs' scales and offsets share no lattice",
            };
            let [scale, error, units] =
                [scale, error, error / finest].map(|number| words::number(words::rounded(number, 6)));
            let axis = ["x", "y", "z"][axis];
            format!("{axis} was rounded to {scale}, by at most {error}, {units} of the finest input's units: {why}")
        });
        told.collect()
    }
}

/// From one file's integers to the lattice's, per axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum AxisMapping {
    /// stored = raw × mul + add, exactly.
    Integer { mul: i64, add: i64 },
    /// stored = round((raw × scale + offset − to_offset) / to_scale).
    Float { scale: f64, offset: f64, to_scale: f64, to_offset: f64 },
}

impl AxisMapping {
    fn apply(&self, raw: i32) -> i64 {
        match *self {
            AxisMapping::Integer { mul, add } => i64::from(raw) * mul + add,
            AxisMapping::Float { scale, offset, to_scale, to_offset } => {
                ((f64::from(raw) * scale + offset - to_offset) / to_scale).round() as i64
            }
        }
    }
}

/// Requantises one file's positions onto the data set's lattice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Requantise {
    axes: [AxisMapping; 3],
    /// Set where all axes only add: the usual case, and the fast one.
    shift: Option<[i64; 3]>,
}

impl Requantise {
    fn new(axes: [AxisMapping; 3]) -> Requantise {
        let mut shift = [0; 3];
        let mut only_adds = true;
        for (to, axis) in shift.iter_mut().zip(&axes) {
            match axis {
                AxisMapping::Integer { mul: 1, add } => *to = *add,
                _ => only_adds = false,
            }
        }
        Requantise { axes, shift: only_adds.then_some(shift) }
    }

    /// The lattice integers of a raw position. Positions within the box that
    /// the lattice was chosen for always fit 32 bits; a position outside (a
    /// file changed under our feet) wraps, and is caught by the bounds check of
    /// whoever uses it.
    #[inline]
    pub fn stored(&self, raw: [i32; 3]) -> [i32; 3] {
        match &self.shift {
            Some(s) => [
                (i64::from(raw[0]) + s[0]) as i32,
                (i64::from(raw[1]) + s[1]) as i32,
                (i64::from(raw[2]) + s[2]) as i32,
            ],
            None => std::array::from_fn(|a| self.axes[a].apply(raw[a]) as i32),
        }
    }
}

/// Chooses the lattice of a data set and how each file gets onto it.
///
/// `misread` tells whether a box of stored integers holds positions that
/// viewers' decoders misread; the offset is then moved to the box's corner.
/// Sources without points must be left out; at least one must remain.
pub fn choose(
    sources: &[SourceGrid],
    misread: impl Fn([i64; 3], [i64; 3]) -> bool,
) -> (Lattice, Vec<Requantise>) {
    let chosen: [AxisChoice; 3] = std::array::from_fn(|a| choose_axis(sources, a));
    let mut shift: [i64; 3] = std::array::from_fn(|a| chosen[a].offset_shift());
    let boxed = |shift: &[i64; 3]| {
        let low: [i64; 3] = std::array::from_fn(|a| chosen[a].low - shift[a]);
        let high: [i64; 3] = std::array::from_fn(|a| chosen[a].high - shift[a]);
        (low, high)
    };
    let (low, high) = boxed(&shift);
    if misread(low, high) {
        shift = std::array::from_fn(|a| chosen[a].corner_shift());
    }
    let (low, high) = boxed(&shift);
    let lattice = Lattice {
        scale: std::array::from_fn(|a| chosen[a].scale),
        offset: std::array::from_fn(|a| moved(chosen[a].offset, chosen[a].scale, shift[a])),
        exact: std::array::from_fn(|a| chosen[a].exact),
        finest: std::array::from_fn(|a| chosen[a].finest),
        too_wide: std::array::from_fn(|a| chosen[a].too_wide),
        min: low.map(|v| v as i32),
        max: high.map(|v| v as i32),
    };
    let requantise = (0..sources.len())
        .map(|i| {
            Requantise::new(std::array::from_fn(|a| match chosen[a].axes[i] {
                AxisMapping::Integer { mul, add } => AxisMapping::Integer { mul, add: add - shift[a] },
                AxisMapping::Float { scale, offset, to_scale, .. } => {
                    AxisMapping::Float { scale, offset, to_scale, to_offset: lattice.offset[a] }
                }
            }))
        })
        .collect();
    (lattice, requantise)
}

/// An offset moved by whole units, rounded once; never the -0 that some
/// headers have.
fn moved(offset: f64, scale: f64, units: i64) -> f64 {
    if units == 0 { offset + 0.0 } else { (units as f64).mul_add(scale, offset) }
}

/// What was chosen for one axis, before the offset is moved.
struct AxisChoice {
    scale: f64,
    offset: f64,
    exact: bool,
    finest: f64,
    too_wide: bool,
    /// Box of the integers on this lattice, before the shift.
    low: i64,
    high: i64,
    axes: Vec<AxisMapping>,
}

/// Positions span fewer than 2³² lattice units, so that they fit an int32.
const SPAN: i64 = 1 << 32;

impl AxisChoice {
    fn fits(&self) -> bool {
        self.high - self.low < SPAN
    }

    /// Units to move the offset by so that all integers fit 32 bits; 0 wherever
    /// the input's own offset serves.
    fn offset_shift(&self) -> i64 {
        if self.low >= i64::from(i32::MIN) && self.high <= i64::from(i32::MAX) {
            0
        } else {
            self.corner_shift()
        }
    }

    /// Units that bring the box's corner to [`CLEAR`], or its middle to 0 where
    /// it is too long for that.
    fn corner_shift(&self) -> i64 {
        match self.high - self.low <= i64::from(i32::MAX) - CLEAR {
            true => self.low - CLEAR,
            false => self.low - i64::from(i32::MIN),
        }
    }
}

/// From here up to 2^26 a coordinate, on any one axis, makes viewers' decoders
/// read the whole position; below, at a corner of 0, they would still lose the
/// high bits that the other axes of a wide cloud have.
const CLEAR: i64 = 1 << 11;

fn choose_axis(sources: &[SourceGrid], axis: usize) -> AxisChoice {
    let mut scales: Vec<f64> = sources.iter().map(|s| s.scale[axis].abs()).collect();
    scales.sort_by(f64::total_cmp);
    scales.dedup();
    let finest = scales[0];
    // Scales such as 0.01 and 0.025 meet on a finer one, and so do offsets
    // that are half a unit apart.
    let mut too_wide = false;
    for divisor in [1.0, 2.0, 4.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 1000.0] {
        match exact_axis(sources, axis, finest / divisor) {
            Some(choice) if choice.fits() => return AxisChoice { finest, ..choice },
            Some(_) => too_wide = true,
            None => {}
        }
    }
    // Inputs may be so far apart that no scale of theirs spans them.
    let mut scale = finest;
    let mut others = scales.into_iter().skip(1);
    loop {
        let choice = rounded_axis(sources, axis, scale);
        if choice.fits() {
            return AxisChoice { finest, too_wide, ..choice };
        }
        scale = others.next().unwrap_or(scale * 2.0);
    }
}

/// The part of a unit up to which what keeps an offset from being whole units
/// away may be the noise of its binary digits. Where these are coarser than that,
/// nobody can tell noise from another lattice, and positions count as rounded.
const MOST_NOISE: f64 = 0.1;

/// The axis on `scale` and the first source's offset, if all sources lie on it.
fn exact_axis(sources: &[SourceGrid], axis: usize, scale: f64) -> Option<AxisChoice> {
    let offset = sources[0].offset[axis];
    let mut choice = AxisChoice::new(scale, offset, true);
    for source in sources {
        let ratio = source.scale[axis] / scale;
        let mul = ratio.round();
        // Relative: what the decimal scale lost when it became binary.
        if mul == 0.0 || (ratio - mul).abs() > mul.abs() * 1e-12 {
            return None;
        }
        let distance = source.offset[axis] - offset;
        let add = (distance / scale).round();
        let noise = 4.0 * f64::EPSILON * (source.offset[axis].abs() + offset.abs()) / scale;
        if add.abs() > 1e15 || (distance / scale - add).abs() > 1e-6 + noise.min(MOST_NOISE) {
            return None;
        }
        choice.include(source, axis, AxisMapping::Integer { mul: mul as i64, add: add as i64 });
    }
    Some(choice)
}

fn rounded_axis(sources: &[SourceGrid], axis: usize, scale: f64) -> AxisChoice {
    let offset = sources[0].offset[axis];
    let mut choice = AxisChoice::new(scale, offset, false);
    for source in sources {
        let to = AxisMapping::Float {
            scale: source.scale[axis],
            offset: source.offset[axis],
            to_scale: scale,
            to_offset: offset,
        };
        choice.include(source, axis, to);
    }
    // Moving the offset rounds it, and so may move a rounded position by one.
    choice.low = choice.low.saturating_sub(1);
    choice.high = choice.high.saturating_add(1);
    choice
}

impl AxisChoice {
    fn new(scale: f64, offset: f64, exact: bool) -> AxisChoice {
        let (low, high) = (i64::MAX, i64::MIN);
        AxisChoice { scale, offset, exact, finest: scale, too_wide: false, low, high, axes: Vec::new() }
    }

    fn include(&mut self, source: &SourceGrid, axis: usize, to: AxisMapping) {
        for raw in [source.min[axis], source.max[axis]] {
            let stored = to.apply(raw);
            self.low = self.low.min(stored);
            self.high = self.high.max(stored);
        }
        self.axes.push(to);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn source(scale: f64, offset: f64, min: i32, max: i32) -> SourceGrid {
        SourceGrid { scale: [scale; 3], offset: [offset; 3], min: [min; 3], max: [max; 3] }
    }

    #[test]
    fn one_file_keeps_its_own_integers() {
        let (lattice, to) = choose(&[source(0.01, 635_577.0, -5, 60_000_000)], |_, _| false);
        assert_eq!((lattice.scale[0], lattice.offset[0]), (0.01, 635_577.0));
        assert_eq!(to[0].stored([-5, 0, 77]), [-5, 0, 77]);
        assert!(lattice.is_exact());
    }

    #[test]
    fn tiles_of_different_scale_and_offset_meet_on_the_finer_one() {
        let sources = [source(0.01, 1000.0, 0, 100), source(0.001, 1000.5, 0, 100)];
        let (lattice, to) = choose(&sources, |_, _| false);
        assert!(lattice.is_exact());
        assert_eq!(to[0].stored([7; 3]), [70; 3]);
        assert_eq!(to[1].stored([7; 3]), [507; 3]);
    }

    #[test]
    fn offsets_half_a_unit_apart_refine_the_scale() {
        let sources = [source(0.01, 0.0, 0, 100), source(0.01, 0.005, 0, 100)];
        let (lattice, to) = choose(&sources, |_, _| false);
        assert!(lattice.is_exact());
        assert_eq!(lattice.scale[0], 0.005);
        assert_eq!(to[1].stored([3; 3]), [7; 3]);
    }

    #[test]
    fn tiles_too_far_apart_for_their_scale_are_rounded_on_a_coarser_one() {
        let sources = [source(1e-8, 0.0, i32::MIN, i32::MAX), source(1e-8, 1e6, i32::MIN, i32::MAX)];
        let (lattice, _) = choose(&sources, |_, _| false);
        assert!(!lattice.exact[0]);
        assert!(lattice.scale[0] > 1e-8);
        assert!(lattice.error_in_units() > 0.5, "they share a lattice, which is not fine enough");
        assert!(lattice.notes()[0].contains("reach too far"), "{:?}", lattice.notes());
    }

    #[test]
    fn how_far_positions_move_is_told_as_a_length_and_in_the_inputs_units() {
        let apart = [source(1e-6, 0.0, 0, 1_000_000), source(1e-6, 1e6, 0, 1_000_000)];
        let (lattice, to) = choose(&apart, |_, _| false);
        assert_eq!((lattice.scale[0], lattice.finest[0]), (256.0 * 1e-6, 1e-6));
        assert_eq!((lattice.error(0), lattice.error_in_units()), (128.0 * 1e-6, 128.0));
        let moved = |raw: i32| lattice.world(0, to[0].stored([raw; 3])[0].into()) - f64::from(raw) * 1e-6;
        let most = (0..1000).map(|raw| moved(raw).abs()).fold(0.0, f64::max);
        assert!(most > 1e-4 && most < lattice.error(0) * 1.001, "{most}");
        let note = "x was rounded to 0.000256, by at most 0.000128, 128 of the finest input's units: \
                    the inputs reach too far for 32-bit integers of a finer scale";
        assert_eq!(lattice.notes()[0], note);
        assert_eq!(lattice.notes().len(), 3);
        // A third of a unit apart; and as fine as the offset's own digits.
        for (scale, offset, shift) in [(0.01, 0.0, 0.01 / 3.0), (1e-8, 5.4e6, 4e-9)] {
            let sources = [source(scale, offset, 0, 100), source(scale, offset + shift, 0, 100)];
            let (lattice, _) = choose(&sources, |_, _| false);
            assert_eq!((lattice.is_exact(), lattice.error_in_units()), (false, 0.5), "{scale}");
            assert!(lattice.notes()[0].contains("share no lattice"), "{:?}", lattice.notes());
        }
        assert!(choose(&apart[..1], |_, _| false).0.notes().is_empty());
    }

    #[test]
    fn a_negative_scale_mirrors_the_integers_exactly() {
        let sources =
            [source(-0.01, 0.0, i32::MIN, -5), source(0.01, 1000.0, 0, 100), source(-0.02, 7.0, -9, 9)];
        let (lattice, to) = choose(&sources, |_, _| false);
        assert!(lattice.is_exact(), "{lattice:?}");
        for (source, to) in sources.iter().zip(&to) {
            for raw in [source.min[0], source.max[0]] {
                let world = f64::from(raw) * source.scale[0] + source.offset[0];
                let stored = to.stored([raw; 3])[1];
                assert!((lattice.world(1, stored.into()) - world).abs() < 1e-5, "{raw}");
                assert!(lattice.min[1] <= stored && stored <= lattice.max[1]);
            }
        }
        let grid = SourceGrid::around([-0.5; 3], [0.0; 3], [1.0; 3], [2.0; 3]);
        assert_eq!((grid.min, grid.max), ([-4; 3], [-2; 3]));
    }

    #[test]
    fn what_viewers_would_misread_moves_to_the_corner() {
        let (lattice, to) = choose(&[source(0.01, 0.0, 1 << 27, (1 << 27) + 9)], |low, _| low[0] >= 1 << 27);
        let clear = CLEAR as i32;
        assert_eq!(lattice.min, [clear; 3]);
        assert_eq!(to[0].stored([(1 << 27) + 3; 3]), [clear + 3; 3]);
        assert!((lattice.world(0, CLEAR + 3) - f64::from((1 << 27) + 3) * 0.01).abs() < 1e-9);
    }

    proptest! {
        /// Whatever the files' scales, of either sign, and offsets, a position lands within half
        /// a unit of where it was, and exactly there if the lattice says so.
        #[test]
        fn positions_stay_where_they_are(
            tiles in proptest::collection::vec(
                (1u32..7, -1000i32..1000, 0u32..4, any::<i16>(), 0i32..30_000, any::<bool>()), 1..5),
            pick in 0usize..100,
        ) {
            let sources: Vec<SourceGrid> = tiles.iter().map(|(e, whole, quarter, min, len, mirrored)| {
                let offset = f64::from(*whole) + f64::from(*quarter) * 0.25;
                let sign = if *mirrored { -1.0 } else { 1.0 };
                source(sign * 10f64.powi(-(*e as i32)), offset, i32::from(*min), i32::from(*min) + len)
            }).collect();
            let (lattice, to) = choose(&sources, |_, _| false);
            let i = pick % sources.len();
            for raw in [sources[i].min[0], sources[i].max[0]] {
                let world = f64::from(raw) * sources[i].scale[0] + sources[i].offset[0];
                let stored = to[i].stored([raw; 3])[0];
                let error = (lattice.world(0, i64::from(stored)) - world).abs() / lattice.scale[0];
                let allowed = if lattice.exact[0] { 1e-4 } else { 0.5 + 1e-4 };
                prop_assert!(error <= allowed, "{error} units off on {lattice:?}");
                prop_assert!(stored >= lattice.min[0] && stored <= lattice.max[0]);
            }
        }
    }
}
