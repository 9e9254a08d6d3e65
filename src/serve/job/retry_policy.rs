//! What follows from the way an attempt ended: the event, the new counts, and
//! how long to wait. Pure, so that thousands of histories can be tried.
//!
//! A *strike* is a crash (of the daemon under the job, or a panic of the worker)
//! or a failure that trying again cannot help. Three strikes send a job to
//! quarantine: a poison input must not take the daemon down for ever. A failure
//! that may pass (no room, an I/O error) is no strike: the job waits, longer each
//! time, and gives up only after many tries. Nor is a crash of the daemon under a
//! job that has got on since the crash before: an hours-long job on a shaky
//! machine is not poison. Nor is one of several jobs under which the daemon died at
//! once: they run alone from then on, and only who did so is blamed.

use super::Event;

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttemptEnd {
    Published,
    /// An error that trying again cannot help.
    Hopeless,
    /// An error that may pass by itself.
    Passing,
    /// The worker panicked; the daemon lives.
    Panicked,
    /// The daemon died under the job.
    Crashed,
    /// The daemon died under the job, which had got on since the last time.
    Interrupted,
    /// The daemon died while it was at several things, of which this is one.
    Suspected,
    /// The daemon shuts down in good order.
    Parked,
    Cancelled,
    Paused,
}

/// What is counted of a job's past.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FailureCounts {
    pub attempts: u32,
    pub strikes: u32,
    pub postponements: u32,
}

/// Limits and waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// With this many strikes a job is quarantined.
    pub max_strikes: u32,
    /// After this many failures that may pass, a job has failed.
    pub max_postponements: u32,
    /// The wait after the first failure that may pass, in milliseconds; it
    /// doubles with each up to `longest_wait`.
    pub first_wait: i64,
    pub longest_wait: i64,
}

impl Default for Policy {
    fn default() -> Policy {
        Policy { max_strikes: 3, max_postponements: 20, first_wait: 5_000, longest_wait: 600_000 }
    }
}

/// What is to be done with the job now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RetryDecision {
    pub event: Event,
    pub tally: FailureCounts,
    /// Milliseconds to wait before the next attempt, where there is one.
    pub wait: i64,
}

/// Judges an attempt. `tally` already counts the attempt itself.
pub fn judge(end: AttemptEnd, tally: FailureCounts, policy: &Policy) -> RetryDecision {
    let at_once = |event, tally| RetryDecision { event, tally, wait: 0 };
    match end {
        AttemptEnd::Published => {
            at_once(Event::Succeed, FailureCounts { postponements: 0, strikes: 0, ..tally })
        }
        AttemptEnd::Cancelled => at_once(Event::Cancel, tally),
        AttemptEnd::Paused => at_once(Event::Pause, tally),
        // The attempt was counted before the run and is taken back: an orderly
        // stop says nothing about the job.
        AttemptEnd::Parked => {
            at_once(Event::Park, FailureCounts { attempts: tally.attempts.saturating_sub(1), ..tally })
        }
        AttemptEnd::Hopeless | AttemptEnd::Panicked => strike(tally, policy, Event::Fail, 0),
        AttemptEnd::Crashed => strike(tally, policy, Event::Crash, policy.first_wait),
        // Whatever kills the daemon, it is not the same piece of this job. Units
        // are finite, so this ends.
        AttemptEnd::Interrupted => at_once(Event::Crash, FailureCounts { strikes: 0, ..tally }),
        // Who of them did it shows when each runs alone.
        AttemptEnd::Suspected => at_once(Event::Crash, tally),
        AttemptEnd::Passing => {
            let tally = FailureCounts { postponements: tally.postponements + 1, ..tally };
            if tally.postponements >= policy.max_postponements {
                return at_once(Event::Fail, tally);
            }
            RetryDecision { event: Event::Postpone, tally, wait: wait_after(tally.postponements, policy) }
        }
    }
}

fn strike(tally: FailureCounts, policy: &Policy, otherwise: Event, wait: i64) -> RetryDecision {
    let tally = FailureCounts { strikes: tally.strikes + 1, ..tally };
    if tally.strikes >= policy.max_strikes {
        return RetryDecision { event: Event::Quarantine, tally, wait: 0 };
    }
    RetryDecision { event: otherwise, tally, wait }
}

/// How long to wait after so many failures, in milliseconds.
pub fn wait_after(postponements: u32, policy: &Policy) -> i64 {
    let doublings = postponements.saturating_sub(1).min(30);
    policy.first_wait.saturating_mul(1 << doublings).min(policy.longest_wait)
}

