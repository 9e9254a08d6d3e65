//! How many points there are, where what the header says and the bytes disagree.
//!
//! Nothing here reads a file: [`judge`] is handed what was found ([`Evidence`])
//! and decides. A header has one count up to version 1.3 and two since: the
//! 32-bit one of old stays beside the 64-bit one. Writers forget either, die
//! before they know it, or put something behind the points.
//!
//! | counts | behind the counted points | verdict |
//! |---|---|---|
//! | one is what there is room for | nothing | it is believed |
//! | all are higher | (the bytes end) | too few: an error, or what is there |
//! | lower | padding, or no points | it is believed; what lies behind is told |
//! | lower | points, whole to the last byte, and the header is not true of the counted ones alone | all are read, and told |
//! | lower | points otherwise | a contradiction: an error, or all of them |
//! | lower | cannot be told | it is believed if the counts by return agree; else as points |
//! | none | padding, or no points | no points |
//! | none | points or cannot be told, whole to the last byte | all are read, and told |
//! | none | the same, and a torn record behind | a contradiction: an error, or all of them |

/// The counts that a header has.
#[derive(Debug, Clone, Copy)]
pub struct DeclaredCounts {
    pub legacy: u64,
    /// Only since version 1.4.
    pub large: Option<u64>,
    /// All points by return added up; 0 where the header says nothing of them.
    pub by_return: u64,
}

/// What the bytes between the counted points and the end of the room for points
/// look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Behind {
    /// Less than a record.
    Nothing,
    /// One and the same byte throughout.
    Padding,
    /// No points: an extended record, or coordinates far from all others.
    NoPoints,
    /// Records among the other points.
    Points,
    /// There is nothing to hold them against.
    Unclear,
}

/// What was found out about a file.
#[derive(Debug, Clone, Copy)]
pub struct Evidence {
    pub claims: DeclaredCounts,
    /// Whole records that there is room for, without padding at the end.
    pub room: u64,
    /// Something follows them that is no whole record.
    pub torn: bool,
    pub behind: Behind,
    /// The header's box and counts by return are exactly those of the counted
    /// points alone.
    pub header_is_exact: bool,
}

/// What becomes of the points of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResolvedCounts {
    /// So many points, as the header says.
    Counted(u64),
    /// The header counts fewer, and the file proves that there are these.
    Proven { said: u64, there: u64 },
    /// The file ends before the points do.
    TooFew { said: u64, there: u64 },
    /// The header counts fewer, and there is more that looks like points.
    Contradiction { said: u64, there: u64 },
}

impl ResolvedCounts {
    /// Points that are read where what can be read is asked for.
    pub fn there(self) -> u64 {
        match self {
            ResolvedCounts::Counted(points) => points,
            ResolvedCounts::Proven { there, .. }
            | ResolvedCounts::TooFew { there, .. }
            | ResolvedCounts::Contradiction { there, .. } => there,
        }
    }
}

impl DeclaredCounts {
    pub fn of(raw: &las::raw::Header) -> DeclaredCounts {
        let legacy = raw.number_of_points_by_return.iter().map(|points| u64::from(*points)).sum();
        let large = raw.large_file.map_or(0, |large| {
            large.number_of_points_by_return.iter().fold(0u64, |sum, points| sum.saturating_add(*points))
        });
        DeclaredCounts {
            legacy: u64::from(raw.number_of_point_records),
            large: raw.large_file.map(|large| large.number_of_point_records),
            by_return: if large > 0 { large } else { legacy },
        }
    }

    /// The counts that are not zero, the one to believe first in front.
    pub fn candidates(self) -> impl Iterator<Item = u64> {
        self.large.into_iter().chain([self.legacy]).filter(|count| *count > 0)
    }

    /// What the header says if nothing contradicts it.
    pub fn said(self) -> u64 {
        self.candidates().next().unwrap_or(0)
    }

    pub fn largest(self) -> u64 {
        self.candidates().max().unwrap_or(0)
    }

    /// Whether one of the counts is this.
    pub fn are(self, points: u64) -> bool {
        self.candidates().any(|count| count == points) || self.said() == points
    }

    /// The count to hold against room for so many points: one that is exactly
    /// that, else the first that is less, else the largest.
    pub fn against(self, room: u64) -> u64 {
        let exact = self.candidates().find(|count| *count == room);
        exact.or_else(|| self.candidates().find(|count| *count < room)).unwrap_or_else(|| self.largest())
    }

    pub fn note_disagreement(self, notes: &mut Vec<String>) {
        // Only that of old may be left at 0: points beyond its 32 bits, and the
        // formats from 6 on, have no place there.
        if let Some(large) = self.large
            && self.legacy > 0
            && large != self.legacy
        {
            notes.push(format!(
                "its header has two counts of points that differ: {} and {large}",
                self.legacy
            ));
        }
    }
}

