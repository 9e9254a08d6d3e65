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
pub enum PointSource {
    /// Scan lines of a flight, from the given one on.
    Aerial { flight: Flight, first_line: u64 },
    /// Columns of a scanner in the village.
    Street { tripod: Tripod, land: Land },
    /// Columns of a scanner in the building.
    Interior { tripod: Tripod, building: Building },
    /// Points by their number.
    Shape { shape: Shape, seed: u64 },
}

impl PointSource {
    /// Points a block.
    pub fn block_length(&self) -> u64 {
        match self {
            PointSource::Aerial { flight, .. } => flight.slots,
            PointSource::Street { tripod, .. } | PointSource::Interior { tripod, .. } => tripod.rows,
            PointSource::Shape { .. } => 256,
        }
    }

    /// Appends the points of a block.
    pub fn block(&self, number: u64, out: &mut Vec<Point>) {
        match self {
            PointSource::Aerial { flight, first_line } => flight.line(first_line + number, out),
            PointSource::Street { tripod, land } => {
                tripod.column(number, |eye, way| street::cast(land, eye, way), out);
            }
            PointSource::Interior { tripod, building } => {
                tripod.column(number, |eye, way| building.cast(eye, way), out);
            }
            PointSource::Shape { shape, seed } => {
                let first = number * self.block_length();
                out.extend((first..first + self.block_length()).map(|index| shape.point(*seed, index)));
            }
        }
    }
}
