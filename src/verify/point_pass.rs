//! The one pass over all points of an octree, in parallel over its nodes: do
//! they decode, do they lie in their node's box, is the sampling's rule kept,
//! are the statistics those of metadata.json; and their sum, to be held against
//! the inputs.

use rayon::prelude::*;

use super::colors::ColorMeans;
use super::cube::RootCube;
use super::digest::Sum;
use super::octree::{OctreeUnderTest, position};
use super::recomputed_statistics::RecomputedStatistics;
use super::report::{Check, Findings};
use super::request::SpacingRule;
use super::spacing::{self, Limit};
use super::structure::is_ours;
use crate::format::potree::{MetadataAttribute, Node, attribute_entry};
use crate::words::grouped;

/// Which rule inner nodes are held to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rule {
    Poisson,
    Grid,
    None,
}

/// What the pass found; adds up in any order.
#[derive(Debug, Clone)]
pub struct PointPass {
    undecodable: Findings,
    outside: Findings,
    /// Breaches of the sampling rule.
    crowded: Findings,
    /// Inner nodes that were held to it, and their points.
    inner: (u64, u64),
    means: ColorMeans,
    tally: RecomputedStatistics,
    pub sum: Sum,
}

impl PointPass {
    fn new(octree: &OctreeUnderTest) -> PointPass {
        PointPass {
            undecodable: Findings::default(),
            outside: Findings::default(),
            crowded: Findings::default(),
            inner: (0, 0),
            means: ColorMeans::default(),
            tally: RecomputedStatistics::new(&octree.schema),
            sum: Sum::default(),
        }
    }

    fn merge(mut self, other: PointPass) -> PointPass {
        self.undecodable.merge(other.undecodable);
        self.outside.merge(other.outside);
        self.crowded.merge(other.crowded);
        self.inner = (self.inner.0 + other.inner.0, self.inner.1 + other.inner.1);
        self.means.merge(other.means);
        self.tally.merge(other.tally);
        self.sum.merge(&other.sum);
        self
    }
}

/// Walks all nodes whose bytes are where the hierarchy says. Records are summed
/// up only where they will be compared.
pub fn walk(octree: &OctreeUnderTest, with_sum: bool) -> PointPass {
    let cube = RootCube::new(&octree.metadata);
    let rule = rule_of(octree);
    let fold = |mut walk: PointPass, (index, node): (usize, &Node)| {
        if octree.is_readable(node) {
            visit(octree, &cube, rule, with_sum, (index, node), &mut walk);
        }
        walk
    };
    octree
        .nodes
        .par_iter()
        .enumerate()
        .with_min_len(16)
        .fold(|| PointPass::new(octree), fold)
        .reduce(|| PointPass::new(octree), PointPass::merge)
}

/// The rule the octree says it keeps; one that does not say is measured by the
/// usual one.
fn rule_of(octree: &OctreeUnderTest) -> Rule {
    match octree.metadata.generator.as_ref().map(|generator| generator.sampling.as_str()) {
        Some("random" | "nearest") => Rule::Grid,
        Some("poisson" | "shells") | None => Rule::Poisson,
        Some(_) => Rule::None,
    }
}

fn visit(
    octree: &OctreeUnderTest,
    cube: &RootCube,
    rule: Rule,
    with_sum: bool,
    (index, node): (usize, &Node),
    walk: &mut PointPass,
) {
    let bounds = cube.bounds(node.name);
    let record_size = octree.schema.record_size();
    let is_inner = node.child_mask != 0 && node.points > 0 && rule != Rule::None;
    let mut sample: Vec<[i32; 3]> = Vec::new();
    let mut outside = 0;
    let mut buffer = Vec::new();
    let PointPass { undecodable, outside: findings, means, tally, sum, .. } = walk;
    let read = octree.blocks(node, |records| {
        for record in records.chunks_exact(record_size) {
            let place = position(record);
            let is_inside = (0..3).all(|a| (bounds[a].0..=bounds[a].1).contains(&i64::from(place[a])));
            if !is_inside {
                outside += 1;
                findings.add(index, || format!("{}: position {place:?} is not in {bounds:?}", node.name));
            }
            if is_inner && is_inside && node.points <= spacing::MOST_POINTS {
                sample.push(place);
            }
        }
        if with_sum {
            octree.compared(records, &mut buffer).chunks_exact(record_size).for_each(|r| sum.add(r));
        }
        means.add(octree, (index, node), records);
        tally.add(&octree.schema, records);
    });
    if let Err(error) = read {
        undecodable.add(index, || format!("{}: {error}", node.name));
    } else if is_inner && outside == 0 {
        walk.inner = (walk.inner.0 + 1, walk.inner.1 + u64::from(node.points));
        hold_to_rule(octree, cube, rule, (index, node), &sample, &mut walk.crowded);
    }
}

