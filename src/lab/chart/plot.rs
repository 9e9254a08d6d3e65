//! Marks between two axes: what methods cost against what one gets for it, with the
//! front of those that none beats on both axes, or one quantity over another as lines.

use super::axis::{self, Ruler};
use super::canvas::{
    BOLD, Canvas, ChartDrawing, LABEL, LINE, MARGIN, Rect, TICK, WIDTH, fitted, told, width,
};
use super::panel::PanelFrame;
use super::series::{Mark, Plot, PlotStyle, Series, joined};
use super::table::{Table, TableCell, TableColumn};
use super::{legend, number, shape};

impl Plot {
    pub(super) fn draw(&self) -> ChartDrawing {
        let all = || self.panels.iter().flat_map(|panel| &panel.series);
        let mut notes = Vec::from_iter(self.left_out());
        let marks = || all().flat_map(|series| &series.marks).filter(|mark| self.takes(mark.x, mark.y));
        let before = || marks().filter_map(|mark| mark.before).filter(|was| self.takes(was.x, was.y));
        let levels =
            || self.references.iter().filter(|level| self.y.takes(level.y) && marks().next().is_some());
        let x = marks().map(|mark| mark.x).chain(before().map(|was| was.x));
        let y =
            marks().map(|mark| mark.y).chain(before().map(|was| was.y)).chain(levels().map(|level| level.y));
        let columns = [1, 1, 2, 3, 2].get(self.panels.len()).copied().unwrap_or(3);
        let most = [[11, 9], [6, 6], [5, 5]][columns - 1];
        let (Some(x), Some(y)) = (Ruler::new(&self.x, x, most[0]), Ruler::new(&self.y, y, most[1])) else {
            return ChartDrawing::empty(&notes);
        };

        let left = MARGIN + 8.0 + y.major.iter().map(|(_, label)| width(label, TICK)).fold(0.0, f64::max);
        let (right, gap) = (WIDTH - MARGIN - 8.0, 22.0);
        let (high, inset) =
            ([380.0, 220.0, 170.0][columns - 1], if self.style == PlotStyle::Front { 22.0 } else { 10.0 });
        let wide = (right - left - gap * (columns - 1) as f64) / columns as f64;
        let head = if self.panels.iter().any(|panel| !panel.name.is_empty()) { 22.0 } else { 0.0 };
        let mut canvas = Canvas::default();
        let hint = ["\u{2003}↓ better", "\u{2003}↑ better", ""][self.y.better as usize];
        let title = fitted(&self.y.words(), LABEL * BOLD, WIDTH - 2.0 * MARGIN - width(hint, LABEL));
        canvas.text("better", [MARGIN, 16.0], "start", &title, hint);
        let (mut bottom, mut unnamed) = (28.0, Vec::new());
        for (number, panel) in self.panels.iter().enumerate() {
            let (row, column) = (number / columns, number % columns);
            let corner =
                [left + (wide + gap) * column as f64, 28.0 + (head + high + 14.0) * row as f64 + head];
            let rect =
                Rect { left: corner[0], top: corner[1], right: corner[0] + wide, bottom: corner[1] + high };
            let frame = PanelFrame {
                x: x.clone().between(rect.left + inset, rect.right - inset),
                y: y.clone().between(rect.bottom - inset, rect.top + inset),
                rect,
            };
            canvas.frame(rect);
            canvas.level_axis(&frame.x, rect, number + columns >= self.panels.len());
            canvas.upright_axis(&frame.y, rect, column == 0);
            let name = fitted(&panel.name, LABEL * BOLD, wide);
            if !name.is_empty() {
                canvas.text("title", [rect.left, rect.top - head + LINE], "start", "", &name);
            }
            for level in levels() {
                let y = frame.y.at(level.y);
                canvas.line("level", [rect.left, y], [rect.right, y]);
            }
            unnamed.extend(self.draw_panel(&mut canvas, &frame, panel));
            bottom = rect.bottom;
        }
        bottom += 2.0 * LINE + 5.0;
        canvas.level_title(&self.x, [left, right], bottom);
        notes.extend(told("no room for the labels of", &unnamed));
        let bottom = canvas.key(self.key(before().next().is_some()), &notes, left, bottom + LINE - 3.0);
        ChartDrawing { canvas, bottom }
    }

