//! The page that charts stand on: one file of HTML that needs nothing else.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::table::Table;
use super::{Chart, canvas};

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
    pub items: Vec<PageItem>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum PageItem {
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
        let (chart, says, caption) = (Box::new(chart.into()), says.to_string(), caption.to_string());
        Figure { chart, says, caption, table: None }
    }

    fn html(&self) -> Markup {
        let table = self.table.clone().unwrap_or_else(|| self.chart.table());
        html! {
            figure {
                @if !self.says.is_empty() { h3 { (self.says) } "\n" }
                div.plot { (PreEscaped(self.chart.svg())) } "\n"
                @if !self.caption.is_empty() { figcaption { (self.caption) } "\n" }
                @if !table.rows.is_empty() { details { summary { "The figures" } "\n" (table.html()) } }
            }
            "\n"
        }
    }
}

impl Page {
    /// The whole file. Its elements are closed as XML wants them, so that it is both.
    pub fn html(&self) -> String {
        let head = "<meta charset=\"utf-8\"/><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
                    <meta name=\"color-scheme\" content=\"light dark\"/><link rel=\"icon\" href=\"data:,\"/>\n";
        let page = html! {
            (DOCTYPE) "\n"
            html lang="en" {
                head {
                    (PreEscaped(head))
                    title { (self.title) }
                    style { (PreEscaped(canvas::CSS)) (PreEscaped(include_str!("page.css"))) }
                }
                body {
                    main {
                        header {
                            h1 { (self.title) }
                            @for part in paragraphs(&self.lead) { p.lead { (part) } }
                            // Where there is more than one sees at once.
                            @if self.sections.len() > 2 {
                                nav aria-label="Contents" { ul { @for (at, section) in self.sections.iter().enumerate() {
                                    li { a href=(format!("#s{at}")) { (section.heading) } }
                                } } }
                            }
                        }
                        @for (at, section) in self.sections.iter().enumerate() {
                            section id=(format!("s{at}")) {
                                h2 { (section.heading) } "\n"
                                @for item in &section.items {
                                    @match item {
                                        PageItem::Text(text) => { @for part in paragraphs(text) { p { (part) } } }
                                        PageItem::Figure(figure) => (figure.html()),
                                        PageItem::Table(table) => (table.html()),
                                    }
                                }
                            }
                        }
                    }
                    @if !self.foot.is_empty() {
                        footer {
                            h2 { "How it was measured" }
                            dl { @for (key, value) in &self.foot { dt { (key) } dd { (value) } "\n" } }
                        }
                    }
                }
            }
            "\n"
        };
        canvas::cleaned(&page.0)
    }
}

/// An empty line parts paragraphs.
fn paragraphs(text: &str) -> impl Iterator<Item = &str> {
    text.split("\n\n").map(str::trim).filter(|part| !part.is_empty())
}
