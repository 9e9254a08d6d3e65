//! Ranges of records in the runs: a chunk's parts, and what a guard keeps out of the
//! octree and why.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::convert::options::{GuardMode, Options};

/// A chunk's part of a run, in records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunSegment {
    pub run: u32,
    pub first: u32,
    pub points: u32,
}

/// Why a point is not in the octree. The numbers stand in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum SetAsideReason {
    Outlier = 1,
    Duplicate = 2,
    Twin = 3,
}

impl SetAsideReason {
    pub fn name(self) -> &'static str {
        match self {
            SetAsideReason::Outlier => "outlier",
            SetAsideReason::Duplicate => "duplicate",
            SetAsideReason::Twin => "twin",
        }
    }

    pub const ALL: [SetAsideReason; 3] =
        [SetAsideReason::Outlier, SetAsideReason::Duplicate, SetAsideReason::Twin];

    pub fn mode(self, options: &Options) -> GuardMode {
        match self {
            SetAsideReason::Outlier => options.outliers,
            SetAsideReason::Duplicate => options.duplicates,
            SetAsideReason::Twin => options.twins,
        }
    }
}

/// Consecutive records of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExcludedRange {
    pub run: u32,
    pub first: u32,
    pub points: u32,
    pub reason: SetAsideReason,
}

/// Ranges of what stands at `indices` (ascending) among the points of a chunk's
/// parts.
pub fn ranges(parts: &[RunSegment], indices: &[u32], reason: SetAsideReason) -> Vec<ExcludedRange> {
    let mut ranges: Vec<ExcludedRange> = Vec::new();
    let (mut part, mut before) = (0, 0u32);
    for index in indices {
        while index - before >= parts[part].points {
            before += parts[part].points;
            part += 1;
        }
        let at = RunSegment { first: parts[part].first + (index - before), points: 1, ..parts[part] };
        put(&mut ranges, at, reason);
    }
    ranges
}

/// One more record; neighbours become one range.
pub fn put(
    ranges: &mut Vec<ExcludedRange>,
    RunSegment { run, first, .. }: RunSegment,
    reason: SetAsideReason,
) {
    match ranges.last_mut() {
        Some(last) if (last.run, last.reason) == (run, reason) && last.first + last.points == first => {
            last.points += 1;
        }
        _ => ranges.push(ExcludedRange { run, first, points: 1, reason }),
    }
}

/// What lies behind the first `keep` points of a chunk's parts.
pub fn behind(
    parts: &[RunSegment],
    keep: u32,
    reason: SetAsideReason,
) -> (Vec<RunSegment>, Vec<ExcludedRange>) {
    let (mut kept, mut behind) = (Vec::new(), Vec::new());
    let mut left = keep;
    for part in parts {
        let here = part.points.min(left);
        left -= here;
        if here > 0 {
            kept.push(RunSegment { points: here, ..*part });
        }
        if here < part.points {
            let (first, points) = (part.first + here, part.points - here);
            behind.push(ExcludedRange { run: part.run, first, points, reason });
        }
    }
    (kept, behind)
}

/// Points by reason.
pub fn tally(ranges: &[ExcludedRange]) -> BTreeMap<SetAsideReason, u64> {
    let mut tally = BTreeMap::new();
    for range in ranges {
        *tally.entry(range.reason).or_default() += u64::from(range.points);
    }
    tally
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: [RunSegment; 3] = [
        RunSegment { run: 0, first: 5, points: 3 },
        RunSegment { run: 2, first: 0, points: 1 },
        RunSegment { run: 3, first: 9, points: 4 },
    ];

    fn range(run: u32, first: u32, points: u32) -> ExcludedRange {
        ExcludedRange { run, first, points, reason: SetAsideReason::Duplicate }
    }

    #[test]
    fn indices_become_ranges_of_their_runs() {
        assert_eq!(
            ranges(&PARTS, &[0, 1, 2, 3, 5, 7], SetAsideReason::Duplicate),
            [range(0, 5, 3), range(2, 0, 1), range(3, 10, 1), range(3, 12, 1)]
        );
    }

    #[test]
    fn what_is_kept_and_what_lies_behind_are_all() {
        for keep in 0..=8 {
            let (kept, rest) = behind(&PARTS, keep, SetAsideReason::Duplicate);
            let kept: u32 = kept.iter().map(|p| p.points).sum();
            let rest: u32 = rest.iter().map(|r| r.points).sum();
            assert_eq!((kept, rest), (keep, 8 - keep));
        }
        assert_eq!(behind(&PARTS, 2, SetAsideReason::Duplicate).1[0], range(0, 7, 1));
    }
}
