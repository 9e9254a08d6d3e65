//! How even samples are, and what samplers cost by themselves.

use crate::lab::chart::{
    Axis, Bar, BarGroup, Bars, Better, Figure, PageItem, Panel, Pattern, Patterns, Plot, PlotStyle,
    ReferenceLine, Section, Series, Table, TableCell, TableColumn,
};
use crate::lab::compare::report::{ComparisonReport, MethodReport, PatternReport, SceneReport};
use crate::lab::sampling::evenness::Evenness;

pub fn section(report: &ComparisonReport, before: Option<&ComparisonReport>) -> Section {
    let mut items = Vec::new();
    let percent = |share: f64| format!("{:.2} % too near", 100.0 * share);
    let pattern = |pattern: &PatternReport| Pattern {
        name: pattern.method.clone(),
        note: percent(pattern.even.inside_share() + pattern.even.across_share()),
        dots: pattern.dots.iter().map(|at| at.map(|c| f64::from(c) / 1000.0)).collect(),
    };
    items.push(PageItem::Figure(Figure::new(
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
        let line = Series::line("", rings.map(|(ring, power)| [wave(ring), *power]));
        Panel { name: pattern.method.clone(), series: vec![line] }
    });
    items.push(PageItem::Figure(Figure::new(
        Plot {
            title: "Radial power spectra".into(),
            x: Axis::linear("frequency", "waves a spacing").better(Better::Neither),
            y: Axis::linear("power", "").better(Better::Neither),
            panels: spectra.collect(),
            style: PlotStyle::Curves,
            references: vec![ReferenceLine { y: 1.0, name: "white noise".into() }],
            ..Plot::default()
        },
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
        BarGroup { name: scene.name.clone(), bars: scene.methods.iter().filter_map(bar).collect() }
    };
    items.push(PageItem::Figure(Figure::new(
        Bars {
            title: "Time of the samplers alone".into(),
            axis: Axis::log("time a point, one thread", "ns"),
            groups: report.scenes.iter().map(group).collect(),
        },
        "The default costs a fraction of the paper's shells and keeps its promise across nodes too.",
        "Only the time inside the sampler, while a tree of the first four million points is built.",
    )));
    items.push(PageItem::Table(even_table(report)));
    Section { heading: "Sampling".into(), items }
}

fn even_table(report: &ComparisonReport) -> Table {
    let column = TableColumn::new;
    let row = |scene: &str, method: &str, even: &Evenness| {
        vec![
            TableCell::Text(scene.to_string()),
            TableCell::Text(method.to_string()),
            TableCell::Number(even.samples as f64),
            TableCell::Number(100.0 * even.inside_share()),
            TableCell::Number(100.0 * even.across_share()),
            TableCell::Number(even.hole),
        ]
    };
    let rows = report.scenes.iter().flat_map(|scene| {
        // With other colours they are the same samples.
        let methods = scene.methods.iter().filter(|method| method.sampler_ns.is_some());
        methods.map(move |method| row(&scene.name, &method.method, &method.even))
    });
    let plane = report.patterns.iter().map(|it| row("plane of noise", &it.method, &it.even));
    Table {
        caption:
            "Samples of inner nodes: how many have another closer than the spacing, in their own node or in another one, and the largest hole"
                .into(),
        columns: vec![
            column("scene", ""),
            column("method", ""),
            column("samples", ""),
            column("inside nodes", "%"),
            column("across nodes", "%"),
            column("largest hole", "spacings"),
        ],
        rows: rows.chain(plane).collect(),
    }
}