    /// What cannot be drawn, and why, in a sentence.
    fn left_out(&self) -> Option<String> {
        let all = self.panels.iter().flat_map(|panel| &panel.series);
        let marks = all.flat_map(|series| series.marks.iter().map(move |mark| (series, mark)));
        let lost = marks.filter(|(_, mark)| !self.takes(mark.x, mark.y)).map(|(series, mark)| {
            let (axis, value) = if self.x.takes(mark.x) { (&self.y, mark.y) } else { (&self.x, mark.x) };
            format!("{} ({} is {})", series.called(mark), axis.title, number::figure(value))
        });
        told("not shown", &lost.collect::<Vec<_>>())
    }

    fn key(&self, before: bool) -> Vec<(Canvas, f64, String)> {
        let mut entries = Vec::new();
        let mut entry =
            |(sign, width): (Canvas, f64), words: &str| entries.push((sign, width, words.to_string()));
        let line = |class: &str| {
            let mut sign = Canvas::default();
            sign.line(class, [0.0, 0.0], [28.0, 0.0]);
            (sign, 34.0)
        };
        let mut names: Vec<&str> = Vec::new();
        for series in
            self.panels.iter().flat_map(|panel| &panel.series).filter(|_| self.style != PlotStyle::Front)
        {
            if !series.name.is_empty() && !names.contains(&series.name.as_str()) {
                names.push(&series.name);
                entry(
                    legend::sign(self.look(&series.name), true, self.style == PlotStyle::Lines),
                    &series.name,
                );
            }
        }
        if self.has_front() {
            entry(line("front"), "front: nothing beats it in both");
            let mut lighter = Canvas::default();
            lighter.path("mark off", &shape::path(0, [6.0, 0.0], 5.0));
            entry((lighter, 18.0), "lighter: beaten");
        }
        self.references
            .iter()
            .filter(|level| self.y.takes(level.y))
            .for_each(|level| entry(line("level"), &level.name));
        if before {
            let sign = if self.style == PlotStyle::Curves { line("was") } else { legend::earlier_sign() };
            entry(sign, "from the earlier run");
        }
        let shown = axis::round_below(self.largest() / 4.0).filter(|_| self.style == PlotStyle::Front);
        if let (Some(size), Some(shown)) = (&self.size, shown) {
            let (mut circle, radius) = (Canvas::default(), self.radius(Some(shown)));
            circle.path("was", &shape::path(0, [radius, 0.0], radius));
            let words = number::with_unit(&number::figure(shown), &size.unit, false);
            entry((circle, 2.0 * radius + 6.0), &format!("area: {}, {words}", size.title));
        }
        entries
    }

    /// Lines that are all measured at the same places need these only once.
    fn side_by_side(&self) -> Option<Table> {
        let all =
            || self.panels.iter().flat_map(|panel| panel.series.iter().map(move |series| (panel, series)));
        let places = |series: &Series| series.marks.iter().map(|mark| mark.x).collect::<Vec<_>>();
        let plain = |mark: &Mark| mark.before.is_none() && mark.label.is_empty();
        let first = places(all().next()?.1);
        let alike = |series: &Series| places(series) == first && series.marks.iter().all(plain);
        if self.style == PlotStyle::Front || !all().all(|(_, series)| alike(series)) {
            return None;
        }
        let heads = all().map(|(panel, series)| joined(&[&panel.name, &series.name], " · "));
        let mut columns = vec![TableColumn::new(&self.x.title, &self.x.unit)];
        columns.extend(heads.map(|head| TableColumn::new(&head, &self.y.unit)));
        let row = |(at, x): (usize, &f64)| {
            let here = all().map(|(_, series)| series.marks[at].y);
            [*x].into_iter().chain(here).map(TableCell::Number).collect()
        };
        let caption = format!("{}: {}", self.title, self.y.title);
        Some(Table { caption, columns, rows: first.iter().enumerate().map(row).collect() })
    }

