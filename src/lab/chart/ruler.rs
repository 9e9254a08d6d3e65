//! From values to places: one axis.

use super::data::{Axis, Scale};
use super::ticks::{self, Ticks};

#[derive(Debug, Clone)]
pub(super) struct Ruler {
    pub axis: Axis,
    pub ticks: Ticks,
    /// Places of the axis's low and high end.
    pub from: f64,
    pub to: f64,
}

impl Ruler {
    /// For all these values, between two places; the places may be said later.
    pub fn new(axis: &Axis, values: impl Iterator<Item = f64>, most: usize) -> Option<Ruler> {
        let ticks = ticks::ticks(axis, values, most)?;
        Some(Ruler { axis: axis.clone(), ticks, from: 0.0, to: 1.0 })
    }

    pub fn between(self, from: f64, to: f64) -> Ruler {
        Ruler { from, to, ..self }
    }

    /// Where a value is that the axis takes; one beyond its ends is put at the end.
    pub fn at(&self, value: f64) -> f64 {
        let bent = |value: f64| match self.axis.scale {
            Scale::Linear => value,
            Scale::Log => value.max(self.ticks.low).ln(),
        };
        let (low, high) = (bent(self.ticks.low), bent(self.ticks.high));
        let share = ((bent(value) - low) / (high - low)).clamp(0.0, 1.0);
        self.from + (self.to - self.from) * share
    }

    pub fn widest_label(&self, size: f64) -> f64 {
        self.ticks.major.iter().map(|(_, label)| super::text::width(label, size)).fold(0.0, f64::max)
    }
}
