//! Pictures of published octrees, one octree at a time.
//!
//! A picture is a comfort and never in a conversion's way: its threads have a low
//! priority, so they take little of what conversions want of the processor, and
//! there is one octree at a time before them, so that memory is bounded. To wait
//! for a free place instead would leave a daemon that is never idle without any.
//!
//! They are drawn into a folder of their own and get their place in the octree's
//! folder here, on the wheel, where octrees are published too: no octree can be
//! replaced between the look at it and the rename.

mod draw;

use std::path::PathBuf;
use std::sync::Arc;

use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;

use super::preflight::SizeClass;
use super::tools::EngineContext;
use crate::convert::context::{Cancel, Context, Progress};
use crate::platform::clock::Millis;
use crate::platform::disk::{Disk, inode};
use crate::serve::config::Config;
use crate::serve::job::retry_policy::wait_after;
use crate::serve::queue::{PendingPreview, PreviewOutcome, Result};
use draw::DrawEnd;

/// Attempts at the pictures of an octree.
const ATTEMPTS: u32 = 3;
/// Not even pictures that conversions leave little of the processor to take so
/// long, in milliseconds; a disk that hangs does.
const LONGEST: Millis = 3_600_000;

/// Where pictures lie until they are whole; behind a dot nobody is served them.
fn easel(config: &Config) -> PathBuf {
    config.octrees().join(".previews")
}

/// What room conversions leave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PreviewCapacity {
    /// A suspect runs or waits to run alone, or the daemon stops.
    None,
    /// Something is converted.
    Some,
    /// Nothing is.
    All,
}

#[derive(Default)]
pub(super) struct Previews {
    drawing: Option<RunningPreview>,
    /// What a run of the daemon that died left is cleared.
    swept: bool,
}

struct RunningPreview {
    due: PendingPreview,
    octree: PathBuf,
    /// Of the octree's folder when it was begun.
    inode: u64,
    into: PathBuf,
    began: Millis,
    cancel: Cancel,
    too_long: bool,
    end: oneshot::Receiver<DrawEnd>,
    /// Kept until the queue has recorded it.
    ended: Option<DrawEnd>,
    /// The pictures are in their place.
    hung: bool,
}

impl Previews {
    pub fn are_at_work(&self) -> bool {
        self.drawing.is_some()
    }

    /// Whether what is drawn may have brought the daemon down before.
    pub fn are_suspect(&self) -> bool {
        self.drawing.as_ref().is_some_and(|drawing| drawing.due.suspect)
    }

    /// Takes note of what was drawn, and begins what is due where there is room.
    pub async fn turn(&mut self, tools: &EngineContext, room: PreviewCapacity) -> Result<()> {
        let now = tools.clock.now();
        if let Some(drawing) = &mut self.drawing {
            drawing.look(now);
            if drawing.ended.is_some() {
                drawing.finish(tools, now).await?;
                self.drawing = None;
            }
        }
        if self.drawing.is_none() && room != PreviewCapacity::None && tools.config.preview {
            self.begin(tools, room == PreviewCapacity::All, now).await?;
        }
        Ok(())
    }

    async fn begin(&mut self, tools: &EngineContext, alone: bool, now: Millis) -> Result<()> {
        let (config, disk, policy) = (&tools.config, &tools.disk, &tools.config.policy);
        if !self.swept {
            self.swept = true;
            clear(disk, easel(config)).await;
        }
        let longest_wait = policy.longest_wait.max(policy.first_wait);
        let Some(due) = tools.store.preview_due(now, longest_wait, alone).await? else { return Ok(()) };
        // The room that is left belongs to what is converted.
        if disk.free_space(&config.octrees()).is_ok_and(|free| free < config.disk_reserve) {
            return Ok(());
        }
        if due.attempts >= ATTEMPTS {
            let why = format!("the daemon died over it, {} times", due.attempts);
            return settle(tools, &due, PreviewOutcome::Failed(why), now).await;
        }
        let next = now + wait_after(due.attempts + 1, policy);
        let Some(due) = tools.store.begin_preview(&due, next, now).await? else { return Ok(()) };
        let octree = config.octrees().join(&due.name);
        let inode = match inode(&octree) {
            Ok(inode) => inode,
            Err(error) => {
                let why = format!("{}: {error}", octree.display());
                return settle(tools, &due, PreviewOutcome::Gone(why), now).await;
            }
        };
        let (into, cancel) = (easel(config).join(due.job.to_string()), Cancel::default());
        let context = Context {
            disk: disk.clone(),
            scratch: into.clone(),
            threads: config.threads,
            memory_limit: SizeClass::Light.memory(config),
            cancel: cancel.clone(),
            progress: Arc::new(Progress::default()),
        };
        let (sender, end) = oneshot::channel();
        let (converter, bell) = (tools.converter.clone(), tools.bell.clone());
        let (options, place, from) = (draw::options(config), into.clone(), octree.clone());
        let work = move || {
            // The engine may be gone in a shutdown; then nobody wants to know.
            let _ = sender.send(draw::draw(&*converter, &from, &place, &options, &context));
            bell.notify_one();
        };
        let spawned = std::thread::Builder::new().name(format!("preview-{}", due.job)).spawn(work);
        if let Err(error) = spawned {
            tracing::debug!(%error, "no thread for a preview");
            // Its sender is dropped, which is seen at the next turn.
        }
        self.drawing = Some(RunningPreview {
            due,
            octree,
            inode,
            into,
            began: now,
            cancel,
            too_long: false,
            end,
            ended: None,
            hung: false,
        });
        Ok(())
    }

