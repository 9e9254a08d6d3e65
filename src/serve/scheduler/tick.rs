//! What the engine does at every tick, as numbered steps, and how it begins and stops.

use std::time::Duration;

use super::engine::{Engine, TickSummary};
use super::folders::scratch_of;
use super::stop::{StopReason, wish_end};
use super::{cleanup, publish};
use crate::convert::checkpoint::scratch::units_done;
use crate::platform::clock::Millis;
use crate::serve::job::Job;
use crate::serve::job::retry_policy::AttemptEnd;
use crate::serve::queue::{AttemptResult, QueueMode, Recovered, Result};

/// How often a running job's progress is noted in the queue, in milliseconds.
const HEARTBEAT: Millis = 10_000;

/// How often scratch is swept though no run ended, in milliseconds: a job that is
/// called off while it waits leaves what its last run left.
const SWEEP: Millis = 60_000;

impl Engine {
    /// Sets right what an earlier run left behind when it died. To be called
    /// once, under the lock of the state folder, before the first tick.
    pub async fn recover(&mut self) -> Result<()> {
        let now = self.tools.clock.now();
        let config = self.tools.config.clone();
        let units = |job| units_done(&scratch_of(&config, job));
        for found in self.tools.store.recover(&self.owner, &config.policy, now, units).await? {
            match found {
                Recovered::Judged(job, event) => {
                    tracing::warn!(job, event = event.name(), "was running when the daemon died");
                }
                Recovered::Staged(job) => self.recover_staged(*job).await?,
            }
        }
        self.sweep().await
    }

    /// Its octree was converted: it is published now, not converted again.
    async fn recover_staged(&mut self, job: Job) -> Result<()> {
        let id = job.id;
        let end = match publish::publish(&self.tools, &job, job.staged.unwrap_or(0)).await {
            Ok(()) => AttemptResult { end: AttemptEnd::Published, error: None },
            Err(failure) => {
                let end = if failure.may_pass { AttemptEnd::Passing } else { AttemptEnd::Crashed };
                AttemptResult { end, error: Some(failure.message) }
            }
        };
        tracing::info!(job = id, name = job.name, "was converted before the daemon died; publishing it");
        self.tools
            .store
            .finish(id, &self.owner, &end, &self.tools.config.policy, self.tools.clock.now())
            .await?;
        Ok(())
    }

    /// One tick.
    ///
    /// 1. Record the runs that ended: stage, publish, finish.
    /// 2. Pass on what operators wish of running jobs, or of all.
    /// 3. Look at the progress of running jobs; note it as a heartbeat. Stop what
    ///    stands still, and give up what does not stop.
    /// 4. Start what fits into the free lanes; say of the rest why it waits.
    /// 5. See to what follows from ends: sources, hooks, pictures.
    ///
    /// An error means that the queue did not answer; nothing is lost by it, and
    /// the next tick goes on.
    pub async fn tick(&mut self) -> Result<TickSummary> {
        let ended = self.record_ended().await?;
        self.pass_on_wishes().await?;
        let mode = self.tools.store.mode().await?;
        if mode == QueueMode::Pause {
            self.return_to_queue();
        }
        self.look_at_progress().await?;
        self.give_up_the_dead().await?;
        let starts = mode == QueueMode::Run && !self.stopping;
        let (started, held) = if starts { self.start_ready().await? } else { (0, 0) };
        self.aftermath.turn(&self.tools, self.room(), self.stopping, mode).await?;
        let now = self.tools.clock.now();
        let due = self.tools.store.next_start(now).await?;
        Ok(TickSummary { ended, started, held, running: self.running.len(), due })
    }

    /// Step 1.
    async fn record_ended(&mut self) -> Result<usize> {
        while let Ok(finished) = self.results.try_recv() {
            if self.abandoned.remove(&finished.job) {
                tracing::warn!(
                    job = finished.job,
                    "a run that was given up has ended; its result is thrown away"
                );
                continue;
            }
            self.unrecorded.push_back(finished);
        }
        let mut ended = 0;
        while let Some(finished) = self.unrecorded.front() {
            let job = finished.job;
            self.record(&finished.clone()).await?;
            self.unrecorded.pop_front();
            self.running.remove(&job);
            self.tools.board.take_down(job);
            ended += 1;
        }
        if ended > 0 || (self.tools.clock.now() - self.swept_at).abs() >= SWEEP {
            self.sweep().await?;
        }
        Ok(ended)
    }

    /// Step 3.
    async fn look_at_progress(&mut self) -> Result<()> {
        let now = self.tools.clock.now();
        for look in self.tools.board.look(now) {
            let Some(running) = self.running.get_mut(&look.job) else { continue };
            running.pulse.feel(look.moved_at, now);
            // Not `>`: a clock that was set back would silence a job that moves.
            if look.moved_at != running.beat_at {
                self.tools.metrics.last_progress_timestamp.set(look.moved_at as f64 / 1000.0);
                if (now - running.beat_at).abs() >= HEARTBEAT {
                    running.beat_at = look.moved_at;
                    self.tools.store.heartbeat(look.job, &self.owner, now).await?;
                }
            }
        }
        Ok(())
    }

    /// Clears what jobs without work before them left in scratch and staging.
    async fn sweep(&mut self) -> Result<()> {
        self.swept_at = self.tools.clock.now();
        // Thousands of small jobs leave nothing behind; they need not all be read
        // after each.
        if cleanup::present(&self.tools.config).iter().all(|job| self.running.contains_key(job)) {
            return Ok(());
        }
        let open = self.tools.store.open_jobs().await?;
        let (config, disk) = (self.tools.config.clone(), self.tools.disk.clone());
        let swept = tokio::task::spawn_blocking(move || cleanup::sweep(&config, &disk, &open)).await;
        if let Err(error) = swept {
            tracing::error!(%error, "the janitor stumbled");
        }
        Ok(())
    }

    /// Stops in good order: nothing new is started, what runs is asked to stop
    /// and parked. What has not stopped within the bound is parked all the same
    /// and abandoned: its lease is gone, so nothing it still does counts.
    pub async fn stop(&mut self) {
        self.stopping = true;
        for running in self.running.values_mut() {
            running.stop.get_or_insert(StopReason::Shutdown);
            running.cancel.cancel();
        }
        let end = self.tools.clock.now() + self.tools.config.shutdown;
        while !self.running.is_empty() && self.tools.clock.now() < end {
            if let Err(error) = self.tick().await {
                tracing::error!(%error, "while stopping");
            }
            let _ = tokio::time::timeout(Duration::from_millis(50), self.tools.bell.notified()).await;
        }
        for (job, running) in std::mem::take(&mut self.running) {
            let end = match running.stop {
                Some(StopReason::Wish(wish)) => wish_end(wish),
                _ => AttemptEnd::Parked,
            };
            let ending = AttemptResult { end, error: None };
            let now = self.tools.clock.now();
            let policy = &self.tools.config.policy;
            match self.tools.store.finish(job, &self.owner, &ending, policy, now).await {
                Ok(_) => tracing::warn!(job, "did not stop in time; parked and abandoned"),
                Err(error) => {
                    tracing::error!(job, %error, "could not be parked; the next start will see a crash")
                }
            }
        }
        self.aftermath.stop(&self.tools, end).await;
    }
}
