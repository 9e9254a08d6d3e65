//! The page that charts stand on: one file of HTML that needs nothing else.

use super::Chart;
use super::table::Table;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Page {
    pub title: String,
    /// What this is and what it found, in a few sentences.
    pub lead: String,
    pub sections: Vec<Section>,
    /// Machine, versions, commit, seeds, options: what one needs to measure it again.
    pub foot: Vec<(String, String)>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Section {
    pub heading: String,
    pub items: Vec<Item>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    Text(String),
    Figure(Figure),
    /// A table that stands for itself.
    Table(Table),
}

#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub chart: Chart,
    /// What it says, in a sentence; stands above it.
    pub says: String,
    /// How to read it; stands below it.
    pub caption: String,
    /// Instead of the table that the chart makes of its own figures.
    pub table: Option<Table>,
}

impl Figure {
    pub fn new(chart: impl Into<Chart>, says: &str, caption: &str) -> Figure {
        Figure { chart: chart.into(), says: says.to_string(), caption: caption.to_string(), table: None }
    }
}

impl Page {
    pub fn html(&self) -> String {
        todo!()
    }
}
