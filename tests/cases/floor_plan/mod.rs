//! Holds the source to the floor plan of src/lib.rs: who may know whom, which
//! crate belongs to which room, how long a file may be, and that no files import each
//! other in a circle. A plan that nobody checks is a wish.

mod circles;
mod paths;

use std::fs;
use std::path::{Path, PathBuf};

use circles::Imports;
use paths::named;

/// Who may know whom within one group; otherwise modules of a group do not meet.
const MEET: &[(&str, &str)] = &[];

/// Who may not know what although the order would allow it: what waits for events or
/// answers requests does not work on clouds and does not talk to the others (an intent
/// goes through the queue); formats hold no policy; what checks a conversion shares nothing
/// with it.
const STRANGERS: &[(&str, &str)] = &[
    ("format", "octree::sampling"),
    ("format", "octree::local_octree"),
    ("verify", "convert"),
    ("serve::watch", "octree"),
    ("serve::watch", "render"),
    ("serve::watch", "serve::scheduler"),
    ("serve::queue", "octree"),
    ("serve::queue", "format"),
    ("serve::queue", "render"),
    ("serve::web", "octree"),
    ("serve::web", "format"),
    ("serve::web", "render"),
    ("serve::web", "verify"),
    ("serve::web", "serve::scheduler"),
];

/// Crates and who may know them. The daemon puts the rooms together and so
/// meets what they are made of.
const OWNED: &[(&str, &[&str])] = &[
    ("las", &["src/format/las/"]),
    ("laz", &["src/format/las/"]),
    ("brotli", &["src/format/potree/"]),
    ("crs_definitions", &["src/format/crs/"]),
    ("proj4rs", &["src/format/crs/"]),
    ("sqlx", &["src/serve/queue/"]),
    ("axum", &["src/serve/"]),
    ("hyper", &["src/serve/web/"]),
    ("hyper_util", &["src/serve/web/"]),
    // What makes markup: the pages of the daemon, and the report's page with its charts.
    ("maud", &["src/serve/web/pages/", "src/lab/chart/"]),
    ("notify", &["src/serve/watch/"]),
    ("prometheus", &["src/serve/metrics", "src/serve/error"]),
    ("indicatif", &["src/cli/"]),
    ("wgpu", &["src/render/gpu/"]),
    ("pollster", &["src/render/gpu/"]),
    ("png", &["src/render/encode/"]),
    ("webp_animation", &["src/render/encode/"]),
];

/// What a room without files, clock and threads of its own does not touch.
const PURE: &[&str] = &["octree", "serve::job"];
/// A pure part of a room that has other parts; it knows nothing of the program.
const APART: &str = "src/lab/chart/";
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

/// The steps of a conversion. They do not import each other, nor does anything else
/// import them: what a step hands over lies below it. `run` alone puts them in a row.
const STEPS: &[&str] =
    &["convert::survey", "convert::distribute", "convert::index", "convert::merge", "convert::publish"];
const CONDUCTOR: &str = "src/convert/run.rs";

/// Folders whose files know of their wing only these modules: what the steps hand over
/// knows no step, and so does the log of checkpoints.
const BELOW: &[(&str, &str, &[&str])] = &[
    ("src/convert/values/", "convert", &["values", "options", "error"]),
    ("src/convert/checkpoint/", "convert", &["checkpoint", "values", "error"]),
];

/// Circles that may stay for now: all of their files lie below this. Each with its reason;
/// one that is no longer there must go from this list.
const CIRCLES: &[(&str, &str)] =
    &[("src/format/laz/", "its codec is under construction; the parts use what its mod.rs defines")];

/// Lines, without the tests at a file's end.
const LONGEST_FILE: usize = 400;