/// Decides by the table above.
pub fn judge(evidence: &Evidence) -> ResolvedCounts {
    let Evidence { claims, room: there, torn, behind, header_is_exact } = *evidence;
    let said = claims.against(there);
    if said == there {
        return ResolvedCounts::Counted(said);
    }
    if said > there {
        return ResolvedCounts::TooFew { said, there };
    }
    let proven = !torn && !header_is_exact && claims.largest() <= there;
    match behind {
        Behind::Nothing | Behind::Padding | Behind::NoPoints => ResolvedCounts::Counted(said),
        Behind::Unclear if said > 0 && claims.by_return == said => ResolvedCounts::Counted(said),
        Behind::Points | Behind::Unclear if proven => ResolvedCounts::Proven { said, there },
        Behind::Points | Behind::Unclear => ResolvedCounts::Contradiction { said, there },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn evidence(counts: (u64, Option<u64>), room: u64, behind: Behind) -> Evidence {
        let claims = DeclaredCounts { legacy: counts.0, large: counts.1, by_return: 0 };
        Evidence { claims, room, torn: false, behind, header_is_exact: false }
    }

    #[test]
    fn a_count_that_fits_the_room_is_believed() {
        for counts in [(100, None), (0, Some(100)), (90, Some(100)), (100, Some(90)), (100, Some(1 << 40))] {
            for torn in [false, true] {
                let found = Evidence { torn, ..evidence(counts, 100, Behind::Nothing) };
                assert_eq!(judge(&found), ResolvedCounts::Counted(100), "{counts:?}");
            }
        }
    }

    #[test]
    fn too_few_bytes_for_every_count_are_told() {
        let found = evidence((101, None), 100, Behind::Nothing);
        assert_eq!(judge(&found), ResolvedCounts::TooFew { said: 101, there: 100 });
        let found = evidence((120, Some(110)), 100, Behind::Nothing);
        assert_eq!(judge(&found), ResolvedCounts::TooFew { said: 120, there: 100 });
    }

    #[test]
    fn what_is_no_point_ends_the_points() {
        for behind in [Behind::Padding, Behind::NoPoints] {
            for torn in [false, true] {
                for said in [0, 90] {
                    let found = Evidence { torn, ..evidence((said, None), 100, behind) };
                    assert_eq!(judge(&found), ResolvedCounts::Counted(said));
                }
            }
        }
    }

    #[test]
    fn points_behind_the_counted_ones_are_read_or_refused() {
        let whole = evidence((90, None), 100, Behind::Points);
        assert_eq!(judge(&whole), ResolvedCounts::Proven { said: 90, there: 100 });
        let contradiction = ResolvedCounts::Contradiction { said: 90, there: 100 };
        assert_eq!(judge(&Evidence { torn: true, ..whole }), contradiction);
        assert_eq!(judge(&Evidence { header_is_exact: true, ..whole }), contradiction);
        // Nobody knows which of two counts was meant.
        let two = evidence((90, Some(120)), 100, Behind::Points);
        assert_eq!(judge(&two), contradiction);
    }

    #[test]
    fn without_a_count_whole_records_are_read() {
        for behind in [Behind::Points, Behind::Unclear] {
            let whole = evidence((0, Some(0)), 100, behind);
            assert_eq!(judge(&whole), ResolvedCounts::Proven { said: 0, there: 100 });
            let torn = Evidence { torn: true, ..whole };
            assert_eq!(judge(&torn), ResolvedCounts::Contradiction { said: 0, there: 100 });
        }
    }

    #[test]
    fn where_bytes_tell_nothing_the_returns_do() {
        let mut found = evidence((90, None), 100, Behind::Unclear);
        assert_eq!(judge(&found), ResolvedCounts::Proven { said: 90, there: 100 });
        found.claims.by_return = 90;
        assert_eq!(judge(&found), ResolvedCounts::Counted(90));
    }

    fn any_evidence() -> impl Strategy<Value = Evidence> {
        use Behind::*;
        let behind = prop::sample::select(vec![Nothing, Padding, NoPoints, Points, Unclear]);
        let count = prop_oneof![Just(0), 0..200u64, Just(1 << 40)];
        let large = prop::option::of(count.clone());
        (count.clone(), large, count, 0..200u64, any::<bool>(), behind, any::<bool>()).prop_map(
            |(legacy, large, by_return, room, torn, behind, header_is_exact)| {
                let claims = DeclaredCounts { legacy, large, by_return };
                Evidence { claims, room, torn, behind, header_is_exact }
            },
        )
    }

    proptest! {
        #[test]
        fn a_verdict_keeps_its_laws(found in any_evidence()) {
            let verdict = judge(&found);
            let candidates: Vec<u64> = found.claims.candidates().collect();
            prop_assert!(verdict.there() <= found.room.max(found.claims.said()));
            match verdict {
                ResolvedCounts::Counted(points) => {
                    // Never more than there is room for, never a number that nobody said.
                    prop_assert!(points <= found.room);
                    prop_assert!(candidates.contains(&points) || candidates.is_empty() && points == 0);
                    // Nothing that is surely a point is passed over.
                    prop_assert!(points == found.room || found.behind != Behind::Points);
                }
                ResolvedCounts::Proven { said, there } => {
                    prop_assert!(said < there && there == found.room && !found.torn);
                    prop_assert!(matches!(found.behind, Behind::Points | Behind::Unclear));
                }
                ResolvedCounts::TooFew { said, there } => prop_assert!(said > there && there == found.room),
                ResolvedCounts::Contradiction { said, there } => {
                    prop_assert!(said < there && there == found.room);
                }
            }
        }
    }
}
