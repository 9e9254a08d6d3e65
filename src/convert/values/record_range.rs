//! Ranges of records in the runs: a chunk's parts, and what a guard keeps out of the
//! octree and why.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::convert::options::{Mode, Options};

/// A chunk's part of a run, in records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    pub run: u32,
    pub first: u32,
    pub points: u32,
}

/// Why a point is not in the octree. The numbers stand in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Reason {
    Outlier = 1,
    Duplicate = 2,
    Twin = 3,
}

impl Reason {
    pub fn name(self) -> &'static str {
        match self {
            Reason::Outlier => "outlier",
            Reason::Duplicate => "duplicate",
            Reason::Twin => "twin",
        }
    }

    pub const ALL: [Reason; 3] = [Reason::Outlier, Reason::Duplicate, Reason::Twin];

    pub fn mode(self, options: &Options) -> Mode {
        match self {
            Reason::Outlier => options.outliers,
            Reason::Duplicate => options.duplicates,
            Reason::Twin => options.twins,
        }
    }
}

/// Consecutive records of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExcludedRange {
    pub run: u32,
    pub first: u32,
    pub points: u32,
    pub reason: Reason,
}

/// Ranges of what stands at `indices` (ascending) among the points of a chunk's
/// parts.
pub fn ranges(parts: &[Part], indices: &[u32], reason: Reason) -> Vec<ExcludedRange> {
    let mut ranges: Vec<ExcludedRange> = Vec::new();
    let (mut part, mut before) = (0, 0u32);
    for index in indices {
        while index - before >= parts[part].points {
            before += parts[part].points;
            part += 1;
        }
        let at = Part { first: parts[part].first + (index - before), points: 1, ..parts[part] };
        put(&mut ranges, at, reason);
    }
    ranges
}

/// One more record; neighbours become one range.
pub fn put(ranges: &mut Vec<ExcludedRange>, Part { run, first, .. }: Part, reason: Reason) {
    match ranges.last_mut() {
        Some(last) if (last.run, last.reason) == (run, reason) && last.first + last.points == first => {
            last.points += 1;
        }
        _ => ranges.push(ExcludedRange { run, first, points: 1, reason }),
    }
}

/// What lies behind the first `keep` points of a chunk's parts.
pub fn behind(parts: &[Part], keep: u32, reason: Reason) -> (Vec<Part>, Vec<ExcludedRange>) {
    let (mut kept, mut behind) = (Vec::new(), Vec::new());
    let mut left = keep;
    for part in parts {
        let here = part.points.min(left);
        left -= here;
        if here > 0 {
            kept.push(Part { points: here, ..*part });
        }
        if here < part.points {
            let (first, points) = (part.first + here, part.points - here);
            behind.push(ExcludedRange { run: part.run, first, points, reason });
        }
    }
    (kept, behind)
}

/// Points by reason.
pub fn tally(ranges: &[ExcludedRange]) -> BTreeMap<Reason, u64> {
    let mut tally = BTreeMap::new();
    for range in ranges {
        *tally.entry(range.reason).or_default() += u64::from(range.points);
    }
    tally
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: [Part; 3] = [
        Part { run: 0, first: 5, points: 3 },
        Part { run: 2, first: 0, points: 1 },
        Part { run: 3, first: 9, points: 4 },
    ];

    fn range(run: u32, first: u32, points: u32) -> ExcludedRange {
        ExcludedRange { run, first, points, reason: Reason::Duplicate }
    }

    #[test]
    fn indices_become_ranges_of_their_runs() {
        assert_eq!(
            ranges(&PARTS, &[0, 1, 2, 3, 5, 7], Reason::Duplicate),
            [range(0, 5, 3), range(2, 0, 1), range(3, 10, 1), range(3, 12, 1)]
        );
    }

    #[test]
    fn what_is_kept_and_what_lies_behind_are_all() {
        for keep in 0..=8 {
            let (kept, rest) = behind(&PARTS, keep, Reason::Duplicate);
            let kept: u32 = kept.iter().map(|p| p.points).sum();
            let rest: u32 = rest.iter().map(|r| r.points).sum();
            assert_eq!((kept, rest), (keep, 8 - keep));
        }
        assert_eq!(behind(&PARTS, 2, Reason::Duplicate).1[0], range(0, 7, 1));
    }
}
