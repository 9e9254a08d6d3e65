//! The thread of one conversion. A panic ends the conversion, not the daemon.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use tokio::sync::{Notify, mpsc};

use super::converter::{ConversionResult, Converter, Failure, Work};
use crate::convert::context::Context;
use crate::serve::job::JobId;

/// An ended run.
#[derive(Debug, Clone)]
pub(super) struct FinishedRun {
    pub job: JobId,
    pub result: Result<ConversionResult, Failure>,
}

/// Starts a run; its end is sent and the bell rung, whatever happens.
pub(super) fn start(
    job: JobId,
    converter: Arc<dyn Converter>,
    work: Work,
    context: Context,
    sender: mpsc::UnboundedSender<FinishedRun>,
    bell: Arc<Notify>,
) {
    let (late_sender, late_bell) = (sender.clone(), bell.clone());
    let run = move || {
        // Unwind safety: what the conversion shared is its progress and its
        // cancel flag, plain atomics that no panic leaves half-written.
        // What is logged meanwhile is about this job.
        let _span = tracing::info_span!("run", job).entered();
        let result = catch_unwind(AssertUnwindSafe(|| converter.convert(&work, &context)))
            .unwrap_or_else(|panic| Err(panicked(&*panic)));
        // The engine may be gone in a shutdown; then nobody wants the result.
        let _ = sender.send(FinishedRun { job, result });
        bell.notify_one();
    };
    let spawned = std::thread::Builder::new().name(format!("job-{job}")).spawn(run);
    if let Err(error) = spawned {
        let message = format!("no thread could be started: {error}");
        let failure = Failure { message, may_pass: true, panicked: false };
        let _ = late_sender.send(FinishedRun { job, result: Err(failure) });
        late_bell.notify_one();
    }
}

fn panicked(panic: &(dyn Any + Send)) -> Failure {
    Failure { message: last_words("the conversion", panic), may_pass: false, panicked: true }
}

/// What to tell of a panic.
pub(super) fn last_words(what: &str, panic: &(dyn Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .map(|text| text.to_string())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "without a word".to_string());
    format!("{what} panicked: {text} (this is a bug in Lodestone; please report it)")
}
