//! Where points come from: every generator cut into blocks that can be made
//! without those before them.

use super::aerial::Flight;
use super::interior::Building;
use super::land::Land;
use super::point::Point;
use super::scan::Tripod;
use super::shapes::Shape;
use super::street;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// Scan lines of a flight, from the given one on.
    Aerial { flight: Flight, first_line: u64 },
    /// Columns of a scanner in the village.
    Street { tripod: Tripod, land: Land },
    /// Columns of a scanner in the building.
    Interior { tripod: Tripod, building: Building },
    /// Points by their number.
    Shape { shape: Shape, seed: u64 },
}

impl Source {
    /// Points a block.
    pub fn block_length(&self) -> u64 {
        match self {
            Source::Aerial { flight, .. } => flight.slots,
            Source::Street { tripod, .. } | Source::Interior { tripod, .. } => tripod.rows,
            Source::Shape { .. } => 256,
        }
    }

    /// Appends the points of a block.
    pub fn block(&self, number: u64, out: &mut Vec<Point>) {
        match self {
            Source::Aerial { flight, first_line } => flight.line(first_line + number, out),
            Source::Street { tripod, land } => {
                tripod.column(number, |eye, way| street::cast(land, eye, way), out);
            }
            Source::Interior { tripod, building } => {
                tripod.column(number, |eye, way| building.cast(eye, way), out);
            }
            Source::Shape { shape, seed } => {
                let first = number * self.block_length();
                out.extend((first..first + self.block_length()).map(|index| shape.point(*seed, index)));
            }
        }
    }
}
