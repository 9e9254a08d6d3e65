//! The figures behind a chart, as a table.

use maud::{Markup, html};

use super::number;

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

#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
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

impl Column {
    pub fn new(title: &str, unit: &str) -> Column {
        Column { title: title.to_string(), unit: unit.to_string() }
    }

    /// Now, before and by how much it changed.
    pub(super) fn with_before(title: &str, unit: &str) -> [Column; 3] {
        [Column::new(title, unit), Column::new("before", unit), Column::new("change", "")]
    }
}

impl Cell {
    pub(super) fn text(text: &str) -> Cell {
        if text.is_empty() { Cell::Nothing } else { Cell::Text(text.to_string()) }
    }

    pub(super) fn maybe(value: Option<f64>) -> Cell {
        value.map_or(Cell::Nothing, Cell::Number)
    }

    pub(super) fn with_before(now: Option<f64>, before: Option<f64>) -> [Cell; 3] {
        let change = now.zip(before).map(|(now, before)| Cell::Change { now, before });
        [Cell::maybe(now), Cell::maybe(before), change.unwrap_or(Cell::Nothing)]
    }

    fn words(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Number(value) => number::figure(*value),
            Cell::Change { now, before } => number::change(*now, *before),
            Cell::Nothing => String::new(),
        }
    }
}

impl Table {
    pub(super) fn html(&self) -> Markup {
        let cells = |column: usize| self.rows.iter().filter_map(move |row| row.get(column));
        // Numbers stand to the right, so that their digits do under each other.
        let number = |column: usize| {
            let mut filled = cells(column).filter(|cell| **cell != Cell::Nothing).peekable();
            let any = filled.peek().is_some();
            (any && filled.all(|cell| !matches!(cell, Cell::Text(_)))).then_some("number")
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
        let filled =
            |at: usize| self.rows.iter().any(|row| row.get(at).is_some_and(|cell| *cell != Cell::Nothing));
        for column in (0..self.columns.len()).rev().filter(|at| !filled(*at)).collect::<Vec<_>>() {
            self.columns.remove(column);
            self.rows.iter_mut().for_each(|row| drop(row.remove(column)));
        }
        self
    }
}
