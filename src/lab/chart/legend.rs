//! Signs of a key: how a method's line and marks look.

use super::canvas::Canvas;
use super::shape;

/// One entry of a key: a method's line, mark or both.
pub(super) fn sign(look: usize, line: bool, mark: bool) -> (Canvas, f64) {
    let mut canvas = Canvas::default();
    let mut parts = Canvas::default();
    if line {
        parts.line("line", [0.0, 0.0], [28.0, 0.0]);
    }
    if mark {
        parts.path("mark", &shape::path(look, [if line { 14.0 } else { 6.0 }, 0.0], 4.5));
    }
    canvas.group(&shape::class(look), "", [0.0, 0.0], parts);
    (canvas, if line { 34.0 } else { 18.0 })
}

/// The sign of a mark of an earlier run and where it is now.
pub(super) fn earlier_sign() -> (Canvas, f64) {
    let mut canvas = Canvas::default();
    canvas.path("was", &shape::path(0, [4.0, 0.0], 3.5));
    canvas.arrow([8.0, 0.0], [27.0, 0.0]);
    (canvas, 34.0)
}
