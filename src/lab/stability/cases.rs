//! The scenes of the table.

use super::options::StabilityOptions;
use crate::lab::synth::{Recipe, SceneKind};

/// A scene and what it is called.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub title: String,
    pub recipe: Recipe,
}

impl Case {
    fn of(kind: SceneKind, points: u64) -> Case {
        Case::called(kind.name(), Recipe::new(kind, points, 1))
    }

    fn called(title: &str, recipe: Recipe) -> Case {
        Case { title: title.to_string(), recipe }
    }

    /// The scene that all others are held against.
    pub fn benign(points: u64) -> Case {
        Case::of(SceneKind::Terrain, points)
    }
}

/// What was wished for, by the number of points, so that the benign scene is
/// made once for each.
pub fn wished(options: &StabilityOptions) -> Vec<Case> {
    let points = options.points;
    let mut cases: Vec<Case> = SceneKind::ALL.map(|kind| Case::of(kind, points)).into();
    let duplicates = Recipe::new(SceneKind::Duplicates, points, 1);
    cases.push(Case::called("duplicates, pairs", Recipe { twins: true, ..duplicates }));
    cases.push(Case::called("duplicates, 99 %", Recipe { share: 0.99, ..duplicates }));
    let town = Recipe::new(SceneKind::Town, points, 1);
    cases.push(Case::called("town, 1 cm in 10 km", Recipe { teapot: true, ..town }));
    if options.full {
        let outliers = Recipe::new(SceneKind::Outliers, 20_000_000, 1);
        cases.push(Case::called("outliers", outliers));
        cases.push(Case::called("outliers, 780 km", Recipe { span: 780.0, ..outliers }));
        cases.push(Case::called(
            "town, 1 cm in 10 km",
            Recipe { teapot: true, ..Recipe::new(SceneKind::Town, 20_000_000, 1) },
        ));
        cases.push(Case::called("volume, 300³", Recipe::new(SceneKind::Volume, 27_000_000, 1)));
        cases.push(Case::called(
            "duplicates, one position",
            Recipe { share: 1.0, ..Recipe::new(SceneKind::Duplicates, 40_000_000, 1) },
        ));
    }
    cases.retain(|case| options.scenes.is_empty() || options.scenes.contains(&case.recipe.kind));
    cases
}
