//! What each sampler makes of a plane of noise.

use rayon::prelude::*;

use super::method::Method;
use super::report::PatternReport;
use crate::lab::sampling::evenness;
use crate::lab::sampling::plane::{SampledPattern, cutting, pattern, spectrum_of};

/// Spacings along the side of the picture of a pattern.
const WIDE: u32 = 28;

pub fn measure(method: Method, patterns: u32) -> PatternReport {
    let patterns: Vec<SampledPattern> =
        (0..patterns.max(1)).into_par_iter().map(|seed| pattern(method.sampling, seed)).collect();
    let even: Vec<_> = patterns.iter().map(|pattern| pattern.even).collect();
    let thousandths = |c: f64| (c * 1000.0).round() as u16;
    PatternReport {
        method: method.name(),
        spectrum: spectrum_of(&patterns),
        even: evenness::total(&even),
        dots: cutting(&patterns[0], WIDE).into_iter().map(|at| at.map(thousandths)).collect(),
    }
}
