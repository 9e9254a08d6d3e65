//! The pictures of a finished octree, as files in a folder of their own.
//!
//! A picture is a comfort: nothing here touches the octree, and what fails here
//! fails no conversion. Each file is written whole or not at all; `preview.json`
//! comes last and tells what there is, so a folder with it is complete.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::context::Context;
use crate::render::color::ColorBy;
use crate::render::encode::{self, Animation, Film};
use crate::render::frame::{Background, Picture};
use crate::render::framing::View;
use crate::render::octree_renderer::{OctreeRenderer, Quality, RenderStats};
use crate::render::renderer::Choice;
use crate::render::{RenderError, Result};

/// Milliseconds that each picture of a turntable stands: a circle of 36 takes
/// four seconds, one of 72 eight, as smooth as the machine that shows it.
const STANDS: u32 = 110;

/// What to make.
#[derive(Debug, Clone)]
pub struct PreviewOptions {
    pub stills: Vec<Still>,
    pub turntable: Option<Turntable>,
    pub color: ColorBy,
    pub view: View,
    pub renderer: Choice,
    /// Points to draw at most.
    pub budget: u64,
    pub transparent: bool,
}

/// A single picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Still {
    /// Of the file, without its ending.
    pub name: String,
    /// STAC's word for what it is good for: `thumbnail` or `overview`.
    pub role: &'static str,
    /// Pixels.
    pub size: [u32; 2],
}

/// A full circle around the cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turntable {
    pub size: [u32; 2],
    pub frames: u32,
    /// Also as MP4, by the machine's `ffmpeg`.
    pub mp4: bool,
}

impl Default for PreviewOptions {
    fn default() -> PreviewOptions {
        let still = |name: &str, role, size| Still { name: name.into(), role, size };
        PreviewOptions {
            stills: vec![
                still("thumbnail", "thumbnail", [512, 512]),
                still("overview", "overview", [1600, 900]),
            ],
            turntable: Some(Turntable { size: [512, 512], frames: 36, mp4: false }),
            color: ColorBy::Auto,
            view: View::Overview,
            renderer: Choice::Auto,
            budget: Quality::default().budget,
            transparent: false,
        }
    }
}

/// What `preview.json` says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PreviewManifest {
    /// The attribute that the colours show, or `height`.
    pub shows: String,
    /// Who drew: the GPU's name, or `cpu`.
    pub renderer: String,
    pub assets: Vec<Asset>,
    /// Of all pictures together.
    pub seconds: f64,
}

/// One of the files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asset {
    /// Name of the file.
    pub href: String,
    #[serde(rename = "type")]
    pub media_type: String,
    pub roles: Vec<String>,
    pub width: u32,
    pub height: u32,
    pub frames: u32,
    pub bytes: u64,
    #[serde(flatten)]
    pub effort: RenderStats,
    pub seconds: f64,
}

/// The file that tells what there is.
pub const INDEX: &str = "preview.json";

/// Makes the pictures of an octree in the folder `into`.
pub fn preview(
    octree: &Path,
    into: &Path,
    options: &PreviewOptions,
    context: &Context,
) -> Result<PreviewManifest> {
    let started = Instant::now();
    let mut studio = OctreeRenderer::open(octree, options.color, options.renderer)?;
    let mut quality = Quality { budget: options.budget, ..Quality::default() };
    if options.transparent {
        quality.background = Background::Transparent;
    }
    let mut assets = Vec::new();
    let write = |name: &str, bytes: &[u8]| {
        let path = into.join(name);
        context.disk.write_atomic(&path, bytes).map_err(|error| unwritten(&path, error))
    };
    context.disk.create_dir_all(into).map_err(|error| unwritten(into, error))?;
    for still in &options.stills {
        let started = Instant::now();
        let (picture, effort) = studio.still(still.size, options.view, &quality)?;
        stop_if_asked(context)?;
        let href = format!("{}.png", still.name);
        let bytes = encode::png(&picture)?;
        write(&href, &bytes)?;
        assets.push(Asset {
            href,
            media_type: "image/png".into(),
            roles: vec![still.role.into()],
            width: picture.width,
            height: picture.height,
            frames: 1,
            bytes: bytes.len() as u64,
            effort,
            seconds: started.elapsed().as_secs_f64(),
        });
    }
    if let Some(turntable) = options.turntable {
        assets.extend(turn(&mut studio, &turntable, &quality, into, context)?);
    }
    let (shows, renderer) = (studio.shows().into(), studio.renderer().into());
    let preview = PreviewManifest { shows, renderer, assets, seconds: started.elapsed().as_secs_f64() };
    let page = serde_json::to_vec_pretty(&preview)
        .map_err(|error| RenderError::Encode { what: "preview.json", reason: error.to_string() })?;
    write(INDEX, &page)?;
    Ok(preview)
}

