//! What a plot shows, as data: panels, series and their marks.

use super::axis::{Axis, Better};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plot {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// One, or several side by side, all to the same scale: a scene each, say.
    pub panels: Vec<Panel>,
    pub style: PlotStyle,
    /// What the area of a mark stands for; all are alike where nothing is said.
    pub size: Option<Quantity>,
    /// Levels to compare with, drawn across.
    pub references: Vec<ReferenceLine>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PlotStyle {
    /// Each mark with its label, and what is beaten on both axes lighter.
    #[default]
    Front,
    /// Marks joined by lines; a key says whose.
    Lines,
    /// Lines alone, of so many points that marks would hide them.
    Curves,
}

/// A quantity with its unit, which may be empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Quantity {
    pub title: String,
    pub unit: String,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// May be empty if it is the only one.
    pub name: String,
    /// What has one name looks alike in all panels.
    pub series: Vec<Series>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReferenceLine {
    pub y: f64,
    pub name: String,
}

/// A method: one mark, or several in the order in which a line joins them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    pub name: String,
    pub marks: Vec<Mark>,
}

/// One measurement.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mark {
    /// What it says beside it, if the series' name is not enough: "1 M points".
    pub label: String,
    pub x: f64,
    pub y: f64,
    /// What its area stands for; see `Plot::size`.
    pub size: Option<f64>,
    /// What one gets without asking: it wears a ring and says so.
    pub default: bool,
    pub before: Option<Before>,
    /// More for the tooltip, in a line of its own.
    pub note: String,
}

/// The same measurement in an earlier run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Before {
    pub x: f64,
    pub y: f64,
    pub size: Option<f64>,
}

impl Series {
    pub fn new(name: &str, marks: Vec<Mark>) -> Series {
        Series { name: name.to_string(), marks }
    }

    /// Of pairs of x and y.
    pub fn line(name: &str, points: impl IntoIterator<Item = [f64; 2]>) -> Series {
        Series::new(name, points.into_iter().map(|[x, y]| Mark::at(x, y)).collect())
    }

    pub(super) fn called(&self, mark: &Mark) -> String {
        joined(&[&self.name, &mark.label], " · ")
    }
}

impl Mark {
    pub fn at(x: f64, y: f64) -> Mark {
        Mark { x, y, ..Mark::default() }
    }
}

pub(super) fn joined(parts: &[&str], between: &str) -> String {
    parts.iter().copied().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(between)
}

impl Plot {
    pub(super) fn takes(&self, x: f64, y: f64) -> bool {
        self.x.takes(x) && self.y.takes(y)
    }

    /// By name, as methods first come.
    pub(super) fn look(&self, name: &str) -> usize {
        let mut names: Vec<&str> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if !names.contains(&series.name.as_str()) {
                names.push(&series.name);
            }
        }
        names.iter().position(|other| *other == name).unwrap_or(0)
    }

    pub(super) fn largest(&self) -> f64 {
        let marks = self.panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.marks);
        let sizes = marks.flat_map(|mark| [mark.size, mark.before.and_then(|before| before.size)]);
        sizes.flatten().filter(|size| size.is_finite()).fold(0.0, f64::max)
    }

    pub(super) fn radius(&self, size: Option<f64>) -> f64 {
        match (self.style, &self.size, size) {
            (PlotStyle::Front, Some(_), Some(size)) if size.is_finite() && self.largest() > 0.0 => {
                (17.0 * (size.max(0.0) / self.largest()).sqrt()).max(3.0)
            }
            (PlotStyle::Front, ..) => 5.5,
            _ => 3.0,
        }
    }

    pub(super) fn has_front(&self) -> bool {
        self.style == PlotStyle::Front && self.x.better != Better::Neither && self.y.better != Better::Neither
    }

    /// So that less is better.
    pub(super) fn cost(&self, mark: &Mark) -> [f64; 2] {
        [(&self.x, mark.x), (&self.y, mark.y)]
            .map(|(axis, v)| if axis.better == Better::Higher { -v } else { v })
    }
}
