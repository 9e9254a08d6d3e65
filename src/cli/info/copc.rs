//! What `lodestone info` tells of a COPC file beside what it tells of any LAZ.

use std::path::Path;

use serde_json::{Value, json};

use super::json as pages;
use super::page::{InfoPage, coordinates, las_page, levels};
use crate::format::copc::hierarchy::MAX_LEVEL;
use crate::format::copc::{CopcEntry, CopcError, CopcFile};
use crate::words::grouped;

/// A page about a COPC file, or the same as JSON.
pub fn describe(path: &Path, memory_limit: u64, as_json: bool) -> Result<String, CopcError> {
    let file = CopcFile::open(path, memory_limit)?;
    if as_json {
        let mut value = pages::las(path, &file.header);
        value["copc"] = json(&file);
        return Ok(pages::pretty(&value));
    }
    let mut page = InfoPage(las_page(path, &file.header));
    let cube = file.cube();
    let corner = cube.center.map(|c| c - cube.halfsize);
    page.line("COPC", if file.is_own() { "by lodestone, with the attributes of its octree" } else { "1.0" });
    page.line("root cube", coordinates([2.0 * cube.halfsize; 3], file.front.scale));
    page.line("", format!("from {}", coordinates(corner, file.front.scale)));
    let (pages, bytes) = (file.hierarchy.pages.len(), file.hierarchy.pages.iter().map(|page| page.1).sum());
    page.line("hierarchy", format!("{} pages, {} bytes", grouped(pages as u64), grouped(bytes)));
    for (index, odd) in file.hierarchy.oddities.iter().enumerate() {
        page.line(if index == 0 { "oddities" } else { "" }, &odd.text);
    }
    page.0.push('\n');
    let nodes: Vec<(u8, bool, u32)> =
        file.nodes().iter().map(|node| (node.key.level, is_leaf(&file, node), node.points)).collect();
    levels(&mut page, file.spacing(), &nodes);
    Ok(page.0)
}

fn is_leaf(file: &CopcFile, node: &CopcEntry) -> bool {
    node.key.level >= MAX_LEVEL || (0..8).all(|index| file.node(node.key.child(index)).is_none())
}

fn json(file: &CopcFile) -> Value {
    let cube = file.cube();
    let depth = file.nodes().iter().map(|node| node.key.level).max().unwrap_or(0);
    let names: Vec<&str> = file.schema().attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    json!({
        "own": file.is_own(),
        "center": cube.center,
        "halfsize": cube.halfsize,
        "spacing": file.front.info.spacing,
        "nodes": file.nodes().len(),
        "depth": depth,
        "pages": file.hierarchy.pages.len(),
        "attributes": names,
        "oddities": file.hierarchy.oddities.iter().map(|odd| odd.text.as_str()).collect::<Vec<_>>(),
    })
}
