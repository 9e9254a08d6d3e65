//! The scenes of the table, and how they are made.

use std::path::Path;
use std::process::Command;

use super::{Result, StabilityError, Wishes};
use crate::measure::process;
use crate::synth::{Kind, Recipe};

/// The point format of all clouds: colours, 26 bytes.
const FORMAT: &str = "2";

/// A scene and what it is called.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub title: String,
    pub recipe: Recipe,
}

impl Case {
    fn of(kind: Kind, points: u64) -> Case {
        let recipe = Recipe::new(kind, points, 1);
        Case { title: format!("{kind:?}").to_lowercase(), recipe }
    }

    fn called(title: &str, recipe: Recipe) -> Case {
        Case { title: title.to_string(), recipe }
    }

    /// The scene that all others are held against.
    pub fn benign(points: u64) -> Case {
        Case::of(Kind::Terrain, points)
    }

    /// Makes the cloud, a folder with one file or several.
    pub fn make(&self, wishes: &Wishes, folder: &Path) -> Result<()> {
        let fault = |source| StabilityError::Folder { path: folder.to_path_buf(), source };
        match std::fs::remove_dir_all(folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(fault(error)),
            _ => std::fs::create_dir_all(folder).map_err(fault)?,
        }
        let Recipe { kind, points, seed, share, twins, teapot, span } = self.recipe;
        let mut command = Command::new(&wishes.program);
        command.args(["synth", &format!("{kind:?}").to_lowercase(), "--format", FORMAT]);
        command.args(["--points", &points.to_string(), "--seed", &seed.to_string()]);
        command.args(["--share", &share.to_string()]);
        command.args(["--span", &span.to_string()]);
        command.args(twins.then_some("--twins")).args(teapot.then_some("--teapot"));
        // The scene of many tiles makes a folder of its own.
        let output = if kind == Kind::Strips { folder.to_path_buf() } else { folder.join("cloud.las") };
        command.arg("-o").arg(output);
        let made = process::run_until(&mut command, &wishes.cancel);
        wishes.ended(&format!("making {}", self.title), made)?;
        Ok(())
    }
}

/// What was wished for, by the number of points, so that the benign scene is
/// made once for each.
pub fn wished(wishes: &Wishes) -> Vec<Case> {
    let points = wishes.points;
    let mut cases: Vec<Case> = Kind::ALL.map(|kind| Case::of(kind, points)).into();
    let duplicates = Recipe::new(Kind::Duplicates, points, 1);
    cases.push(Case::called("duplicates, pairs", Recipe { twins: true, ..duplicates }));
    cases.push(Case::called("duplicates, 99 %", Recipe { share: 0.99, ..duplicates }));
    let town = Recipe::new(Kind::Town, points, 1);
    cases.push(Case::called("town, 1 cm in 10 km", Recipe { teapot: true, ..town }));
    if wishes.full {
        let outliers = Recipe::new(Kind::Outliers, 20_000_000, 1);
        cases.push(Case::called("outliers", outliers));
        cases.push(Case::called("outliers, 780 km", Recipe { span: 780.0, ..outliers }));
        cases.push(Case::called(
            "town, 1 cm in 10 km",
            Recipe { teapot: true, ..Recipe::new(Kind::Town, 20_000_000, 1) },
        ));
        cases.push(Case::called("volume, 300³", Recipe::new(Kind::Volume, 27_000_000, 1)));
        cases.push(Case::called(
            "duplicates, one position",
            Recipe { share: 1.0, ..Recipe::new(Kind::Duplicates, 40_000_000, 1) },
        ));
    }
    cases.retain(|case| wishes.scenes.is_empty() || wishes.scenes.contains(&case.recipe.kind));
    cases
}
