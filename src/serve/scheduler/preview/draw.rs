//! What an attempt does: draw, on threads that stand back in the line for the
//! processor, and give the pictures their place.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::convert::context::Context;
use crate::convert::preview::{PreviewManifest, PreviewOptions, Still, Turntable};
use crate::platform::disk::{Disk, DiskError, inode};
use crate::render::RenderError;
use crate::render::color::ColorBy;
use crate::serve::config::Config;
use crate::serve::scheduler::converter::Converter;
use crate::serve::scheduler::worker;

/// A step back in the line for the processor: beside a conversion a picture gets
/// a tenth of it. The last place (19) would get nothing on a machine that is
/// never idle.
const STEP_BACK: i32 = 10;

/// How an attempt ended.
pub(super) enum DrawEnd {
    Drawn(Box<PreviewManifest>),
    Nothing(String),
    Badly(String),
    Stopped,
    Gone(String),
}

/// One attempt; a panic ends it and nothing else.
pub(super) fn draw(
    converter: &dyn Converter,
    octree: &Path,
    into: &Path,
    options: &PreviewOptions,
    context: &Context,
) -> DrawEnd {
    // Unwind safety: nothing is shared but the flag to stop, a plain atomic.
    catch_unwind(AssertUnwindSafe(|| attempt(converter, octree, into, options, context)))
        .unwrap_or_else(|panic| DrawEnd::Badly(worker::last_words("drawing it", &*panic)))
}

/// What the daemon has made of each octree.
pub(super) fn options(config: &Config) -> PreviewOptions {
    let mut options = PreviewOptions { color: config.preview_color, ..PreviewOptions::default() };
    // For lists: a few kilobytes, so that a page of them is no load. Last, since
    // whoever takes the first thumbnail wants the large one.
    options.stills.push(Still { name: "icon".into(), role: "thumbnail", size: [128, 128] });
    let frames = config.preview_frames;
    options.turntable =
        options.turntable.filter(|_| frames > 0).map(|turntable| Turntable { frames, ..turntable });
    options
}

fn attempt(
    converter: &dyn Converter,
    octree: &Path,
    into: &Path,
    options: &PreviewOptions,
    context: &Context,
) -> DrawEnd {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(context.threads)
        .thread_name(|number| format!("preview-{number}"))
        .start_handler(|_| step_back())
        .build();
    let pool = match pool {
        Ok(pool) => pool,
        Err(error) => return DrawEnd::Badly(format!("no threads could be started for it: {error}")),
    };
    if let Err(error) = context.disk.remove_dir_all(into) {
        return DrawEnd::Badly(error.to_string());
    }
    let mut drawn = pool.install(|| converter.preview(octree, into, options, context));
    if let Err(RenderError::NoAttribute { .. }) = &drawn {
        // The setting is for all clouds; what this one has is better than nothing.
        let options = PreviewOptions { color: ColorBy::Auto, ..options.clone() };
        drawn = pool.install(|| converter.preview(octree, into, &options, context));
    }
    match drawn {
        Ok(preview) => DrawEnd::Drawn(Box::new(preview)),
        Err(error @ (RenderError::Nothing { .. } | RenderError::NotFinite { .. })) => {
            DrawEnd::Nothing(error.to_string())
        }
        Err(RenderError::Cancelled) => DrawEnd::Stopped,
        Err(_) if inode(octree).is_err() => DrawEnd::Gone(format!("{} is gone", octree.display())),
        Err(error) => DrawEnd::Badly(error.to_string()),
    }
}

/// For this thread alone: on Linux threads have priorities of their own.
fn step_back() {
    if let Err(error) = rustix::process::nice(STEP_BACK) {
        tracing::debug!(%error, "previews run at the common priority");
    }
}

/// Gives the pictures their place in the octree's folder, if that is still the
/// one with this inode; tells whether it was.
pub(super) fn hang(disk: &Disk, from: &Path, octree: &Path, known: u64) -> Result<bool, DiskError> {
    if inode(octree).ok() != Some(known) {
        return Ok(false);
    }
    let place = octree.join("preview");
    if place.symlink_metadata().is_ok_and(|there| !there.is_dir()) {
        let error = io::Error::other("something that is no folder has this name");
        return Err(DiskError::new("put the pictures into", &place, error));
    }
    disk.replace_dir(from, &place)?;
    Ok(true)
}
