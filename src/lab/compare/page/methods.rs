//! What each method costs, and how true its coarse levels are.

use crate::lab::chart::{
    Axis, Before, Figure, Mark, PageItem, Panel, Plot, Quantity, Section, Series, Table, TableCell,
    TableColumn,
};
use crate::lab::compare::report::{ComparisonReport, MethodReport, SceneReport};
use crate::words::grouped;

pub fn section(report: &ComparisonReport, before: Option<&ComparisonReport>) -> Section {
    let mut items = vec![PageItem::Text(
        "Each mark is a way to convert: to the left is cheap, at the bottom is true. Error is the mean \
         difference of a pixel, of 255, between a picture of so many points of the coarse levels and the \
         picture of all points, over four views. The line joins the methods that none beats on both. \"Averaged\" is \
         --lod-color average: coarse levels show the mean colour of what their points stand for, and the \
         originals are kept beside. \"The figures\" under a chart have pictures of fewer and of more points too."
            .into(),
    )];
    for scene in &report.scenes {
        let earlier = before.and_then(|before| before.scene(&scene.name));
        let chart = speed_accuracy(report, scene, earlier);
        let says = says(report, scene);
        let caption = format!(
            "{}, {} points: processor seconds a million points and error; the area is memory.",
            scene.name,
            grouped(scene.points)
        );
        let mut figure = Figure::new(chart, &says, &caption);
        figure.table = Some(method_table(report, scene, earlier));
        items.push(PageItem::Figure(figure));
    }
    Section { heading: "Converting".into(), items }
}

/// The budget that the charts show: the middle one. The tables have them all.
fn budget(report: &ComparisonReport) -> u64 {
    report.budgets.get(report.budgets.len() / 2).copied().unwrap_or(0)
}

pub fn speed_accuracy(report: &ComparisonReport, scene: &SceneReport, before: Option<&SceneReport>) -> Plot {
    let budget = budget(report);
    let mark = |method: &MethodReport| Mark {
        x: method.cpu_a_million(scene.points),
        y: method.error(budget),
        size: Some(method.peak as f64 / 1e6),
        default: method.is_default(),
        before: before.and_then(|before| {
            let earlier = before.method(&method.method)?;
            Some(Before {
                x: earlier.cpu_a_million(before.points),
                y: earlier.error(budget),
                size: Some(earlier.peak as f64 / 1e6),
            })
        }),
        note: format!("{:.2} s for {} points", method.wall.median, grouped(scene.points)),
        ..Mark::default()
    };
    let series = scene.methods.iter().map(|method| Series::new(&method.method, vec![mark(method)])).collect();
    Plot {
        title: format!("Speed against accuracy of {}", scene.name),
        x: Axis::log("processor time a million points", "s"),
        y: Axis::linear(&format!("error of pictures of {} points", grouped(budget)), "of 255"),
        size: Some(Quantity { title: "memory".into(), unit: "MB".into() }),
        panels: vec![Panel { name: String::new(), series }],
        ..Plot::default()
    }
}

/// What a scene's chart says, in a sentence.
fn says(report: &ComparisonReport, scene: &SceneReport) -> String {
    let budget = budget(report);
    let Some(default) = scene.default_method() else {
        return String::new();
    };
    let others = scene.methods.iter().filter(|method| !method.is_default());
    let Some(cheapest) = others.min_by(|a, b| a.cpu.median.total_cmp(&b.cpu.median)) else {
        return String::new();
    };
    let (time, error) =
        (cheapest.cpu.median / default.cpu.median, cheapest.error(budget) / default.error(budget));
    if !time.is_finite() || !error.is_finite() {
        return format!("{}: too small a cloud to tell the methods apart.", scene.name);
    }
    format!(
        "{}: {} takes {time:.2} × the processor time of {} and its pictures err {error:.2} × as much.",
        scene.name, cheapest.method, default.method
    )
}

fn method_table(report: &ComparisonReport, scene: &SceneReport, before: Option<&SceneReport>) -> Table {
    let column = TableColumn::new;
    let row = |method: &MethodReport| {
        let earlier = before.and_then(|before| before.method(&method.method));
        let cell = |of: &dyn Fn(&MethodReport) -> f64| match earlier {
            Some(earlier) => TableCell::Change { now: of(method), before: of(earlier) },
            None => TableCell::Number(of(method)),
        };
        let millions = scene.points as f64 / 1e6;
        let costs = [
            TableCell::Text(method.method.clone()),
            cell(&|m| m.wall.median),
            cell(&|m| millions / m.wall.median),
            cell(&|m| m.cpu_a_million(scene.points)),
            cell(&|m| m.peak as f64 / 1e6),
            cell(&|m| m.octree_bytes as f64 / 1e6),
        ];
        let errors = report
            .budgets
            .iter()
            .flat_map(|budget| [cell(&|m| m.error(*budget)), cell(&|m| m.flip(*budget))]);
        costs.into_iter().chain(errors).collect()
    };
    let costs = [
        column("method", ""),
        column("time", "s"),
        column("speed", "M points/s"),
        column("processor time", "s a million"),
        column("memory", "MB"),
        column("octree", "MB"),
    ];
    let errors = report.budgets.iter().flat_map(|budget| {
        let points = format!("{}k", budget / 1000);
        [column(&format!("error, {points}"), "of 255"), column(&format!("ꟻLIP, {points}"), "")]
    });
    Table {
        caption: format!("{}, {} points", scene.name, grouped(scene.points)),
        columns: costs.into_iter().chain(errors).collect(),
        rows: scene.methods.iter().map(row).collect(),
    }
}
