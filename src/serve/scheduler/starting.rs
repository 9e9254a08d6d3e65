//! Step four of the wheel: what waits and fits is started; of the rest it is said
//! why it waits. What may have brought the daemon down runs alone, so that nobody is
//! blamed for what another did.

use std::sync::Arc;

use super::converter::Work;
use super::engine::{Engine, RunningJob};
use super::preflight::{self, SizeClass};
use super::preview::PreviewCapacity;
use super::standstill::StallTimer;
use super::{folders, worker};
use crate::convert::context::{Cancel, Context, Progress};
use crate::convert::options::Options;
use crate::platform::clock::Millis;
use crate::serve::job::retry_policy::AttemptEnd;
use crate::serve::job::{Job, QueuedFile};
use crate::serve::queue::{AttemptResult, Result};

/// How many waiting jobs are looked at for one that fits.
const LOOK_AHEAD: i64 = 1000;
/// How many are looked at first; mostly one of them does.
const FIRST_LOOK: i64 = 16;

/// The options that a job was queued with; never others in their place.
fn options_of(job: &Job) -> std::result::Result<Options, String> {
    if let Some(refusal) = &job.refusal {
        return Err(format!("{refusal}; mend or remove it, and the data set is taken anew"));
    }
    serde_json::from_value(job.options.clone()).map_err(|e| format!("its options cannot be read: {e}"))
}

/// What became of those that run alone.
enum Suspects {
    /// There is none that could start.
    None,
    Started,
    /// One could, when all else has ended.
    Wait,
}

impl Engine {
    /// Step 4.
    pub(super) async fn start_ready(&mut self) -> Result<(usize, usize)> {
        let (mut started, mut held) = (0, 0);
        self.makes_room = false;
        let suspect_runs = self.running.values().any(|running| running.alone) || self.aftermath.draws().1;
        if suspect_runs {
            return Ok((0, 0));
        }
        match self.start_suspect().await? {
            Suspects::None => {}
            Suspects::Started => return Ok((1, 0)),
            Suspects::Wait => {
                self.makes_room = true;
                return Ok((0, 0));
            }
        }
        for lane in [SizeClass::Heavy, SizeClass::Light] {
            let mut looked_at = 0;
            for limit in [FIRST_LOOK, LOOK_AHEAD] {
                if !self.is_free(lane) {
                    break;
                }
                let now = self.tools.clock.now();
                let sizes = lane.sizes(&self.tools.config);
                let jobs = self.tools.store.ready(now, self.longest_wait(), sizes, limit).await?;
                let all = (jobs.len() as i64) < limit;
                for job in jobs.into_iter().skip(looked_at) {
                    if !self.is_free(lane) {
                        break;
                    }
                    match self.try_start(job, lane, now).await? {
                        true => started += 1,
                        false => held += 1,
                    }
                }
                if all {
                    break;
                }
                looked_at = limit as usize;
            }
        }
        Ok((started, held))
    }

    /// No job is told to wait for longer.
    fn longest_wait(&self) -> Millis {
        let policy = &self.tools.config.policy;
        policy.longest_wait.max(policy.first_wait)
    }

    /// Starts one of those that may have brought the daemon down, where nothing else
    /// is at work.
    async fn start_suspect(&mut self) -> Result<Suspects> {
        let now = self.tools.clock.now();
        for job in self.tools.store.suspects(now, self.longest_wait(), FIRST_LOOK).await? {
            let Some((job, inputs)) = self.fit(job, now).await? else { continue };
            if !self.running.is_empty() || self.aftermath.draws().0 {
                return Ok(Suspects::Wait);
            }
            let Some(job) = self.tools.store.claim(job.id, &self.owner, now).await? else { continue };
            tracing::info!(job = job.id, name = job.name, "runs alone, for the daemon died while it ran");
            let (id, lane) = (job.id, SizeClass::of(&job, &self.tools.config));
            self.start_claimed(job, lane, inputs, now).await?;
            self.running.entry(id).and_modify(|running| running.alone = true);
            return Ok(Suspects::Started);
        }
        Ok(Suspects::None)
    }

