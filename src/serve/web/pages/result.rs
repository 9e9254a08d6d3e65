//! What a conversion reported, in sentences, tables and a chart.

use maud::{Markup, html};
use serde_json::Value;

use super::{charts, crs, parts, words};
use crate::words as figures;

fn number(value: &Value, key: &str) -> u64 {
    value[key].as_u64().unwrap_or_default()
}

fn texts<'a>(value: &'a Value, key: &str) -> Vec<&'a str> {
    value[key].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

fn axes(value: &Value) -> Option<[f64; 3]> {
    let values = value.as_array()?;
    Some([values.first()?.as_f64()?, values.get(1)?.as_f64()?, values.get(2)?.as_f64()?])
}

fn triple(values: [f64; 3]) -> String {
    values.map(words::figure).join(" · ")
}

pub(super) fn all(report: &Value) -> Markup {
    html! {
        div.cards {
            div { (account(report)) (time(report)) (oddities(report)) }
            div { (place(report)) }
        }
    }
}

/// Where every point went.
fn account(report: &Value) -> Markup {
    let [read, written, aside, dropped, missing] =
        ["points_in", "points_out", "points_set_aside", "points_dropped", "points_missing"]
            .map(|key| number(report, key));
    let kept_aside = aside.saturating_sub(dropped);
    html! {
        section.card #account aria-labelledby="account-title" {
            h2 #account-title { "What came out" }
            p {
                strong { (words::grouped(written)) } " of " strong { (words::grouped(read)) } " points are in the octree, in "
                (words::counted(number(report, "nodes"), "node", "nodes")) " on "
                (words::counted(number(report, "depth") + 1, "level", "levels")) ", "
                (words::bytes(number(report, "output_bytes"))) "."
                @if written == read && missing == 0 { " None is lost." }
            }
            @if kept_aside > 0 {
                p {
                    (words::counted(kept_aside, "point lies", "points lie")) " beside it, in "
                    (texts(report, "files_aside").join(", ")) "."
                }
            }
            @if dropped > 0 { p { (words::counted(dropped, "point was", "points were")) " dropped, as was asked." } }
            @if missing > 0 {
                p.banner.bad {
                    (words::counted(missing, "point that the files promise", "points that the files promise"))
                    " could not be read: a file is cut or damaged."
                }
            }
            @let error = report["max_error"].as_array().map(|_| axes(&report["max_error"])).unwrap_or_default();
            @if report["exact"].as_bool() == Some(true) {
                p { "Every position is exact, to the last bit of its file." }
            } @else if let Some(error) = error {
                p {
                    "Positions moved by at most " (triple(error)) " (x · y · z), because the files' lattices do not fit one \
                    another."
                }
            }
        }
    }
}

/// Where it lies in the world.
fn place(report: &Value) -> Markup {
    let lattice = &report["lattice"];
    let (scale, offset) = (axes(&lattice["scale"]), axes(&lattice["offset"]));
    let corner = |key: &str| {
        let (raw, scale, offset) = (axes(&lattice[key])?, scale?, offset?);
        Some([0, 1, 2].map(|axis| raw[axis] * scale[axis] + offset[axis]))
    };
    let wkt = crs::of(report);
    let units = crs::units(wkt);
    // In which each axis counts; nothing is said where the text says nothing.
    let unit = units.map(|[across, heights]| [across, across, heights]).unwrap_or_default();
    let places = |values: [f64; 3]| {
        [0, 1, 2].map(|axis| words::coordinate(values[axis], scale.map_or(f64::NAN, |scale| scale[axis])))
    };
    let row = |name: &str, values: [String; 3]| {
        html! {
            tr {
                th scope="row" { (name) }
                @for (value, unit) in values.iter().zip(unit) {
                    td.num { (value) @if !unit.is_empty() { span.dim { "\u{a0}" (unit) } } }
                }
            }
        }
    };
    html! {
        section.card #place aria-labelledby="place-title" {
            h2 #place-title { "Where it lies" }
            dl.facts {
                dt { "Coordinate system" }
                dd {
                    @match crs::name(wkt) {
                        Some(name) => { (name)
                            @if wkt.len() > 60 { details { summary { "as WKT" } (parts::copyable(wkt, None)) } }
                            @if let Some(proj4) = report["projection"].as_str().filter(|text| text.starts_with('+')) {
                                details { summary { "as PROJ string" } (parts::copyable(proj4, None)) }
                            }
                        },
                        None => "none is given in the files",
                    }
                }
            }
            div.scroll tabindex="0" role="region" aria-labelledby="place-title" {
                table.axes {
                    thead { tr { td {} @for axis in ["x", "y", "z"] { th.num scope="col" { (axis) } } } }
                    tbody {
                        @if let (Some(low), Some(high)) = (corner("min"), corner("max")) {
                            (row("Lowest", places(low))) (row("Highest", places(high)))
                            (row("Extent", places([0, 1, 2].map(|axis| high[axis] - low[axis]))))
                        }
                        @if let Some(scale) = scale { (row("Scale", scale.map(figures::number))) }
                        @if let Some(offset) = offset { (row("Offset", offset.map(figures::number))) }
                    }
                }
            }
            dl.facts {
                @if let Some(spacing) = report["spacing"].as_f64() {
                    dt { "Spacing of the coarsest points" }
                    dd { (words::figure(spacing)) @if !unit[0].is_empty() { " " (unit[0]) } }
                }
                @let options = &report["options"];
                dt { "Sampling" } dd { (choice(options["sampling"].as_str().unwrap_or("—"))) }
                dt { "Encoding" } dd { (choice(options["encoding"].as_str().unwrap_or("—"))) }
            }
        }
    }
}

