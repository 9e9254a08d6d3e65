//! One quantity over another, a line a method: error over time, power over frequency.

use super::data::{Axis, Series};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lines {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// One, or several side by side, all to the same scale: a scene each, say.
    pub panels: Vec<Panel>,
    /// Levels to compare with, drawn across.
    pub references: Vec<Reference>,
    /// Draw only the lines; for lines of so many points that marks would hide them.
    pub bare: bool,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// May be empty if it is the only one.
    pub name: String,
    pub series: Vec<Series>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reference {
    pub y: f64,
    /// "white noise"
    pub name: String,
}

impl Lines {
    /// Radial power spectra, one panel a pattern of samples: pairs of frequency (in
    /// units of the principal one, or as the title says) and power, 1 being white noise.
    pub fn spectra(title: &str, frequency: Axis, spectra: Vec<(String, Vec<[f64; 2]>)>) -> Lines {
        let _ = (title, frequency, spectra);
        todo!()
    }
}
