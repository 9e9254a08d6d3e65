//! The figures behind a chart, as a table of HTML.

use super::number;
use super::text::escaped;

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

impl Cell {
    pub fn text(text: &str) -> Cell {
        if text.is_empty() { Cell::Nothing } else { Cell::Text(text.to_string()) }
    }

    pub fn maybe(value: Option<f64>) -> Cell {
        value.map_or(Cell::Nothing, Cell::Number)
    }

    fn is_text(&self) -> bool {
        matches!(self, Cell::Text(_))
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
    pub fn html(&self) -> String {
        // Numbers stand to the right, so that their digits do under each other.
        let class = |column: usize| {
            let mut cells = self.rows.iter().filter_map(|row| row.get(column));
            let numbers = cells.clone().any(|cell| !matches!(cell, Cell::Text(_) | Cell::Nothing));
            if numbers && !cells.any(Cell::is_text) { " class=\"number\"" } else { "" }
        };
        let classes: Vec<&str> = (0..self.columns.len()).map(class).collect();
        let head = self.columns.iter().zip(&classes).map(|(column, class)| {
            let unit = match column.unit.is_empty() {
                true => String::new(),
                false => format!(" <span class=\"unit\">{}</span>", escaped(&column.unit)),
            };
            format!("<th scope=\"col\"{class}>{}{unit}</th>", escaped(&column.title))
        });
        let row = |row: &Vec<Cell>| {
            let cells = classes.iter().enumerate().map(|(column, class)| {
                let words = row.get(column).map(Cell::words).unwrap_or_default();
                match column {
                    0 => format!("<th scope=\"row\"{class}>{}</th>", escaped(&words)),
                    _ => format!("<td{class}>{}</td>", escaped(&words)),
                }
            });
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let caption = match self.caption.is_empty() {
            true => String::new(),
            false => format!("<caption>{}</caption>\n", escaped(&self.caption)),
        };
        format!(
            "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{}\"><table>\n{caption}<thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody></table></div>\n",
            escaped(if self.caption.is_empty() { "Table" } else { &self.caption }),
            head.collect::<String>(),
            self.rows.iter().map(row).collect::<String>(),
        )
    }

    /// Without the columns in which nothing stands.
    pub(super) fn without_empty_columns(mut self) -> Table {
        let filled = |column: usize| {
            self.rows.iter().any(|row| row.get(column).is_some_and(|cell| *cell != Cell::Nothing))
        };
        let keep: Vec<bool> = (0..self.columns.len()).map(filled).collect();
        let kept = |at: usize| keep.get(at).copied().unwrap_or(false);
        let mut at = 0..;
        self.columns.retain(|_| at.next().is_some_and(kept));
        for row in &mut self.rows {
            let mut at = 0..;
            row.retain(|_| at.next().is_some_and(kept));
        }
        self
    }
}
