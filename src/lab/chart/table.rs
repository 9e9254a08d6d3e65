//! The figures behind a chart, as a table.

use maud::{Markup, html};

use super::number;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    pub caption: String,
    pub columns: Vec<TableColumn>,
    pub rows: Vec<Vec<TableCell>>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct TableColumn {
    pub title: String,
    /// Empty where there is none.
    pub unit: String,
}

#[derive(Debug, Clone, PartialEq)]
pub enum TableCell {
    Text(String),
    /// To three digits that matter, or as a whole number where it is large.
    Number(f64),
    /// Now against before, told in percent.
    Change {
        now: f64,
        before: f64,
    },
    Nothing,
}

impl TableColumn {
    pub fn new(title: &str, unit: &str) -> TableColumn {
        TableColumn { title: title.to_string(), unit: unit.to_string() }
    }

    /// Now, before and by how much it changed.
    pub(super) fn with_before(title: &str, unit: &str) -> [TableColumn; 3] {
        [TableColumn::new(title, unit), TableColumn::new("before", unit), TableColumn::new("change", "")]
    }
}

impl TableCell {
    pub(super) fn text(text: &str) -> TableCell {
        if text.is_empty() { TableCell::Nothing } else { TableCell::Text(text.to_string()) }
    }

    pub(super) fn maybe(value: Option<f64>) -> TableCell {
        value.map_or(TableCell::Nothing, TableCell::Number)
    }

    pub(super) fn with_before(now: Option<f64>, before: Option<f64>) -> [TableCell; 3] {
        let change = now.zip(before).map(|(now, before)| TableCell::Change { now, before });
        [TableCell::maybe(now), TableCell::maybe(before), change.unwrap_or(TableCell::Nothing)]
    }

    fn words(&self) -> String {
        match self {
            TableCell::Text(text) => text.clone(),
            TableCell::Number(value) => number::figure(*value),
            TableCell::Change { now, before } => number::change(*now, *before),
            TableCell::Nothing => String::new(),
        }
    }
}

impl Table {
    pub(super) fn html(&self) -> Markup {
        let cells = |column: usize| self.rows.iter().filter_map(move |row| row.get(column));
        // Numbers stand to the right, so that their digits do under each other.
        let number = |column: usize| {
            let mut filled = cells(column).filter(|cell| **cell != TableCell::Nothing).peekable();
            let any = filled.peek().is_some();
            (any && filled.all(|cell| !matches!(cell, TableCell::Text(_)))).then_some("number")
        };
        let classes: Vec<_> = (0..self.columns.len()).map(number).collect();
        html! {
            div.wide tabindex="0" role="region" aria-label=(if self.caption.is_empty() { "Table" } else { &self.caption }) {
                table {
                    @if !self.caption.is_empty() { caption { (self.caption) } }
                    thead { tr { @for (column, class) in self.columns.iter().zip(&classes) {
                        th scope="col" class=[class] {
                            (column.title)
                            @if !column.unit.is_empty() { " " span.unit { (column.unit) } }
                        }
                    } } }
                    tbody { @for row in &self.rows { tr { @for (at, (cell, class)) in row.iter().zip(&classes).enumerate() {
                        @if at == 0 { th scope="row" class=[class] { (cell.words()) } }
                        @else { td class=[class] { (cell.words()) } }
                    } } "\n" } }
                }
            }
            "\n"
        }
    }

    /// Without the columns in which nothing stands.
    pub(super) fn without_empty_columns(mut self) -> Table {
        let filled = |at: usize| {
            self.rows.iter().any(|row| row.get(at).is_some_and(|cell| *cell != TableCell::Nothing))
        };
        for column in (0..self.columns.len()).rev().filter(|at| !filled(*at)).collect::<Vec<_>>() {
            self.columns.remove(column);
            self.rows.iter_mut().for_each(|row| drop(row.remove(column)));
        }
        self
    }
}
