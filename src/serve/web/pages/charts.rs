//! Small charts as SVG. Sizes stand in attributes, for the page allows no style
//! within itself; each says in words what it shows.

use maud::{Markup, html};

const WIDE: f64 = 120.0;
const HIGH: f64 = 28.0;

fn highest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// A line over time, the oldest first.
pub(super) fn line(values: &[f64], what: &str) -> Markup {
    let top = highest(values);
    if values.len() < 2 || top <= 0.0 {
        return html! {};
    }
    let step = WIDE / (values.len() - 1) as f64;
    let points: Vec<String> = values
        .iter()
        .enumerate()
        .map(|(at, value)| format!("{:.1},{:.1}", at as f64 * step, HIGH - 1.0 - (HIGH - 3.0) * value / top))
        .collect();
    html! {
        svg.spark viewBox={ "0 0 " (WIDE) " " (HIGH) } width=(WIDE) height=(HIGH) role="img" aria-label=(what) {
            polyline points=(points.join(" ")) {}
        }
    }
}

/// Bars over time, the oldest first.
pub(super) fn bars(values: &[f64], what: &str) -> Markup {
    let top = highest(values);
    if top <= 0.0 {
        return html! {};
    }
    let step = WIDE / values.len() as f64;
    html! {
        svg.spark viewBox={ "0 0 " (WIDE) " " (HIGH) } width=(WIDE) height=(HIGH) role="img" aria-label=(what) {
            @for (at, value) in values.iter().enumerate() {
                @let high = if *value > 0.0 { (HIGH * value / top).max(1.5) } else { 0.0 };
                rect x=(format!("{:.2}", at as f64 * step)) y=(format!("{:.2}", HIGH - high))
                    width=(format!("{:.2}", step * 0.8)) height=(format!("{high:.2}")) {}
            }
        }
    }
}

/// Counts by value, few of them or many; neighbours are drawn as one where there
/// are more than the chart is wide.
pub(super) fn histogram(counts: &[u64], what: &str) -> Markup {
    const MOST: usize = 64;
    let each = counts.len().div_ceil(MOST).max(1);
    let sums: Vec<f64> =
        counts.chunks(each).map(|chunk| chunk.iter().map(|count| *count as f64).sum()).collect();
    bars(&sums, what)
}

/// Parts of a whole beside each other: name, share of one, and what it says.
pub(super) fn parts(parts: &[(String, f64, String)], what: &str) -> Markup {
    const LONG: f64 = 1000.0;
    let sum: f64 = parts.iter().map(|(_, share, _)| share.max(0.0)).sum();
    if sum <= 0.0 {
        return html! {};
    }
    let mut at = 0.0;
    let placed: Vec<(f64, f64)> = parts
        .iter()
        .map(|(_, share, _)| {
            let (from, long) = (at, LONG * share.max(0.0) / sum);
            at += long;
            (from, long)
        })
        .collect();
    html! {
        svg.shares viewBox={ "0 0 " (LONG) " 24" } preserveAspectRatio="none" role="img" aria-label=(what) {
            @for (index, (from, long)) in placed.iter().enumerate() {
                rect class={ "part-" (index % 6) } x=(format!("{from:.1}")) y="0" width=(format!("{:.1}", long.max(1.0))) height="24" {}
            }
        }
        ul.legend {
            @for (index, (name, _, says)) in parts.iter().enumerate() {
                li { span class={ "dot part-" (index % 6) } aria-hidden="true" {} (name) " " span.dim { (says) } }
            }
        }
    }
}
