//! How long a run has stood still.

use crate::platform::clock::Millis;

/// What one look may add at most: a machine that slept for the night, or a clock
/// that was set ahead, does not make a job stand still.
const LONGEST_LOOK: Millis = 10_000;

/// How long a run has stood still, as far as we have looked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StallTimer {
    moved_at: Millis,
    looked_at: Millis,
    pub still: Millis,
    /// How much of that was after it was told to stop.
    pub stopping: Millis,
}

impl StallTimer {
    pub fn new(now: Millis) -> StallTimer {
        StallTimer { moved_at: now, looked_at: now, still: 0, stopping: 0 }
    }

    /// Notes one look at a run whose progress last moved at `moved_at`.
    pub fn feel(&mut self, moved_at: Millis, now: Millis) {
        // Backwards is no time at all.
        let passed = (now - self.looked_at).clamp(0, LONGEST_LOOK);
        self.looked_at = now;
        if moved_at == self.moved_at {
            self.still += passed;
        } else {
            (self.moved_at, self.still) = (moved_at, 0);
        }
        self.stopping += passed;
    }

    /// Notes that the run was told to stop.
    pub fn stop(&mut self) {
        self.stopping = 0;
    }
}

/// What the operator is told.
pub(super) fn reason(stall: Millis) -> String {
    let seconds = stall / 1000;
    match seconds {
        0..120 => format!("made no progress for {seconds} s"),
        _ => format!("made no progress for {} min", seconds / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_standing_still_counts_and_no_jump_of_the_clock() {
        let mut pulse = StallTimer::new(0);
        for now in 1..=100 {
            pulse.feel(now * 1000, now * 1000);
        }
        assert_eq!(pulse.still, 0, "it moved all the time");
        pulse.feel(100_000, 101_000);
        assert_eq!(pulse.still, 1000);
        pulse.feel(100_000, 90_000_000);
        assert_eq!(pulse.still, 1000 + LONGEST_LOOK, "a night is one look");
        pulse.feel(100_000, 5_000);
        pulse.feel(100_000, 6_000);
        assert_eq!(pulse.still, 2000 + LONGEST_LOOK, "set back, it goes on from there");
        pulse.feel(6_500, 7_000);
        assert_eq!(pulse.still, 0);
    }
}
