//! Statistics of attributes that add up in any order: each slice or chunk makes
//! its own, and their sum is the same whatever the threads did.

use super::attribute::{Attribute, Scalar, Schema};

/// What is known of one attribute over a set of points.
#[derive(Debug, Clone, PartialEq)]
pub struct AttributeStatistics {
    /// Smallest and largest stored value per element; `min > max` where there
    /// was no value (no points, or only NaN).
    pub min: Vec<f64>,
    pub max: Vec<f64>,
    /// Points per value, for attributes of one unsigned or signed byte
    /// (signed values count at their bit pattern, as viewers index it).
    pub histogram: Option<Vec<u64>>,
}
