//! A run that stands still is stopped, and given up where it does not stop. Only
//! standing still counts: a job that moves may run for a month.

use super::engine::{Engine, RunningJob};
use super::standstill::reason;
use super::stop::{StopReason, wish_end};
use crate::platform::clock::Millis;
use crate::serve::job::Job;
use crate::serve::job::retry_policy::AttemptEnd;
use crate::serve::queue::{AttemptResult, Result};

/// Why a job waits whose old run has not ended: two runs would write into the
/// same folders.
const HANGS: &str =
    "an earlier run of it hangs and has not ended; it goes on when that ends, or after a restart";
/// Why a job waits while the older content of its data set is still converted.
const STOPPING: &str = "the run of its source's other content has not ended yet; it starts when that has";
/// How long it waits for that where there is no limit to standing still.
const LONGEST_STOP: Millis = 30 * 60_000;
/// How long a stopped run has to end, in milliseconds.
const GRACE: Millis = 60_000;

impl Engine {
    /// The run that a job waits for, in words. One that was told to stop and does
    /// not is waited for until it would be given up: the two have folders of their
    /// own, and the old one's result no longer counts.
    pub(super) fn waits_for_a_run(&self, job: &Job) -> Option<&'static str> {
        if self.abandoned.contains(&job.id) {
            return Some(HANGS);
        }
        let limit = self.tools.config.stall.unwrap_or(LONGEST_STOP).max(GRACE);
        let counts = |run: &RunningJob| run.stop.is_none() || run.pulse.stopping < limit;
        self.running.values().any(|run| run.job.source == job.source && counts(run)).then_some(STOPPING)
    }

    /// Part of step 3.
    pub(super) async fn give_up_the_dead(&mut self) -> Result<()> {
        let Some(stall) = self.tools.config.stall else { return Ok(()) };
        let mut dead = Vec::new();
        for (job, running) in &mut self.running {
            let still = running.pulse.still >= stall;
            match running.stop {
                None if still => {
                    tracing::error!(job, name = running.job.name, "{}; stopping it", reason(stall));
                    self.tools.metrics.jobs_stalled.inc();
                    running.stop = Some(StopReason::Stalled);
                    running.pulse.stop();
                    running.cancel.cancel();
                }
                // An operator may have called it off meanwhile, or seen it first.
                Some(StopReason::Stalled) if running.pulse.stopping >= GRACE => {
                    dead.push((*job, AttemptResult { end: AttemptEnd::Crashed, error: Some(reason(stall)) }));
                }
                Some(StopReason::Wish(wish)) if still && running.pulse.stopping >= GRACE => {
                    dead.push((*job, AttemptResult { end: wish_end(wish), error: None }));
                }
                _ => {}
            }
        }
        for (job, ending) in dead {
            // Its end may have come in this moment, and wait to be recorded.
            if self.unrecorded.iter().any(|finished| finished.job == job) {
                continue;
            }
            let (now, policy) = (self.tools.clock.now(), &self.tools.config.policy);
            self.tools.store.finish(job, &self.owner, &ending, policy, now).await?;
            tracing::error!(job, "did not stop within a minute; given up");
            self.running.remove(&job);
            self.abandoned.insert(job);
            self.tools.board.take_down(job);
        }
        Ok(())
    }
}
