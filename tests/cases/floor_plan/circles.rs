//! Circles of files: a file that imports another, which imports the first, be it over
//! others. Neither can be understood, tested or moved without the other; what both need
//! belongs into a file of its own below them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::module;
use super::paths::{Named, named};

/// Which file imports which, and in which line first.
pub struct Imports(BTreeMap<String, BTreeMap<String, usize>>);

/// A source with the module that it is and the paths that it names outside of tests.
struct Source {
    file: String,
    module: Vec<String>,
    paths: Vec<Named>,
}

impl Imports {
    /// Of files with their sources. What is there for tests alone does not count; nor
    /// does it where a file passes on what stands in files below its folder
    /// (`pub use child::Thing`): that is a table of contents. Who imports `Thing` by that
    /// imports the child too.
    pub fn of(files: &[(String, String)]) -> Imports {
        let sources: Vec<Source> = files
            .iter()
            .filter(|(file, _)| !is_for_tests(file) && file != "src/main.rs")
            .map(|(file, source)| {
                let module = module(file);
                let paths = named(source, &module).into_iter().filter(|named| !named.test).collect();
                Source { file: file.clone(), module, paths }
            })
            .collect();
        let by_module: BTreeMap<&[String], &Source> =
            sources.iter().map(|source| (source.module.as_slice(), source)).collect();
        let mut imports = BTreeMap::new();
        for source in &sources {
            let to: &mut BTreeMap<String, usize> = imports.entry(source.file.clone()).or_default();
            for named in &source.paths {
                for target in targets(&by_module, source, named) {
                    if target != source.file {
                        to.entry(target).or_insert(named.line);
                    }
                }
            }
        }
        Imports(imports)
    }

    /// Every import that is part of a circle, on one of the shortest that it is part of,
    /// as the files in their order; each circle once.
    pub fn circles(&self) -> BTreeSet<Vec<String>> {
        let mut circles = BTreeSet::new();
        for (from, imports) in &self.0 {
            for to in imports.keys() {
                if let Some(mut circle) = self.way(to, from) {
                    circle.pop();
                    circle.insert(0, from.clone());
                    let first = (0..circle.len()).min_by_key(|at| &circle[*at]).unwrap_or(0);
                    circle.rotate_left(first);
                    circles.insert(circle);
                }
            }
        }
        circles
    }

    /// A circle as a path, with the lines of the imports: `a.rs:3 → b.rs:7 → a.rs`.
    pub fn told(&self, circle: &[String]) -> String {
        let mut text = String::new();
        for (from, to) in circle.iter().zip(circle.iter().cycle().skip(1)) {
            text += &format!("{from}:{} → ", self.0[from][to]);
        }
        text + &circle[0]
    }

    /// The files on a shortest way from one to another, both included.
    fn way(&self, from: &str, to: &str) -> Option<Vec<String>> {
        let mut came_from: BTreeMap<&str, &str> = BTreeMap::new();
        let mut next = VecDeque::from([from]);
        while let Some(at) = next.pop_front() {
            if at == to {
                let back = std::iter::successors(Some(at), |at| came_from.get(at).copied());
                let mut way: Vec<String> = back.map(str::to_string).collect();
                way.reverse();
                return Some(way);
            }
            for import in self.0.get(at).into_iter().flat_map(BTreeMap::keys) {
                if import != from && !came_from.contains_key(import.as_str()) {
                    came_from.insert(import, at);
                    next.push_back(import);
                }
            }
        }
        None
    }
}

/// Files that exist under test alone.
fn is_for_tests(file: &str) -> bool {
    file.split('/').any(|part| part.starts_with("test") || part.ends_with("tests.rs"))
}

/// The files that a path leads to: the one of the longest module that it begins with,
/// and where that passes the rest on from a file below it, that one.
fn targets(by_module: &BTreeMap<&[String], &Source>, source: &Source, named: &Named) -> Vec<String> {
    let path: Vec<String> = match named.path.split_first() {
        Some((root, rest)) if root == "crate" => rest.to_vec(),
        // A path that begins with a module of this file.
        _ => source.module.iter().chain(&named.path).cloned().collect(),
    };
    let starts_here = named.path.first().is_some_and(|root| root == "crate");
    let least = if starts_here { 1 } else { source.module.len() + 1 };
    let Some(length) = (least..=path.len()).rev().find(|length| by_module.contains_key(&path[..*length]))
    else {
        return Vec::new();
    };
    let target = by_module[&path[..length]];
    let is_below = target.module.len() > source.module.len() && target.module.starts_with(&source.module);
    if named.is_passed_on && is_below {
        return Vec::new();
    }
    let mut targets = vec![target.file.clone()];
    if let Some(name) = path.get(length) {
        let passed_on = target.paths.iter().filter(|other| {
            other.is_passed_on && other.name.as_deref().is_some_and(|other| other == name || other == "*")
        });
        for other in passed_on {
            let mut further = other.path.clone();
            if other.name.as_deref() == Some("*") {
                further.pop();
                further.push(name.clone());
            }
            let further = Named { path: further, is_passed_on: false, ..other.clone() };
            targets.extend(self::targets(by_module, target, &further));
        }
    }
    targets
}
