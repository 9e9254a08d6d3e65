//! What each way to draw costs, and how near it comes to the picture of all points.

use std::collections::BTreeSet;
use std::slice;

use crate::lab::chart::{Axis, Before, Figure, Mark, PageItem, Panel, Plot, PlotStyle, Section, Series};
use crate::lab::compare::pictures::{BEST, PLAINEST};
use crate::lab::compare::report::{ComparisonReport, FrameReport, SceneReport, mean};
use crate::words::grouped;

pub fn section(report: &ComparisonReport, before: Option<&ComparisonReport>) -> Section {
    // The mean over the views, a mark a budget.
    let marks = |scene: &SceneReport, style: &str, renderer: &str, flip: bool| -> Vec<[f64; 2]> {
        let Some(found) = scene.renderers.iter().find(|r| r.style == style && r.renderer == renderer) else {
            return Vec::new();
        };
        let of = |budget: u64| {
            let frames = || found.pictures.iter().filter(move |frame| frame.picture.budget == budget);
            let error = |frame: &FrameReport| match flip {
                true => frame.picture.flip,
                false => frame.picture.error,
            };
            [mean(frames().map(|frame| frame.draw_ms)), mean(frames().map(error))]
        };
        budgets(slice::from_ref(scene)).into_iter().map(of).collect()
    };
    let panel = |scene: &SceneReport, flip: bool| {
        let earlier = before.and_then(|before| before.scene(&scene.name));
        let series = scene.renderers.iter().map(|renderer| {
            let (style, who) = (renderer.style.as_str(), renderer.renderer.as_str());
            let old = earlier.map(|earlier| marks(earlier, style, who, flip)).unwrap_or_default();
            let name = if who == "cpu" { style.to_string() } else { format!("{style}, {who}") };
            let now =
                marks(scene, style, who, flip).into_iter().enumerate().zip(budgets(slice::from_ref(scene)));
            let mark = now.map(|((place, [x, y]), budget)| Mark {
                note: format!("{} points at most", grouped(budget)),
                before: old.get(place).map(|[x, y]| Before { x: *x, y: *y, size: None }),
                ..Mark::at(x, y)
            });
            Series::new(&name, mark.collect())
        });
        Panel { name: scene.name.clone(), series: series.collect() }
    };
    let figure = |flip: bool, title: &str, y: Axis, says: &str| {
        let chart = Plot {
            title: title.into(),
            x: Axis::log("time to draw", "ms"),
            y,
            panels: report.scenes.iter().map(|scene| panel(scene, flip)).collect(),
            style: PlotStyle::Lines,
            ..Plot::default()
        };
        let caption = "A mark a budget, from 25 000 to 1.5 million points of the default's octree; means of \
                       four views of 512 × 512 pixels, beside the picture of all points at the highest setting.";
        PageItem::Figure(Figure::new(chart, says, caption))
    };
    let items = vec![
        figure(
            false,
            "Error against time of the renderers",
            Axis::linear("mean pixel error", "of 255"),
            &drawing_says(report),
        ),
        figure(
            true,
            "ꟻLIP against time of the renderers",
            Axis::linear("mean ꟻLIP", ""),
            "The same by what an eye sees that flips between the pictures.",
        ),
    ];
    Section { heading: "Drawing".into(), items }
}

/// The budgets that scenes were drawn with, from the least.
fn budgets(scenes: &[SceneReport]) -> Vec<u64> {
    let all = scenes.iter().flat_map(|scene| &scene.renderers).flat_map(|renderer| &renderer.pictures);
    let budgets: BTreeSet<u64> = all.map(|frame| frame.picture.budget).collect();
    budgets.into_iter().collect()
}

/// What the charts of drawing say, in a sentence: the plainest way beside the best
/// at the same budget, over all scenes.
fn drawing_says(report: &ComparisonReport) -> String {
    let frames = |style: &'static str, budget: u64| {
        let all = report.scenes.iter().flat_map(|scene| &scene.renderers);
        let those = all.filter(move |it| it.style == style && it.renderer == "cpu");
        those.flat_map(|it| &it.pictures).filter(move |frame| frame.picture.budget == budget)
    };
    let (plain, best) = (PLAINEST, BEST);
    let budgets = budgets(&report.scenes);
    let budget = budgets.get(budgets.len() / 2).copied().unwrap_or(0);
    let times = |of: fn(&FrameReport) -> f64| {
        mean(frames(best, budget).map(of)) / mean(frames(plain, budget).map(of))
    };
    let (error, time) = (times(|frame| frame.picture.error), times(|frame| frame.draw_ms));
    if !error.is_finite() || !time.is_finite() {
        return "Every way to draw comes to the same picture.".to_string();
    }
    format!(
        "At {} points {best} shading errs {error:.2} × as much as points of {plain} and takes {time:.1} × as long.",
        grouped(budget)
    )
}
