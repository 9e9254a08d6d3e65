//! Colours for what has none of its own.

/// Viridis in ten steps: even to the eye, in grey and to the colour-blind too.
const VIRIDIS: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 74, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [109, 205, 89],
    [180, 222, 44],
    [253, 231, 37],
];

/// The colour of a share of a height from 0 to 1: without the darkest end of the
/// map, which the background would swallow.
pub fn height(share: f64) -> [u8; 3] {
    viridis(0.15 + 0.85 * share.max(0.0))
}

/// The colour of a share from 0 to 1; what is not a number is at the bottom.
pub fn viridis(share: f64) -> [u8; 3] {
    let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    let at = share * (VIRIDIS.len() - 1) as f64;
    let (step, mix) = ((at as usize).min(VIRIDIS.len() - 2), at.fract());
    let mix = if at >= (VIRIDIS.len() - 1) as f64 { 1.0 } else { mix };
    std::array::from_fn(|i| {
        let (a, b) = (f64::from(VIRIDIS[step][i]), f64::from(VIRIDIS[step + 1][i]));
        (a + (b - a) * mix).round() as u8
    })
}

/// A grey of a share from 0 to 1, neither black nor white, so that the shading
/// and the background stay apart from it.
pub fn grey(share: f64) -> [u8; 3] {
    [(30.0 + 215.0 * share.clamp(0.0, 1.0)) as u8; 3]
}

/// The ASPRS classes (LAS 1.4 R15, table 17) in the colours in which QGIS shows
/// them, the black of roads lifted so that it can be told from the background.
pub fn class(class: u8) -> [u8; 3] {
    match class {
        0 => [186, 186, 186],
        1 => [170, 170, 170],
        2 => [170, 85, 0],
        3 => [0, 170, 170],
        4 => [85, 255, 85],
        5 => [0, 170, 0],
        6 => [255, 85, 85],
        7 => [170, 0, 0],
        8 => [85, 85, 85],
        9 => [85, 255, 255],
        10 => [170, 0, 170],
        11 => [62, 62, 66],
        12 => [100, 100, 100],
        13 => [255, 255, 85],
        14 => [255, 255, 0],
        15 => [255, 170, 85],
        16 => [200, 200, 60],
        17 => [85, 85, 255],
        18 => [150, 60, 60],
        // Reserved and users' own classes: each its own, all of them apart.
        other => viridis(f64::from(other.wrapping_mul(97)) / 255.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_starts_and_ends_where_it_should() {
        assert_eq!(viridis(0.0), VIRIDIS[0]);
        assert_eq!(viridis(1.0), VIRIDIS[9]);
        assert_eq!(viridis(f64::NAN), VIRIDIS[0]);
        assert_eq!(viridis(7.0), VIRIDIS[9]);
        assert_eq!(viridis(0.5), [35, 144, 140]);
    }

    #[test]
    fn it_only_gets_lighter() {
        let light = |share| {
            let [r, g, b] = viridis(share).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for step in 0..100 {
            assert!(light(f64::from(step + 1) / 100.0) >= light(f64::from(step) / 100.0) - 0.5);
        }
    }
}