/// Holds an inner node's points to the sampling's rule.
fn hold_to_rule(
    octree: &OctreeUnderTest,
    cube: &RootCube,
    rule: Rule,
    (index, node): (usize, &Node),
    sample: &[[i32; 3]],
    crowded: &mut Findings,
) {
    let name = node.name;
    if node.points > spacing::MOST_POINTS {
        let text = || format!("{name}: {} points are more than can keep a spacing", node.points);
        return crowded.add_many(node.points.into(), index, text);
    }
    let corner = cube.bounds(name).map(|(min, _)| min);
    let exponent = cube.side_exponent(name.level());
    let scale = octree.metadata.scale;
    let spacing = octree.metadata.spacing / f64::from(name.level()).exp2();
    match (rule, exponent) {
        (Rule::Grid, Some(exponent)) => {
            let count = spacing::crowded_cells(sample, corner, exponent);
            if count > 0 {
                crowded
                    .add_many(count, index, || format!("{name}: {count} points share a cell with another"));
            }
        }
        (Rule::Poisson, exponent) => {
            let limit = exact_limit(octree, exponent).unwrap_or(Limit::of_world(scale, spacing));
            let found = spacing::too_close(sample, corner, limit);
            if found.pairs > 0 {
                let unit = if matches!(limit, Limit::Units(_)) { scale[0] } else { 1.0 };
                let closest = found.closest * unit;
                let [a, b] = found.example;
                crowded.add_many(found.pairs, index, || {
                    format!(
                        "{name}: {}{} pairs, closest {closest:.6} < {spacing:.6} ({a:?}, {b:?})",
                        if found.more { "at least " } else { "" },
                        found.pairs
                    )
                });
            }
        }
        (Rule::Grid, None) | (Rule::None, _) => {}
    }
}

/// The limit in whole units, where all axes have the same scale, the node's
/// side is a power of two of it, and the root's spacing is 1/128 of its side.
fn exact_limit(octree: &OctreeUnderTest, exponent: Option<i32>) -> Option<Limit> {
    let [x, y, z] = octree.metadata.scale;
    let bounds = &octree.metadata.bounding_box;
    let is_usual = ((bounds.max[0] - bounds.min[0]) / octree.metadata.spacing - 128.0).abs() < 1e-6;
    (x == y && y == z && is_usual).then(|| exponent.map(|e| Limit::of_exponent(e - 7)))?
}

impl PointPass {
    /// What the pass found, in words.
    pub fn checks(self, octree: &OctreeUnderTest, spacing: SpacingRule) -> Vec<Check> {
        let statistics = statistics(octree, &self.tally);
        let averages = self.means.clone().check(octree, &self.tally);
        let readable = self.undecodable.count == 0;
        let bounds =
            if RootCube::new(&octree.metadata).is_lattice() { "to the unit" } else { "within a unit" };
        let crowded = self.spacing_check(octree);
        let binds = match spacing {
            SpacingRule::Require => true,
            SpacingRule::Report => false,
            SpacingRule::Auto => is_ours(&octree.metadata),
        };
        let checks = [
            Check::of("decoding", self.undecodable, "every node decodes", "nodes do not decode"),
            Check::of(
                "boxes",
                self.outside,
                format!("every point lies in its node's box, {bounds}"),
                "points lie outside their node's box",
            ),
            if binds { crowded } else { crowded.softened() },
            match readable {
                true => statistics,
                false => Check::skipped("statistics", "not all points could be read"),
            },
        ];
        checks.into_iter().chain(averages).collect()
    }

    fn spacing_check(&self, octree: &OctreeUnderTest) -> Check {
        let (nodes, points) = (grouped(self.inner.0), grouped(self.inner.1));
        let (fine, wrong) = match rule_of(octree) {
            Rule::Poisson => {
                ("no two points closer than the spacing", "pairs of points closer than the spacing")
            }
            Rule::Grid => ("one point a cell", "points that share a cell of the 128³ grid"),
            Rule::None => {
                return Check::skipped("spacing", "the octree's sampling has no rule that is known here");
            }
        };
        let fine = format!("{fine} in {nodes} inner nodes with {points} points");
        Check::of("spacing", self.crowded.clone(), fine, wrong)
    }
}

/// The statistics of metadata.json beside those of the points.
fn statistics(octree: &OctreeUnderTest, tally: &RecomputedStatistics) -> Check {
    let mut wrong = Findings::default();
    let entries = octree.metadata.attributes.iter().zip(&octree.schema.attributes).zip(tally.columns());
    for ((said, attribute), column) in entries {
        let mut attribute = attribute.clone();
        if attribute.name == "position" {
            attribute.scale = octree.metadata.scale.to_vec();
            attribute.offset = octree.metadata.offset.to_vec();
        }
        let found = attribute_entry(&attribute, column);
        let slack = |element: usize| match attribute.name.as_str() {
            // World coordinates: the last bits depend on the way of computing.
            "position" => attribute.scale[element] * 1e-3,
            _ => 0.0,
        };
        compare_statistics(said, &found, slack, &mut wrong);
    }
    let histograms = octree.metadata.attributes.iter().filter(|a| a.histogram.is_some()).count();
    let fine = format!("ranges of all attributes and {histograms} histograms are those of the points");
    Check::of("statistics", wrong, fine, "statistics of metadata.json are not those of the points")
}

fn compare_statistics(
    said: &MetadataAttribute,
    found: &MetadataAttribute,
    slack: impl Fn(usize) -> f64,
    wrong: &mut Findings,
) {
    let name = &said.name;
    let differs = |a: &[f64], b: &[f64]| {
        a.len() != b.len() || a.iter().zip(b).enumerate().any(|(i, (a, b))| (a - b).abs() > slack(i))
    };
    if differs(&said.min, &found.min) || differs(&said.max, &found.max) {
        wrong.add(0, || {
            let (a, b, c, d) = (&said.min, &said.max, &found.min, &found.max);
            format!("{name}: said to be {a:?} to {b:?}, is {c:?} to {d:?}")
        });
    }
    // Viewers do without a histogram; one that is there must be true.
    if said.histogram.is_some() && said.histogram != found.histogram {
        wrong.add(0, || format!("{name}: its histogram is not that of the points"));
    }
}
