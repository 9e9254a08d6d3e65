//! Ways to convert that are compared.

use std::path::PathBuf;

use crate::convert::options::{LodColor, Sampling};
use crate::lab::settings::WorkFolder;

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
    pub fn arguments(self) -> Vec<&'static str> {
        let colour = if self.averaged { LodColor::Average } else { LodColor::Keep };
        vec!["-m", self.sampling.name(), "--lod-color", colour.name()]
    }
}

/// Where a method's octree lies until it is measured.
pub fn octree(place: &WorkFolder, method: Method) -> PathBuf {
    place.at(&format!("octree of {}", method.name()))
}
