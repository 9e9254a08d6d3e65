//! Speed against accuracy: every sampler and every renderer on the same scenes,
//! what it costs and how good it is (the measures of MEASURES: pictures held
//! against those of all points, spacing, coverage and spectrum of samples).
//!
//! ```text
//! scene ─┬▶ conversions in turns, a process each ──▶ octrees ─┬▶ spacing, holes
//!        └▶ samplers alone, in turns                          ├▶ pictures of coarse levels
//!                                                             └▶ renderers by budget
//! plane of noise ──▶ samplers ──▶ patterns, spectra
//! ```
//!
//! All is data first ([`Report`], written as JSON); the page is made from that.

mod cloud;
mod conversion;
mod machine;
mod page;
mod pattern;
mod pictures;
mod report;
mod sampler;
mod verdict;

use std::path::PathBuf;

use super::settings::{Means, Place, Result, Step};
use crate::convert::options::{LodColor, Sampling};
use crate::lab::synth::Kind;
use crate::render::framing::View;
pub use page::{main_chart, page};
pub use report::{Report, read};
pub use verdict::{Finding, findings};

/// What is to be compared.
#[derive(Debug, Clone)]
pub struct Wishes {
    pub means: Means,
    pub scenes: Vec<Kind>,
    /// Points of each scene.
    pub points: u64,
    /// Clouds of the user, beside the scenes.
    pub clouds: Vec<PathBuf>,
    /// Points of a picture, by which octrees are compared.
    pub budgets: Vec<u64>,
    /// Patterns that a spectrum is the mean of.
    pub patterns: u32,
}

impl Wishes {
    /// For an impression, in minutes.
    pub fn quick(means: Means) -> Wishes {
        let scenes = vec![Kind::Terrain, Kind::Interior, Kind::Object];
        let budgets = vec![50_000, 200_000];
        Wishes { means, scenes, points: 2_000_000, clouds: Vec::new(), budgets, patterns: 4 }
    }

    /// For the record, in an hour.
    pub fn full(means: Means) -> Wishes {
        let scenes = vec![Kind::Terrain, Kind::Interior, Kind::Object, Kind::Town];
        let budgets = vec![50_000, 200_000, 800_000];
        Wishes { means, scenes, points: 20_000_000, clouds: Vec::new(), budgets, patterns: 16 }
    }
}

/// Side of all pictures, in pixels.
const SIZE: [u32; 2] = [512, 512];

/// The views of MEASURES.
const VIEWS: [(&str, View); 4] = [
    ("overview", View::Overview),
    ("grazing", View::Grazing),
    ("close", View::Close),
    ("inside", View::Inside),
];

/// A way to convert.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    pub sampling: Sampling,
    /// Whether coarse levels show the mean colour of what their points stand for.
    pub averaged: bool,
}

impl Method {
    /// In the order of the charts; the first is the default.
    pub const ALL: [Method; 6] = [
        Method { sampling: Sampling::Poisson, averaged: false },
        Method { sampling: Sampling::Shells, averaged: false },
        Method { sampling: Sampling::Random, averaged: false },
        Method { sampling: Sampling::Nearest, averaged: false },
        Method { sampling: Sampling::Poisson, averaged: true },
        Method { sampling: Sampling::Random, averaged: true },
    ];

    /// Those that choose other points than all before.
    pub fn samplers() -> impl Iterator<Item = Method> {
        Method::ALL.into_iter().filter(|method| !method.averaged)
    }

    pub fn name(self) -> String {
        format!("{}{}", self.sampling.name(), if self.averaged { ", averaged" } else { "" })
    }

    /// What `lodestone convert` is to be told.
    fn arguments(self) -> Vec<&'static str> {
        let colour = if self.averaged { LodColor::Average } else { LodColor::Keep };
        vec!["-m", self.sampling.name(), "--lod-color", colour.name()]
    }
}

/// Counts the steps as they are taken.
struct Steps<'a> {
    done: std::cell::Cell<usize>,
    of: usize,
    say: &'a dyn Fn(Step),
}

impl Steps<'_> {
    /// Begins the next step.
    fn next(&self, what: String) {
        (self.say)(Step { done: self.done.get(), of: self.of, what });
        self.done.set(self.done.get() + 1);
    }
}

/// Measures all that is wished for. `say` is told before each step.
pub fn measure(wishes: &Wishes, say: &dyn Fn(Step)) -> Result<Report> {
    let place = Place::new(&wishes.means)?;
    let clouds = cloud::all(wishes);
    // A cloud is made, converted, sampled, looked at, and drawn.
    let of_cloud = 1 + wishes.means.rounds * (1 + Method::ALL.len()) + Method::ALL.len() + VIEWS.len();
    let of = clouds.len() * of_cloud + Method::samplers().count();
    let steps = Steps { done: Default::default(), of, say };
    let mut report = Report::new(wishes);
    for method in Method::samplers() {
        steps.next(format!("patterns of {}", method.name()));
        report.patterns.push(pattern::measure(method, wishes.patterns));
        wishes.means.go_on()?;
    }
    for cloud in &clouds {
        report.scenes.push(cloud::measure(wishes, cloud, &place, &steps)?);
    }
    Ok(report)
}
