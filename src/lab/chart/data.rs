//! What a chart is made of: axes, series, marks. Plain values, so that whoever has
//! measured something can say it without knowing how it is drawn.

/// How an axis counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    #[default]
    Linear,
    /// Every decade as long as the next. What is not above zero has no place on it.
    Log,
}

/// Which end of an axis one wants to be at.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Better {
    #[default]
    Lower,
    Higher,
    Neither,
}

/// A quantity with its unit, such as "memory" in "MB".
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Quantity {
    pub title: String,
    /// Empty where there is none.
    pub unit: String,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    pub title: String,
    /// Empty where there is none.
    pub unit: String,
    pub scale: Scale,
    pub better: Better,
}

impl Axis {
    pub fn linear(title: &str, unit: &str) -> Axis {
        Axis { title: title.to_string(), unit: unit.to_string(), ..Axis::default() }
    }

    pub fn log(title: &str, unit: &str) -> Axis {
        Axis { scale: Scale::Log, ..Axis::linear(title, unit) }
    }

    /// The same axis, of which another end is the good one; the lower one is unless
    /// somebody says otherwise.
    pub fn better(self, better: Better) -> Axis {
        Axis { better, ..self }
    }

    /// Whether a value has a place on it. What is beyond these bounds is no
    /// measurement, and steps between such values would not be numbers.
    pub(super) fn takes(&self, value: f64) -> bool {
        match self.scale {
            Scale::Linear => value == 0.0 || (1e-300..1e300).contains(&value.abs()),
            Scale::Log => (1e-300..1e300).contains(&value),
        }
    }

    /// "time (ns)"
    pub(super) fn words(&self) -> String {
        named(&self.title, &self.unit)
    }
}

impl Quantity {
    pub(super) fn words(&self) -> String {
        named(&self.title, &self.unit)
    }
}

fn named(title: &str, unit: &str) -> String {
    if unit.is_empty() { title.to_string() } else { format!("{title} ({unit})") }
}

/// A method: one mark, or several that belong together (budgets, settings).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    pub name: String,
    /// In the order in which a line should join them.
    pub marks: Vec<Mark>,
    /// Colour, shape and dash, by number; its place in the list where none is given.
    /// Give one where a method should look the same in several charts.
    pub look: Option<usize>,
}

impl Series {
    pub fn new(name: &str, marks: Vec<Mark>) -> Series {
        Series { name: name.to_string(), marks, look: None }
    }

    /// A line without labels, of pairs of x and y.
    pub fn line(name: &str, points: impl IntoIterator<Item = [f64; 2]>) -> Series {
        Series::new(name, points.into_iter().map(|[x, y]| Mark::at(x, y)).collect())
    }
}

/// One measurement.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mark {
    /// What it says beside it, if the series' name is not enough: "1 M points".
    pub label: String,
    pub x: f64,
    pub y: f64,
    /// What its area stands for; see `Scatter::size`.
    pub size: Option<f64>,
    /// What one gets without asking: it wears a ring and says so.
    pub default: bool,
    /// The same measurement in an earlier run.
    pub before: Option<Before>,
    /// More for the tooltip, in a line of its own.
    pub note: String,
}

impl Mark {
    pub fn at(x: f64, y: f64) -> Mark {
        Mark { x, y, ..Mark::default() }
    }
}

/// Where a mark was in an earlier run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Before {
    pub x: f64,
    pub y: f64,
    pub size: Option<f64>,
}
