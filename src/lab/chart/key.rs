//! How to read a chart, below it: signs with a few words each, and what could not be
//! drawn.

use super::canvas::{Anchor, Canvas};
use super::frame::{LINE, TICK};
use super::{shape, text};

pub(super) enum Sign {
    /// A method's line and mark, or only one of them.
    Look {
        look: usize,
        line: bool,
        mark: bool,
    },
    /// A line of a class of `style::CSS`.
    Line(&'static str),
    /// What is beaten is lighter.
    Off,
    /// Then and now.
    Before,
    /// A bar then.
    Hollow,
    /// An area.
    Circle(f64),
    None,
}

pub(super) struct Key {
    pub entries: Vec<(Sign, String)>,
    pub notes: Vec<String>,
}

const GAP: f64 = 18.0;

impl Key {
    /// Draws it from a place on, so wide, and says where it ends.
    pub fn draw(&self, canvas: &mut Canvas, [left, top]: [f64; 2], width: f64) -> f64 {
        let mut y = top;
        for row in self.rows(width) {
            let height = row.iter().map(|(sign, _)| sign.height()).fold(0.0, f64::max);
            // All signs of a row stand on one line, be some circles large.
            let (mut x, middle) = (left, y + height / 2.0);
            for (sign, words) in row {
                sign.draw(canvas, [x, middle]);
                canvas.text("key", [x + sign.width(), middle + TICK * 0.36], Anchor::Start, &words);
                x += sign.width() + text::width(&words, TICK) + GAP;
            }
            y += height + 4.0;
        }
        for line in self.notes.iter().flat_map(|note| text::wrapped(note, TICK, width)) {
            y += LINE;
            canvas.text("note", [left, y], Anchor::Start, &line);
        }
        y
    }

    /// As many entries a row as fit; longer words are cut.
    fn rows(&self, width: f64) -> Vec<Vec<(&Sign, String)>> {
        let mut rows: Vec<Vec<(&Sign, String)>> = Vec::new();
        let mut room = 0.0;
        for (sign, words) in &self.entries {
            let words = text::fitted(words, TICK, width - sign.width());
            let own = sign.width() + text::width(&words, TICK);
            match rows.last_mut().filter(|_| own <= room) {
                Some(row) => row.push((sign, words)),
                None => {
                    rows.push(vec![(sign, words)]);
                    room = width;
                }
            }
            room -= own + GAP;
        }
        rows
    }
}

impl Sign {
    fn width(&self) -> f64 {
        match self {
            Sign::Look { line: true, .. } | Sign::Line(_) | Sign::Before | Sign::Hollow => 34.0,
            Sign::Look { .. } | Sign::Off => 18.0,
            Sign::Circle(radius) => 2.0 * radius + 6.0,
            Sign::None => 0.0,
        }
    }

    fn height(&self) -> f64 {
        match self {
            Sign::Circle(radius) => (2.0 * radius + 2.0).max(LINE),
            _ => LINE,
        }
    }

    fn draw(&self, canvas: &mut Canvas, [x, y]: [f64; 2]) {
        match self {
            Sign::Look { look, line, mark } => {
                canvas.open(&shape::class(*look), "");
                if *line {
                    canvas.polyline("line", shape::dash(*look), &[[x, y], [x + 28.0, y]]);
                }
                if *mark {
                    let middle = if *line { x + 14.0 } else { x + 6.0 };
                    canvas.path("mark", &shape::path(*look, [middle, y], 4.5));
                }
                canvas.close();
            }
            Sign::Line(class) => canvas.line(class, [x, y], [x + 28.0, y]),
            Sign::Off => canvas.path("mark off", &shape::path(0, [x + 6.0, y], 5.0)),
            Sign::Before => {
                canvas.path("was", &shape::path(0, [x + 4.0, y], 3.5));
                canvas.path("arrow", &super::spots::arrow([x + 8.0, y], [x + 27.0, y]));
            }
            Sign::Hollow => canvas.rect("hollow", [x, y - 6.0], [28.0, 12.0]),
            Sign::Circle(radius) => canvas.circle("was", [x + radius, y], *radius),
            Sign::None => {}
        }
    }
}
