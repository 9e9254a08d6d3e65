//! The page that charts stand on: one file of HTML that needs nothing else.

use super::table::Table;
use super::text::escaped;
use super::{Chart, style};

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
    pub chart: Box<Chart>,
    /// What it says, in a sentence; stands above it.
    pub says: String,
    /// How to read it; stands below it.
    pub caption: String,
    /// Instead of the table that the chart makes of its own figures.
    pub table: Option<Table>,
}

impl Figure {
    pub fn new(chart: impl Into<Chart>, says: &str, caption: &str) -> Figure {
        Figure {
            chart: Box::new(chart.into()),
            says: says.to_string(),
            caption: caption.to_string(),
            table: None,
        }
    }
}

impl Page {
    pub fn html(&self) -> String {
        let title = escaped(&self.title);
        let sections: String = self.sections.iter().enumerate().map(|(at, part)| part.html(at)).collect();
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
             <meta name=\"color-scheme\" content=\"light dark\"/>\n\
             <link rel=\"icon\" href=\"data:,\"/>\n\
             <title>{title}</title>\n<style>\n{}{}{}</style></head>\n\
             <body><main><header><h1>{title}</h1>\n{}{}</header>\n{sections}</main>\n{}</body></html>\n",
            style::variables(),
            style::CHART,
            style::PAGE,
            paragraphs(&self.lead, " class=\"lead\""),
            self.contents(),
            self.footer(),
        )
    }

    /// Where there is more than one sees at once.
    fn contents(&self) -> String {
        if self.sections.len() < 3 {
            return String::new();
        }
        let entries = self.sections.iter().enumerate();
        let entries =
            entries.map(|(at, part)| format!("<li><a href=\"#s{at}\">{}</a></li>", escaped(&part.heading)));
        format!("<nav aria-label=\"Contents\"><ul>{}</ul></nav>", entries.collect::<String>())
    }

    fn footer(&self) -> String {
        if self.foot.is_empty() {
            return String::new();
        }
        let entries = self
            .foot
            .iter()
            .map(|(key, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escaped(key), escaped(value)));
        format!("<footer><h2>How it was measured</h2>\n<dl>{}</dl></footer>\n", entries.collect::<String>())
    }
}

impl Section {
    fn html(&self, number: usize) -> String {
        let items = self.items.iter().map(|item| match item {
            Item::Text(text) => paragraphs(text, ""),
            Item::Figure(figure) => figure.html(),
            Item::Table(table) => table.html(),
        });
        let heading = escaped(&self.heading);
        format!("<section id=\"s{number}\"><h2>{heading}</h2>\n{}</section>\n", items.collect::<String>())
    }
}

impl Figure {
    fn html(&self) -> String {
        let says = match self.says.is_empty() {
            true => String::new(),
            false => format!("<h3>{}</h3>\n", escaped(&self.says)),
        };
        let caption = match self.caption.is_empty() {
            true => String::new(),
            false => format!("<figcaption>{}</figcaption>\n", escaped(&self.caption)),
        };
        let table = self.table.clone().unwrap_or_else(|| self.chart.table());
        let table = match table.rows.is_empty() {
            true => String::new(),
            false => format!("<details><summary>The figures</summary>\n{}</details>\n", table.html()),
        };
        format!("<figure>{says}<div class=\"plot\">{}</div>\n{caption}{table}</figure>\n", self.chart.svg())
    }
}

/// An empty line parts paragraphs.
fn paragraphs(text: &str, class: &str) -> String {
    let parts = text.split("\n\n").map(str::trim).filter(|part| !part.is_empty());
    parts.map(|part| format!("<p{class}>{}</p>\n", escaped(part))).collect()
}
