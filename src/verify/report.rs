//! What a verification found: checks with an outcome each, as JSON for machines
//! and as a page for people.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

use super::request::VerifyRequest;
use crate::format::potree::{Metadata, PotreeEncoding};
use crate::words::{Plain, grouped};

/// How many examples of a fault are kept.
pub const EXAMPLES: usize = 5;

#[derive(Debug, Clone, Serialize)]
pub struct VerifyReport {
    pub octree: PathBuf,
    /// Whether nothing is wrong.
    pub ok: bool,
    pub name: String,
    pub encoding: String,
    /// Points that the nodes hold together.
    pub points: u64,
    pub nodes: u64,
    /// Level of the deepest node; the root's is 0.
    pub depth: u32,
    /// Size of octree.bin.
    pub bytes: u64,
    pub checks: Vec<Check>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Comparison>,
    pub seconds: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckOutcome {
    Ok,
    /// Worth knowing, not a fault.
    Note,
    /// Could not be checked, because of what was found before.
    Skipped,
    Wrong,
}

#[derive(Debug, Clone, Serialize)]
pub struct Check {
    pub name: &'static str,
    pub outcome: CheckOutcome,
    pub summary: String,
    /// How many things are wrong or worth a note.
    pub count: u64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub examples: Vec<String>,
}

/// The octree beside the files that it was made of.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    pub files: u64,
    /// Points of the files.
    pub points: u64,
    /// Points that lie beside the octree.
    pub set_aside: u64,
    /// Points that the octree's report says were dropped on request.
    pub dropped: u64,
    /// Points of the files that the octree lacks, and points of the octree that
    /// the files lack; each counted as often as it is there too much.
    pub missing: u64,
    pub extra: u64,
    pub position: PositionError,
    /// Attributes of the files that were left out on request.
    pub left_out: Vec<String>,
    pub checks: Vec<Check>,
}

/// How far the lattice moved positions, at most.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PositionError {
    /// Per axis in world units; 0 where every position is exact.
    pub world: [f64; 3],
    /// The largest in units of the octree's scale and of the inputs' scales.
    pub octree_units: f64,
    pub input_units: f64,
}

impl Check {
    pub fn ok(name: &'static str, summary: impl Into<String>) -> Check {
        Check { name, outcome: CheckOutcome::Ok, summary: summary.into(), count: 0, examples: Vec::new() }
    }

    pub fn skipped(name: &'static str, summary: impl Into<String>) -> Check {
        Check { outcome: CheckOutcome::Skipped, ..Check::ok(name, summary) }
    }

    pub fn note(name: &'static str, summary: impl Into<String>) -> Check {
        Check { outcome: CheckOutcome::Note, ..Check::ok(name, summary) }
    }

    pub fn wrong(name: &'static str, summary: impl Into<String>) -> Check {
        Check { outcome: CheckOutcome::Wrong, count: 1, ..Check::ok(name, summary) }
    }

    /// Fine where nothing was found, else wrong.
    pub fn of(name: &'static str, findings: Findings, fine: impl Into<String>, wrong: &str) -> Check {
        if findings.count == 0 {
            return Check::ok(name, fine);
        }
        let summary = format!("{} {wrong}", grouped(findings.count));
        let examples = findings.examples.into_iter().map(|(_, text)| text).collect();
        Check { name, outcome: CheckOutcome::Wrong, summary, count: findings.count, examples }
    }

    /// The same check where its rule does not bind.
    pub fn softened(mut self) -> Check {
        if self.outcome == CheckOutcome::Wrong {
            self.outcome = CheckOutcome::Note;
        }
        self
    }
}

/// Faults of one kind: how many, and the first of them. Adds up in any order.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    pub count: u64,
    /// With the place (a node's index) by which they are ordered.
    examples: Vec<(usize, String)>,
}

impl Findings {
    pub fn add(&mut self, place: usize, text: impl FnOnce() -> String) {
        self.add_many(1, place, text);
    }

    /// Several faults with one example.
    pub fn add_many(&mut self, count: u64, place: usize, text: impl FnOnce() -> String) {
        self.count += count;
        if self.examples.len() < EXAMPLES || self.examples.last().is_some_and(|last| place < last.0) {
            self.examples.push((place, text()));
            self.trim();
        }
    }

