//! Rectangles and segments of a drawing, y pointing down.

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub from: [f64; 2],
    pub to: [f64; 2],
}

impl Rect {
    pub fn new([left, top]: [f64; 2], [width, height]: [f64; 2]) -> Rect {
        Rect { left, top, right: left + width, bottom: top + height }
    }

    pub fn around([x, y]: [f64; 2], radius: f64) -> Rect {
        Rect { left: x, top: y, right: x, bottom: y }.grown(radius)
    }

    pub fn grown(self, by: f64) -> Rect {
        Rect { left: self.left - by, top: self.top - by, right: self.right + by, bottom: self.bottom + by }
    }

    pub fn width(&self) -> f64 {
        self.right - self.left
    }

    pub fn height(&self) -> f64 {
        self.bottom - self.top
    }

    pub fn middle(&self) -> [f64; 2] {
        [(self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0]
    }

    pub fn meets(&self, other: &Rect) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    pub fn holds(&self, other: &Rect) -> bool {
        self.left <= other.left
            && other.right <= self.right
            && self.top <= other.top
            && other.bottom <= self.bottom
    }

    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }

    pub fn nearest(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x.clamp(self.left, self.right), y.clamp(self.top, self.bottom)]
    }
}

impl Segment {
    pub fn crosses(&self, other: &Segment) -> bool {
        let side = |line: &Segment, [x, y]: [f64; 2]| {
            let [dx, dy] = [line.to[0] - line.from[0], line.to[1] - line.from[1]];
            dx * (y - line.from[1]) - dy * (x - line.from[0])
        };
        side(self, other.from) * side(self, other.to) < 0.0
            && side(other, self.from) * side(other, self.to) < 0.0
    }

    pub fn meets(&self, rect: &Rect) -> bool {
        let Rect { left, top, right, bottom } = *rect;
        let apart = self.from[0].max(self.to[0]) < left
            || self.from[0].min(self.to[0]) > right
            || self.from[1].max(self.to[1]) < top
            || self.from[1].min(self.to[1]) > bottom;
        if apart {
            return false;
        }
        let diagonals = [
            Segment { from: [left, top], to: [right, bottom] },
            Segment { from: [left, bottom], to: [right, top] },
        ];
        rect.contains(self.from)
            || rect.contains(self.to)
            || diagonals.iter().any(|line| line.crosses(self))
            || {
                // Along an axis a segment may touch a diagonal's end alone.
                self.from[0] == self.to[0] || self.from[1] == self.to[1]
            }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_meet_what_they_touch() {
        let rect = Rect::new([10.0, 10.0], [20.0, 10.0]);
        let meets = |from, to| Segment { from, to }.meets(&rect);
        assert!(meets([0.0, 15.0], [40.0, 15.0]), "through");
        assert!(meets([0.0, 0.0], [12.0, 12.0]), "into");
        assert!(meets([15.0, 12.0], [20.0, 14.0]), "inside");
        assert!(meets([5.0, 17.0], [17.0, 5.0]), "over a corner");
        assert!(!meets([0.0, 14.0], [14.0, 0.0]), "past a corner");
        assert!(!meets([0.0, 15.0], [9.0, 15.0]), "before");
    }

    #[test]
    fn segments_cross_only_between_their_ends() {
        let line = Segment { from: [0.0, 0.0], to: [10.0, 10.0] };
        assert!(line.crosses(&Segment { from: [0.0, 10.0], to: [10.0, 0.0] }));
        assert!(!line.crosses(&Segment { from: [0.0, 10.0], to: [4.0, 6.0] }));
        assert!(!line.crosses(&Segment { from: [1.0, 0.0], to: [11.0, 10.0] }));
    }
}