    /// Asks what runs to stop.
    pub fn stop(&mut self) {
        if let Some(drawing) = &self.drawing {
            drawing.cancel.cancel();
        }
    }

    /// What has not stopped is begun again at the next start, as if it had not
    /// been begun.
    pub async fn abandon(&mut self, tools: &EngineContext) -> Result<()> {
        let Some(drawing) = self.drawing.take() else { return Ok(()) };
        settle(tools, &drawing.due, PreviewOutcome::Parked, tools.clock.now()).await
    }
}

impl RunningPreview {
    fn look(&mut self, now: Millis) {
        if self.ended.is_none() {
            self.ended = match self.end.try_recv() {
                Ok(end) => Some(end),
                Err(TryRecvError::Empty) => None,
                Err(TryRecvError::Closed) => Some(DrawEnd::Badly("no thread could be started for it".into())),
            };
        }
        if self.ended.is_none() && !self.too_long && (now - self.began).abs() >= LONGEST {
            tracing::warn!(job = self.due.job, "its pictures take too long; stopping them");
            self.too_long = true;
            self.cancel.cancel();
        }
    }

    /// May be called again where the queue did not answer.
    async fn finish(&mut self, tools: &EngineContext, now: Millis) -> Result<()> {
        if matches!(self.ended, Some(DrawEnd::Drawn(_))) && !self.hung {
            self.hang(tools).await?;
        }
        let (settled, seconds) = match &self.ended {
            Some(DrawEnd::Drawn(preview)) => {
                let receipt = serde_json::to_value(preview).unwrap_or_default();
                (PreviewOutcome::Done(receipt.to_string()), Some(preview.seconds))
            }
            Some(DrawEnd::Nothing(why)) => (PreviewOutcome::Nothing(why.clone()), None),
            Some(DrawEnd::Gone(why)) => (PreviewOutcome::Gone(why.clone()), None),
            Some(DrawEnd::Badly(why)) => (self.again(tools, why.clone(), now), None),
            Some(DrawEnd::Stopped) if self.too_long => {
                let why = format!("not done within {} minutes", LONGEST / 60_000);
                (self.again(tools, why, now), None)
            }
            Some(DrawEnd::Stopped) | None => (PreviewOutcome::Parked, None),
        };
        settle(tools, &self.due, settled, now).await?;
        if let Some(seconds) = seconds {
            tools.metrics.preview_seconds.observe(seconds);
        }
        clear(&tools.disk, self.into.clone()).await;
        Ok(())
    }

    fn again(&self, tools: &EngineContext, why: String, now: Millis) -> PreviewOutcome {
        match self.due.attempts {
            ATTEMPTS.. => PreviewOutcome::Failed(why),
            attempts => PreviewOutcome::Later(why, now + wait_after(attempts, &tools.config.policy)),
        }
    }

    /// Gives the pictures their place, if the octree is still the one that they
    /// show.
    async fn hang(&mut self, tools: &EngineContext) -> Result<()> {
        let stands = tools.store.preview_stands(&self.due).await?;
        let (disk, from, octree, known) =
            (tools.disk.clone(), self.into.clone(), self.octree.clone(), self.inode);
        let hung = match stands {
            true => tokio::task::spawn_blocking(move || draw::hang(&disk, &from, &octree, known)).await,
            false => Ok(Ok(false)),
        };
        match hung {
            Ok(Ok(true)) => self.hung = true,
            Ok(Ok(false)) => {
                self.ended = Some(DrawEnd::Gone("the octree was replaced while it was drawn".into()));
            }
            Ok(Err(error)) => self.ended = Some(DrawEnd::Badly(error.to_string())),
            Err(error) => self.ended = Some(DrawEnd::Badly(error.to_string())),
        }
        Ok(())
    }
}

/// Records and tells how an attempt ended.
async fn settle(
    tools: &EngineContext,
    due: &PendingPreview,
    settled: PreviewOutcome,
    now: Millis,
) -> Result<()> {
    let counts = tools.store.settle_preview(due, &settled, now).await?;
    let (job, name) = (due.job, due.name.as_str());
    let outcome = match &settled {
        _ if !counts => "dropped",
        PreviewOutcome::Parked => return Ok(()),
        PreviewOutcome::Done(_) => {
            tracing::info!(job, name, "its pictures are made");
            "done"
        }
        PreviewOutcome::Nothing(why) => {
            tracing::info!(job, name, why, "no pictures");
            "nothing"
        }
        PreviewOutcome::Later(why, _) => {
            tracing::warn!(job, name, why, "its pictures failed, are tried again");
            "postponed"
        }
        PreviewOutcome::Failed(why) => {
            tracing::warn!(job, name, why, "its pictures failed; `jobs preview` tries again");
            "failed"
        }
        PreviewOutcome::Gone(_) => "dropped",
    };
    tools.metrics.previews.with_label_values(&[outcome]).inc();
    Ok(())
}

async fn clear(disk: &Disk, folder: PathBuf) {
    let disk = disk.clone();
    let cleared = tokio::task::spawn_blocking(move || disk.remove_dir_all(&folder)).await;
    // It is cleared before the next drawing, or at the next start.
    if let Ok(Err(error)) = cleared {
        tracing::warn!(%error, "left-over of a preview");
    }
}
