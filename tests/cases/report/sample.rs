//! A page with every kind of chart and what makes drawing hard: crowds, earlier runs,
//! values without a place, names that are markup. The figures are made up.

use lodestone::lab::chart::{
    Axis, Bar, BarGroup, Bars, Before, Better, Figure, Mark, Page, PageItem, Panel, Pattern, Patterns, Plot,
    PlotStyle, Quantity, ReferenceLine, Section, Series, Table, TableCell, TableColumn,
};

/// Numbers from 0 to 1 that look random and are the same everywhere.
pub fn noise(seed: u64) -> impl Iterator<Item = f64> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    std::iter::repeat_with(move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    })
}

/// A measurement of one method: name, time, error, memory and the earlier ones.
type Sampler = (&'static str, f64, f64, f64, Option<[f64; 2]>);

const SAMPLERS: [Sampler; 8] = [
    ("inside-out", 52.0, 0.067, 210.0, Some([58.0, 0.068])),
    ("paper's shells", 297.0, 0.066, 180.0, None),
    ("hash", 41.0, 0.171, 340.0, Some([39.0, 0.19])),
    ("Morton", 48.0, 0.091, 150.0, None),
    ("grid cells", 12.6, 1.4, 40.0, None),
    ("random in grid", 13.5, 0.288, 45.0, Some([13.4, 0.288])),
    ("dart throwing <b>&amp;", 310.0, 0.3, 500.0, None),
    ("streaming", 54.0, 0.069, 95.0, None),
];

/// The panel of a plot that has only one.
fn alone(series: Vec<Series>) -> Vec<Panel> {
    vec![Panel { name: String::new(), series }]
}

pub fn samplers() -> Plot {
    let series = SAMPLERS.map(|(name, x, y, size, before)| {
        let mark = Mark {
            size: Some(size),
            default: name == "inside-out",
            before: before.map(|[x, y]| Before { x, y, size: Some(size * 1.1) }),
            ..Mark::at(x, y)
        };
        Series::new(name, vec![mark])
    });
    Plot {
        title: "Samplers: time against unevenness".into(),
        x: Axis::log("time a point", "ns"),
        y: Axis::log("power at low frequencies", "white noise = 1"),
        size: Some(Quantity { title: "memory".into(), unit: "MB".into() }),
        panels: alone(series.into()),
        ..Plot::default()
    }
}

/// Several marks a method, one of which has no place on its axis.
pub fn renderers() -> Plot {
    let budgets = [("100 k", 1.0), ("300 k", 2.6), ("1 M", 7.9), ("3 M", 22.0)];
    let series = |name: &str, pace: f64, error: f64| {
        let mark = |(label, cost): (&str, f64)| Mark {
            label: label.into(),
            default: name == "CPU" && label == "1 M",
            ..Mark::at(pace * cost, error / cost.powf(0.45))
        };
        Series::new(name, budgets.map(mark).into())
    };
    let mut lost = series("PotreeConverter", 5.0, 0.4);
    lost.marks[1].y = f64::NAN;
    Plot {
        title: "Renderers: time a frame against picture error".into(),
        x: Axis::log("time a frame", "ms"),
        y: Axis::linear("FLIP", ""),
        panels: alone(vec![series("CPU", 4.0, 0.21), series("GPU", 0.4, 0.22), lost]),
        ..Plot::default()
    }
}

/// More marks in one place than there is room for labels.
pub fn crowd() -> Plot {
    let mut noise = noise(7);
    let mut next = || noise.next().unwrap_or(0.5);
    let marks = (0..40).map(|at| {
        let name = format!("method number {at}");
        Series::new(&name, vec![Mark::at(1.0 + 0.04 * next(), 10.0 + next())])
    });
    Plot {
        title: "A crowd".into(),
        x: Axis::linear("points a second", "M").better(Better::Higher),
        y: Axis::linear("score", "").better(Better::Higher),
        panels: alone(marks.collect()),
        ..Plot::default()
    }
}

fn series(name: &str, speed: f64, floor: f64, earlier: bool) -> Series {
    let at = |k: i32| [speed * 2.0_f64.powi(k), floor + 0.4 * 0.62_f64.powi(k)];
    let mark = |k: i32| {
        let [x, y] = at(k);
        let before = earlier.then_some(Before { x: x * 1.3, y: y * 1.1, size: None });
        Mark { before, ..Mark::at(x, y) }
    };
    Series::new(name, (0..7).map(mark).collect())
}

fn methods(scale: f64, earlier: bool) -> Vec<Series> {
    vec![
        series("inside-out", 0.9 * scale, 0.01, earlier),
        series("random in grid", 0.5 * scale, 0.04, false),
        series("hash", 0.7 * scale, 0.012, false),
    ]
}

pub fn error_over_time(earlier: bool) -> Plot {
    Plot {
        title: "Picture error over time".into(),
        x: Axis::log("time", "ms"),
        y: Axis::log("FLIP", ""),
        panels: vec![Panel { name: String::new(), series: methods(1.0, earlier) }],
        references: vec![ReferenceLine { y: 0.02, name: "nobody sees it".into() }],
        style: PlotStyle::Lines,
        ..Plot::default()
    }
}

pub fn scenes() -> Plot {
    let names = ["terrain", "town", "interior", "object", "volume"];
    let panel = |(at, name): (usize, &str)| Panel {
        name: name.into(),
        series: methods(1.0 + at as f64 * 0.6, at == 2),
    };
    Plot { panels: names.into_iter().enumerate().map(panel).collect(), ..error_over_time(false) }
}

pub fn spectra() -> Plot {
    let spectrum = |rise: f64, peak: f64, seed: u64| -> Vec<[f64; 2]> {
        let points = noise(seed).take(120).enumerate().map(|(k, noise)| {
            let f = (k + 1) as f64 / 40.0;
            let bump = peak * (-(f - 1.0).powi(2) * 30.0).exp();
            [f, (1.0 / (1.0 + (-(f - 0.85) * rise).exp()) + bump + 0.1 * (noise - 0.5)).max(0.0)]
        });
        points.collect()
    };
    let patterns = [("inside-out", 25.0, 1.1, 1), ("hash", 12.0, 0.5, 2), ("random", 0.1, 0.4, 3)];
    let panel = |(name, rise, peak, seed): (&str, f64, f64, u64)| Panel {
        name: name.into(),
        series: vec![Series::line("", spectrum(rise, peak, seed))],
    };
    Plot {
        title: "Power spectra of samples on a plane".into(),
        x: Axis::linear("frequency", "1 = principal").better(Better::Neither),
        y: Axis::linear("power", "").better(Better::Neither),
        panels: patterns.map(panel).into(),
        style: PlotStyle::Curves,
        references: vec![ReferenceLine { y: 1.0, name: "white noise".into() }],
        ..Plot::default()
    }
}

pub fn stages(axis: Axis) -> Bars {
    let group = |name: &str, scale: f64| {
        let bar = |(at, (name, x, _, _, before)): (usize, &Sampler)| Bar {
            before: before.map(|[x, _]| x * scale),
            spread: (at % 2 == 0).then_some([x * scale * 0.93, x * scale * 1.12]),
            default: at == 0,
            ..Bar::new(name, x * scale)
        };
        BarGroup { name: name.into(), bars: SAMPLERS.iter().take(6).enumerate().map(bar).collect() }
    };
    Bars {
        title: "Time a point by scene".into(),
        axis,
        groups: vec![group("terrain", 1.0), group("interior", 1.17)],
    }
}

pub fn patterns() -> Patterns {
    let pattern = |name: &str, spacing: f64, seed: u64| {
        let mut noise = noise(seed);
        let mut dots: Vec<[f64; 2]> = Vec::new();
        for _ in 0..6000 {
            let dot = [noise.next().unwrap_or(0.5), noise.next().unwrap_or(0.5)];
            let far = |other: &[f64; 2]| (other[0] - dot[0]).hypot(other[1] - dot[1]) >= spacing;
            if dots.len() < 900 && dots.iter().all(far) {
                dots.push(dot);
            }
        }
        let note = format!("{} dots", dots.len());
        Pattern { name: name.into(), note, dots }
    };
    let lattice = (0..900).map(|k| [((k % 30) as f64 + 0.5) / 30.0, ((k / 30) as f64 + 0.5) / 30.0]);
    let lattice =
        Pattern { name: "lattice".into(), note: "spikes along the axes".into(), dots: lattice.collect() };
    Patterns {
        title: "What samples look like".into(),
        patterns: vec![pattern("Poisson disk", 0.027, 3), pattern("white noise", 0.0, 4), lattice],
    }
}

/// Charts with as good as nothing in them.
pub fn edges() -> Vec<PageItem> {
    let one = |x: f64, y: f64| Plot {
        title: "One mark".into(),
        panels: alone(vec![Series::new("alone", vec![Mark::at(x, y)])]),
        ..samplers()
    };
    let none = Plot { panels: alone(vec![series("nowhere", -1.0, f64::INFINITY, false)]), ..samplers() };
    let line = |k: i32| Series::line(&format!("{k}"), [[10f64.powi(k * 3), 10f64.powi(-k)]]);
    let huge =
        Plot { title: "From tiny to huge".into(), panels: alone((-9..=9).map(line).collect()), ..samplers() };
    let figure = |chart: Plot, says: &str| PageItem::Figure(Figure::new(chart, says, ""));
    vec![
        figure(one(3.0, 4.0), "One mark is its own front."),
        figure(none, "What has no place is named."),
        figure(huge, "Twenty decades."),
        PageItem::Figure(Figure::new(Plot { style: PlotStyle::Lines, ..Plot::default() }, "No lines.", "")),
        PageItem::Figure(Figure::new(Bars::default(), "No bars.", "")),
        PageItem::Figure(Figure::new(Patterns::default(), "No patterns.", "")),
    ]
}

/// Charts as nobody would make them up: scatters and lines of all densities.
pub fn strange(seed: u64) -> Page {
    let mut noise = noise(seed);
    let mut next = move || noise.next().unwrap_or(0.5);
    let words = ["a", "inside-out", "PotreeConverter 2.1", "random", "WWW", "iii", "GPU, software Vulkan"];
    let mut items = Vec::new();
    for at in 0..16 {
        let reach = 10_f64.powf(6.0 * next() - 3.0);
        let axis = |title: &str, log: bool, better| {
            if log { Axis::log(title, "ns").better(better) } else { Axis::linear(title, "").better(better) }
        };
        let better = [Better::Lower, Better::Higher, Better::Neither][at % 3];
        let x = axis("time a point of the whole cloud", next() < 0.5, better);
        let y = axis("error", next() < 0.5, Better::Lower);
        let count = 1 + (next() * 9.0) as usize;
        let series: Vec<Series> = (0..count)
            .map(|number| {
                let name = format!("{} {number}", words[(next() * words.len() as f64) as usize]);
                let marks = (0..1 + (next() * 5.0) as usize).map(|_| {
                    let place = [next() * reach, next() + 0.01];
                    let before = (next() < 0.2).then(|| Before { x: place[0] * 1.2, y: next(), size: None });
                    let label = if next() < 0.3 { "1 M".to_string() } else { String::new() };
                    Mark {
                        label,
                        before,
                        size: Some(next()),
                        default: next() < 0.1,
                        ..Mark::at(place[0], place[1])
                    }
                });
                Series::new(&name, marks.collect())
            })
            .collect();
        let title = format!("Strange chart {at} of {seed}");
        let size = Some(Quantity { title: "memory".into(), unit: "MB".into() });
        let panel = |k: usize| Panel { name: format!("scene {k}"), series: series.clone() };
        let (panels, style, references) = match at % 4 {
            0 | 2 => (alone(series), PlotStyle::Front, Vec::new()),
            rest => {
                let style = if rest == 3 { PlotStyle::Curves } else { PlotStyle::Lines };
                let level = ReferenceLine { y: 0.5, name: "half".into() };
                ((0..1 + at % 5).map(panel).collect(), style, vec![level])
            }
        };
        let chart = Plot { title, x, y, panels, style, size, references };
        items.push(PageItem::Figure(Figure::new(chart, "", "")));
    }
    Page { sections: vec![Section { heading: "Strange".into(), items }], ..Page::default() }
}

pub fn page() -> Page {
    let figure = |chart: lodestone::lab::chart::Chart, says: &str, caption: &str| {
        PageItem::Figure(Figure::new(chart, says, caption))
    };
    let table = Table {
        caption: "Scenes that break converters".into(),
        columns: vec![
            TableColumn::new("scene", ""),
            TableColumn::new("time", "s"),
            TableColumn::new("against terrain", ""),
        ],
        rows: vec![
            vec![
                TableCell::Text("duplicates".into()),
                TableCell::Number(1.234),
                TableCell::Change { now: 1.2, before: 1.0 },
            ],
            vec![TableCell::Text("<outliers>".into()), TableCell::Nothing, TableCell::Nothing],
        ],
    };
    let section = |heading: &str, items| Section { heading: heading.into(), items };
    Page {
        title: "Speed against accuracy".into(),
        lead: "What samplers and renderers cost, and what one gets for it.\n\nLower left is better throughout, unless an axis says otherwise.".into(),
        sections: vec![
            section("Samplers", vec![
                PageItem::Text("Each sampler took samples of the same clouds, in turns.".into()),
                figure(samplers().into(), "Inside-out is as even as the paper's shells, in a fifth of the time.", "20 M points of terrain, one thread, medians of five."),
                figure(stages(Axis::linear("time a point", "ns")).into(), "The scene matters little.", "Whiskers: fastest and slowest of five."),
                figure(stages(Axis::log("time a point", "ns")).into(), "The same on a logarithmic axis.", ""),
                figure(patterns().into(), "Blue noise has neither clumps nor rows.", "A square of one node."),
                figure(spectra().into(), "Little power below the principal frequency.", "White noise is 1."),
            ]),
            section("Renderers", vec![
                figure(renderers().into(), "The GPU is ten times as fast.", "1600 × 900 pixels."),
                figure(error_over_time(true).into(), "The error halves with every doubling.", ""),
                figure(scenes().into(), "In all scenes.", ""),
            ]),
            section("Limits", {
                let mut items = vec![figure(crowd().into(), "A crowd of forty.", ""), PageItem::Table(table)];
                items.extend(edges());
                items
            }),
        ],
        foot: [("machine", "2 cores"), ("commit", "0123456789abcdef"), ("seeds", "7"), ("options", "--rounds 5 <&>")]
            .map(|(key, value)| (key.to_string(), value.to_string()))
            .into(),
    }
}
