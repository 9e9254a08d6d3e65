//! One quantity over another, a line a method: error over time, power over frequency.

use super::canvas::Canvas;
use super::data::{Axis, Better, Mark, Series};
use super::drawing::{Drawing, MARGIN, WIDTH};
use super::frame::{self, BOLD, Frame, LABEL, LINE, TICK};
use super::grid::Grid;
use super::key::{Key, Sign};
use super::rect::{Rect, Segment};
use super::ruler::Ruler;
use super::spots::{self, Spot};
use super::{canvas, shape, text};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lines {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// One, or several side by side, all to the same scale: a scene each, say.
    pub panels: Vec<Panel>,
    /// Levels to compare with, drawn across.
    pub references: Vec<Reference>,
    /// Draw only the lines; for lines of so many points that marks would hide them.
    pub bare: bool,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// May be empty if it is the only one.
    pub name: String,
    /// Of one name, of one look in all panels.
    pub series: Vec<Series>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reference {
    pub y: f64,
    /// "white noise"
    pub name: String,
}

const INSET: f64 = 10.0;

impl Lines {
    /// Radial power spectra, one panel a pattern of samples: its name, and pairs of
    /// frequency and power, of which 1 is that of white noise.
    pub fn spectra(title: &str, frequency: Axis, spectra: Vec<(String, Vec<[f64; 2]>)>) -> Lines {
        let panel = |(name, points)| Panel { name, series: vec![Series::line("", points)] };
        Lines {
            title: title.to_string(),
            x: frequency.better(Better::Neither),
            y: Axis::linear("power", "").better(Better::Neither),
            panels: spectra.into_iter().map(panel).collect(),
            references: vec![Reference { y: 1.0, name: "white noise".to_string() }],
            bare: true,
        }
    }

    pub(super) fn drawing(&self) -> Drawing {
        let series = || self.panels.iter().flat_map(|panel| &panel.series);
        let left_out = spots::left_out(series(), &self.x, &self.y);
        let shown = || series().flat_map(|series| &series.marks).filter(|mark| self.shows(mark.x, mark.y));
        let before =
            || shown().filter_map(|mark| mark.before).filter(|before| self.shows(before.x, before.y));
        let x = shown().map(|mark| mark.x).chain(before().map(|before| before.x));
        let y = shown().map(|mark| mark.y).chain(before().map(|before| before.y));
        // Levels alone are no measurement.
        let levels = self.references.iter().map(|level| level.y).filter(|_| shown().next().is_some());
        let panels = self.panels.len();
        let most = Grid::ticks(panels);
        let rulers = (Ruler::new(&self.x, x, most[0]), Ruler::new(&self.y, y.chain(levels), most[1]));
        let (Some(x), Some(y)) = rulers else { return Drawing::empty(&self.title, left_out) };

        let names = self.names();
        let left = MARGIN + y.widest_label(TICK) + 8.0;
        let right = WIDTH - MARGIN - if panels == 1 { end_labels(&names) } else { 8.0 };
        let heads = self.panels.iter().any(|panel| !panel.name.is_empty());
        let grid = Grid { panels, left, right, top: 28.0, head: if heads { 22.0 } else { 0.0 } };
        let mut canvas = Canvas::default();
        frame::y_title(&mut canvas, &self.y, [MARGIN, 16.0], WIDTH - 2.0 * MARGIN);
        let mut without = Vec::new();
        for (number, panel) in self.panels.iter().enumerate() {
            let frame = Frame::new(x.clone(), y.clone(), grid.rect(number), INSET);
            grid.frame(&mut canvas, number, &frame, &panel.name);
            without.extend(self.draw_panel(&mut canvas, &frame, panel, &names));
        }
        let bottom = grid.bottom() + 2.0 * LINE + 5.0;
        frame::x_title(&mut canvas, &self.x, left, right, bottom);
        let mut key = self.key(&names, before().next().is_some());
        key.notes.extend(left_out);
        key.notes.extend(spots::told("no room for the labels of", without));
        let bottom = key.draw(&mut canvas, [left, bottom + LINE - 3.0], WIDTH - MARGIN - left);
        Drawing::new(&self.title, canvas, bottom)
    }

    fn shows(&self, x: f64, y: f64) -> bool {
        self.x.takes(x) && self.y.takes(y)
    }

    /// The methods of all panels with their looks, as they first come.
    fn names(&self) -> Vec<(&str, usize)> {
        let mut names: Vec<(&str, usize)> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if !names.iter().any(|(name, _)| *name == series.name) {
                names.push((&series.name, series.look.unwrap_or(names.len())));
            }
        }
        names
    }

    /// Draws what was measured, and names those for whose label there is no room.
    fn draw_panel(
        &self,
        canvas: &mut Canvas,
        frame: &Frame,
        panel: &Panel,
        names: &[(&str, usize)],
    ) -> Vec<String> {
        let Rect { left, right, .. } = frame.rect;
        for level in self.references.iter().filter(|level| self.y.takes(level.y)) {
            let place = frame.y.at(level.y);
            canvas.line("level", [left, place], [right, place]);
        }
        let look = |series: &Series| {
            let known = names.iter().find(|(name, _)| *name == series.name);
            series.look.or(known.map(|(_, look)| *look))
        };
        let all: Vec<Series> =
            panel.series.iter().map(|series| Series { look: look(series), ..series.clone() }).collect();
        let alone = self.panels.len() == 1;
        let radius = if self.bare {
            0.0
        } else if alone {
            4.0
        } else {
            3.0
        };
        let mut lines = Vec::new();
        for (number, series) in all.iter().enumerate() {
            let look = spots::look(series, number);
            canvas.open(&shape::class(look), &series.name);
            if self.bare {
                let was = |mark: &Mark| mark.before.map(|before| [before.x, before.y]);
                self.runs(frame, series, was)
                    .iter()
                    .for_each(|run| canvas.path("was", &canvas::through(run)));
            }
            for run in self.runs(frame, series, |mark| Some([mark.x, mark.y])) {
                canvas.polyline("line", shape::dash(look), &run);
                lines.extend(run.windows(2).map(|ends| Segment { from: ends[0], to: ends[1] }));
            }
            canvas.close();
        }
        let spots: Vec<Spot> = spots::spots(&all, frame, |_| radius);
        if !self.bare {
            spots.iter().for_each(|spot| spot.draw(canvas, &spot.tooltip(&self.x, &self.y, None)));
        }
        if !alone {
            return Vec::new();
        }
        let within = Rect { right: WIDTH - MARGIN, ..frame.rect };
        spots::labels(canvas, &spots, within, &lines)
    }

    /// Pieces of a line between what could not be shown.
    fn runs(
        &self,
        frame: &Frame,
        series: &Series,
        of: impl Fn(&Mark) -> Option<[f64; 2]>,
    ) -> Vec<Vec<[f64; 2]>> {
        let places: Vec<Option<[f64; 2]>> = series
            .marks
            .iter()
            .map(|mark| of(mark).filter(|[x, y]| self.shows(*x, *y)).map(|[x, y]| frame.at(x, y)))
            .collect();
        let runs = places.split(Option::is_none).map(|run| run.iter().flatten().copied().collect::<Vec<_>>());
        runs.filter(|run| run.len() > 1).collect()
    }

    fn key(&self, names: &[(&str, usize)], before: bool) -> Key {
        let mut entries = Vec::new();
        if self.panels.len() > 1 {
            let named = names.iter().filter(|(name, _)| !name.is_empty());
            let look = |look: usize| Sign::Look { look, line: true, mark: !self.bare };
            entries.extend(named.map(|(name, at)| (look(*at), name.to_string())));
        }
        let levels = self.references.iter().filter(|level| self.y.takes(level.y));
        entries.extend(levels.map(|level| (Sign::Line("level"), level.name.clone())));
        if before {
            let sign = if self.bare { Sign::Line("was") } else { Sign::Before };
            entries.push((sign, "the earlier run".to_string()));
        }
        Key { entries, notes: Vec::new() }
    }
}

/// Room at the right for the names of lines.
fn end_labels(names: &[(&str, usize)]) -> f64 {
    let widest = names.iter().map(|(name, _)| text::width(name, LABEL * BOLD)).fold(0.0, f64::max);
    (widest + 14.0).min(WIDTH * 0.35)
}
