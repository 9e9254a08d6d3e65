//! The page: what the figures are made into for people.

use super::report::{MethodReport, PatternReport, Report, SceneReport, mean};
use super::verdict::{Finding, findings};
use crate::measure::chart::{
    Axis, Bar, Bars, Before, Cell, Chart, Column, Figure, Group, Item, Lines, Mark, Page, Panel, Pattern,
    Patterns, Quantity, Scatter, Section, Series, Table,
};

/// The page of a report, beside an earlier one where there is one.
pub fn page(report: &Report, before: Option<&Report>) -> Page {
    Page {
        title: "Lodestone: speed against accuracy".into(),
        lead: lead(report),
        sections: vec![methods(report, before), samples(report, before), renderers(report, before)],
        foot: foot(report, before),
    }
}

/// The chart that says most: what the first scene costs by each method, and how
/// true its coarse levels are.
pub fn main_chart(report: &Report) -> Option<Chart> {
    Some(speed_accuracy(report, report.scenes.first()?, None).into())
}

fn lead(report: &Report) -> String {
    let findings = findings(report);
    let missed: Vec<&str> = findings.iter().filter(|f| !f.holds).map(|f| f.words.as_str()).collect();
    let verdict = match missed.as_slice() {
        [] => "all that is claimed for it below holds".to_string(),
        missed => format!("not all that is claimed for it holds ({})", missed.join("; ")),
    };
    format!(
        "Which method should I use for my cloud, and what does it cost me? {} scenes were converted and drawn \
         by every method on this machine. The default is poisson sampling with high-quality shading, and \
         {verdict}.",
        report.scenes.len()
    )
}

