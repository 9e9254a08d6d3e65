//! One octree before the camera: stills and turntables of it.

use std::collections::HashSet;
use std::path::Path;

use super::camera::{OrbitCamera, focal};
use super::ceiling::ceiling;
use super::color::{ColorBy, ColorMapper};
use super::error::Result;
use super::frame::{Background, Drawing, Picture, Shading};
use super::framing::{View, frame};
use super::node_selection::{SelectionRequest, bounds_of_points, select};
use super::octree::Octree;
use super::renderer::{Choice, Renderer};
use super::sample::CoarseSample;
use super::scene::Scene;

/// Pixels of a cell's side, the cells in sight below which splats grow, and the
/// radius to which they do, in pixels.
const CELL: f64 = 8.0;
const FEW: f32 = 48.0;
const BIG: f32 = 14.0;
/// How far what is looked at reaches beyond the points of the first look, in shares of
/// their longest side.
const BEYOND: f64 = 0.25;

/// How good a picture is, and what it may cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Distance of neighbouring points in the picture, in pixels; 0 for all
    /// points that there are.
    pub spacing: f64,
    /// Points to draw at most.
    pub budget: u64,
    pub shading: Shading,
    pub background: Background,
}

impl Default for Quality {
    fn default() -> Quality {
        let shading = Shading::default();
        Quality { spacing: 0.7, budget: 1_900_000, shading, background: Background::CALM }
    }
}

impl Quality {
    /// For the pictures of a turntable: a little coarser, and bounded so that
    /// dozens of them take seconds; they are small and pass by.
    pub fn turntable() -> Quality {
        Quality { spacing: 1.0, budget: 300_000, ..Quality::default() }
    }

    /// Every point of the cloud: what the others are measured against.
    pub fn full() -> Quality {
        Quality { spacing: 0.0, budget: u64::MAX, ..Quality::default() }
    }
}

/// What was looked at for a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct RenderStats {
    pub nodes: u64,
    pub points: u64,
    /// Bytes read for it, of hierarchy and points.
    pub bytes_read: u64,
}

/// An octree, a first look at it, and a renderer.
pub struct OctreeRenderer {
    octree: Octree,
    sample: CoarseSample,
    painter: ColorMapper,
    /// World z of the ceiling, where there is one.
    ceiling: Option<f64>,
    renderer: Renderer,
}

/// The points of a picture, or of all pictures of a turntable.
struct PointSet {
    scene: Scene,
    effort: RenderStats,
    /// Radius below which splats are too small, in pixels, where there is so
    /// little to see that one would look for it.
    least: f32,
}

/// Where a picture is taken from.
#[derive(Debug, Clone, Copy)]
pub struct Viewpoint {
    shot: OrbitCamera,
    /// World z above which nothing is shown.
    top: f64,
}

/// A picture that is set up: all that it needs is in memory.
pub struct SetUp {
    shot: OrbitCamera,
    size: [u32; 2],
    set: PointSet,
}

impl SetUp {
    pub fn effort(&self) -> RenderStats {
        self.set.effort
    }
}

impl OctreeRenderer {
    pub fn open(folder: &Path, by: ColorBy, choice: Choice) -> Result<OctreeRenderer> {
        let mut octree = Octree::open(folder)?;
        let sample = CoarseSample::take(&mut octree)?;
        let painter = ColorMapper::choose(&octree, &sample, by)?;
        let ceiling = ceiling(&sample.positions);
        Ok(OctreeRenderer { octree, sample, painter, ceiling, renderer: Renderer::open(choice)? })
    }

