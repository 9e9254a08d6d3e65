//! `lodestone preview`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::arguments;
use super::exit::Exit;
use super::output::{failed, say};
use super::sheet;
use crate::convert::context::{Cancel, Context, Progress};
use crate::convert::preview::{PreviewManifest, PreviewOptions, Still, Turntable, preview};
use crate::platform::disk::Disk;
use crate::platform::limits;
use crate::render::color::ColorBy;
use crate::render::framing::View;
use crate::render::octree_renderer::Quality;
use crate::render::renderer::Choice;
use crate::words::Plain;

/// Draw a thumbnail, an overview and a turntable of octrees; no display, driver or viewer needed
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folders of octrees, of Lodestone's or PotreeConverter's making
    #[arg(required = true, num_args = 1..)]
    octrees: Vec<PathBuf>,
    /// Folder to write the pictures into; `preview` within the octree's if not given. Of several
    /// octrees each gets a folder of its own in it, and `index.html` shows them all
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// A picture of this size instead of thumbnail and overview, as in 800x600; may be repeated
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Vec<[u32; 2]>,
    /// Pictures of the turntable; 0 for none
    #[arg(long, default_value_t = 36, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=720))]
    frames: u32,
    /// The turntable also as MP4, by the `ffmpeg` of this machine
    #[arg(long)]
    mp4: bool,
    /// What to colour by
    #[arg(long, ignore_case = true, default_value = "auto", value_name = "WHAT")]
    color: ColorBy,
    /// From where to look at it
    #[arg(long, ignore_case = true, default_value = "overview", value_name = "VIEW")]
    view: View,
    /// What is to draw: a real GPU where there is one, else the CPU; or one of them
    #[arg(long, ignore_case = true, default_value = "auto", value_name = "WHO")]
    renderer: Choice,
    /// Points to draw at most, in each picture
    #[arg(long, default_value_t = Quality::default().budget, value_name = "POINTS")]
    budget: u64,
    /// Leave the background out
    #[arg(long)]
    transparent: bool,
    /// Print what was made as JSON
    #[arg(long)]
    json: bool,
    /// Threads to work with; all that the machine or container grants if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub fn run(arguments: Arguments) -> Exit {
    let pool = match arguments::pool(arguments.threads) {
        Ok(pool) => pool,
        Err(error) => return failed(&error),
    };
    let mut options = PreviewOptions {
        color: arguments.color,
        view: arguments.view,
        renderer: arguments.renderer,
        budget: arguments.budget,
        transparent: arguments.transparent,
        ..PreviewOptions::default()
    };
    if !arguments.size.is_empty() {
        let still = |&[w, h]: &[u32; 2]| Still { name: format!("{w}x{h}"), role: "overview", size: [w, h] };
        options.stills = arguments.size.iter().map(still).collect();
    }
    let turntable = Turntable { size: [512, 512], frames: arguments.frames, mp4: arguments.mp4 };
    options.turntable = (arguments.frames > 0).then_some(turntable);
    let mut made = Vec::new();
    let mut exit = Exit::Done;
    let several = arguments.octrees.len() > 1;
    for octree in &arguments.octrees {
        let name = sheet::name_of(octree);
        let into = match &arguments.output {
            Some(folder) if several => folder.join(&name),
            Some(folder) => folder.clone(),
            // Beside a COPC file.
            None if octree.is_file() => octree.with_file_name("preview"),
            None => octree.join("preview"),
        };
        match pool.install(|| preview(octree, &into, &options, &context(&into, pool.current_num_threads()))) {
            Ok(preview) => {
                if !arguments.json {
                    tell(&into, &preview);
                }
                made.push((name, preview));
            }
            Err(error) => exit = failed(&error),
        }
    }
    if let (Some(folder), true) = (&arguments.output, several) {
        let path = folder.join("index.html");
        if let Err(error) = Disk::new().write_atomic(&path, sheet::page(&made).as_bytes()) {
            exit = failed(&error);
        }
    }
    if arguments.json {
        let json = match made.as_slice() {
            [(_, only)] if !several => serde_json::to_string_pretty(only),
            all => serde_json::to_string_pretty(&all.iter().map(|(_, preview)| preview).collect::<Vec<_>>()),
        };
        match json {
            Ok(json) => say!("{json}"),
            Err(error) => return failed(&error),
        }
    }
    exit
}

fn context(into: &Path, threads: usize) -> Context {
    Context {
        disk: Disk::new(),
        scratch: into.to_path_buf(),
        threads,
        memory_limit: limits::default_memory_limit(),
        cancel: Cancel::default(),
        progress: Arc::new(Progress::default()),
    }
}

fn tell(into: &Path, made: &PreviewManifest) {
    say!(
        "{} by {}, drawn by {}, {:.2} s",
        Plain(into.display()),
        Plain(&made.shows),
        made.renderer,
        made.seconds
    );
    for asset in &made.assets {
        let size = format!("{}x{}", asset.width, asset.height);
        let (points, kib) = (asset.effort.points, asset.bytes / 1024);
        say!("  {:15} {size:>9}  {points:>9} points  {kib:>5} KiB  {:.2} s", asset.href, asset.seconds);
    }
}

/// A size in pixels, as in 800x600.
fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some(size) if size.iter().all(|side| (16..=8192).contains(side)) => Ok(size),
        _ => Err(format!("{text:?} is no size; write it as 800x600, each side 16 to 8192 pixels")),
    }
}
