//! The median of the last differences, as LASzip keeps it: five values in order,
//! of which a new one pushes out the least or the greatest by turns.

#[derive(Debug, Clone, Copy)]
pub struct Median {
    values: [i32; 5],
    /// Whether the greatest goes next.
    greatest_goes: bool,
}

impl Default for Median {
    fn default() -> Median {
        Median { values: [0; 5], greatest_goes: true }
    }
}

impl Median {
    pub fn get(&self) -> i32 {
        self.values[2]
    }

    pub fn add(&mut self, value: i32) {
        // Not a plain turn by turn: only a value on the far side of the median
        // changes which end goes next.
        let above = if self.greatest_goes { value >= self.values[2] } else { value > self.values[2] };
        let place = if self.greatest_goes {
            let place = self.values[..4].iter().position(|v| value < *v).unwrap_or(4);
            self.values.copy_within(place..4, place + 1);
            place
        } else {
            let place = self.values[1..].iter().rposition(|v| *v < value).map_or(0, |at| at + 1);
            self.values.copy_within(1..=place, 0);
            place
        };
        self.values[place] = value;
        if above == self.greatest_goes {
            self.greatest_goes = !self.greatest_goes;
        }
    }
}