    /// What the colours show: an attribute's name, or `height`.
    pub fn shows(&self) -> &'static str {
        self.painter.shows()
    }

    /// Who draws: the GPU's name, or `cpu`.
    pub fn renderer(&self) -> &str {
        self.renderer.name()
    }

    /// One picture.
    pub fn still(&mut self, size: [u32; 2], view: View, quality: &Quality) -> Result<(Picture, RenderStats)> {
        let set_up = self.set_up(size, view, quality)?;
        Ok((self.draw(&set_up, quality)?, set_up.effort()))
    }

    /// Chooses and reads what a picture needs.
    pub fn set_up(&mut self, size: [u32; 2], view: View, quality: &Quality) -> Result<SetUp> {
        let stand = self.stand(size, view);
        self.set_up_from(stand, size, quality)
    }

    /// Where a view is taken from. It follows the first look at the octree, so
    /// another octree of the same cloud would choose another by a little.
    pub fn stand(&self, size: [u32; 2], view: View) -> Viewpoint {
        let top = self.top(view);
        Viewpoint { shot: frame(&self.below(top), view, size, false), top }
    }

    /// The same from a given stand.
    pub fn set_up_from(&mut self, stand: Viewpoint, size: [u32; 2], quality: &Quality) -> Result<SetUp> {
        let Viewpoint { shot, top } = stand;
        Ok(SetUp { shot, size, set: self.set(&[shot], size, top, quality)? })
    }

    /// Draws what is set up, as often as one likes.
    pub fn draw(&mut self, set_up: &SetUp, quality: &Quality) -> Result<Picture> {
        self.shoot(&set_up.shot, set_up.size, quality, &set_up.set)
    }

    /// A full circle in so many pictures, each handed over as it is done. All
    /// are of the same points: the nearest any of them needs. So they are read
    /// once, and nothing comes and goes from one picture to the next.
    pub fn turntable(
        &mut self,
        size: [u32; 2],
        frames: u32,
        quality: &Quality,
        mut done: impl FnMut(Picture) -> Result<()>,
    ) -> Result<RenderStats> {
        let top = self.top(View::Overview);
        let first = frame(&self.below(top), View::Overview, size, true);
        let shots: Vec<OrbitCamera> =
            (0..frames).map(|number| first.turned(f64::from(number) / f64::from(frames))).collect();
        let set = self.set(&shots, size, top, quality)?;
        for shot in &shots {
            done(self.shoot(shot, size, quality, &set)?)?;
        }
        Ok(set.effort)
    }

    /// World z above which a view shows nothing.
    fn top(&self, view: View) -> f64 {
        let opens = matches!(view, View::Overview | View::Top | View::Close);
        self.ceiling.filter(|_| opens).unwrap_or(f64::INFINITY)
    }

    /// The points of the first look that are shown, without lone ones.
    fn below(&self, top: f64) -> Vec<[f64; 3]> {
        self.sample.together.iter().filter(|p| p[2] <= top).copied().collect()
    }

    /// The box of what is looked at. The first look saw a part of it, so that it reaches
    /// farther than those points; but no farther than points do.
    fn looked_at(&self) -> [[f64; 3]; 2] {
        let [low, high] = bounds_of_points(&self.octree);
        let of = |pick: fn(f64, f64) -> f64, from: f64, axis: usize| {
            self.sample.together.iter().map(|point| point[axis]).fold(from, pick)
        };
        let first = [0, 1, 2].map(|axis| of(f64::min, f64::INFINITY, axis));
        let last = [0, 1, 2].map(|axis| of(f64::max, f64::NEG_INFINITY, axis));
        let margin = (0..3).map(|axis| last[axis] - first[axis]).fold(0.0, f64::max) * BEYOND;
        [
            std::array::from_fn(|axis| low[axis].max(first[axis] - margin)),
            std::array::from_fn(|axis| high[axis].min(last[axis] + margin)),
        ]
    }

    fn set(
        &mut self,
        shots: &[OrbitCamera],
        size: [u32; 2],
        top: f64,
        quality: &Quality,
    ) -> Result<PointSet> {
        let cameras: Vec<_> = shots.iter().map(OrbitCamera::camera).collect();
        let wanted = SelectionRequest { spacing: quality.spacing, budget: quality.budget, size, top };
        let before = self.octree.bytes_read();
        let chosen = select(&mut self.octree, &cameras, &wanted)?;
        let centre = shots.first().map_or([0.0; 3], |shot| shot.target);
        let scene = Scene::load(&self.octree, &chosen, &self.painter, centre, top, self.looked_at())?;
        let effort = RenderStats {
            nodes: chosen.len() as u64,
            points: scene.splats.len() as u64,
            bytes_read: self.octree.bytes_read() - before,
        };
        let least = shots.first().map_or(0.0, |shot| self.least(shot, size));
        Ok(PointSet { scene, effort, least })
    }

    /// Radius below which the splats of a shot are too small, in pixels: it grows
    /// where there is little to see, such as a single point.
    fn least(&self, shot: &OrbitCamera, size: [u32; 2]) -> f32 {
        let (camera, focal) = (shot.camera(), focal(size[0], size[1]));
        let cells = self.sample.positions.iter().filter_map(|point| {
            let [x, y, away] = camera.view(*point);
            let cell = [x, y].map(|side| (side / away * focal / CELL).floor() as i32);
            (away > 0.0).then_some(cell)
        });
        let cells = cells.collect::<HashSet<_>>().len().max(1);
        (FEW / cells as f32).min(BIG)
    }

    fn shoot(
        &mut self,
        shot: &OrbitCamera,
        size: [u32; 2],
        quality: &Quality,
        set: &PointSet,
    ) -> Result<Picture> {
        let (scene, mut shading) = (&set.scene, quality.shading);
        shading.core[0] = shading.core[0].max(set.least);
        let drawing = Drawing::new(
            &shot.camera(),
            size,
            scene.centre,
            scene.reach,
            scene.largest,
            &shading,
            quality.background,
        );
        self.renderer.draw(&drawing, scene)
    }
}
