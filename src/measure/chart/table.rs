//! The figures behind a chart, as a table of HTML.

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    pub caption: String,
    pub columns: Vec<Column>,
    pub rows: Vec<Vec<Cell>>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Column {
    pub title: String,
    /// Empty where there is none.
    pub unit: String,
}

impl Column {
    pub fn new(title: &str, unit: &str) -> Column {
        Column { title: title.to_string(), unit: unit.to_string() }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    Text(String),
    /// To three digits that matter, or as a whole number where it is large.
    Number(f64),
    /// Now against before, told in per cent.
    Change {
        now: f64,
        before: f64,
    },
    Nothing,
}