/// The counts after an order or a change of the source put the job back into
/// the queue. A changed source is a clean slate. An order alone keeps the
/// strikes of a failed job, so that retrying poison by hand ends in quarantine
/// as well; lifting the quarantine itself clears them.
pub fn forgive(event: Event, was_quarantined: bool, tally: FailureCounts) -> FailureCounts {
    let strikes = if event == Event::Release || was_quarantined { 0 } else { tally.strikes };
    FailureCounts { strikes, postponements: 0, ..tally }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::job::state_machine::{State, next};
    use proptest::prelude::*;

    const ENDS: [AttemptEnd; 10] = [
        AttemptEnd::Published,
        AttemptEnd::Hopeless,
        AttemptEnd::Passing,
        AttemptEnd::Panicked,
        AttemptEnd::Crashed,
        AttemptEnd::Interrupted,
        AttemptEnd::Suspected,
        AttemptEnd::Parked,
        AttemptEnd::Cancelled,
        AttemptEnd::Paused,
    ];

    fn any_end() -> impl Strategy<Value = AttemptEnd> {
        proptest::sample::select(ENDS.to_vec())
    }

    proptest! {
        #[test]
        fn every_verdict_on_a_run_is_legal(end in any_end(), attempts in 1u32..9, strikes in 0u32..9, postponements in 0u32..30) {
            let verdict = judge(end, FailureCounts { attempts, strikes, postponements }, &Policy::default());
            prop_assert!(next(State::Running, verdict.event).is_some());
            prop_assert!(verdict.wait >= 0 && verdict.wait <= Policy::default().longest_wait);
        }

        /// However a job's life goes, poison runs at most three times in a row before
        /// someone has to decide anew.
        #[test]
        fn poison_runs_at_most_three_times(ends in prop::collection::vec(any_end(), 1..60)) {
            let policy = Policy::default();
            let (mut state, mut tally) = (State::Queued, FailureCounts::default());
            let mut struck = 0;
            for end in ends {
                if state != State::Queued { break }
                tally.attempts += 1;
                match end {
                    AttemptEnd::Crashed | AttemptEnd::Panicked | AttemptEnd::Hopeless => struck += 1,
                    AttemptEnd::Interrupted => struck = 0,
                    _ => {}
                }
                let verdict = judge(end, tally, &policy);
                tally = verdict.tally;
                state = next(State::Running, verdict.event).expect("a legal verdict");
            }
            prop_assert!(struck <= policy.max_strikes);
            prop_assert_eq!(state == State::Quarantined, tally.strikes >= policy.max_strikes);
        }

        #[test]
        fn parking_costs_nothing(attempts in 0u32..9, strikes in 0u32..3, postponements in 0u32..9) {
            let before = FailureCounts { attempts, strikes, postponements };
            let claimed = FailureCounts { attempts: attempts + 1, ..before };
            prop_assert_eq!(judge(AttemptEnd::Parked, claimed, &Policy::default()).tally, before);
        }
    }

    #[test]
    fn waits_double_up_to_the_longest() {
        let policy = Policy::default();
        let mut tally = FailureCounts::default();
        let mut waits = vec![];
        for _ in 0..10 {
            let verdict = judge(AttemptEnd::Passing, tally, &policy);
            tally = verdict.tally;
            waits.push(verdict.wait / 1000);
        }
        assert_eq!(waits, [5, 10, 20, 40, 80, 160, 320, 600, 600, 600]);
    }

    #[test]
    fn who_was_not_alone_is_not_blamed() {
        let before = FailureCounts { attempts: 4, strikes: 2, postponements: 1 };
        let verdict = judge(AttemptEnd::Suspected, before, &Policy::default());
        assert_eq!((verdict.event, verdict.tally), (Event::Crash, before));
    }

    #[test]
    fn retrying_poison_by_hand_ends_in_quarantine_until_the_source_changes() {
        let policy = Policy::default();
        let mut tally = FailureCounts::default();
        for event in [Event::Fail, Event::Fail, Event::Quarantine] {
            let verdict = judge(AttemptEnd::Hopeless, forgive(Event::Retry, false, tally), &policy);
            assert_eq!(verdict.event, event);
            tally = verdict.tally;
        }
        assert_eq!(forgive(Event::Release, true, tally).strikes, 0);
    }
}
