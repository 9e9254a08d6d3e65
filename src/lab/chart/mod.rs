//! Charts: pure functions from figures to SVG and HTML. They know no sampler, no
//! renderer and no file.
//!
//! Drawn here and not by a crate: marks and text must follow the page's light and
//! dark colours by CSS variables, labels stand at their marks instead of in a
//! legend, and a page of fifteen charts is to be a file that one mails. What a crate
//! would save is the easy part.
//!
//! The way of a chart: its values (`data`) → ranges and round ticks (`ticks`) →
//! a ruler from values to places (`ruler`) → `frame`, marks (`shape`), labels that
//! keep out of each other's way (`label`) → markup (`canvas`). Nothing asks a browser
//! how wide a text is: `text` estimates it on the wide side.

pub mod bars;
pub mod data;
pub mod lines;
pub mod page;
pub mod pattern;
pub mod scatter;
pub mod table;

mod canvas;
mod drawing;
mod figures;
mod frame;
mod front;
mod grid;
mod key;
mod label;
mod number;
mod rect;
mod ruler;
mod shape;
mod spots;
mod style;
mod text;
mod ticks;

pub use bars::{Bar, Bars, Group};
pub use data::{Axis, Before, Better, Mark, Quantity, Scale, Series};
pub use lines::{Lines, Panel, Reference};
pub use page::{Figure, Item, Page, Section};
pub use pattern::{Pattern, Patterns};
pub use scatter::Scatter;
pub use table::{Cell, Column, Table};

use canvas::Setting;
use drawing::Drawing;

/// Any chart.
#[derive(Debug, Clone, PartialEq)]
pub enum Chart {
    Scatter(Scatter),
    Lines(Lines),
    Bars(Bars),
    Patterns(Patterns),
}

impl Chart {
    /// The chart as an `<svg>` for a page of ours, whose style it needs.
    pub fn svg(&self) -> String {
        self.drawing().svg(Setting::Page)
    }

    /// The chart as a file of its own, with style, heading and background.
    pub fn svg_standalone(&self) -> String {
        self.drawing().svg(Setting::Alone)
    }

    /// Its figures as a table.
    pub fn table(&self) -> Table {
        match self {
            Chart::Scatter(chart) => figures::scatter(chart),
            Chart::Lines(chart) => figures::lines(chart),
            Chart::Bars(chart) => figures::bars(chart),
            Chart::Patterns(chart) => figures::patterns(chart),
        }
    }

    fn drawing(&self) -> Drawing {
        match self {
            Chart::Scatter(chart) => chart.drawing(),
            Chart::Lines(chart) => chart.drawing(),
            Chart::Bars(chart) => chart.drawing(),
            Chart::Patterns(chart) => chart.drawing(),
        }
    }
}

impl From<Scatter> for Chart {
    fn from(chart: Scatter) -> Chart {
        Chart::Scatter(chart)
    }
}

impl From<Lines> for Chart {
    fn from(chart: Lines) -> Chart {
        Chart::Lines(chart)
    }
}

impl From<Bars> for Chart {
    fn from(chart: Bars) -> Chart {
        Chart::Bars(chart)
    }
}

impl From<Patterns> for Chart {
    fn from(chart: Patterns) -> Chart {
        Chart::Patterns(chart)
    }
}
