//! What follows from a job's end, beside the engine's wheel and never in its way:
//! its sources are put away, its hook is told, pictures are made of its octree, it is verified where that was
//! ordered, and
//! long after its record goes. The debts stand in the queue ([`crate::serve::queue`]);
//! what is only known here may be forgotten by a crash.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use tokio::task::{JoinHandle, JoinSet};

use super::hook::{self, HookEnd};
use super::preview::{PreviewCapacity, Previews};
use super::sources::{self, NotMoved, SourceActionOutcome, SourceActionPlan};
use super::tools::EngineContext;
use super::verification::Verifications;
use super::virtual_cloud::VirtualCloud;
use crate::convert::context::Cancel;
use crate::platform::clock::Millis;
use crate::serve::job::{JobId, State};
use crate::serve::queue::{PendingHook, QueueMode, Result};

/// Hooks that run at the same time.
const HOOKS: usize = 4;
/// Debts that are looked at in one turn.
const BATCH: i64 = 100;
/// The pause after sources could not be put away for now, in milliseconds.
const AGAIN: Millis = 60_000;
/// How often ends that no hook is to be told of are cleared; all in one go,
/// for every write is a sync of the disk.
const CLEARING: Millis = 10_000;

/// How often old records are looked for.
const PURGING: Millis = 3_600_000;

struct Carrying {
    job: JobId,
    /// Whether an earlier try may have put some of it away.
    begun: bool,
    done: JoinHandle<std::result::Result<SourceActionOutcome, NotMoved>>,
}

#[derive(Default)]
pub(super) struct FollowUps {
    /// The one data set whose sources are being put away.
    carrying: Option<Carrying>,
    cancel: Cancel,
    /// Sources that could not be put away for now, and when to try again.
    later: HashMap<JobId, Millis>,
    hooks: JoinSet<(JobId, State, HookEnd, String)>,
    telling: HashSet<JobId>,
    cleared_at: Millis,
    purging: Option<JoinHandle<()>>,
    purged_at: Millis,
    previews: Previews,
    verifications: Verifications,
    virtual_cloud: VirtualCloud,
}

impl FollowUps {
    /// Whether pictures are drawn, and whether by suspects.
    pub fn draws(&self) -> (bool, bool) {
        (self.previews.are_at_work(), self.previews.are_suspect())
    }

    /// Takes note of what has ended and starts what is owed.
    pub async fn turn(
        &mut self,
        tools: &EngineContext,
        room: PreviewCapacity,
        stopping: bool,
        mode: QueueMode,
    ) -> Result<()> {
        let now = tools.clock.now();
        self.carried(tools, now).await?;
        while let Some(told) = self.hooks.try_join_next() {
            self.told(tools, told, now).await?;
        }
        let resting = stopping || mode == QueueMode::Pause;
        self.previews.turn(tools, if resting { PreviewCapacity::None } else { room }).await?;
        // Nothing runs beside a suspect.
        self.verifications.turn(tools, resting || room == PreviewCapacity::None).await?;
        self.virtual_cloud.turn(tools, stopping).await;
        if stopping {
            return Ok(());
        }
        self.start_carrying(tools, now).await?;
        self.start_hooks(tools, now).await?;
        self.start_purge(tools, now);
        Ok(())
    }

    /// Removes the records of what ended long ago, now and then.
    fn start_purge(&mut self, tools: &EngineContext, now: Millis) {
        let Some(keep) = tools.config.keep else { return };
        let resting = (0..PURGING).contains(&(now - self.purged_at));
        if resting || self.purging.as_ref().is_some_and(|purging| !purging.is_finished()) {
            return;
        }
        self.purged_at = now;
        let (store, octrees) = (tools.store.clone(), tools.config.octrees());
        // Not waited for at a stop: each of its transactions stands by itself.
        self.purging = Some(tokio::spawn(async move {
            match store.purge(now - keep, &octrees).await {
                Ok(0) => {}
                Ok(jobs) => tracing::info!(jobs, "removed the records of jobs that ended long ago"),
                Err(error) => tracing::warn!(%error, "old records stay for now"),
            }
        }));
    }

    async fn start_carrying(&mut self, tools: &EngineContext, now: Millis) -> Result<()> {
        if self.carrying.is_some() {
            return Ok(());
        }
        for (job, what) in tools.store.sources_owed(now, tools.config.patience, BATCH).await? {
            if self.later.get(&job.id).is_some_and(|at| now < *at && *at <= now + AGAIN) {
                continue;
            }
            let inputs = tools.store.inputs(job.id).await?;
            let begun = tools.store.begin_sources(job.id).await?;
            let plan = SourceActionPlan::new(&tools.config, &job, what, inputs);
            let (disk, cancel, bell) = (tools.disk.clone(), self.cancel.clone(), tools.bell.clone());
            let carrying = tokio::task::spawn_blocking(move || {
                let done = sources::put_away(&plan, &disk, &cancel);
                bell.notify_one();
                done
            });
            self.carrying = Some(Carrying { job: job.id, begun, done: carrying });
            break;
        }
        Ok(())
    }

