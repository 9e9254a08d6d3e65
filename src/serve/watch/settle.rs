//! Is this data set quiet and whole? Pure: sights and the time come in, a
//! decision goes out.
//!
//! A data set is taken when its stamp (names, sizes and times of its files) has
//! not changed for the settle time, was seen the same at least twice, nobody
//! writes, and its files are whole by their own headers. A marker file that came
//! after all others takes the place of the settle time. What is quiet but not whole
//! gets patience: a copy may pause for long. After that it is taken as it is, with
//! the doubt noted: what is in doubt is never put away, for its writer may go on.

use super::waiting::WaitingKind;
use crate::platform::clock::Millis;

/// The times that decide, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    pub settle: Millis,
    /// Counted from the last change.
    pub patience: Millis,
}

/// What is remembered of a data set between scans.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    stamp: String,
    /// When this stamp was first seen.
    since: Millis,
    /// How often in a row.
    times: u32,
    last: Millis,
    /// The judgement of its files; forgotten when the stamp changes.
    pub whole: Option<Completeness>,
}

/// What the files say about themselves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Completeness {
    Whole {
        points: u64,
    },
    /// More may come.
    NotYet(NotYet),
    /// No further bytes can make it whole.
    Never(String),
    /// Nobody can say, for we may not read it; that may change without any
    /// change of the file.
    Unreadable(String),
}

/// Why a data set is not whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotYet {
    pub kind: WaitingKind,
    pub why: String,
    /// Bytes that are there, and that it is to have where its headers tell.
    pub progress: Option<(u64, Option<u64>)>,
}

