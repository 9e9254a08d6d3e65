//! A finished drawing, and the measures that all charts share.

use super::canvas::{Anchor, Canvas, Setting};
use super::frame::{BOLD, LINE, TICK};
use super::text;

/// All charts are as wide, so that on a page their frames and texts match.
pub(super) const WIDTH: f64 = 720.0;
/// Left and right of everything.
pub(super) const MARGIN: f64 = 4.0;

pub(super) struct Drawing {
    title: String,
    canvas: Canvas,
    height: f64,
}

impl Drawing {
    pub fn new(title: &str, canvas: Canvas, bottom: f64) -> Drawing {
        Drawing { title: title.to_string(), canvas, height: bottom + 8.0 }
    }

    /// Where there is nothing to draw, and why.
    pub fn empty(title: &str, left_out: Option<String>) -> Drawing {
        let mut canvas = Canvas::default();
        canvas.rect("frame", [MARGIN, 4.0], [WIDTH - 2.0 * MARGIN, 72.0]);
        canvas.text("label", [WIDTH / 2.0, 45.0], Anchor::Middle, "Nothing was measured.");
        let mut y = 80.0;
        for line in left_out.iter().flat_map(|note| text::wrapped(note, TICK, WIDTH - 2.0 * MARGIN)) {
            y += LINE;
            canvas.text("note", [MARGIN, y], Anchor::Start, &line);
        }
        Drawing::new(title, canvas, y)
    }

    pub fn svg(self, setting: Setting) -> String {
        let Drawing { title, canvas, height } = self;
        if setting == Setting::Page {
            return canvas.svg([WIDTH, height], &title, setting);
        }
        // Alone it has no page to say what it is.
        let mut whole = Canvas::default();
        let heading = text::fitted(&title, HEADING * BOLD, WIDTH - 2.0 * MARGIN);
        let top = if heading.is_empty() { PADDING } else { PADDING + 28.0 };
        whole.text("heading", [PADDING + MARGIN, PADDING + 16.0], Anchor::Start, &heading);
        whole.moved(canvas, [PADDING, top]);
        whole.svg([WIDTH + 2.0 * PADDING, height + top], &title, setting)
    }
}

const HEADING: f64 = 15.0;
/// Around a chart that stands alone.
const PADDING: f64 = 12.0;
