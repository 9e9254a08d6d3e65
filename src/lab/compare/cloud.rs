//! One cloud through all of it: made or found, converted by every method in
//! turns, sampled, looked at, drawn.

use std::path::{Path, PathBuf};

use super::method::{Method, octree};
use super::options::{CompareOptions, SEED, VIEWS};
use super::report::SceneReport;
use super::steps::Steps;
use super::{conversion, pictures, sampler};
use crate::format::inputs;
use crate::lab::sampling::evenness;
use crate::lab::settings::{MeasureError, Result, WorkFolder};
use crate::lab::synth::Recipe;

/// A scene to be made, or a cloud of the user.
pub enum ComparedCloud {
    Scene(Recipe),
    Own(PathBuf),
}

pub fn all(options: &CompareOptions) -> Vec<ComparedCloud> {
    let scenes =
        options.scenes.iter().map(|kind| ComparedCloud::Scene(Recipe::new(*kind, options.points, SEED)));
    scenes.chain(options.clouds.iter().cloned().map(ComparedCloud::Own)).collect()
}

impl ComparedCloud {
    fn name(&self) -> String {
        match self {
            ComparedCloud::Scene(recipe) => recipe.kind.name().to_string(),
            ComparedCloud::Own(path) => {
                path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
            }
        }
    }
}

pub fn measure(
    options: &CompareOptions,
    cloud: &ComparedCloud,
    place: &WorkFolder,
    steps: &Steps,
) -> Result<SceneReport> {
    let name = cloud.name();
    let path = match cloud {
        ComparedCloud::Scene(recipe) => {
            steps.next(format!("making {name}"));
            let folder = place.at("cloud");
            options.means.synthesise(recipe, &name, &folder)?;
            folder
        }
        ComparedCloud::Own(path) => {
            steps.next(format!("reading {name}"));
            path.clone()
        }
    };
    let files = inputs::expand(std::slice::from_ref(&path))?;
    let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|meta| meta.len()).sum();
    let (points, mut methods) = conversion::measure(options, &name, &path, place, steps)?;
    let speeds = sampler::measure(options, &name, &files, steps)?;
    for (method, speed) in Method::samplers().zip(speeds) {
        let figures = methods.iter_mut().find(|figures| figures.method == method.name());
        figures.into_iter().for_each(|figures| figures.sampler_ns = Some(speed));
    }
    for (method, figures) in Method::ALL.into_iter().zip(&mut methods) {
        steps.next(format!("{name}: spacing of {}", method.name()));
        figures.even = evenness::total(&evenness::of_levels(&octree(place, method))?);
        options.means.go_on()?;
    }
    let mut renderers = Vec::new();
    for view in VIEWS {
        steps.next(format!("{name}: pictures, {}", view.0));
        pictures::measure(options, view, place, &mut methods, &mut renderers)?;
    }
    for method in Method::ALL {
        remove(&octree(place, method))?;
    }
    place.clear("cloud")?;
    Ok(SceneReport { name, points, bytes, methods, renderers })
}

fn remove(folder: &Path) -> Result<()> {
    let fault = |source| MeasureError::Folder { path: folder.to_path_buf(), source };
    std::fs::remove_dir_all(folder).map_err(fault)
}
