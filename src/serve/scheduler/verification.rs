//! Verifications that were ordered, one at a time, on threads of low priority. What
//! they find stays with the job.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use serde_json::{Value, json};
use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;

use super::preflight::{self, SizeClass};
use super::tools::EngineContext;
use super::worker;
use crate::convert::options::{Damaged, Options};
use crate::serve::job::{Job, JobId, QueuedFile};
use crate::serve::queue::Result;
use crate::verify::{self, SpacingRule, VerifyRequest};

/// Attempts; each is begun only if the daemon outlived the one before.
const ATTEMPTS: u32 = 3;
/// As pictures: a tenth of what a conversion takes of the processor.
const STEP_BACK: i32 = 10;

type VerificationResult = std::result::Result<Value, String>;

#[derive(Default)]
pub(super) struct Verifications {
    running: Option<RunningVerification>,
}

struct RunningVerification {
    job: JobId,
    end: oneshot::Receiver<VerificationResult>,
    /// Kept until the queue has recorded it.
    ended: Option<VerificationResult>,
}

impl Verifications {
    /// Takes note of what was found, and begins what is due.
    pub async fn turn(&mut self, tools: &EngineContext, resting: bool) -> Result<()> {
        if let Some(running) = &mut self.running {
            if running.ended.is_none() {
                running.ended = match running.end.try_recv() {
                    Ok(end) => Some(end),
                    Err(TryRecvError::Empty) => None,
                    Err(TryRecvError::Closed) => Some(Err("no thread could be started for it".to_string())),
                };
            }
            if let Some(end) = &running.ended {
                tools.store.settle_verification(running.job, end, tools.clock.now()).await?;
                tracing::info!(
                    job = running.job,
                    ok = end.as_ref().is_ok_and(|r| r["ok"] == true),
                    "verified"
                );
                self.running = None;
            }
        }
        match self.running.is_none() && !resting {
            true => self.begin(tools).await,
            false => Ok(()),
        }
    }

    async fn begin(&mut self, tools: &EngineContext) -> Result<()> {
        let Some((job, attempts)) = tools.store.verification_due().await? else { return Ok(()) };
        if attempts >= ATTEMPTS {
            let end = Err(format!("the daemon died over it, {attempts} times"));
            return tools.store.settle_verification(job.id, &end, tools.clock.now()).await;
        }
        tools.store.count_verification(job.id, 1).await?;
        let (sender, end) = oneshot::channel();
        let inputs = tools.store.inputs(job.id).await?;
        let request = request(tools, &job, &inputs);
        let (threads, bell, id) = (tools.config.threads, tools.bell.clone(), job.id);
        let work = move || {
            // The engine may be gone in a shutdown; then nobody wants to know.
            let _ = sender.send(verified(&request, threads));
            bell.notify_one();
        };
        if let Err(error) = std::thread::Builder::new().name(format!("verify-{id}")).spawn(work) {
            // Its sender is dropped, which is seen at the next turn.
            tracing::debug!(%error, "no thread for a verification");
        }
        self.running = Some(RunningVerification { job: job.id, end, ended: None });
        Ok(())
    }

    /// What has not ended is begun again at the next start, as if it had not been.
    pub async fn abandon(&mut self, tools: &EngineContext) -> Result<()> {
        let Some(running) = self.running.take() else { return Ok(()) };
        tools.store.count_verification(running.job, -1).await
    }
}

/// Against the files that it was made of, if they are still what they were.
fn request(tools: &EngineContext, job: &Job, inputs: &[QueuedFile]) -> VerifyRequest {
    let options: Options = serde_json::from_value(job.options.clone()).unwrap_or_default();
    let there = !inputs.is_empty() && preflight::input_trouble(inputs).is_none();
    let against: Vec<PathBuf> = inputs.iter().filter(|_| there).map(|input| input.path.clone()).collect();
    let folder = tools.config.octrees().join(&job.name);
    let copc = job.result.as_ref().and_then(|report| report["copc"]["file"].as_str());
    VerifyRequest {
        octree: match copc {
            Some(file) if !options.format.potree => folder.join(file),
            _ => folder,
        },
        against,
        damaged: options.damaged == Damaged::Keep,
        memory_limit: SizeClass::Light.memory(&tools.config),
        spacing: SpacingRule::Auto,
    }
}

fn verified(request: &VerifyRequest, threads: usize) -> VerificationResult {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|number| format!("verify-{number}"))
        .start_handler(|_| {
            if let Err(error) = rustix::process::nice(STEP_BACK) {
                tracing::debug!(%error, "a verification runs at the common priority");
            }
        })
        .build()
        .map_err(|error| format!("no threads could be started for it: {error}"))?;
    let began = std::time::Instant::now();
    // Unwind safety: nothing is shared but the request, which is only read.
    let found = catch_unwind(AssertUnwindSafe(|| pool.install(|| verify::verify(request))))
        .map_err(|panic| worker::last_words("verifying it", &*panic))?
        .map_err(|error| error.to_string())?;
    let mut report = serde_json::to_value(&found).unwrap_or_default();
    if let Value::Object(report) = &mut report {
        report.insert("seconds".to_string(), json!(began.elapsed().as_secs_f64()));
        // Where it lies on this machine is nobody's business.
        report.remove("octree");
    }
    Ok(report)
}
