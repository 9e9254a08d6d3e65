//! What a chart shows, as a table.

use super::data::{Axis, Before, Mark, Series};
use super::table::{Cell, Column, Table};
use super::{Bars, Lines, Patterns, Scatter, front};

/// Now, before and by how much it changed, for one quantity.
fn columns(title: &str, unit: &str) -> [Column; 3] {
    [Column::new(title, unit), Column::new("before", unit), Column::new("change", "")]
}

fn cells(now: f64, before: Option<f64>) -> [Cell; 3] {
    let change = before.map_or(Cell::Nothing, |before| Cell::Change { now, before });
    [Cell::Number(now), Cell::maybe(before), change]
}

fn of_axis(axis: &Axis) -> [Column; 3] {
    columns(&axis.title, &axis.unit)
}

fn of_mark(mark: &Mark) -> impl Iterator<Item = Cell> {
    let before = |of: fn(Before) -> f64| mark.before.map(of);
    cells(mark.x, before(|b| b.x)).into_iter().chain(cells(mark.y, before(|b| b.y)))
}

pub(super) fn scatter(chart: &Scatter) -> Table {
    let mut heads = vec![Column::new("method", ""), Column::new("setting", "")];
    heads.extend(of_axis(&chart.x).into_iter().chain(of_axis(&chart.y)));
    let size = chart.size.clone().unwrap_or_default();
    heads.extend(columns(&size.title, &size.unit));
    heads.push(Column::new("remarks", ""));
    let marks: Vec<(&Series, &Mark)> = pairs(&chart.series).collect();
    let shown = |mark: &Mark| chart.x.takes(mark.x) && chart.y.takes(mark.y);
    // What is not shown beats nobody.
    let place = |mark: &Mark| if shown(mark) { [mark.x, mark.y] } else { [f64::NAN; 2] };
    let points: Vec<[f64; 2]> = marks.iter().map(|(_, mark)| place(mark)).collect();
    let fronted = chart.front && front::defined(&chart.x, &chart.y);
    let beaten = front::beaten(&points, &chart.x, &chart.y);
    let row = |((series, mark), beaten): (&(&Series, &Mark), &Option<usize>)| {
        let place = match beaten {
            _ if !fronted || !shown(mark) => "",
            None => "on the front",
            Some(_) => "off the front",
        };
        let default = if mark.default { "default" } else { "" };
        let remarks = [default, place, &mark.note].into_iter().filter(|part| !part.is_empty());
        let mut row = vec![Cell::text(&series.name), Cell::text(&mark.label)];
        row.extend(of_mark(mark));
        match chart.size.as_ref().and(mark.size) {
            Some(size) => row.extend(cells(size, mark.before.and_then(|before| before.size))),
            None => row.extend([Cell::Nothing, Cell::Nothing, Cell::Nothing]),
        }
        row.push(Cell::text(&remarks.collect::<Vec<_>>().join(", ")));
        row
    };
    let rows = marks.iter().zip(&beaten).map(row).collect();
    Table { caption: chart.title.clone(), columns: heads, rows }.without_empty_columns()
}

fn pairs(series: &[Series]) -> impl Iterator<Item = (&Series, &Mark)> {
    series.iter().flat_map(|series| series.marks.iter().map(move |mark| (series, mark)))
}

pub(super) fn lines(chart: &Lines) -> Table {
    if let Some(table) = side_by_side(chart) {
        return table;
    }
    let mut heads = ["panel", "method", "setting"].map(|title| Column::new(title, "")).to_vec();
    heads.extend(of_axis(&chart.x).into_iter().chain(of_axis(&chart.y)));
    let all = chart.panels.iter().flat_map(|panel| pairs(&panel.series).map(move |pair| (panel, pair)));
    let rows = all.map(|(panel, (series, mark))| {
        let mut row = [&panel.name, &series.name, &mark.label].map(|name| Cell::text(name)).to_vec();
        row.extend(of_mark(mark));
        row
    });
    Table { caption: chart.title.clone(), columns: heads, rows: rows.collect() }.without_empty_columns()
}

/// Lines that are all measured at the same places need these only once.
fn side_by_side(chart: &Lines) -> Option<Table> {
    let all: Vec<(String, &Series)> = chart
        .panels
        .iter()
        .flat_map(|panel| panel.series.iter().map(move |series| (panel, series)))
        .map(|(panel, series)| {
            let names = [panel.name.as_str(), &series.name].into_iter().filter(|name| !name.is_empty());
            (names.collect::<Vec<_>>().join(" · "), series)
        })
        .collect();
    let (_, first) = all.first()?;
    let plain = |mark: &Mark| mark.before.is_none() && mark.label.is_empty();
    let alike = |series: &Series| {
        let same = series.marks.iter().map(|mark| mark.x).eq(first.marks.iter().map(|mark| mark.x));
        same && series.marks.iter().all(plain)
    };
    if !all.iter().all(|(_, series)| alike(series)) {
        return None;
    }
    let mut columns = vec![Column::new(&chart.x.title, &chart.x.unit)];
    let heads = all.iter().map(|(name, _)| if name.is_empty() { &chart.y.title } else { name });
    columns.extend(heads.map(|name| Column::new(name, &chart.y.unit)));
    let row = |at: usize| {
        let here = all.iter().map(|(_, series)| Cell::maybe(series.marks.get(at).map(|mark| mark.y)));
        [Cell::maybe(first.marks.get(at).map(|mark| mark.x))].into_iter().chain(here).collect()
    };
    let rows = (0..first.marks.len()).map(row).collect();
    Some(Table { caption: format!("{}: {}", chart.title, chart.y.title), columns, rows })
}

