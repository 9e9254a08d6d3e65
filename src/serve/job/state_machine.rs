//! The state machine of a job: every state, every event, and in one table every
//! legal change. What is not in the table does not happen.
//!
//! ```text
//!             ┌──────── Postpone, Crash, Park ───────┐
//!             ▼                                      │
//!  (new) ─▶ queued ───────────── Claim ──────────▶ running ── Succeed ──▶ done
//!            │  ▲ ▲                                │ │ │ │                 │
//!      Pause │  │ └── Retry, Release ── failed ◀───┘ │ │ └─ Quarantine ─┐  │ Retry
//!            ▼  │ Resume                  (Fail)     │ │                ▼  ▼
//!          paused ◀───────────── Pause ──────────────┘ │        quarantined (queued)
//!            │                                         │
//!            └── Cancel ──▶ cancelled ◀── Cancel ──────┘
//! ```

use serde::{Deserialize, Serialize};

/// Where a job stands. The names are what scripts and dashboards rely on.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Waits for its turn.
    Queued,
    /// A worker has it.
    Running,
    /// Waits until an operator resumes it.
    Paused,
    /// Its octree is published.
    Done,
    /// Ended with an error that trying again does not help, or not any more.
    Failed,
    /// Struck three times: it is not touched until its source changes or an
    /// operator says so.
    Quarantined,
    /// An operator, or a newer content of the same source, called it off.
    Cancelled,
}

impl State {
    pub const ALL: [State; 7] = [
        State::Queued,
        State::Running,
        State::Paused,
        State::Done,
        State::Failed,
        State::Quarantined,
        State::Cancelled,
    ];

    pub fn name(self) -> &'static str {
        match self {
            State::Queued => "queued",
            State::Running => "running",
            State::Paused => "paused",
            State::Done => "done",
            State::Failed => "failed",
            State::Quarantined => "quarantined",
            State::Cancelled => "cancelled",
        }
    }

    pub fn parse(name: &str) -> Option<State> {
        State::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Whether the job still has work before it.
    pub fn is_open(self) -> bool {
        matches!(self, State::Queued | State::Running | State::Paused)
    }
}

/// What can happen to a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Event {
    /// A worker takes it; the attempt is counted with this.
    Claim,
    /// Its octree is published.
    Succeed,
    /// It cannot succeed as it is.
    Fail,
    /// It could not succeed now, but may later.
    Postpone,
    /// The daemon died under it.
    Crash,
    /// It struck too often.
    Quarantine,
    /// The daemon shuts down; the attempt does not count.
    Park,
    Cancel,
    Pause,
    Resume,
    /// An operator orders another try.
    Retry,
    /// Its source was written again: a new chance.
    Release,
}

impl Event {
    pub const ALL: [Event; 12] = [
        Event::Claim,
        Event::Succeed,
        Event::Fail,
        Event::Postpone,
        Event::Crash,
        Event::Quarantine,
        Event::Park,
        Event::Cancel,
        Event::Pause,
        Event::Resume,
        Event::Retry,
        Event::Release,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Event::Claim => "claim",
            Event::Succeed => "succeed",
            Event::Fail => "fail",
            Event::Postpone => "postpone",
            Event::Crash => "crash",
            Event::Quarantine => "quarantine",
            Event::Park => "park",
            Event::Cancel => "cancel",
            Event::Pause => "pause",
            Event::Resume => "resume",
            Event::Retry => "retry",
            Event::Release => "release",
        }
    }
}

/// Every legal change of state.
pub const TABLE: &[(State, Event, State)] = &[
    (State::Queued, Event::Claim, State::Running),
    (State::Queued, Event::Pause, State::Paused),
    (State::Queued, Event::Cancel, State::Cancelled),
    (State::Running, Event::Succeed, State::Done),
    (State::Running, Event::Fail, State::Failed),
    (State::Running, Event::Postpone, State::Queued),
    (State::Running, Event::Crash, State::Queued),
    (State::Running, Event::Quarantine, State::Quarantined),
    (State::Running, Event::Park, State::Queued),
    (State::Running, Event::Pause, State::Paused),
    (State::Running, Event::Cancel, State::Cancelled),
    (State::Paused, Event::Resume, State::Queued),
    (State::Paused, Event::Cancel, State::Cancelled),
    (State::Failed, Event::Retry, State::Queued),
    (State::Failed, Event::Release, State::Queued),
    (State::Quarantined, Event::Retry, State::Queued),
    (State::Quarantined, Event::Release, State::Queued),
    (State::Cancelled, Event::Retry, State::Queued),
    (State::Cancelled, Event::Release, State::Queued),
    // The octree was lost or spoiled, and someone wants it made anew.
    (State::Done, Event::Retry, State::Queued),
];

/// The state after `event`, or nothing where the event is not legal in `state`.
pub fn next(state: State, event: Event) -> Option<State> {
    TABLE.iter().find(|(from, on, _)| *from == state && *on == event).map(|(_, _, to)| *to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn an_event_leads_from_a_state_to_one_state_only() {
        let mut seen = HashSet::new();
        for (from, event, _) in TABLE {
            assert!(seen.insert((from, event)), "{from:?} on {event:?} stands twice");
        }
    }

    #[test]
    fn only_a_claim_starts_a_run_and_only_from_the_queue() {
        for (from, event, to) in TABLE {
            assert_eq!(*to == State::Running, *event == Event::Claim);
            if *event == Event::Claim {
                assert_eq!(*from, State::Queued);
            }
        }
    }

    #[test]
    fn only_a_run_can_succeed_fail_or_strike() {
        for (from, event, _) in TABLE {
            if matches!(
                event,
                Event::Succeed
                    | Event::Fail
                    | Event::Postpone
                    | Event::Crash
                    | Event::Quarantine
                    | Event::Park
            ) {
                assert_eq!(*from, State::Running, "{event:?}");
            }
        }
    }

    #[test]
    fn no_state_is_a_dead_end_for_the_operator() {
        // From everywhere an operator (Retry, Resume, Cancel) and the engine
        // (Claim, Succeed) together can still bring the job to done.
        for start in State::ALL {
            let mut reached = HashSet::from([start]);
            let mut open = vec![start];
            while let Some(state) = open.pop() {
                for event in [Event::Claim, Event::Succeed, Event::Resume, Event::Retry, Event::Cancel] {
                    if let Some(to) = next(state, event)
                        && reached.insert(to)
                    {
                        open.push(to);
                    }
                }
            }
            assert!(reached.contains(&State::Done), "{start:?} never gets done");
        }
    }

    #[test]
    fn names_parse_back() {
        for state in State::ALL {
            assert_eq!(State::parse(state.name()), Some(state));
        }
    }
}
