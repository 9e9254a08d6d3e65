//! The charts of the report: pure functions from figures to SVG and HTML. They know no
//! sampler, no renderer and no file.
//!
//! Drawn here because the nearest crate, kuva 0.6, was tried on the hardest of them and put
//! labels on each other and on marks; its colors are fixed, where a page has light and dark.

mod axis;
mod canvas;
mod dots;
mod label;
mod legend;
mod number;
mod page;
mod panel;
mod pattern;
mod plot;
mod series;
mod shape;
mod table;

pub use axis::{Axis, Better, Scale};
pub use dots::{Bar, BarGroup, Bars};
pub use page::{Figure, Page, PageItem, Section};
pub use pattern::{Pattern, Patterns};
pub use series::{Before, Mark, Panel, Plot, PlotStyle, Quantity, ReferenceLine, Series};
pub use table::{Table, TableCell, TableColumn};

/// Any chart.
#[derive(Debug, Clone, PartialEq)]
pub enum Chart {
    Plot(Plot),
    Bars(Bars),
    Patterns(Patterns),
}

impl Chart {
    /// The chart as an `<svg>` for a [`Page`], whose style it needs.
    pub fn svg(&self) -> String {
        self.draw().svg(self.title())
    }

    /// The chart as a file of its own, with style, heading and background.
    pub fn svg_standalone(&self) -> String {
        self.draw().svg_standalone(self.title())
    }

    fn draw(&self) -> canvas::ChartDrawing {
        match self {
            Chart::Plot(chart) => chart.draw(),
            Chart::Bars(chart) => chart.draw(),
            Chart::Patterns(chart) => chart.draw(),
        }
    }

    /// What it is, for those who hear it instead of seeing it.
    pub fn title(&self) -> &str {
        match self {
            Chart::Plot(chart) => &chart.title,
            Chart::Bars(chart) => &chart.title,
            Chart::Patterns(chart) => &chart.title,
        }
    }

    /// Its figures as a table.
    pub fn table(&self) -> Table {
        match self {
            Chart::Plot(chart) => chart.table(),
            Chart::Bars(chart) => chart.table(),
            Chart::Patterns(chart) => chart.table(),
        }
    }
}

macro_rules! is_a_chart {
    ($($kind:ident),*) => {$(
        impl From<$kind> for Chart {
            fn from(chart: $kind) -> Chart {
                Chart::$kind(chart)
            }
        }
    )*};
}
is_a_chart!(Plot, Bars, Patterns);
