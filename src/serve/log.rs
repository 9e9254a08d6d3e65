//! Lines of the log that are about a job, set aside as they are written, so that
//! they can be kept with it: whoever asks why a job failed need not search the
//! daemon's log, which may be long gone.
//!
//! An event is about a job where it has a field `job`, or happens within a span
//! that has one. Nothing here waits: what nobody takes away in time is dropped,
//! the oldest first.

use std::collections::VecDeque;
use std::fmt::{self, Write};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

use crate::platform::clock::Clock;
use crate::serve::job::JobId;

/// A line of the log about a job.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LogLine {
    #[serde(skip)]
    pub job: JobId,
    /// Milliseconds since 1970.
    pub at: i64,
    /// `error`, `warn`, `info` or `debug`.
    pub level: String,
    pub text: String,
}

/// Lines that may wait to be taken away.
const MAX_WAITING: usize = 4000;
/// Bytes of a line.
const MAX_LINE: usize = 2000;

/// One log, as there is one subscriber for the process.
static LINES: Mutex<VecDeque<LogLine>> = Mutex::new(VecDeque::new());

/// Takes away the lines that were written since the last call, the oldest first.
pub fn take_lines() -> Vec<LogLine> {
    LINES.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect()
}

/// Sets lines about jobs aside; to be installed beside what writes the log.
#[derive(Debug, Clone, Copy, Default)]
pub struct JobLines;

/// The job that a span is about.
struct OfJob(JobId);

#[derive(Default)]
struct LineFields {
    job: Option<JobId>,
    message: String,
    others: String,
}

impl Visit for LineFields {
    fn record_i64(&mut self, field: &Field, value: i64) {
        match field.name() {
            "job" => self.job = Some(value),
            _ => self.record_debug(field, &value),
        }
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        match field.name() {
            "job" => self.job = JobId::try_from(value).ok(),
            _ => self.record_debug(field, &value),
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing to a String never fails.
        let _ = match field.name() {
            "message" => write!(self.message, "{value:?}"),
            // The page that shows the lines is the job's own.
            "name" => Ok(()),
            name => write!(self.others, " {name}={value:?}"),
        };
    }
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for JobLines {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let mut fields = LineFields::default();
        attributes.record(&mut fields);
        if let (Some(job), Some(span)) = (fields.job, context.span(id)) {
            span.extensions_mut().insert(OfJob(job));
        }
    }

    fn on_event(&self, event: &Event<'_>, context: Context<'_, S>) {
        let mut fields = LineFields::default();
        event.record(&mut fields);
        let of_span = || {
            let mut spans = context.event_scope(event)?;
            spans.find_map(|span| span.extensions().get::<OfJob>().map(|OfJob(job)| *job))
        };
        let Some(job) = fields.job.or_else(of_span) else { return };
        let mut text = fields.message + &fields.others;
        if text.len() > MAX_LINE {
            let end = (0..=MAX_LINE).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
            text.truncate(end);
            text.push('…');
        }
        let level = event.metadata().level().as_str().to_ascii_lowercase();
        let line = LogLine { job, at: Clock::System.now(), level, text };
        let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.len() >= MAX_WAITING {
            lines.pop_front();
        }
        lines.push_back(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::prelude::*;

    #[test]
    fn lines_go_to_the_job_they_are_about() {
        let subscriber = tracing_subscriber::registry().with(JobLines);
        tracing::subscriber::with_default(subscriber, || {
            tracing::info!("about nobody");
            tracing::warn!(job = 71_001i64, name = "x", seconds = 2, "slow");
            tracing::info_span!("run", job = 71_002i64).in_scope(|| {
                tracing::info!(files = 3, "within");
                tracing::info_span!("inner").in_scope(|| tracing::error!("{}", "ä".repeat(3000)));
            });
        });
        let lines = take_lines();
        let of = |job: JobId| {
            let lines = lines.iter().filter(|line| line.job == job);
            lines.map(|line| (line.level.as_str(), line.text.as_str())).collect::<Vec<_>>()
        };
        assert_eq!(of(71_001), [("warn", "slow seconds=2")]);
        assert_eq!(of(71_002)[0], ("info", "within files=3"));
        assert!(of(71_002)[1].1.len() <= MAX_LINE + "…".len(), "bounded");
    }
}