/// The turntable, as WebP and on request as MP4.
fn turn(
    studio: &mut OctreeRenderer,
    turntable: &Turntable,
    quality: &Quality,
    into: &Path,
    context: &Context,
) -> Result<Vec<Asset>> {
    let started = Instant::now();
    let Turntable { size, frames, mp4 } = *turntable;
    let moving = Quality::turntable();
    let moving =
        Quality { budget: quality.budget.min(moving.budget), background: quality.background, ..moving };
    let film_path = into.join(FILM);
    let unfinished = into.join(format!("{FILM}.part"));
    let mut film = if mp4 { Some(Film::new(size, STANDS, &unfinished)?) } else { None };
    // One frame is encoded while the next is drawn.
    let (effort, bytes) = std::thread::scope(|scope| {
        let (hand_over, frames_drawn) = std::sync::mpsc::sync_channel::<Picture>(1);
        let encoder = scope.spawn(move || {
            let mut animation = Animation::new(size, STANDS)?;
            for picture in frames_drawn {
                animation.add(&picture)?;
                film.as_mut().map_or(Ok(()), |film| film.add(&picture))?;
            }
            let bytes = animation.finish()?;
            film.map_or(Ok(()), Film::finish)?;
            Ok(bytes)
        });
        let drawn = studio.turntable(size, frames, &moving, |picture| {
            stop_if_asked(context)?;
            // Where nobody takes it, the encoder has failed and says why.
            let _ = hand_over.send(picture);
            Ok(())
        });
        drop(hand_over);
        let encoded: Result<Vec<u8>> = encoder.join().unwrap_or_else(|_| {
            Err(RenderError::Encode { what: "the turntable", reason: "its thread panicked".into() })
        });
        Ok::<_, RenderError>((drawn?, encoded?))
    })?;
    let path = into.join(TURNTABLE);
    context.disk.write_atomic(&path, &bytes).map_err(|error| unwritten(&path, error))?;
    let asset = |href: &str, media_type: &str, bytes: u64| Asset {
        href: href.into(),
        media_type: media_type.into(),
        roles: vec!["overview".into()],
        width: size[0],
        height: size[1],
        frames,
        bytes,
        effort,
        seconds: started.elapsed().as_secs_f64(),
    };
    let mut assets = vec![asset(TURNTABLE, "image/webp", bytes.len() as u64)];
    if mp4 {
        let written = std::fs::metadata(&unfinished)
            .map_err(|source| RenderError::Read { path: unfinished.clone(), source })?;
        context.disk.rename(&unfinished, &film_path).map_err(|error| unwritten(&film_path, error))?;
        assets.push(asset(FILM, "video/mp4", written.len()));
    }
    Ok(assets)
}

/// Names of the turntable's files.
const TURNTABLE: &str = "turntable.webp";
const FILM: &str = "turntable.mp4";

fn stop_if_asked(context: &Context) -> Result<()> {
    if context.cancel.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
}

fn unwritten(path: &Path, error: crate::platform::disk::DiskError) -> RenderError {
    RenderError::Write { path: path.to_path_buf(), source: std::io::Error::other(error) }
}
