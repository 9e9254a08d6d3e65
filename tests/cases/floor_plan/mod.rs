//! Holds the source to the floor plan of src/lib.rs: who may know whom, which
//! crate belongs to which room, how long a file may be. A plan that nobody
//! checks is a wish.

mod paths;

use std::fs;
use std::path::{Path, PathBuf};

use paths::named;

/// Who may know whom within one group of src/lib.rs; otherwise rooms of a group
/// do not meet.
const MEET: &[(&str, &str)] = &[
    ("lod", "cloud"),
    ("log", "clock"),
    ("store", "config"),
    ("watch", "config"),
    ("watch", "store"),
    ("web", "config"),
    ("web", "store"),
    ("engine", "config"),
    ("engine", "store"),
    ("cli", "daemon"),
];

/// Who may not know whom although the order would allow it: stages are plain
/// functions, and what waits for events or answers requests neither works on
/// clouds nor talks to the others (an intent goes through the store).
const STRANGERS: &[(&str, &str)] = &[
    ("stage", "metrics"),
    ("stage", "job"),
    ("format", "job"),
    ("format", "lod"),
    ("watch", "lod"),
    ("web", "lod"),
    ("web", "engine"),
    ("watch", "engine"),
    ("web", "format"),
    ("web", "render"),
    ("watch", "render"),
    ("store", "render"),
    ("web", "verify"),
    ("store", "format"),
    ("store", "lod"),
];

/// Crates and who may know them. The daemon puts the rooms together and so
/// meets what they are made of.
const OWNED: &[(&str, &[&str])] = &[
    ("las", &["src/format/las/"]),
    ("laz", &["src/format/las/"]),
    ("brotli", &["src/format/potree/"]),
    ("crs_definitions", &["src/format/crs/"]),
    ("proj4rs", &["src/format/crs/"]),
    ("sqlx", &["src/store/"]),
    ("axum", &["src/web/", "src/daemon/"]),
    ("hyper", &["src/web/"]),
    ("hyper_util", &["src/web/"]),
    ("maud", &["src/web/pages/"]),
    ("notify", &["src/watch/"]),
    ("prometheus", &["src/metrics", "src/daemon/"]),
    ("indicatif", &["src/cli/"]),
    ("wgpu", &["src/render/gpu/"]),
    ("pollster", &["src/render/gpu/"]),
    ("png", &["src/render/encode/"]),
    ("webp_animation", &["src/render/encode/"]),
];

/// What a room without files, clock and threads of its own does not touch.
const PURE: &[&str] = &["cloud", "job", "lod"];
/// A pure part of a room that has other parts; it knows nothing of the program.
const APART: &str = "src/measure/chart/";
const IMPURE: &[&[&str]] = &[
    &["std", "fs"],
    &["std", "net"],
    &["std", "thread"],
    &["std", "process"],
    &["std", "time", "SystemTime"],
    &["std", "time", "Instant"],
    &["tokio"],
    &["rustix"],
    &["memmap2"],
];

/// Lines, without the tests at a file's end.
const LONGEST_FILE: usize = 400;

/// The rooms by group, as src/lib.rs lists them: a blank line parts groups.
fn groups(lib: &str) -> Vec<Vec<String>> {
    let mut groups = vec![Vec::new()];
    for line in lib.lines() {
        match line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(';')) {
            Some(room) => groups.last_mut().expect("never empty").push(room.to_string()),
            None if line.is_empty() => groups.push(Vec::new()),
            None => {}
        }
    }
    groups.retain(|group| !group.is_empty());
    groups
}

/// What a file does that its place forbids.
fn offences(groups: &[Vec<String>], file: &str, source: &str) -> Vec<String> {
    let module = module(file);
    let room = module.first().cloned().unwrap_or_default();
    let group_of = |room: &str| groups.iter().position(|group| group.iter().any(|r| r == room));
    let mut offences = Vec::new();
    // Tests stand beside what they test and do not count.
    let lines = source.lines().take_while(|line| *line != "#[cfg(test)]").count();
    if lines > LONGEST_FILE {
        offences.push(format!("{file}: {lines} lines; part it"));
    }
    if !source.starts_with("//!") && !file.ends_with("/tests.rs") {
        offences.push(format!("{file}: does not open by saying what lives here (//!)"));
    }
    for named in named(source, &module) {
        let path: Vec<&str> = named.path.iter().map(String::as_str).collect();
        let mut offend = |what: String| offences.push(format!("{file}:{}: {what}", named.line));
        if let Some((name, homes)) = OWNED.iter().find(|(name, _)| *name == path[0])
            && !homes.iter().any(|home| file.starts_with(home))
        {
            offend(format!("the crate {name} belongs to {} alone", homes.join(" and ")));
        }
        if named.test || file.ends_with("/tests.rs") {
            continue; // a test may look where it likes, for its crates see above
        }
        let apart = file.starts_with(APART);
        if apart && path[0] == "crate" && !path.starts_with(&["crate", "measure", "chart"]) {
            offend(format!("{APART} is to know nothing of the program ({})", path.join("::")));
        }
        if (apart || PURE.contains(&room.as_str())) && IMPURE.iter().any(|impure| path.starts_with(impure)) {
            offend(format!("{} has no place in a pure room", path.join("::")));
        }
        let ("crate", Some(other)) = (path[0], path.get(1)) else { continue };
        let (Some(from), Some(to)) = (group_of(&room), group_of(other)) else { continue };
        let stranger = STRANGERS.contains(&(&room, other));
        let sibling = from == to && room != *other && !MEET.contains(&(&room, other));
        if to > from || sibling || stranger {
            offend(format!("{room} may not know {other} ({})", path.join("::")));
        }
    }
    offences
}