fn methods(report: &Report, before: Option<&Report>) -> Section {
    let mut items = vec![Item::Text(
        "Each mark is a way to convert: to the left is cheap, at the bottom is true. Error is the mean \
         difference of a pixel, of 255, between a picture of so many points of the coarse levels and the \
         picture of all points, over four views. The line joins the methods that none beats on both. \"Averaged\" is \
         `--lod-color average`: coarse levels show the mean colour of what their points stand for, and the \
         originals are kept beside."
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
        items.push(Item::Figure(figure));
    }
    Section { heading: "Converting".into(), items }
}

fn budget(report: &Report) -> u64 {
    report.budgets.first().copied().unwrap_or(0)
}

fn speed_accuracy(report: &Report, scene: &SceneReport, before: Option<&SceneReport>) -> Scatter {
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
    Scatter {
        title: format!("Speed against accuracy of {}", scene.name),
        x: Axis::log("processor time a million points", "s"),
        y: Axis::linear(&format!("error of pictures of {} points", grouped(budget)), "of 255"),
        size: Some(Quantity { title: "memory".into(), unit: "MB".into() }),
        series: scene.methods.iter().map(|method| Series::new(&method.method, vec![mark(method)])).collect(),
        front: true,
    }
}

/// What a scene's chart says, in a sentence.
fn says(report: &Report, scene: &SceneReport) -> String {
    let budget = budget(report);
    let Some(default) = scene.methods.iter().find(|method| method.is_default()) else {
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

fn method_table(report: &Report, scene: &SceneReport, before: Option<&SceneReport>) -> Table {
    let budget = budget(report);
    let column = Column::new;
    let row = |method: &MethodReport| {
        let earlier = before.and_then(|before| before.method(&method.method));
        let cell = |of: &dyn Fn(&MethodReport) -> f64| match earlier {
            Some(earlier) => Cell::Change { now: of(method), before: of(earlier) },
            None => Cell::Number(of(method)),
        };
        let millions = scene.points as f64 / 1e6;
        vec![
            Cell::Text(method.method.clone()),
            cell(&|m| m.wall.median),
            cell(&|m| millions / m.wall.median),
            cell(&|m| m.cpu_a_million(scene.points)),
            cell(&|m| m.peak as f64 / 1e6),
            cell(&|m| m.octree_bytes as f64 / 1e6),
            cell(&|m| m.error(budget)),
            cell(&|m| m.flip(budget)),
        ]
    };
    Table {
        caption: format!("{}, {} points", scene.name, grouped(scene.points)),
        columns: vec![
            column("method", ""),
            column("time", "s"),
            column("speed", "M points/s"),
            column("processor time", "s a million"),
            column("memory", "MB"),
            column("octree", "MB"),
            column("error", "of 255"),
            column("ꟻLIP", ""),
        ],
        rows: scene.methods.iter().map(row).collect(),
    }
}

fn samples(report: &Report, before: Option<&Report>) -> Section {
    let mut items = Vec::new();
    let percent = |share: f64| format!("{:.2} % too near", 100.0 * share);
    let pattern = |pattern: &PatternReport| Pattern {
        name: pattern.method.clone(),
        note: percent(pattern.even.inside_share() + pattern.even.across_share()),
        dots: pattern.dots.iter().map(|at| at.map(|c| f64::from(c) / 1000.0)).collect(),
        ..Pattern::default()
    };
    items.push(Item::Figure(Figure::new(
        Patterns {
            title: "Sample patterns".into(),
            patterns: report.patterns.iter().map(pattern).collect(),
        },
        "The default leaves no clusters, no holes and no rows, also where nodes meet.",
        "White noise on a plane, sampled twice as in an octree; four nodes meet in the middle of each picture.",
    )));
    let spectra = report.patterns.iter().map(|pattern| {
        let rings = pattern.spectrum.rings.iter().enumerate().skip(4);
        let wave = |ring: usize| ring as f64 / f64::from(pattern.spectrum.spacings);
        (pattern.method.clone(), rings.map(|(ring, power)| [wave(ring), *power]).collect())
    });
    items.push(Item::Figure(Figure::new(
        Lines::spectra(
            "Radial power spectra",
            Axis::linear("frequency", "waves a spacing"),
            spectra.collect(),
        ),
        "Blue noise has little power on the left, one soft peak near a wave a spacing, and no spikes.",
        "Power by frequency of the patterns, mean of several patterns; 1 is white noise.",
    )));
    let group = |scene: &SceneReport| {
        let earlier = before.and_then(|before| before.scene(&scene.name));
        let bar = |method: &MethodReport| {
            let own = method.sampler_ns?;
            let before = earlier.and_then(|it| it.method(&method.method)?.sampler_ns);
            Some(Bar {
                spread: Some([own.min, own.max]),
                before: before.map(|before| before.median),
                default: method.is_default(),
                ..Bar::new(&method.method, own.median)
            })
        };
        Group { name: scene.name.clone(), bars: scene.methods.iter().filter_map(bar).collect() }
    };
    items.push(Item::Figure(Figure::new(
        Bars {
            title: "Time of the samplers alone".into(),
            axis: Axis::log("time a point, one thread", "ns"),
            groups: report.scenes.iter().map(group).collect(),
        },
        "The default costs a fraction of the paper's shells and keeps its promise across nodes too.",
        "Only the time inside the sampler, while a tree of the first four million points is built.",
    )));
    items.push(Item::Table(even_table(report)));
    Section { heading: "Sampling".into(), items }
}

fn even_table(report: &Report) -> Table {
    let column = Column::new;
    let rows = report.scenes.iter().flat_map(|scene| {
        scene.methods.iter().map(|method| {
            vec![
                Cell::Text(scene.name.clone()),
                Cell::Text(method.method.clone()),
                Cell::Number(method.even.samples as f64),
                Cell::Number(100.0 * method.even.inside_share()),
                Cell::Number(100.0 * method.even.across_share()),
                Cell::Number(method.even.hole),
            ]
        })
    });
    let plane = report.patterns.iter().map(|pattern| {
        vec![
            Cell::Text("plane of noise".into()),
            Cell::Text(pattern.method.clone()),
            Cell::Number(pattern.even.samples as f64),
            Cell::Number(100.0 * pattern.even.inside_share()),
            Cell::Number(100.0 * pattern.even.across_share()),
            Cell::Number(pattern.even.hole),
        ]
    });
    Table {
        caption:
            "Samples of inner nodes: how many have another closer than the spacing, and the largest hole"
                .into(),
        columns: vec![
            column("scene", ""),
            column("method", ""),
            column("samples", ""),
            column("too near in their node", "%"),
            column("too near across nodes", "%"),
            column("largest hole", "spacings"),
        ],
        rows: rows.chain(plane).collect(),
    }
}

fn renderers(report: &Report, before: Option<&Report>) -> Section {
    let budgets = |scene: &SceneReport| -> Vec<u64> {
        let all = scene.renderers.iter().flat_map(|renderer| &renderer.pictures);
        let mut budgets: Vec<u64> = all.map(|frame| frame.picture.budget).collect();
        budgets.sort_unstable();
        budgets.dedup();
        budgets
    };
    // The mean over the views, a mark a budget.
    let marks = |scene: &SceneReport, style: &str, renderer: &str, flip: bool| -> Vec<[f64; 2]> {
        let Some(found) = scene.renderers.iter().find(|r| r.style == style && r.renderer == renderer) else {
            return Vec::new();
        };
        let of = |budget: u64| {
            let frames = || found.pictures.iter().filter(move |frame| frame.picture.budget == budget);
            let error = |frame: &super::report::FrameReport| match flip {
                true => frame.picture.flip,
                false => frame.picture.error,
            };
            [mean(frames().map(|frame| frame.draw_ms)), mean(frames().map(error))]
        };
        budgets(scene).into_iter().map(of).collect()
    };
    let panel = |scene: &SceneReport, flip: bool| {
        let earlier = before.and_then(|before| before.scene(&scene.name));
        let series = scene.renderers.iter().map(|renderer| {
            let (style, who) = (renderer.style.as_str(), renderer.renderer.as_str());
            let old = earlier.map(|earlier| marks(earlier, style, who, flip)).unwrap_or_default();
            let name = if who == "cpu" { style.to_string() } else { format!("{style}, {who}") };
            let now = marks(scene, style, who, flip).into_iter().enumerate().zip(budgets(scene));
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
        let chart = Lines {
            title: title.into(),
            x: Axis::log("time to draw", "ms"),
            y,
            panels: report.scenes.iter().map(|scene| panel(scene, flip)).collect(),
            ..Lines::default()
        };
        let caption = "A mark a budget, from 25 000 to 1.5 million points of the default's octree; means of \
                       four views of 512 × 512 pixels, beside the picture of all points at the highest setting.";
        Item::Figure(Figure::new(chart, says, caption))
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

/// What the charts of drawing say, in a sentence: the plainest way beside the best
/// at the same budget, over all scenes.
fn drawing_says(report: &Report) -> String {
    let frames = |style: &'static str, budget: u64| {
        let all = report.scenes.iter().flat_map(|scene| &scene.renderers);
        let those = all.filter(move |it| it.style == style && it.renderer == "cpu");
        those.flat_map(|it| &it.pictures).filter(move |frame| frame.picture.budget == budget)
    };
    let (plain, best) = (super::pictures::PLAINEST, super::pictures::BEST);
    let mut budgets: Vec<u64> = report
        .scenes
        .iter()
        .flat_map(|scene| &scene.renderers)
        .flat_map(|it| it.pictures.iter().map(|frame| frame.picture.budget))
        .collect();
    budgets.sort_unstable();
    budgets.dedup();
    let budget = budgets.get(budgets.len() / 2).copied().unwrap_or(0);
    let times = |of: fn(&super::report::FrameReport) -> f64| {
        mean(frames(best, budget).map(of)) / mean(frames(plain, budget).map(of))
    };
    let (error, time) = (times(|frame| frame.picture.error), times(|frame| frame.draw_ms));
    if !error.is_finite() || !time.is_finite() {
        return "Every way to draw comes to the same picture.".to_string();
    }
    format!(
        "At {} points {best} shading errs {error:.2} × as much as {plain} points and takes {time:.1} × as long.",
        grouped(budget)
    )
}

fn foot(report: &Report, before: Option<&Report>) -> Vec<(String, String)> {
    let pair = |name: &str, value: String| (name.to_string(), value);
    let commit = if report.commit.is_empty() { "unknown" } else { &report.commit };
    let budgets: Vec<String> = report.budgets.iter().map(|budget| grouped(*budget)).collect();
    let mut foot = vec![
        pair("machine", report.machine.clone()),
        pair("lodestone", format!("{}, commit {commit}", report.version)),
        pair("threads", report.threads.to_string()),
        pair("conversions a method", format!("{} in turns; medians", report.rounds)),
        pair("seed of the scenes", report.seed.to_string()),
        pair("budgets of the methods' pictures", format!("{} points", budgets.join(", "))),
    ];
    if let Some(before) = before {
        foot.push(pair(
            "beside",
            format!("{}, commit {}, {}", before.version, before.commit, before.machine),
        ));
    }
    let say = |finding: &Finding| {
        format!("{}: {}", if finding.holds { "holds" } else { "does not hold" }, finding.words)
    };
    foot.extend(findings(report).iter().map(|finding| pair("claim", say(finding))));
    foot
}

fn grouped(number: u64) -> String {
    crate::verify::grouped(number)
}

#[cfg(test)]
mod tests {
    use super::super::report::tests_support::{method, report};
    use super::*;

    #[test]
    fn the_page_has_every_chart_and_every_method() {
        let now = report(vec![method("poisson", 1.0, 2.0), method("random", 0.7, 4.0)]);
        let mut before = now.clone();
        before.scenes[0].methods[1] = method("random", 0.9, 5.0);
        for before in [None, Some(&before)] {
            let html = page(&now, before).html();
            assert_eq!(html.matches("<svg").count(), 6, "{html}");
            assert!(html.contains("a &lt;machine&gt;") && html.contains("0123456789ab"));
            assert!(html.contains("random takes 0.70 × the processor time of poisson"), "{html}");
            assert!(!html.contains("NaN") && !html.contains("inf "), "{html}");
        }
        assert!(main_chart(&now).is_some_and(|chart| chart.svg_standalone().contains("poisson")));
    }

    #[test]
    fn a_report_is_read_again_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let (path, now) = (folder.path().join("report.json"), report(vec![method("poisson", 1.0, 2.0)]));
        std::fs::write(&path, serde_json::to_vec(&now).unwrap()).unwrap();
        let back = super::super::read(&path).unwrap();
        assert_eq!(page(&back, None).html(), page(&now, None).html());
        std::fs::write(&path, "{}").unwrap();
        let error = super::super::read(&path).unwrap_err().to_string();
        assert!(error.contains("report.json") && error.contains("no report"), "{error}");
    }
}