    pub(super) fn table(&self) -> Table {
        if let Some(table) = self.side_by_side() {
            return table;
        }
        let size = self.size.clone().unwrap_or_default();
        let axis = |title: &str, unit: &str| TableColumn::with_before(title, unit);
        let mut columns = ["panel", "method", "setting"].map(|title| TableColumn::new(title, "")).to_vec();
        columns
            .extend(axis(&self.x.title, &self.x.unit).into_iter().chain(axis(&self.y.title, &self.y.unit)));
        columns.extend(axis(&size.title, &size.unit));
        columns.push(TableColumn::new("remarks", ""));
        let series =
            self.panels.iter().flat_map(|panel| panel.series.iter().map(move |series| (panel, series)));
        let marks =
            series.flat_map(|(panel, series)| series.marks.iter().map(move |mark| (panel, series, mark)));
        let rows = marks.map(|(panel, series, mark)| {
            let mut row = [&panel.name, &series.name, &mark.label].map(|name| TableCell::text(name)).to_vec();
            row.extend(TableCell::with_before(Some(mark.x), mark.before.map(|was| was.x)));
            row.extend(TableCell::with_before(Some(mark.y), mark.before.map(|was| was.y)));
            let shown = self.size.is_some();
            let was = mark.before.and_then(|was| was.size);
            row.extend(TableCell::with_before(mark.size.filter(|_| shown), was.filter(|_| shown)));
            row.push(TableCell::text(&joined(
                &[if mark.default { "default" } else { "" }, &mark.note],
                ", ",
            )));
            row
        });
        Table { caption: self.title.clone(), columns, rows: rows.collect() }.without_empty_columns()
    }
}

#[cfg(test)]
mod tests {
    use super::super::axis::Axis;
    use super::super::series::{Before, Panel};
    use super::*;

    #[test]
    fn a_table_tells_what_the_chart_shows() {
        let was = Before { x: 100.0, y: 1.0, size: None };
        let marks = [Mark { before: Some(was), ..Mark::at(50.0, 1.0) }, Mark::at(60.0, 2.0)];
        let series = ["a", "b"].into_iter().zip(marks).map(|(name, mark)| Series::new(name, vec![mark]));
        let panels = vec![Panel { name: String::new(), series: series.collect() }];
        let (x, y) = (Axis::log("time", "ns"), Axis::linear("error", ""));
        let table = Plot { x, y, panels, ..Plot::default() }.table();
        let heads: Vec<&str> = table.columns.iter().map(|column| column.title.as_str()).collect();
        assert_eq!(heads, ["method", "time", "before", "change", "error", "before", "change"]);
        let html = table.html().0;
        assert!(html.contains("<td class=\"number\">−50\u{202f}%</td>"), "{html}");
        let unit = "class=\"number\">time <span class=\"unit\">ns</span></th>";
        assert!(html.contains(unit), "{html}");
    }

    #[test]
    fn lines_at_the_same_places_stand_side_by_side() {
        let plot = |places: [f64; 2]| {
            let lines = vec![
                Series::line("a", [[1.0, 2.0], [2.0, 4.0]]),
                Series::line("b", places.map(|x| [x, 5.0])),
            ];
            let panels = vec![Panel { name: "town".into(), series: lines }];
            Plot { panels, style: PlotStyle::Lines, ..Plot::default() }.table()
        };
        assert_eq!(plot([1.0, 2.0]).rows[1], [2.0, 4.0, 5.0].map(TableCell::Number));
        assert_eq!(plot([1.0, 2.0]).columns[2].title, "town · b");
        assert_eq!(plot([1.0, 3.0]).rows.len(), 4);
    }
}
