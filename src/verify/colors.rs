//! Averaged colors of coarse levels. A point then has two colors, its own and a
//! mean; the input is held against its own, wherever that stands. Of a mean the
//! octree alone tells that it lies within the range of the cloud's colors, and
//! that a leaf's points, which are all that there is in their place, have none but
//! their own.

use super::color_attributes::ColorAttributes;
use super::octree::OctreeUnderTest;
use super::recomputed_statistics::RecomputedStatistics;
use super::report::{Check, Findings};
use crate::format::potree::Node;
use crate::words::grouped;

/// What a walk over the nodes finds; adds up in any order.
#[derive(Debug, Clone, Default)]
pub struct ColorMeans {
    /// Points of leaves with a mean that is not their own color.
    foreign: Findings,
    leaves: u64,
}

impl ColorMeans {
    pub fn merge(&mut self, other: ColorMeans) {
        self.foreign.merge(other.foreign);
        self.leaves += other.leaves;
    }

    /// Takes in records of a node.
    pub fn add(&mut self, octree: &OctreeUnderTest, (index, node): (usize, &Node), records: &[u8]) {
        let Some(colors) = octree.colors.as_ref().filter(|_| node.child_mask == 0) else { return };
        let points = records.chunks_exact(octree.schema.record_size());
        self.leaves += points.len() as u64;
        let foreign = points.filter(|record| !colors.is_own(record)).count() as u64;
        if foreign > 0 {
            let ColorAttributes { own, mean, .. } = colors;
            let text = || format!("{}: '{mean}' of {} is not '{own}'", node.name, grouped(foreign));
            self.foreign.add_many(foreign, index, text);
        }
    }

    /// What there is to say, where colors were averaged.
    pub fn check(mut self, octree: &OctreeUnderTest, tally: &RecomputedStatistics) -> Option<Check> {
        let ColorAttributes { own, mean, .. } = octree.colors.as_ref()?;
        let column = |name: &str| {
            let columns = octree.schema.attributes.iter().zip(tally.columns());
            columns.filter(|(attribute, _)| attribute.name == name).map(|(_, column)| column).next()
        };
        let (owns, means) = (column(own)?, column(mean)?);
        let is_below = means.min.iter().zip(&owns.min).any(|(mean, own)| mean < own);
        let is_above = means.max.iter().zip(&owns.max).any(|(mean, own)| mean > own);
        if is_below || is_above {
            let (a, b, c, d) = (&means.min, &means.max, &owns.min, &owns.max);
            let text = || format!("'{mean}' from {a:?} to {b:?} is no mean of '{own}' from {c:?} to {d:?}");
            self.foreign.add(octree.nodes.len(), text);
        }
        let leaves = grouped(self.leaves);
        let fine = format!(
            "'{mean}' lies within the range of '{own}', and is '{own}' in the {leaves} points of leaves"
        );
        Some(Check::of("averages", self.foreign, fine, "averages that cannot be"))
    }
}

/// What the comparison with the inputs leaves out.
pub fn note(octree: &OctreeUnderTest) -> Option<Check> {
    let ColorAttributes { own, mean, .. } = octree.colors.as_ref()?;
    let text = match *own {
        "rgb" => format!("'{mean}' holds averages, which no input has; 'rgb' was compared"),
        _ => format!("'{mean}' holds averages; the originals are in '{own}', which was compared"),
    };
    Some(Check::note("averages", text))
}

#[cfg(test)]
mod tests {
    use super::super::tests_support::{Draft, draft, schema};
    use super::super::{CheckOutcome, SpacingRule, VerifyReport, VerifyRequest, verify};
    use super::*;
    use crate::format::potree::PotreeEncoding;
    use crate::octree::attribute::{Attribute, Scalar, Schema};

    /// Averages stand behind position and color.
    const MEAN: usize = 18;

    /// An octree whose averages are all their points' own colors, as they are
    /// where neighbours have the same.
    fn averaged() -> Draft {
        let color = |name: &str| Attribute::new(name, Scalar::U16, 3);
        let position = schema().attributes.remove(0);
        let two = Schema { attributes: vec![position, color("rgb"), color("rgb average")] };
        let record = |i: u32| {
            let place = [i * 7919 % 4096, i * 5309 % 4096, i * 3461 % 64];
            let own = [100 + i as u16 % 50, 200, 300];
            let places = place.iter().flat_map(|c| c.to_le_bytes());
            places.chain([own, own].concat().into_iter().flat_map(u16::to_le_bytes)).collect::<Vec<u8>>()
        };
        let mut draft = draft(two, &(0..2000).map(record).collect::<Vec<_>>(), 12, 200);
        draft.metadata.generator.as_mut().unwrap().lod_color = Some("attribute".into());
        draft
    }

    fn report(draft: Draft) -> VerifyReport {
        let folder = tempfile::tempdir().unwrap();
        draft.write(folder.path(), PotreeEncoding::Default);
        let request = VerifyRequest {
            octree: folder.path().to_path_buf(),
            against: Vec::new(),
            damaged: false,
            memory_limit: 1 << 30,
            spacing: SpacingRule::Auto,
        };
        verify(&request).unwrap()
    }

    fn averages(report: &VerifyReport) -> &Check {
        report.checks.iter().find(|check| check.name == "averages").unwrap()
    }

    /// Changes one average in a node with or without children.
    fn changed(of_leaf: bool, value: u16) -> VerifyReport {
        let mut draft = averaged();
        let names: Vec<_> = draft.nodes.iter().map(|(node, _)| node.name).collect();
        let is_leaf = |node: &Node| {
            let children: Vec<_> = (0..8).filter_map(|child| node.name.child(child)).collect();
            !names.iter().any(|name| children.contains(name))
        };
        let nodes = draft.nodes.iter_mut();
        let (_, records) =
            nodes.filter(|(node, records)| is_leaf(node) == of_leaf && !records.is_empty()).last().unwrap();
        records[MEAN..MEAN + 2].copy_from_slice(&value.to_le_bytes());
        report(draft)
    }

    #[test]
    fn averages_that_can_be_are_let_be() {
        let report = report(averaged());
        assert!(report.ok, "{report}");
        assert!(averages(&report).summary.contains("'rgb average' lies within"), "{report}");
        // Whatever lies between the darkest and the lightest.
        assert!(changed(false, 120).ok);
    }

    #[test]
    fn averages_that_cannot_be_are_found() {
        for (of_leaf, value, example) in
            [(true, 99, "of 1 is not 'rgb'"), (false, 99, "is no mean"), (false, 151, "is no mean")]
        {
            let report = changed(of_leaf, value);
            assert!(!report.ok, "{report}");
            let check = averages(&report);
            assert_eq!(check.outcome, CheckOutcome::Wrong);
            assert!(check.examples.iter().any(|text| text.contains(example)), "{report}");
        }
    }

    #[test]
    fn attributes_that_are_said_to_be_there_and_are_not_are_missed() {
        for said in ["average", "median"] {
            let mut draft = averaged();
            draft.metadata.generator.as_mut().unwrap().lod_color = Some(said.into());
            let report = report(draft);
            assert_eq!((report.checks[0].name, report.checks[0].outcome), ("metadata", CheckOutcome::Wrong));
        }
    }
}
