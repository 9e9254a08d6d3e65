//! Speed against accuracy: a mark a measurement, and the front of those that none
//! beats on both axes.

use super::data::{Axis, Quantity, Series};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scatter {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// What the area of a mark stands for; all are alike where nothing is said.
    pub size: Option<Quantity>,
    pub series: Vec<Series>,
    /// Draw the front, and what is beaten lighter. Needs a better end on both axes.
    pub front: bool,
}