    async fn carried(&mut self, tools: &EngineContext, now: Millis) -> Result<()> {
        if !self.carrying.as_ref().is_some_and(|carrying| carrying.done.is_finished()) {
            return Ok(());
        }
        let Some(Carrying { job, begun, done }) = self.carrying.take() else { return Ok(()) };
        let done = done.await.unwrap_or_else(|e| Err(NotMoved::ForNow(format!("moving it failed: {e}"))));
        let (outcome, at, kind, detail) = match done {
            Ok(SourceActionOutcome::Moved(to)) => {
                let to = to.to_string_lossy().into_owned();
                ("moved", Some(to.clone()), "sources moved", format!("to {to}"))
            }
            Ok(SourceActionOutcome::Removed) => {
                ("deleted", Some(String::new()), "sources deleted", String::new())
            }
            // Perhaps by us, before a crash: what stands for it may be all there is.
            Ok(SourceActionOutcome::Gone) => {
                ("gone", Some(String::new()), "sources gone", "they were not there any more".to_string())
            }
            Err(NotMoved::ForGood(why)) => {
                tracing::warn!(job, why, "its sources stay");
                // What lies there may be another's, and the earlier gone before a crash.
                ("kept", begun.then(String::new), "sources kept", why)
            }
            Err(NotMoved::ForNow(why)) => {
                // Said once, though it is tried every minute.
                if self.later.insert(job, now + AGAIN).is_none() {
                    tracing::warn!(job, why, "its sources stay for now");
                }
                return Ok(());
            }
        };
        tracing::info!(job, detail, "{kind}");
        // Not recorded, it is found to be done at the next try.
        tools.store.settle_sources(job, at.as_deref(), kind, &detail, now).await?;
        tools.metrics.sources.with_label_values(&[outcome]).inc();
        self.later.remove(&job);
        Ok(())
    }

    async fn start_hooks(&mut self, tools: &EngineContext, now: Millis) -> Result<()> {
        let nobody: Vec<State> = [State::Done, State::Failed, State::Quarantined]
            .into_iter()
            .filter(|end| hook::of(&tools.config, *end).is_none())
            .collect();
        if !nobody.is_empty() && !(0..CLEARING).contains(&(now - self.cleared_at)) {
            tools.store.forget_hooks(&nobody).await?;
            self.cleared_at = now;
        }
        if nobody.len() == 3 || self.telling.len() >= HOOKS {
            return Ok(());
        }
        for telling in tools.store.hooks_owed(BATCH).await? {
            if self.telling.len() >= HOOKS {
                break;
            }
            self.start_hook(tools, telling);
        }
        Ok(())
    }

    fn start_hook(&mut self, tools: &EngineContext, telling: PendingHook) {
        let (job, end) = (telling.job.id, telling.end);
        let Some(program) = hook::of(&tools.config, end).cloned() else { return };
        // It is told where the sources are, so they come first, if they can.
        let carried_first = telling.sources_owed && !self.later.contains_key(&job);
        if carried_first || !self.telling.insert(job) {
            return;
        }
        let environment = hook::environment(&tools.config, &telling);
        let limit = Duration::from_millis(tools.config.hook_limit as u64);
        let bell = tools.bell.clone();
        self.hooks.spawn(async move {
            let (ended, text) = hook::run(&program, environment, limit).await;
            bell.notify_one();
            (job, end, ended, text)
        });
    }

    async fn told(
        &mut self,
        tools: &EngineContext,
        told: std::result::Result<(JobId, State, HookEnd, String), tokio::task::JoinError>,
        now: Millis,
    ) -> Result<()> {
        let (job, end, ended, text) = match told {
            Ok(told) => told,
            Err(error) => {
                // Which one is not told; those that are still owed are told again.
                tracing::error!(%error, "a hook's task failed");
                self.telling.clear();
                return Ok(());
            }
        };
        match ended {
            HookEnd::Well => tracing::info!(job, text, "hook"),
            HookEnd::Badly | HookEnd::TooLate => tracing::warn!(job, text, "the hook failed"),
        }
        tools.metrics.hooks.with_label_values(&[ended.name()]).inc();
        // Also where the record fails: it is then told once more.
        self.telling.remove(&job);
        tools.store.settle_hook(job, end, &text, now).await
    }

    /// Waits for what runs until `end`, and kills it then. It is still owed, and
    /// begun again at the next start.
    pub async fn stop(&mut self, tools: &EngineContext, end: Millis) {
        self.cancel.cancel();
        self.previews.stop();
        while self.carrying.is_some() || !self.hooks.is_empty() || self.previews.are_at_work() {
            if let Err(error) = self.turn(tools, PreviewCapacity::None, true, QueueMode::Run).await {
                tracing::error!(%error, "while stopping");
            }
            if tools.clock.now() >= end {
                break;
            }
            let _ = tokio::time::timeout(Duration::from_millis(50), tools.bell.notified()).await;
        }
        if let Err(error) = self.previews.abandon(tools).await {
            tracing::error!(%error, "while stopping; its attempt counts");
        }
        if let Err(error) = self.verifications.abandon(tools).await {
            tracing::error!(%error, "while stopping; its attempt counts");
        }
        self.hooks.shutdown().await;
    }
}