/// The modules by group, lowest first: a blank line parts groups. Those of `serve`, the
/// only wing with an order of its own, come before `serve` itself.
fn groups(lib: &str, serve: &str) -> Vec<Vec<String>> {
    let mut groups = vec![Vec::new()];
    for line in lib.lines() {
        match line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(';')) {
            Some("serve") => {
                let inner = self::groups(serve, "").into_iter();
                let within = |room: String| format!("serve::{room}");
                groups.extend(inner.map(|group| group.into_iter().map(within).collect::<Vec<_>>()));
                groups.push(vec!["serve".to_string()]);
            }
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
    let place = |room: &str| groups.iter().position(|group| group.iter().any(|r| r == room));
    let room_of = |path: &[String]| {
        let inner = path.iter().take(2).map(String::as_str).collect::<Vec<_>>().join("::");
        if place(&inner).is_some() { inner } else { path.first().cloned().unwrap_or_default() }
    };
    let room = room_of(&module);
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
        if apart && path[0] == "crate" && !path.starts_with(&["crate", "lab", "chart"]) {
            offend(format!("{APART} is to know nothing of the program ({})", path.join("::")));
        }
        if (apart || PURE.contains(&room.as_str())) && IMPURE.iter().any(|impure| path.starts_with(impure)) {
            offend(format!("{} has no place in a pure room", path.join("::")));
        }
        if path[0] != "crate" {
            continue;
        }
        let inner = path[1..].join("::");
        let is_step = |step: &&str| inner == **step || inner.starts_with(&format!("{step}::"));
        if let Some(step) = STEPS.iter().copied().find(|step| is_step(step))
            && file != CONDUCTOR
            && module.join("::") != step
        {
            offend(format!("only {CONDUCTOR} may import the step {step} ({inner})"));
        }
        let below = BELOW.iter().find(|(folder, ..)| file.starts_with(folder));
        if let Some((folder, wing, known)) = below
            && path[1] == *wing
            && path.get(2).is_some_and(|inner| !known.contains(inner))
        {
            offend(format!("{folder} may not know {inner}"));
        }
        let other = room_of(&named.path[1..]);
        let (Some(from), Some(to)) = (place(&room), place(&other)) else { continue };
        let target = path[1..].join("::") + "::";
        let stranger =
            STRANGERS.iter().any(|(who, what)| *who == room && target.starts_with(&format!("{what}::")));
        let sibling = from == to && room != other && !MEET.contains(&(room.as_str(), other.as_str()));
        if to > from || sibling || stranger {
            offend(format!("{room} may not know {other} ({})", path.join("::")));
        }
    }
    offences
}

/// src/convert/survey.rs is `convert::survey`, src/convert/mod.rs is `convert`.
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
    let groups = plan();
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    assert!(files.len() > 20, "only {} sources found", files.len());
    let mut all = Vec::new();
    for path in files {
        let file = path.strip_prefix(root).unwrap().to_str().unwrap().to_string();
        let wing = module(&file).into_iter().next();
        if let Some(wing) = wing.filter(|wing| !groups.iter().flatten().any(|r| r == wing)) {
            all.push(format!("{file}: src/lib.rs has no module {wing}"));
        }
        all.extend(offences(&groups, &file, &fs::read_to_string(&path).unwrap()));
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

/// All sources with their paths from the repository's root on.
fn all_sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    let named = |path: PathBuf| {
        let file = path.strip_prefix(root).unwrap().to_str().unwrap().to_string();
        (file, fs::read_to_string(&path).unwrap())
    };
    files.into_iter().map(named).collect()
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let imports = Imports::of(&all_sources());
    let mut found = Vec::new();
    let mut seen = vec![false; CIRCLES.len()];
    for circle in imports.circles() {
        let known = CIRCLES.iter().position(|(folder, _)| circle.iter().all(|file| file.starts_with(folder)));
        match known {
            Some(known) => seen[known] = true,
            None => found.push(imports.told(&circle)),
        }
    }
    assert!(found.is_empty(), "{} circles:\n{}", found.len(), found.join("\n"));
    for ((folder, why), seen) in CIRCLES.iter().zip(seen) {
        assert!(seen, "{folder} holds no circle any more ({why}); strike it from the list");
    }
}

/// Circles of sources that are made up, as paths.
fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
    let files: Vec<(String, String)> =
        files.iter().map(|(file, source)| (file.to_string(), source.to_string())).collect();
    let imports = Imports::of(&files);
    imports.circles().iter().map(|circle| imports.told(circle)).collect()
}

