//! A few numbers, as bars on a linear axis and as dots on a logarithmic one, where a
//! bar's length would mean nothing.

use super::data::Axis;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bars {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub axis: Axis,
    pub groups: Vec<Group>,
}

/// Bars that belong together, with a heading: a scene, say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Group {
    /// May be empty if it is the only one.
    pub name: String,
    pub bars: Vec<Bar>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bar {
    pub name: String,
    pub value: f64,
    /// Lowest and highest of what was measured.
    pub spread: Option<[f64; 2]>,
    /// The same in an earlier run.
    pub before: Option<f64>,
    /// What one gets without asking.
    pub default: bool,
    /// More for the tooltip, in a line of its own.
    pub note: String,
    /// Colour by number, as in `Series::look`; its place in the group where none is given.
    pub look: Option<usize>,
}

impl Bar {
    pub fn new(name: &str, value: f64) -> Bar {
        Bar { name: name.to_string(), value, ..Bar::default() }
    }
}