impl NotYet {
    pub fn new(kind: WaitingKind, why: impl Into<String>) -> NotYet {
        NotYet { kind, why: why.into(), progress: None }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decision {
    Take {
        points: u64,
        /// Why it is not as it should be, and must not be put away.
        doubt: Option<String>,
    },
    Wait(NotYet),
}

impl Observation {
    pub fn new(stamp: &str, now: Millis) -> Observation {
        Observation { stamp: stamp.to_string(), since: now, times: 0, last: now, whole: None }
    }

    /// Notes one more look.
    pub fn see(&mut self, stamp: &str, now: Millis) {
        // A clock that was set back would make it quiet for ever, or never.
        if self.stamp != stamp || now < self.last {
            *self = Observation::new(stamp, now);
        }
        self.times += 1;
        self.last = now;
    }

    /// Whether it is this that was seen last.
    pub fn is(&self, stamp: &str) -> bool {
        self.stamp == stamp
    }

    /// Since when it is as it is.
    pub fn since(&self) -> Millis {
        self.since
    }

    fn quiet_for(&self, now: Millis) -> Millis {
        now - self.since
    }
}

/// Whether nothing changed for long enough; otherwise why it waits.
pub fn is_quiet(sight: &Observation, closed: bool, now: Millis, limits: &Limits) -> Result<(), String> {
    if closed {
        return Ok(());
    }
    // Twice: a clock that jumps ahead between two scans must not pass for quiet.
    if sight.times < 2 || sight.quiet_for(now) < limits.settle {
        return Err(format!(
            "changed {} s ago; taken when quiet for {} s",
            seconds(sight.quiet_for(now)),
            seconds(limits.settle)
        ));
    }
    Ok(())
}

/// Whether a quiet data set is taken.
pub fn decide(
    sight: &Observation,
    whole: &Completeness,
    writer: bool,
    now: Millis,
    limits: &Limits,
) -> Decision {
    match whole {
        _ if writer => {
            Decision::Wait(NotYet::new(WaitingKind::Writing, "a program holds it open for writing"))
        }
        Completeness::Whole { points } => Decision::Take { points: *points, doubt: None },
        Completeness::Never(why) => Decision::Take { points: 0, doubt: Some(why.clone()) },
        Completeness::Unreadable(why) => Decision::Wait(NotYet::new(WaitingKind::Unreadable, why.clone())),
        Completeness::NotYet(not_yet)
            if sight.times >= 2 && sight.quiet_for(now) >= limits.patience.max(limits.settle) =>
        {
            Decision::Take { points: 0, doubt: Some(not_yet.why.clone()) }
        }
        Completeness::NotYet(not_yet) => {
            let left = limits.patience.max(limits.settle) - sight.quiet_for(now);
            let why = match not_yet.kind {
                WaitingKind::Marker => format!("{}; it is waited for {} s more", not_yet.why, seconds(left)),
                _ => format!("not whole yet: {}", not_yet.why),
            };
            Decision::Wait(NotYet { why, ..not_yet.clone() })
        }
    }
}

fn seconds(millis: Millis) -> String {
    format!("{:.1}", millis as f64 / 1000.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: Limits = Limits { settle: 5_000, patience: 60_000 };
    const WHOLE: Completeness = Completeness::Whole { points: 7 };

    fn taken(sight: &Observation, whole: &Completeness, writer: bool, marker: bool, now: Millis) -> bool {
        is_quiet(sight, marker, now, &LIMITS).is_ok()
            && matches!(decide(sight, whole, writer, now, &LIMITS), Decision::Take { .. })
    }

    fn seen(times: &[Millis]) -> Observation {
        let mut sight = Observation::new("a", times[0]);
        for now in times {
            sight.see("a", *now);
        }
        sight
    }

    fn cut() -> Completeness {
        Completeness::NotYet(NotYet::new(WaitingKind::Incomplete, "cut"))
    }

    #[test]
    fn one_look_is_never_enough_whatever_the_clock_says() {
        let mut sight = seen(&[0]);
        assert!(!taken(&sight, &WHOLE, false, false, 1_000_000_000));
        sight.see("a", 1_000_000_000);
        assert!(taken(&sight, &WHOLE, false, false, 1_000_000_000));
    }

    #[test]
    fn a_clock_set_back_starts_the_wait_again() {
        let mut sight = seen(&[100_000, 104_000]);
        sight.see("a", 50_000);
        sight.see("a", 54_000);
        assert!(!taken(&sight, &WHOLE, false, false, 54_000));
        sight.see("a", 55_000);
        assert!(taken(&sight, &WHOLE, false, false, 55_000));
    }

    #[test]
    fn a_marker_takes_the_place_of_the_wait_but_not_of_wholeness() {
        let sight = seen(&[0]);
        assert!(taken(&sight, &WHOLE, false, true, 0));
        assert!(!taken(&sight, &cut(), false, true, 0));
        assert!(!taken(&sight, &WHOLE, true, true, 0));
    }

    #[test]
    fn what_never_gets_whole_is_taken_at_once_and_what_may_get_patience() {
        let sight = seen(&[0, 5_000]);
        assert!(taken(&sight, &Completeness::Never("no LAS".into()), false, false, 5_000));
        let cut = cut();
        assert!(!taken(&sight, &cut, false, false, 59_999));
        let Decision::Take { doubt, .. } = decide(&sight, &cut, false, 60_000, &LIMITS) else {
            panic!("it waits")
        };
        assert!(doubt.is_some(), "and is never put away");
    }

    proptest! {
        /// A copy that writes with pauses shorter than the patience is never
        /// taken before it is whole, and always within the settle time and two
        /// looks after that.
        #[test]
        fn a_slow_copy_is_taken_whole_and_only_then(
            pauses in prop::collection::vec(0i64..59_000, 1..20),
            step in 100i64..4_000,
        ) {
            let ends: Vec<i64> = pauses.iter().scan(0, |at, pause| { *at += pause; Some(*at) }).collect();
            let end = *ends.last().expect("one");
            let mut sight: Option<Observation> = None;
            let mut now = 0;
            loop {
                let stamp = ends.iter().filter(|at| **at <= now).count().to_string();
                let whole = now >= end;
                let sight = sight.get_or_insert_with(|| Observation::new(&stamp, now));
                sight.see(&stamp, now);
                let judged = if whole { WHOLE } else { cut() };
                if taken(sight, &judged, false, false, now) {
                    prop_assert!(whole, "taken at {} before the end at {}", now, end);
                    prop_assert!(now <= end + LIMITS.settle + 2 * step);
                    break;
                }
                now += step;
            }
        }
    }
}