#[test]
fn planted_circles_are_seen() {
    let all = [
        ("src/a/mod.rs", "mod b;\nmod c;\npub use c::Thing;\nuse b::Other;\n"),
        ("src/a/b.rs", "//! B\nuse super::{c, Thing};\n"),
        ("src/a/c.rs", "//! C\n"),
        ("src/d.rs", "fn d() { crate::e::f() }\n"),
        ("src/e.rs", "use crate::g::{self as other, One};\n"),
        ("src/g.rs", "\n\nmod inner { use super::super::d; }\n"),
    ];
    assert_eq!(
        circles_of(&all),
        ["src/a/b.rs:2 → src/a/mod.rs:4 → src/a/b.rs", "src/d.rs:1 → src/e.rs:1 → src/g.rs:3 → src/d.rs"]
    );
    // One that hides behind a folder's table of contents.
    let hidden = [
        ("src/a/mod.rs", "mod b;\npub use b::*;\n"),
        ("src/a/b.rs", "use crate::c::f;\n"),
        ("src/c.rs", "use crate::a::Thing;\n"),
    ];
    assert_eq!(circles_of(&hidden), ["src/a/b.rs:1 → src/c.rs:1 → src/a/b.rs"]);
    // Two within one another: every import of both is on one that is told.
    let eight = [
        ("src/a.rs", "use crate::{b, c};\n"),
        ("src/b.rs", "use crate::a::A;\n"),
        ("src/c.rs", "\nuse crate::a::A;\n"),
    ];
    assert_eq!(
        circles_of(&eight),
        ["src/a.rs:1 → src/b.rs:1 → src/a.rs", "src/a.rs:1 → src/c.rs:2 → src/a.rs"]
    );
}

#[test]
fn imports_of_tests_make_no_circle() {
    let all = [
        ("src/a/mod.rs", "mod b;\npub use b::{Thing, self as other};\npub(crate) use b::f;\n"),
        (
            "src/a/b.rs",
            "use crate::c::f;\npub(in super::super) fn f() {}\nmod tests { use super::super::Thing; }\n",
        ),
        ("src/c.rs", "// use crate::a::b;\nconst A: &str = \"crate::a::b\";\n"),
        ("src/a/tests.rs", "use super::*;\n"),
    ];
    assert_eq!(circles_of(&all), Vec::<String>::new());
}

/// The plan as it stands in the library.
fn plan() -> Vec<Vec<String>> {
    let read = |file| fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
    groups(&read("src/lib.rs"), &read("src/serve/mod.rs"))
}

#[test]
fn the_plan_is_read_from_the_library() {
    let lib = "//! Text\n\n// Pure.\npub mod octree;\npub mod words;\n\n// Work.\npub mod serve;\n";
    let groups = groups(lib, "//! Text\n\npub mod job;\n\npub mod web;\n\nmod own;\n");
    assert_eq!(groups, [vec!["octree", "words"], vec!["serve::job"], vec!["serve::web"], vec!["serve"]]);
}

/// Whether the plan objects to a line in a file.
fn objects(file: &str, line: &str) -> bool {
    !offences(&plan(), file, &format!("//! Here.\n{line}\n")).is_empty()
}

