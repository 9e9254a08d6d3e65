//! What an octree's folder tells: its attributes, with ranges and histograms, and
//! its files.

use std::fs;
use std::path::Path;

use maud::{Markup, html};
use serde_json::Value;

use super::super::api::JobView;
use super::{charts, parts, words};

/// Of a metadata.json that is read for a page, in bytes.
const LONGEST: u64 = 8 << 20;
/// Files that are listed.
const FILES: usize = 60;

/// An octree's folder, looked at once.
#[derive(Debug, Default)]
pub(super) struct OnDisk {
    metadata: Value,
    /// Paths in the folder, and bytes.
    files: Vec<(String, u64)>,
}

impl OnDisk {
    /// What cannot be read is not told.
    pub fn read(folder: &Path) -> OnDisk {
        let path = folder.join("metadata.json");
        let small = fs::metadata(&path).is_ok_and(|meta| meta.is_file() && meta.len() <= LONGEST);
        let text = small.then(|| fs::read(&path).ok()).flatten().unwrap_or_default();
        let mut files = vec![];
        list(folder, "", &mut files);
        files.sort();
        OnDisk { metadata: serde_json::from_slice(&text).unwrap_or_default(), files }
    }
}

fn list(folder: &Path, prefix: &str, files: &mut Vec<(String, u64)>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(meta) = entry.metadata() else { continue };
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if meta.is_file() && files.len() < FILES {
            files.push((name, meta.len()));
        } else if meta.is_dir() && prefix.is_empty() && !name.starts_with('.') {
            list(&entry.path(), &format!("{name}/"), files);
        }
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn shown(values: &[f64]) -> String {
    if values.is_empty() {
        "—".to_string()
    } else {
        values.iter().map(|v| words::figure(*v)).collect::<Vec<_>>().join(" · ")
    }
}

/// From the first to the last value that there is, with what they count.
fn counts(attribute: &Value) -> Option<(usize, Vec<u64>)> {
    let all: Vec<u64> = attribute["histogram"].as_array()?.iter().filter_map(Value::as_u64).collect();
    let first = all.iter().position(|count| *count > 0)?;
    let last = all.iter().rposition(|count| *count > 0)?;
    Some((first, all[first..=last].to_vec()))
}

/// The names of ASPRS, for the classes that most clouds have.
fn class(code: usize) -> Option<&'static str> {
    const NAMES: [&str; 19] = [
        "never classified",
        "unclassified",
        "ground",
        "low vegetation",
        "medium vegetation",
        "high vegetation",
        "building",
        "low noise",
        "model key",
        "water",
        "rail",
        "road",
        "overlap",
        "wire guard",
        "wire conductor",
        "tower",
        "wire connector",
        "bridge deck",
        "high noise",
    ];
    NAMES.get(code).copied()
}

pub(super) fn table(on_disk: &OnDisk) -> Markup {
    let attributes = on_disk.metadata["attributes"].as_array().map(Vec::as_slice).unwrap_or_default();
    if attributes.is_empty() {
        return html! {};
    }
    html! {
        section.card #attributes aria-labelledby="attributes-title" {
            h2 #attributes-title { "Attributes" }
            div.scroll tabindex="0" role="region" aria-labelledby="attributes-title" {
                table {
                    thead { tr {
                        th scope="col" { "Name" } th scope="col" { "Type" } th scope="col" { "From" } th scope="col" { "To" }
                        th scope="col" { "Values" }
                    } }
                    tbody { @for attribute in attributes { (row(attribute)) } }
                }
            }
        }
    }
}

fn row(attribute: &Value) -> Markup {
    let name = attribute["name"].as_str().unwrap_or("—");
    let elements = attribute["numElements"].as_u64().unwrap_or(1);
    html! {
        tr {
            td { (name) @if let Some(text) = attribute["description"].as_str().filter(|text| !text.is_empty()) { div.dim { (text) } } }
            td { (attribute["type"].as_str().unwrap_or("—")) @if elements > 1 { " × " (elements) } }
            td { (shown(&numbers(&attribute["min"]))) }
            td { (shown(&numbers(&attribute["max"]))) }
            td {
                @if let Some((first, counts)) = counts(attribute) {
                    (charts::histogram(&counts, &format!("How often each value of {name} occurs")))
                    @if name == "classification" {
                        div.dim {
                            @for (at, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0).take(8) {
                                div { (first + at) " " (class(first + at).unwrap_or("")) ": " (words::points(*count)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// What viewers are to be given.
pub(super) fn addresses(octree: Option<&str>, copc: Option<&str>) -> Markup {
    html! {
        @if let Some(url) = octree {
            p { "For Potree and viewers that read its format: " (parts::copyable(url, Some(url))) }
        }
        @if let Some(url) = copc {
            p { "As COPC, for QGIS, PDAL and most others: " (parts::copyable(url, Some(url))) }
        }
    }
}

/// The files of what a job made; `folder` is where they are served.
pub(super) fn files(on_disk: &OnDisk, view: &JobView, folder: &str) -> Markup {
    html! {
        section.card #files aria-labelledby="files-title" {
            h2 #files-title { "Files" }
            (addresses(view.octree.as_deref(), view.copc.as_deref()))
            table {
                thead { tr { th scope="col" { "File" } th.num scope="col" { "Size" } th scope="col" { span.visually-hidden { "Link" } } } }
                tbody {
                    @for (name, bytes) in &on_disk.files {
                        @let url = format!("{folder}/{}", name.split('/').map(super::list::encoded).collect::<Vec<_>>().join("/"));
                        tr {
                            td { a href=(url) { (name) } }
                            td.num { (words::bytes(*bytes)) }
                            td { button.copy.quiet type="button" hidden data-copy=(url) data-copy-url=(url) aria-label={ "Copy link to " (name) } { "Copy link" } }
                        }
                    }
                }
            }
        }
    }
}
