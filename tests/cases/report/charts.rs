//! Charts and their page: valid markup whatever the figures are, and laid out in a
//! real browser so that everything can be read.

use chart::{Axis, Bar, BarGroup, Bars, Before, Better, Chart, Figure, Mark, Page, PageItem, Panel, Pattern};
use chart::{Patterns, Plot, PlotStyle, Quantity, ReferenceLine, Section, Series};
use lodestone::lab::chart;
use proptest::prelude::*;

#[test]
fn a_browser_lays_the_page_out_so_that_it_can_be_read() {
    let Some(program) = super::browser::program() else { return };
    let page = super::sample::page().html();
    assert!(page.len() < 300_000, "{} bytes", page.len());
    assert!(!page.contains("<script"), "nothing on it runs");

    let plain = super::browser::open(program, &page, "html", 1000, false);
    assert!(plain.console.is_empty(), "{:?}", plain.console);

    let [light, dark] = [false, true].map(|dark| super::browser::look(program, &page, 1000, dark));
    // As large as a telephone, where figures are moved sideways and the page is not.
    let small = super::browser::look(program, &page, 390, false);
    for seen in [&light, &dark, &small] {
        assert_eq!(seen["faults"], serde_json::json!([]));
        assert_eq!(seen["drawings"], page.matches("<svg ").count());
        assert!(seen["texts"].as_u64() > Some(200), "{seen}");
    }
    assert_ne!(light["paper"], dark["paper"]);
    assert_ne!(light["mark"], dark["mark"]);
}

#[test]
fn whatever_is_measured_can_be_read() {
    let Some(program) = super::browser::program() else { return };
    for seed in 1..=3 {
        let seen = super::browser::look(program, &super::sample::strange(seed).html(), 1000, false);
        assert_eq!(seen["faults"], serde_json::json!([]), "seed {seed}");
        assert_eq!(seen["drawings"], 16);
    }
}

/// The judge is judged: what it must object to.
#[test]
fn a_browser_sees_what_cannot_be_read() {
    let Some(program) = super::browser::program() else { return };
    let svg = "<svg class=\"chart\" viewBox=\"0 0 400 200\" aria-label=\"bad\">\
               <text x=\"10\" y=\"50\">one text</text><text x=\"20\" y=\"52\">another text</text>\
               <text x=\"380\" y=\"150\">too far right</text></svg>";
    let page = format!("<!DOCTYPE html><html><body><figure>{svg}</figure><figure></figure></body></html>");
    let faults = super::browser::look(program, &page, 1000, false)["faults"].to_string();
    for fault in ["lies on", "outside", "no marks", "without a drawing"] {
        assert!(faults.contains(fault), "{fault}: {faults}");
    }
    let noisy = page.replace("</body>", "<script>console.error('heard')</script></body>");
    let heard = super::browser::open(program, &noisy, "html", 1000, false).console;
    assert!(heard.iter().any(|line| line.contains("heard")), "{heard:?}");
}

#[test]
fn a_chart_stands_alone() {
    let chart = Chart::from(super::sample::samplers());
    let svg = chart.svg_standalone();
    super::markup::elements(&svg).unwrap();
    assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" "));
    assert!(
        svg.contains("<style>") && svg.contains("prefers-color-scheme:dark") && svg.contains("inside-out")
    );
    let Some(program) = super::browser::program() else { return };
    let seen = super::browser::open(program, &svg, "svg", 800, true);
    assert!(seen.console.is_empty() && !seen.dom.contains("parsererror"), "{:?} {}", seen.console, seen.dom);
    // In a page, as an <img> would have it.
    let page = format!("<!DOCTYPE html><html><body>{svg}</body></html>");
    assert_eq!(super::browser::look(program, &page, 1000, false)["faults"], serde_json::json!([]));
}

/// Anything that somebody may call a number.
fn value() -> impl Strategy<Value = f64> {
    prop_oneof![4 => 1e-3..1e3, 1 => any::<f64>(), 1 => Just(0.0), 1 => Just(f64::NAN), 1 => Just(7.0)]
}

