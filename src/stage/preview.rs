//! The pictures of a finished octree, as files in a folder of their own.
//!
//! A picture is a comfort: nothing here touches the octree, and what fails here
//! fails no conversion. Each file is written whole or not at all; `preview.json`
//! comes last and tells what there is, so a folder with it is complete.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::context::Context;
use crate::render::colour::ColorBy;
use crate::render::encode::{self, Animation};
use crate::render::frame::{Background, Picture};
use crate::render::framing::View;
use crate::render::renderer::Choice;
use crate::render::studio::{Effort, Quality, Studio};
use crate::render::{RenderError, Result};

/// Milliseconds that a full circle takes.
const CIRCLE: u32 = 7200;

/// What to make.
#[derive(Debug, Clone)]
pub struct Options {
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
}

impl Default for Options {
    fn default() -> Options {
        let still = |name: &str, role, size| Still { name: name.into(), role, size };
        Options {
            stills: vec![
                still("thumbnail", "thumbnail", [512, 512]),
                still("overview", "overview", [1600, 900]),
            ],
            turntable: Some(Turntable { size: [512, 512], frames: 36 }),
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
pub struct Preview {
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
    pub effort: Effort,
    pub seconds: f64,
}

/// The file that tells what there is.
pub const INDEX: &str = "preview.json";

/// Makes the pictures of an octree in the folder `into`.
pub fn preview(octree: &Path, into: &Path, options: &Options, context: &Context) -> Result<Preview> {
    let started = Instant::now();
    let mut studio = Studio::open(octree, options.color, options.renderer)?;
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
        assets.push(Asset::of(href, "image/png", still.role, &picture, 1, bytes.len(), effort, started));
    }
    if let Some(Turntable { size, frames }) = options.turntable {
        let started = Instant::now();
        let mut animation = Animation::new(size, CIRCLE / frames.max(1))?;
        let mut last = None;
        let moving = Quality::turntable();
        let moving =
            Quality { budget: quality.budget.min(moving.budget), background: quality.background, ..moving };
        let effort = studio.turntable(size, frames, &moving, |picture| {
            stop_if_asked(context)?;
            animation.add(&picture)?;
            last = Some(picture);
            Ok(())
        })?;
        let bytes = animation.finish()?;
        let href = "turntable.webp".to_string();
        write(&href, &bytes)?;
        if let Some(picture) = last {
            assets.push(Asset::of(
                href,
                "image/webp",
                "overview",
                &picture,
                frames,
                bytes.len(),
                effort,
                started,
            ));
        }
    }
    let (shows, renderer) = (studio.shows().into(), studio.renderer().into());
    let preview = Preview { shows, renderer, assets, seconds: started.elapsed().as_secs_f64() };
    let page = serde_json::to_vec_pretty(&preview)
        .map_err(|error| RenderError::Encode { what: "preview.json", reason: error.to_string() })?;
    write(INDEX, &page)?;
    Ok(preview)
}

impl Asset {
    #[expect(clippy::too_many_arguments, reason = "one figure each, named where they are given")]
    fn of(
        href: String,
        media_type: &str,
        role: &str,
        picture: &Picture,
        frames: u32,
        bytes: usize,
        effort: Effort,
        started: Instant,
    ) -> Asset {
        Asset {
            href,
            media_type: media_type.into(),
            roles: vec![role.into()],
            width: picture.width,
            height: picture.height,
            frames,
            bytes: bytes as u64,
            effort,
            seconds: started.elapsed().as_secs_f64(),
        }
    }
}

fn stop_if_asked(context: &Context) -> Result<()> {
    if context.cancel.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
}

fn unwritten(path: &Path, error: crate::disk::DiskError) -> RenderError {
    RenderError::Write { path: path.to_path_buf(), source: std::io::Error::other(error) }
}