/// src/stage/survey.rs is `stage::survey`, src/stage/mod.rs is `stage`.
fn module(file: &str) -> Vec<String> {
    let inner = file.trim_start_matches("src/").trim_end_matches(".rs");
    let mut module: Vec<String> = inner.split('/').map(str::to_string).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        module.pop();
    }
    module
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn every_file_keeps_to_the_floor_plan() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let groups = groups(&fs::read_to_string(root.join("src/lib.rs")).unwrap());
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    assert!(files.len() > 20, "only {} sources found", files.len());
    let mut all = Vec::new();
    for path in files {
        let file = path.strip_prefix(root).unwrap().to_str().unwrap().to_string();
        let room = module(&file).into_iter().next();
        if let Some(room) = room.filter(|room| !groups.iter().flatten().any(|r| r == room)) {
            all.push(format!("{file}: src/lib.rs has no room {room}"));
        }
        all.extend(offences(&groups, &file, &fs::read_to_string(&path).unwrap()));
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

#[test]
fn rooms_are_read_from_the_library() {
    let groups = groups("//! Text\n\n// Pure.\npub mod cloud;\npub mod lod;\n\n// Work.\npub mod stage;\n");
    assert_eq!(groups, [vec!["cloud", "lod"], vec!["stage"]]);
}

/// Whether the plan objects to a line in a file.
fn objects(file: &str, line: &str) -> bool {
    let lib = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    !offences(&groups(&lib), file, &format!("//! Here.\n{line}\n")).is_empty()
}

#[test]
fn breaches_are_seen() {
    for (file, line) in [
        ("src/cloud/node.rs", "use crate::disk::Disk;"),
        ("src/cloud/node.rs", "use crate::lod::tree;"),
        ("src/job/mod.rs", "use crate::cloud::node::Key;"),
        ("src/cloud/node.rs", "fn f() { let _ = std::fs::read(\"a\"); }"),
        ("src/measure/chart/bars.rs", "use crate::measure::process::Run;"),
        ("src/measure/chart/bars.rs", "use super::super::flip; use crate::lod::tree;"),
        ("src/measure/chart/page.rs", "fn f() { let _ = std::fs::write(\"a\", \"b\"); }"),
        ("src/lod/tree.rs", "use std::{mem, time::{Duration, SystemTime}};"),
        ("src/lod/tree.rs", "fn f() { std::thread::spawn(|| ()); }"),
        ("src/stage/survey.rs", "use crate::store::Store;"),
        ("src/stage/survey.rs", "use crate::{cloud::node, metrics::Metrics};"),
        ("src/stage/survey.rs", "use super::super::engine::tick;"),
        ("src/stage/survey.rs", "mod inner { use super::super::super::web::serve; }"),
        ("src/stage/mod.rs", "pub use super::verify::check;"),
        ("src/stage/survey.rs", "use las::Header;"),
        ("src/stage/survey.rs", "fn f(h: &laz::LazVlr) {}"),
        ("src/stage/survey.rs", "use ::laz::LazVlr;"),
        ("src/format/las/raw.rs", "use brotli::Decompressor;"),
        ("src/web/mod.rs", "use sqlx::SqlitePool;"),
        ("src/web/mod.rs", "use crate::engine::Engine;"),
        ("src/web/mod.rs", "mod tests { use sqlx::SqlitePool; }"),
        ("src/watch/mod.rs", "use crate::web;"),
        ("src/config.rs", "type A<'a> = crate::cli::Exit; // 'x'"),
    ] {
        assert!(objects(file, line), "nobody minds {line} in {file}");
    }
    assert!(objects("src/cloud/node.rs", &"\n".repeat(LONGEST_FILE)));
    let lib = ["cloud".to_string()];
    assert!(!offences(&[lib.to_vec()], "src/cloud/a.rs", "use std::mem;\n").is_empty(), "opens without //!");
}

#[test]
fn what_is_allowed_is_let_be() {
    for (file, line) in [
        ("src/measure/chart/bars.rs", "use super::canvas::Canvas; use crate::measure::chart::data::Axis;"),
        ("src/lod/tree.rs", "use crate::cloud::node::Key;"),
        ("src/lod/tree.rs", "use super::sampler::Sampler; use std::time::Duration;"),
        (
            "src/cloud/node.rs",
            "// use crate::disk::Disk;\n/* std::fs::read */ const A: &str = \"crate::web::x\";",
        ),
        ("src/cloud/node.rs", "const A: &str = r#\"a \" crate::web::x\"#; const B: char = '\"';"),
        ("src/cloud/node.rs", "mod tests { use crate::synth::Scene; use std::fs::read; }"),
        ("src/stage/survey.rs", "use crate::format::las; fn f() { las::open(); }"),
        ("src/stage/survey.rs", "use crate::format::{las::Source, potree};"),
        ("src/stage/survey.rs", "mod inner { use super::super::survey::plan; }"),
        ("src/format/las/raw.rs", "use las::Header; use laz::LazVlr;"),
        ("src/store/queue.rs", "use sqlx::SqlitePool; use crate::job::Job;"),
        ("src/engine/mod.rs", "use crate::{stage::Cancel, store::Store, job::Job};"),
        ("src/cli/serve.rs", "use crate::daemon;"),
    ] {
        assert!(!objects(file, line), "somebody minds {line} in {file}");
    }
}
