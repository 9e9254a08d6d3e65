//! What an octree's folder tells: its attributes, with ranges and histograms, and
//! its files.

use std::fs;
use std::path::Path;

use maud::{Markup, html};
use serde_json::Value;

use super::super::api::JobView;
use super::super::octrees;
use super::{charts, parts, words};
use crate::words::class_name;

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

/// Whether this is the one attribute that viewers take for another type than it has:
/// angles to the left of the track are negative, and stored as bytes without a sign.
fn is_signed(attribute: &Value) -> bool {
    attribute["name"] == "scan angle rank" && attribute["type"] == "uint8"
}

/// The lowest and the highest values.
fn range(attribute: &Value) -> [Vec<f64>; 2] {
    match counts(attribute).filter(|_| is_signed(attribute)) {
        Some((first, counts)) => [vec![first as f64], vec![(first + counts.len() as i64 - 1) as f64]],
        None => ["min", "max"].map(|key| numbers(&attribute[key])),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

/// Values of an attribute; a position's in the decimals of this scale.
fn shown(values: &[f64], scale: Option<&[f64]>) -> String {
    if values.is_empty() {
        return "—".to_string();
    }
    let text = |axis: usize, value: f64| match scale.and_then(|scale| scale.get(axis)) {
        Some(scale) => words::coordinate(value, *scale),
        None => words::figure(value),
    };
    values.iter().enumerate().map(|(axis, value)| text(axis, *value)).collect::<Vec<_>>().join(" · ")
}

/// From the first to the last value that there is, with what they count.
fn counts(attribute: &Value) -> Option<(i64, Vec<u64>)> {
    let mut all: Vec<u64> = attribute["histogram"].as_array()?.iter().filter_map(Value::as_u64).collect();
    let lowest = if is_signed(attribute) && all.len() == 256 { -128 } else { 0 };
    if lowest < 0 {
        all.rotate_right(128);
    }
    let first = all.iter().position(|count| *count > 0)?;
    let last = all.iter().rposition(|count| *count > 0)?;
    Some((lowest + first as i64, all[first..=last].to_vec()))
}

pub(super) fn table(on_disk: &OnDisk) -> Markup {
    let attributes = on_disk.metadata["attributes"].as_array().map(Vec::as_slice).unwrap_or_default();
    if attributes.is_empty() {
        return html! {};
    }
    let scale = numbers(&on_disk.metadata["scale"]);
    html! {
        section.card #attributes aria-labelledby="attributes-title" {
            h2 #attributes-title { "Attributes" }
            div.scroll tabindex="0" role="region" aria-labelledby="attributes-title" {
                table {
                    thead { tr {
                        th scope="col" { "Name" } th scope="col" { "Type" } th scope="col" { "From" } th scope="col" { "To" }
                        th scope="col" { "Values" }
                    } }
                    tbody { @for attribute in attributes { (row(attribute, &scale)) } }
                }
            }
        }
    }
}

fn row(attribute: &Value, scale: &[f64]) -> Markup {
    let name = attribute["name"].as_str().unwrap_or("—");
    let scale = (name == "position").then_some(scale);
    let elements = attribute["numElements"].as_u64().unwrap_or(1);
    html! {
        tr {
            td { (name) @if let Some(text) = attribute["description"].as_str().filter(|text| !text.is_empty()) { div.dim { (text) } } }
            td { (attribute["type"].as_str().unwrap_or("—")) @if elements > 1 { " × " (elements) } }
            @let [low, high] = range(attribute);
            td { (shown(&low, scale)) }
            td { (shown(&high, scale)) }
            td {
                @if let Some((first, counts)) = counts(attribute) {
                    @if counts.len() == 1 { span.dim { "in all points" } }
                    @else {
                    (charts::histogram(&counts, &format!("How often each value of {name} occurs"))) }
                    @if name == "classification" {
                        div.dim {
                            @for (code, count) in (first..).zip(&counts).filter(|(_, count)| **count > 0).take(8) {
                                div { (code) " " (class_name(code).unwrap_or("")) ": " (words::points(*count)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// What viewers are to be given: the addresses of an octree and of a COPC file.
pub(super) fn addresses(octree: Option<&str>, copc: Option<&str>) -> Markup {
    html! {
        dl.facts {
            @if let Some(url) = octree { dt { "For Potree" } dd { (parts::copyable(url, Some(url))) } }
            @if let Some(url) = copc {
                dt { "For QGIS" }
                dd {
                    (parts::copyable(url, Some(url)))
                    div.dim { "Layer ▸ Add Layer ▸ Add Point Cloud Layer ▸ Protocol: HTTP(S)" }
                }
                dt { "For PDAL" } dd { (parts::copyable(&format!("pdal info --summary {url}"), Some(url))) }
            }
        }
    }
}

/// The files of what a job made; `folder` is where they are served.
pub(super) fn files(on_disk: &OnDisk, view: &JobView, folder: &str) -> Markup {
    html! {
        section.card #files aria-labelledby="files-title" {
            h2 #files-title { "Files" }
            (addresses(view.octree.as_deref(), view.copc.as_deref()))
            table.files {
                thead { tr { th scope="col" { "File" } th.num scope="col" { "Size" } th scope="col" { span.visually-hidden { "Link" } } } }
                tbody {
                    @for (name, bytes) in &on_disk.files {
                        @let url = format!("{folder}/{}", octrees::encoded(name));
                        tr {
                            td { a href=(url) { (name) } }
                            td.num { (words::bytes(*bytes)) }
                            td { button.copy.quiet type="button" data-copy=(url) data-copy-url=(url) aria-label={ "Copy link to " (name) } { "Copy link" } }
                        }
                    }
                }
            }
        }
    }
}