/// What an option's value means.
fn choice(value: &str) -> &str {
    match value {
        "poisson" => "Poisson disk: evenly spread, at every depth",
        "random" => "random: the fastest",
        "DEFAULT" => "not compressed",
        "BROTLI" => "compressed with Brotli",
        other => other,
    }
}

const STAGES: [&str; 5] = ["survey", "distribute", "index", "merge", "publish"];

/// Where the time went.
fn time(report: &Value) -> Markup {
    let seconds = STAGES.map(|stage| (stage, report["seconds_by_stage"][stage].as_f64().unwrap_or_default()));
    let sum: f64 = seconds.iter().map(|(_, seconds)| seconds).sum();
    if sum <= 0.0 {
        return html! {};
    }
    let shares: Vec<(String, f64, String)> = seconds
        .iter()
        .map(|(stage, seconds)| {
            let says = format!("{:.2} s, {:.0} %", seconds, 100.0 * seconds / sum);
            (parts::stage(stage).to_string(), *seconds, says)
        })
        .collect();
    let peak = STAGES.iter().filter_map(|stage| report["peak_bytes_by_stage"][stage].as_u64()).max();
    let resumed = number(report, "units_resumed");
    html! {
        section.card #time aria-labelledby="time-title" {
            h2 #time-title { "Where the time went" }
            (charts::parts(&shares, "Seconds by stage"))
            p.dim {
                (words::points((number(report, "points_in") as f64 / sum) as u64)) " points a second"
                @if let Some(peak) = peak { ", at most " (words::bytes(peak)) " of memory" }
                @if resumed > 0 { ", " (words::counted(resumed, "unit", "units")) " of work taken over from an earlier attempt" }
                "."
            }
        }
    }
}

/// What was odd about the inputs, what was looked for, and what was done.
fn oddities(report: &Value) -> Markup {
    let (repairs, notes) = (texts(report, "repairs"), texts(report, "notes"));
    let (left_out, unused) = (texts(report, "left_out"), texts(report, "unused_attributes"));
    let guards = report["guards"].as_array().map(Vec::as_slice).unwrap_or_default();
    html! {
        section.card #oddities aria-labelledby="oddities-title" {
            h2 #oddities-title { "What was looked for, and found" }
            ul {
                @for guard in guards { li { (guarded(guard)) } }
                @for repair in repairs { li { "Mended: " (parts::text(repair)) } }
                @for note in notes { li { (parts::text(note)) } }
                @if !left_out.is_empty() { li { "Left out, as was asked: " (left_out.join(", ")) "." } }
                @if !unused.is_empty() { li { "Zero in every point, and so not kept: " (unused.join(", ")) "." } }
            }
        }
    }
}

fn guarded(guard: &Value) -> Markup {
    let (name, found) = (guard["name"].as_str().unwrap_or("guard"), number(guard, "points"));
    let mode = guard["mode"].as_str().unwrap_or("");
    let what = match name {
        "outlier" => "Outliers",
        "duplicate" => "Crowds at one position",
        "twin" => "Equal records",
        other => other,
    };
    html! {
        (what) ": "
        @match (mode, found) {
            ("keep", _) => "all kept, as is set.",
            (_, 0) => "none.",
            ("drop", _) => { (words::counted(found, "point", "points")) " dropped, as was asked." },
            _ => { (words::counted(found, "point", "points")) " set aside." },
        }
        @if let Some(threshold) = guard["threshold"].as_str() { " " span.dim { "(" (threshold) ")" } }
    }
}
