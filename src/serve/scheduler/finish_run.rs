//! What is done when a run has ended: publish what succeeded, judge what did not,
//! record it, and tell.

use super::converter::{ConversionResult, Failure};
use super::engine::{Engine, RunningJob};
use super::folders::staging;
use super::standstill::reason;
use super::stop::{StopReason, wish_end};
use super::worker::FinishedRun;
use super::{preflight, publish, sources};
use crate::platform::clock::Millis;
use crate::platform::disk::{inode, seal};
use crate::serve::config::sources::OnDone;
use crate::serve::job::Event;
use crate::serve::job::State;
use crate::serve::job::retry_policy::AttemptEnd;
use crate::serve::job::state_machine;
use crate::serve::queue::{AttemptResult, Result};

impl Engine {
    /// Records one ended run; may be called again for the same one.
    pub(super) async fn record(&self, finished: &FinishedRun) -> Result<()> {
        let Some(running) = self.running.get(&finished.job) else { return Ok(()) };
        let ending = match &finished.result {
            Ok(report) => self.settle_success(running, report).await?,
            Err(failure) => failing(running, failure, self.tools.config.stall),
        };
        let now = self.tools.clock.now();
        let verdict = self
            .tools
            .store
            .finish(finished.job, &self.owner, &ending, &self.tools.config.policy, now)
            .await?;
        let Some(verdict) = verdict else {
            tracing::warn!(job = finished.job, "its lease was lost; the result is thrown away");
            return Ok(());
        };
        self.tell(running, verdict.event, &ending, finished, now);
        Ok(())
    }

    /// The conversion succeeded: publish, unless an operator or the source
    /// thought better of it meanwhile; the queue knows.
    async fn settle_success(&self, running: &RunningJob, report: &ConversionResult) -> Result<AttemptResult> {
        let inputs = self.tools.store.inputs(running.job.id).await?;
        if let Some(changed) = preflight::changed(&inputs) {
            let error =
                format!("{} changed while it was converted; waiting until it is quiet", changed.display());
            return Ok(AttemptResult { end: AttemptEnd::Passing, error: Some(error) });
        }
        let staged = match self.tools.store.job(running.job.id).await?.staged {
            // This call's forerunner got so far, and what lies in staging now
            // may be the octree that was replaced.
            Some(staged) => staged,
            None => {
                let (id, mut result) = (running.job.id, report.json.clone());
                // Before the octree stands: after a crash in between nobody would know.
                let what = sources::wish(&self.tools.config, &running.job.source);
                let doubt = sources::doubt(&running.job, report);
                if let Some(doubt) = doubt.as_deref() {
                    add_note(&mut result, doubt, what);
                }
                let what = if doubt.is_some() { OnDone::Keep } else { what };
                self.tools.store.owe_sources(id, &self.owner, what).await?;
                let folder = staging(&self.tools.config, id);
                let (inode, seal) = (inode(&folder).unwrap_or(0), seal(&folder));
                let (now, result, store) = (self.tools.clock.now(), result.to_string(), &self.tools.store);
                let staged = (inode, seal.as_deref());
                if inode != 0 && !store.stage(id, &self.owner, staged, &result, now).await? {
                    // Called off in the last moment, which the record will say.
                    return Ok(AttemptResult { end: AttemptEnd::Parked, error: None });
                }
                inode
            }
        };
        Ok(match publish::publish(&self.tools, &running.job, staged).await {
            Ok(()) => AttemptResult { end: AttemptEnd::Published, error: None },
            Err(failure) => failing(running, &failure, self.tools.config.stall),
        })
    }

    /// Logs and counts the end of a run.
    fn tell(
        &self,
        running: &RunningJob,
        event: Event,
        ending: &AttemptResult,
        finished: &FinishedRun,
        now: Millis,
    ) {
        let (job, name) = (running.job.id, running.job.name.as_str());
        let error = ending.error.as_deref().unwrap_or("");
        match event {
            Event::Succeed => published(running, finished),
            Event::Park => tracing::info!(job, name, "parked; it goes on from there later"),
            Event::Postpone => tracing::warn!(job, name, error, "did not succeed, is tried again"),
            Event::Fail | Event::Quarantine => tracing::error!(job, name, error, "{}", event.name()),
            _ => tracing::info!(job, name, "{}", event.name()),
        }
        let metrics = &self.tools.metrics;
        let result = state_machine::next(State::Running, event).map_or("", |s| s.name());
        metrics
            .jobs_finished
            .with_label_values(&[if event == Event::Postpone { "postponed" } else { result }])
            .inc();
        if let (Event::Succeed, Ok(report)) = (event, &finished.result) {
            metrics.points_read.inc_by(report.points_in);
            metrics.points_written.inc_by(report.points_out);
            for (reason, points) in &report.set_aside {
                metrics.set_aside(reason, *points);
            }
            metrics.input_bytes.inc_by(running.job.bytes);
            metrics.output_bytes.inc_by(report.output_bytes);
            if let Some(bytes) = report.copc_bytes {
                metrics.copc_files.inc();
                metrics.copc_bytes.inc_by(bytes);
            }
            for (stage, seconds) in &report.seconds_by_stage {
                metrics.stage_seconds.with_label_values(&[stage]).observe(*seconds);
            }
            let started = running.job.started_at.unwrap_or(now);
            metrics.job_seconds.observe((now - started).max(0) as f64 / 1000.0);
        }
    }
}

/// Warnings of a job that the log tells; its report has all.
const MAX_LOGGED: usize = 20;

fn published(running: &RunningJob, finished: &FinishedRun) {
    let (job, name) = (running.job.id, running.job.name.as_str());
    let Ok(report) = &finished.result else { return };
    let set_aside: u64 = report.set_aside.iter().map(|(_, points)| points).sum();
    let (points, missing) = (report.points_out, report.points_missing);
    tracing::info!(job, name, points, set_aside, missing, "published");
    for warning in report.warnings.iter().take(MAX_LOGGED) {
        tracing::warn!(job, name, "{warning}");
    }
    if let Some(more @ 1..) = report.warnings.len().checked_sub(MAX_LOGGED) {
        tracing::warn!(job, name, "and {more} more warnings, in report.json");
    }
}

/// Tells in a job's report why its sources stay.
fn add_note(report: &mut serde_json::Value, doubt: &str, what: OnDone) {
    let note = match what {
        OnDone::Keep => doubt.to_string(),
        OnDone::Move | OnDone::Delete => format!("{doubt}; its sources stay where they are"),
    };
    tracing::warn!(note, "converted all the same");
    if let Some(report) = report.as_object_mut() {
        let notes = report.entry("notes").or_insert_with(|| serde_json::json!([]));
        if let Some(notes) = notes.as_array_mut() {
            notes.push(note.into());
        }
    }
}

/// How a run that failed is judged: what we stopped ourselves is no failure.
fn failing(running: &RunningJob, failure: &Failure, stall: Option<Millis>) -> AttemptResult {
    let error = Some(failure.message.clone());
    match running.stop {
        Some(StopReason::Shutdown) => AttemptResult { end: AttemptEnd::Parked, error: None },
        Some(StopReason::Wish(wish)) => AttemptResult { end: wish_end(wish), error: None },
        Some(StopReason::Stalled) => {
            AttemptResult { end: AttemptEnd::Crashed, error: Some(reason(stall.unwrap_or_default())) }
        }
        None if failure.panicked => AttemptResult { end: AttemptEnd::Panicked, error },
        None if failure.may_pass => AttemptResult { end: AttemptEnd::Passing, error },
        None => AttemptResult { end: AttemptEnd::Hopeless, error },
    }
}
