//! The front: what nothing else beats on both axes.

use super::data::{Axis, Better};
use super::spots::Spot;

/// So that less is better: the value, or what stands for it.
fn cost(axis: &Axis, value: f64) -> f64 {
    if axis.better == Better::Higher { -value } else { value }
}

/// For each point, who beats it: is no worse in both and better in one.
pub(super) fn beaten(points: &[[f64; 2]], x: &Axis, y: &Axis) -> Vec<Option<usize>> {
    let costs: Vec<[f64; 2]> = points.iter().map(|[a, b]| [cost(x, *a), cost(y, *b)]).collect();
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    // Who is beaten by several is told of one that is beaten by none.
    let free: Vec<bool> = costs.iter().map(|own| !costs.iter().any(|other| beats(other, own))).collect();
    let by = |own: &[f64; 2]| (0..costs.len()).find(|other| free[*other] && beats(&costs[*other], own));
    costs.iter().map(by).collect()
}

/// Whether both axes have a better end.
pub(super) fn defined(x: &Axis, y: &Axis) -> bool {
    x.better != Better::Neither && y.better != Better::Neither
}

/// The border of what is beaten, as a line of steps across the frame, from the worst
/// of one axis to the worst of the other. `ends` are the worst places of both.
pub(super) fn steps(spots: &[Spot], ends: [f64; 2]) -> Vec<[f64; 2]> {
    let mut corners: Vec<[f64; 2]> =
        spots.iter().filter(|spot| spot.beaten.is_none()).map(|spot| spot.at).collect();
    // From the best in x on; then y gets better with every step.
    let way = |a: &[f64; 2]| (a[0] - ends[0]).abs();
    corners.sort_by(|a, b| way(b).total_cmp(&way(a)));
    let (Some(first), Some(last)) = (corners.first().copied(), corners.last().copied()) else {
        return Vec::new();
    };
    let mut line = vec![[first[0], ends[1]]];
    for corner in corners {
        if let Some(previous) = line.last().copied()
            && previous[0] != corner[0]
        {
            line.push([corner[0], previous[1]]);
        }
        line.push(corner);
    }
    line.push([ends[0], last[1]]);
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nothing_beats_is_on_the_front() {
        let lower = Axis::linear("", "");
        let points = [[1.0, 4.0], [2.0, 2.0], [2.0, 2.0], [3.0, 3.0], [2.0, 5.0], [4.0, 1.0]];
        let by = beaten(&points, &lower, &lower);
        assert_eq!(by, [None, None, None, Some(1), Some(0), None]);
        let higher = lower.clone().better(Better::Higher);
        let by = beaten(&points, &lower, &higher);
        assert_eq!(by, [None, Some(0), Some(0), Some(0), None, Some(0)]);
    }
}