#[test]
fn breaches_are_seen() {
    for (file, line) in [
        ("src/octree/node.rs", "use crate::platform::disk::Disk;"),
        ("src/serve/job/mod.rs", "use crate::serve::config::Config;"),
        ("src/octree/node.rs", "fn f() { let _ = std::fs::read(\"a\"); }"),
        ("src/lab/chart/plot.rs", "use crate::lab::process::Run;"),
        ("src/lab/chart/plot.rs", "use super::super::flip; use crate::octree::local_octree;"),
        ("src/lab/chart/page.rs", "fn f() { let _ = std::fs::write(\"a\", \"b\"); }"),
        ("src/octree/local_octree.rs", "use std::{mem, time::{Duration, SystemTime}};"),
        ("src/octree/local_octree.rs", "fn f() { std::thread::spawn(|| ()); }"),
        ("src/format/las/mod.rs", "use crate::octree::sampling::poisson::PoissonDisk;"),
        ("src/convert/survey.rs", "use crate::serve::queue::Store;"),
        ("src/convert/survey.rs", "use crate::{octree::node, serve::metrics::Metrics};"),
        ("src/convert/survey.rs", "use super::super::serve::scheduler::Engine;"),
        ("src/convert/survey.rs", "mod inner { use super::super::super::serve::web::serve; }"),
        ("src/convert/mod.rs", "pub use super::verify::check;"),
        ("src/convert/index.rs", "use super::distribute::Part;"),
        ("src/convert/guards/outliers.rs", "fn f() { crate::convert::survey::open() }"),
        ("src/convert/staging.rs", "use crate::convert::{error, merge};"),
        ("src/convert/values/runs.rs", "use crate::convert::checkpoint::scratch::Scratch;"),
        ("src/convert/checkpoint/receipt.rs", "use super::super::set_aside::tally;"),
        ("src/convert/survey.rs", "use las::Header;"),
        ("src/convert/survey.rs", "fn f(h: &laz::LazVlr) {}"),
        ("src/convert/survey.rs", "use ::laz::LazVlr;"),
        ("src/format/las/raw.rs", "use brotli::Decompressor;"),
        ("src/serve/web/mod.rs", "use sqlx::SqlitePool;"),
        ("src/serve/web/mod.rs", "use crate::serve::scheduler::Engine;"),
        ("src/serve/web/mod.rs", "use super::scheduler::Engine;"),
        ("src/serve/web/mod.rs", "mod tests { use sqlx::SqlitePool; }"),
        ("src/serve/watch/mod.rs", "use crate::serve::web;"),
        ("src/serve/watch/mod.rs", "use crate::serve::scheduler;"),
        ("src/serve/config/mod.rs", "type A<'a> = crate::cli::Exit; // 'x'"),
    ] {
        assert!(objects(file, line), "nobody minds {line} in {file}");
    }
    assert!(objects("src/octree/node.rs", &"\n".repeat(LONGEST_FILE)));
    let lib = ["octree".to_string()];
    assert!(!offences(&[lib.to_vec()], "src/octree/a.rs", "use std::mem;\n").is_empty(), "opens without //!");
}

#[test]
fn what_is_allowed_is_let_be() {
    for (file, line) in [
        ("src/lab/chart/plot.rs", "use super::canvas::Canvas; use crate::lab::chart::axis::Axis;"),
        ("src/octree/local_octree.rs", "use crate::octree::node::Key;"),
        ("src/octree/local_octree.rs", "use super::sampling::sampler::Sampler; use std::time::Duration;"),
        (
            "src/octree/node.rs",
            "// use crate::platform::disk::Disk;\n/* std::fs::read */ const A: &str = \"crate::serve::web::x\";",
        ),
        ("src/octree/node.rs", "const A: &str = r#\"a \" crate::serve::x\"#; const B: char = '\"';"),
        ("src/octree/node.rs", "mod tests { use crate::lab::synth::Scene; use std::fs::read; }"),
        ("src/convert/survey.rs", "use crate::format::las; fn f() { las::open(); }"),
        ("src/convert/survey.rs", "use crate::format::{las::Source, potree};"),
        ("src/convert/survey.rs", "mod inner { use super::super::survey::plan; }"),
        ("src/convert/run.rs", "use crate::convert::{index, merge::merge};"),
        ("src/convert/survey.rs", "use super::values::runs::Runs; use super::counting::Counter;"),
        (
            "src/convert/checkpoint/scratch.rs",
            "use crate::convert::values::block; use super::journal::Journal;",
        ),
        ("src/format/las/raw.rs", "use las::Header; use laz::LazVlr;"),
        ("src/serve/queue/claim.rs", "use sqlx::SqlitePool; use crate::serve::job::Job;"),
        ("src/serve/scheduler/mod.rs", "use crate::{convert::Cancel, serve::queue::Store, serve::job::Job};"),
        ("src/cli/serve.rs", "use crate::serve;"),
    ] {
        assert!(!objects(file, line), "somebody minds {line} in {file}");
    }
}