pub(super) fn bars(chart: &Bars) -> Table {
    let unit = &chart.axis.unit;
    let mut heads = vec![Column::new("group", ""), Column::new("method", "")];
    heads.extend(of_axis(&chart.axis));
    heads.extend([Column::new("lowest", unit), Column::new("highest", unit), Column::new("remarks", "")]);
    let all = chart.groups.iter().flat_map(|group| group.bars.iter().map(move |bar| (group, bar)));
    let rows = all.map(|(group, bar)| {
        let mut row = vec![Cell::text(&group.name), Cell::text(&bar.name)];
        row.extend(cells(bar.value, bar.before));
        row.extend([0, 1].map(|end| Cell::maybe(bar.spread.map(|spread| spread[end]))));
        let default = if bar.default { "default" } else { "" };
        let remarks = [default, &bar.note].into_iter().filter(|part| !part.is_empty());
        row.push(Cell::text(&remarks.collect::<Vec<_>>().join(", ")));
        row
    });
    Table { caption: chart.title.clone(), columns: heads, rows: rows.collect() }.without_empty_columns()
}

pub(super) fn patterns(chart: &Patterns) -> Table {
    let columns = ["pattern", "dots", "marked", "remarks"].map(|title| Column::new(title, "")).to_vec();
    let count = |dots: &[[f64; 2]]| Cell::Text(dots.len().to_string());
    let rows = chart.patterns.iter().map(|pattern| {
        let marked = if pattern.marked.is_empty() { Cell::Nothing } else { count(&pattern.marked) };
        vec![Cell::text(&pattern.name), count(&pattern.dots), marked, Cell::text(&pattern.note)]
    });
    Table { caption: chart.title.clone(), columns, rows: rows.collect() }.without_empty_columns()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_tells_what_the_chart_shows() {
        let mark = |x, y, before: Option<f64>| Mark {
            before: before.map(|x| Before { x, y, size: None }),
            ..Mark::at(x, y)
        };
        let chart = Scatter {
            title: "Samplers".into(),
            x: Axis::log("time", "ns"),
            y: Axis::linear("error", ""),
            series: vec![
                Series::new("a", vec![mark(50.0, 1.0, Some(100.0))]),
                Series::new("b", vec![mark(60.0, 2.0, None)]),
                Series::new("no place", vec![mark(0.0, 0.0, None)]),
            ],
            front: true,
            ..Scatter::default()
        };
        let table = scatter(&chart);
        let heads: Vec<&str> = table.columns.iter().map(|column| column.title.as_str()).collect();
        assert_eq!(heads, ["method", "time", "before", "change", "error", "before", "change", "remarks"]);
        let remarks: Vec<_> = table.rows.iter().filter_map(|row| row.last().cloned()).collect();
        assert_eq!(remarks, [Cell::text("on the front"), Cell::text("off the front"), Cell::Nothing]);
        assert_eq!(table.rows[0][3], Cell::Change { now: 50.0, before: 100.0 });
        let html = table.html();
        assert!(html.contains("<td class=\"number\">−50\u{202f}%</td>"), "{html}");
        assert!(
            html.contains("<th scope=\"col\" class=\"number\">time <span class=\"unit\">ns</span></th>"),
            "{html}"
        );
    }

    #[test]
    fn lines_at_the_same_places_stand_side_by_side() {
        let line = |name: &str, shift: f64| Series::line(name, [[1.0, 2.0 + shift], [2.0, 4.0 + shift]]);
        let panel = |series| super::super::Panel { name: "town".into(), series };
        let chart = Lines { panels: vec![panel(vec![line("a", 0.0), line("b", 1.0)])], ..Lines::default() };
        let table = lines(&chart);
        assert_eq!(table.rows[1], [2.0, 4.0, 5.0].map(Cell::Number));
        assert_eq!(table.columns[2].title, "town · b");
        let chart =
            Lines { panels: vec![panel(vec![line("a", 0.0), Series::line("b", [[3.0, 1.0]])])], ..chart };
        assert_eq!(lines(&chart).rows.len(), 3);
    }
}