fn name() -> impl Strategy<Value = String> {
    prop_oneof!["[a-z ]{0,12}", "[<>&\"' a-z]{0,9}", any::<String>()]
}

fn mark() -> impl Strategy<Value = Mark> {
    let before = prop::option::of((value(), value()).prop_map(|(x, y)| Before { x, y, size: Some(x) }));
    let parts = (name(), value(), value(), prop::option::of(value()), any::<bool>(), before);
    parts.prop_map(|(label, x, y, size, default, before)| Mark {
        label,
        x,
        y,
        size,
        default,
        before,
        ..Mark::default()
    })
}

fn series() -> impl Strategy<Value = Vec<Series>> {
    let one = (name(), prop::collection::vec(mark(), 0..5));
    prop::collection::vec(one.prop_map(|(name, marks)| Series { name, marks }), 0..5)
}

fn axis() -> impl Strategy<Value = Axis> {
    let better = prop_oneof![Just(Better::Lower), Just(Better::Higher), Just(Better::Neither)];
    (name(), name(), any::<bool>(), better).prop_map(|(title, unit, log, better)| {
        let axis = if log { Axis::log(&title, &unit) } else { Axis::linear(&title, &unit) };
        axis.better(better)
    })
}

fn chart() -> impl Strategy<Value = Chart> {
    let style =
        prop_oneof![3 => Just(PlotStyle::Front), 1 => Just(PlotStyle::Lines), 1 => Just(PlotStyle::Curves)];
    let panels =
        prop::collection::vec((name(), series()).prop_map(|(name, series)| Panel { name, series }), 0..5);
    let plot = (name(), axis(), axis(), panels, style, any::<bool>(), value()).prop_map(
        |(title, x, y, panels, style, sized, level)| {
            let size = sized.then(|| Quantity { title: title.clone(), unit: String::new() });
            let references = vec![ReferenceLine { y: level, name: title.clone() }];
            Chart::from(Plot { title, x, y, panels, style, size, references })
        },
    );
    let bar = (name(), value(), prop::option::of([value(), value()]), prop::option::of(value()));
    let bar = bar.prop_map(|(name, value, spread, before)| Bar { spread, before, ..Bar::new(&name, value) });
    let group = (name(), prop::collection::vec(bar, 0..4)).prop_map(|(name, bars)| BarGroup { name, bars });
    let bars = (name(), axis(), prop::collection::vec(group, 0..3));
    let bars = bars.prop_map(|(title, axis, groups)| Chart::from(Bars { title, axis, groups }));
    let dots = || prop::collection::vec([0.0..1.1, 0.0..1.1], 0..9);
    let pattern = (name(), name(), dots());
    let pattern = pattern.prop_map(|(name, note, dots)| Pattern { name, note, dots });
    let patterns = (name(), prop::collection::vec(pattern, 0..6));
    let patterns = patterns.prop_map(|(title, patterns)| Chart::from(Patterns { title, patterns }));
    prop_oneof![5 => plot, 1 => bars, 1 => patterns]
}

proptest! {
    #[test]
    fn markup_is_valid_whatever_the_figures_are(chart in chart(), text in any::<String>()) {
        let alone = super::markup::elements(&chart.svg_standalone()).map_err(TestCaseError::fail)?;
        prop_assert_eq!(super::markup::odd_lengths(&alone), Vec::<String>::new());
        let item = PageItem::Figure(Figure::new(chart, &text, &text));
        let section = Section { heading: text.clone(), items: vec![PageItem::Text(text.clone()), item] };
        let page = Page { title: text.clone(), lead: text.clone(), sections: vec![section], foot: vec![(text.clone(), text)] };
        let page = super::markup::elements(&page.html()).map_err(TestCaseError::fail)?;
        prop_assert_eq!(super::markup::odd_lengths(&page), Vec::<String>::new());
    }
}