    pub fn merge(&mut self, other: Findings) {
        self.count += other.count;
        self.examples.extend(other.examples);
        self.trim();
    }

    fn trim(&mut self) {
        self.examples.sort();
        self.examples.truncate(EXAMPLES);
    }
}

impl VerifyReport {
    /// A report that has checked nothing yet.
    pub fn empty(request: &VerifyRequest, metadata: Option<&Metadata>) -> VerifyReport {
        VerifyReport {
            octree: request.octree.clone(),
            ok: false,
            name: metadata.map_or(String::new(), |m| m.name.clone()),
            encoding: metadata.map_or("", |m| encoding_in_words(m.encoding)).to_string(),
            points: 0,
            nodes: 0,
            depth: 0,
            bytes: 0,
            checks: Vec::new(),
            against: None,
            seconds: 0.0,
        }
    }

    /// Points that are missing because that was asked for.
    pub fn dropped(&self) -> u64 {
        self.against.as_ref().map_or(0, |against| against.dropped.min(against.missing))
    }

    /// Takes stock: nothing wrong anywhere?
    pub fn judge(&mut self) {
        let compared = self.against.iter().flat_map(|against| &against.checks);
        self.ok = self.checks.iter().chain(compared).all(|check| check.outcome != CheckOutcome::Wrong);
    }
}

impl fmt::Display for VerifyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} ({})",
            Plain(self.octree.display()),
            Plain(if self.name.is_empty() { "no name" } else { &self.name })
        )?;
        let (points, nodes) = (grouped(self.points), grouped(self.nodes));
        let levels = self.depth + 1;
        let bytes = grouped(self.bytes);
        writeln!(
            f,
            "{points} points in {nodes} nodes on {levels} levels, {} in {bytes} bytes",
            self.encoding
        )?;
        write_checks(f, &self.checks)?;
        if let Some(against) = &self.against {
            let (files, points) = (grouped(against.files), grouped(against.points));
            writeln!(f, "Against {files} {} with {points} points", plural(against.files, "file", "files"))?;
            write_checks(f, &against.checks)?;
        }
        let dropped = self.dropped();
        let verdict = match (self.ok, dropped) {
            (false, _) => "This octree is WRONG".to_string(),
            (true, 0) => "Nothing is wrong".to_string(),
            (true, _) => format!("Nothing is wrong, but {} points were dropped on request", grouped(dropped)),
        };
        write!(f, "{verdict} ({:.1} s).", self.seconds)
    }
}

fn write_checks(f: &mut fmt::Formatter<'_>, checks: &[Check]) -> fmt::Result {
    for check in checks {
        let outcome = match check.outcome {
            CheckOutcome::Ok => "ok",
            CheckOutcome::Note => "note",
            CheckOutcome::Skipped => "-",
            CheckOutcome::Wrong => "WRONG",
        };
        writeln!(f, "  {outcome:<6} {:<11} {}", check.name, Plain(&check.summary))?;
        for example in &check.examples {
            writeln!(f, "         {:<11} {}", "", Plain(example))?;
        }
        if check.count > check.examples.len() as u64 && !check.examples.is_empty() {
            writeln!(f, "         {:<11} ...", "")?;
        }
    }
    Ok(())
}

/// Bytes a point, as told in the report.
fn encoding_in_words(encoding: PotreeEncoding) -> &'static str {
    match encoding {
        PotreeEncoding::Default => "DEFAULT",
        PotreeEncoding::Brotli => "BROTLI",
    }
}

pub fn plural<'a>(count: u64, one: &'a str, many: &'a str) -> &'a str {
    if count == 1 { one } else { many }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_stand_in_groups() {
        assert_eq!([0, 999, 1000, 1234567].map(grouped), ["0", "999", "1 000", "1 234 567"]);
    }

    #[test]
    fn findings_keep_the_first_whatever_their_order() {
        let collect = |order: Vec<usize>| {
            let mut findings = Findings::default();
            order.iter().for_each(|&place| findings.add(place, || format!("at {place}")));
            findings
        };
        let mut forward = collect((0..10).collect());
        forward.merge(collect((10..20).collect()));
        let mut backward = collect((10..20).rev().collect());
        backward.merge(collect((0..10).rev().collect()));
        assert_eq!(forward.examples, backward.examples);
        assert_eq!((forward.count, backward.count), (20, 20));
    }
}
