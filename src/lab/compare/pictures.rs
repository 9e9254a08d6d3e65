//! Pictures of a view: of every method's octree at fixed budgets, and of the
//! default one's by every way to draw, all held against the picture of all
//! points at the highest setting.

use std::time::Instant;

use super::method::{Method, octree};
use super::options::{CompareOptions, SIZE};
use super::report::{FrameReport, MethodReport, PictureReport, RendererReport};
use crate::lab::flip;
use crate::lab::process::spread;
use crate::lab::settings::{Result, WorkFolder};
use crate::render::color::ColorBy;
use crate::render::frame::{Picture, Shading};
use crate::render::framing::View;
use crate::render::octree_renderer::{OctreeRenderer, Quality, RenderStats, Viewpoint};
use crate::render::renderer::Choice;

/// Points of the pictures that renderers are compared by.
const BUDGETS: [u64; 6] = [25_000, 50_000, 100_000, 250_000, 600_000, 1_500_000];
/// Times that each is drawn; the median counts.
const TIMES: usize = 3;

pub const PLAINEST: &str = "one pixel";
pub const BEST: &str = "high quality";

/// Ways to draw, from the plainest to the one that is used.
fn styles() -> [(&'static str, Shading); 4] {
    let plain = Shading { blended: false, fringe: 0.0, fill: 0, ..Shading::default() };
    [
        (PLAINEST, Shading { core: [0.5; 2], ..plain }),
        ("fixed splats", Shading { core: [1.5; 2], ..plain }),
        ("adaptive splats", Shading { fill: Shading::default().fill, ..plain }),
        (BEST, Shading::default()),
    ]
}

/// The picture of all points, what the eye sees of it, and where it was taken
/// from: all that are held against it are taken from there too.
struct Full {
    stand: Viewpoint,
    picture: Picture,
    seen: flip::ReferencePicture,
}

impl Full {
    fn new(studio: &mut OctreeRenderer, view: View) -> Result<Full> {
        let stand = studio.stand(SIZE, view);
        let (picture, _) = taken(studio, stand, &Quality::full())?;
        Ok(Full { stand, seen: flip::ReferencePicture::new(SIZE[0] as usize, &picture.pixels), picture })
    }
}

fn taken(studio: &mut OctreeRenderer, stand: Viewpoint, quality: &Quality) -> Result<(Picture, RenderStats)> {
    let set_up = studio.set_up_from(stand, SIZE, quality)?;
    Ok((studio.draw(&set_up, quality)?, set_up.effort()))
}

/// All pictures of a view; what they come to is added to the methods' and the
/// renderers' figures.
pub fn measure(
    options: &CompareOptions,
    (name, view): (&str, View),
    place: &WorkFolder,
    methods: &mut [MethodReport],
    renderers: &mut Vec<RendererReport>,
) -> Result<()> {
    let mut full: Option<Full> = None;
    for (method, figures) in Method::ALL.into_iter().zip(methods) {
        let mut studio = OctreeRenderer::open(&octree(place, method), ColorBy::Auto, Choice::Cpu)?;
        let full = match &full {
            Some(full) => full,
            None => full.insert(Full::new(&mut studio, view)?),
        };
        for &budget in &options.budgets {
            let (picture, effort) = taken(&mut studio, full.stand, &within(budget))?;
            figures.pictures.push(held_against(full, &picture, name, budget, effort.points));
            options.means.go_on()?;
        }
    }
    let Some(full) = full else { return Ok(()) };
    for choice in choices() {
        draw(options, name, choice, place, &full, renderers)?;
    }
    Ok(())
}

/// The CPU, and a GPU where there is one.
fn choices() -> Vec<Choice> {
    let gpu = crate::render::renderer::Renderer::open(Choice::Auto).is_ok_and(|it| it.name() != "cpu");
    [Choice::Cpu].into_iter().chain(gpu.then_some(Choice::Auto)).collect()
}

fn draw(
    options: &CompareOptions,
    name: &str,
    choice: Choice,
    place: &WorkFolder,
    full: &Full,
    renderers: &mut Vec<RendererReport>,
) -> Result<()> {
    let mut studio = OctreeRenderer::open(&octree(place, Method::ALL[0]), ColorBy::Auto, choice)?;
    for budget in BUDGETS {
        let started = Instant::now();
        let quality = within(budget);
        let set = studio.set_up_from(full.stand, SIZE, &quality)?;
        let load_ms = started.elapsed().as_secs_f64() * 1e3;
        for (style, shading) in styles() {
            let mut times = Vec::new();
            let mut picture = None;
            for _ in 0..TIMES {
                let started = Instant::now();
                picture = Some(studio.draw(&set, &Quality { shading, ..quality.clone() })?);
                times.push(started.elapsed().as_secs_f64() * 1e3);
                options.means.go_on()?;
            }
            let Some(picture) = picture else { continue };
            let picture = held_against(full, &picture, name, budget, set.effort().points);
            let draw_ms = spread(times.into_iter()).median;
            let renderer = studio.renderer().to_string();
            let known = renderers.iter_mut().find(|it| it.style == style && it.renderer == renderer);
            let frame = FrameReport { picture, draw_ms, load_ms };
            match known {
                Some(known) => known.pictures.push(frame),
                None => {
                    renderers.push(RendererReport { style: style.into(), renderer, pictures: vec![frame] })
                }
            }
        }
    }
    Ok(())
}

/// The best picture of so many points.
fn within(budget: u64) -> Quality {
    Quality { budget, ..Quality::full() }
}

fn held_against(full: &Full, picture: &Picture, view: &str, budget: u64, points: u64) -> PictureReport {
    PictureReport {
        view: view.to_string(),
        budget,
        points,
        error: flip::pixel_error(&full.picture.pixels, &picture.pixels),
        flip: full.seen.mean(&picture.pixels),
    }
}