    /// What room there is for pictures.
    pub(super) fn room(&self) -> PreviewCapacity {
        if self.makes_room || self.running.values().any(|running| running.alone) {
            PreviewCapacity::None
        } else if self.running.is_empty() {
            PreviewCapacity::All
        } else {
            PreviewCapacity::Some
        }
    }

    /// Starts a job, or says why it does not start yet.
    async fn try_start(&mut self, job: Job, lane: SizeClass, now: Millis) -> Result<bool> {
        let Some((job, inputs)) = self.fit(job, now).await? else { return Ok(false) };
        let Some(job) = self.tools.store.claim(job.id, &self.owner, now).await? else { return Ok(false) };
        self.start_claimed(job, lane, inputs, now).await?;
        Ok(true)
    }

    /// A job whose options cannot be had fails; none runs with others in their place.
    async fn start_claimed(
        &mut self,
        job: Job,
        lane: SizeClass,
        inputs: Vec<QueuedFile>,
        now: Millis,
    ) -> Result<()> {
        match options_of(&job) {
            Ok(options) => self.start(job, lane, inputs, options, now),
            Err(error) => {
                let ending = AttemptResult { end: AttemptEnd::Hopeless, error: Some(error) };
                self.tools.store.finish(job.id, &self.owner, &ending, &self.tools.config.policy, now).await?;
                tracing::error!(job = job.id, name = job.name, error = ending.error, "failed");
            }
        }
        Ok(())
    }

    /// A job with its inputs, where nothing holds it; otherwise the queue is told what
    /// does.
    async fn fit(&self, job: Job, now: Millis) -> Result<Option<(Job, Vec<QueuedFile>)>> {
        let store = &self.tools.store;
        if let Some(reason) = self.waits_for_a_run(&job) {
            if job.hold.as_deref() != Some(reason) {
                store.hold(job.id, Some(reason), now).await?;
            }
            return Ok(None);
        }
        let inputs = store.inputs(job.id).await?;
        let in_hand: Vec<(SizeClass, u64)> =
            self.running.values().map(|r| (r.lane, preflight::room(&r.job))).collect();
        let trouble = preflight::input_trouble(&inputs);
        let is_input = trouble.is_some();
        if let Some(reason) = trouble.or_else(|| preflight::disk_trouble(&job, &in_hand, &self.tools)) {
            let is_news = job.hold.as_deref() != Some(reason.as_str());
            if is_news && !(is_input && store.give_way(job.id, &reason, now).await?) {
                tracing::warn!(job = job.id, name = job.name, reason, "held");
                store.hold(job.id, Some(&reason), now).await?;
            }
            return Ok(None);
        }
        Ok(Some((job, inputs)))
    }

    fn start(
        &mut self,
        job: Job,
        lane: SizeClass,
        inputs: Vec<QueuedFile>,
        mut options: Options,
        now: Millis,
    ) {
        let config = &self.tools.config;
        tracing::info!(job = job.id, name = job.name, files = inputs.len(), bytes = job.bytes, "converting");
        let (cancel, progress) = (Cancel::default(), Arc::new(Progress::default()));
        let context = Context {
            disk: self.tools.disk.clone(),
            scratch: folders::scratch_of(config, job.id),
            threads: config.threads,
            memory_limit: lane.memory(config),
            cancel: cancel.clone(),
            progress: progress.clone(),
        };
        // The staging folder's name is nothing to go by.
        options.name.get_or_insert_with(|| job.name.clone());
        let work = Work::new(inputs, folders::staging(config, job.id), options);
        self.tools.metrics.attempts.inc();
        self.tools.board.hang_up(job.id, progress, now);
        let id = job.id;
        self.running.insert(
            id,
            RunningJob {
                job,
                lane,
                cancel,
                stop: None,
                beat_at: now,
                pulse: StallTimer::new(now),
                alone: false,
            },
        );
        worker::start(
            id,
            self.tools.converter.clone(),
            work,
            context,
            self.sender.clone(),
            self.tools.bell.clone(),
        );
    }

    fn is_free(&self, lane: SizeClass) -> bool {
        self.running.values().filter(|running| running.lane == lane).count() < lane.width(&self.tools.config)
    }
}
