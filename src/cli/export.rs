//! `lodestone export`: an octree or a COPC file back to LAS or LAZ.

use std::path::PathBuf;

use super::arguments;
use super::exit::Exit;
use super::output::{failed, say};
use crate::export::{ExportRequest, export};
use crate::platform::limits;
use crate::words::{Plain, grouped};

/// Write the points of an octree or a COPC file as LAS or LAZ, with all attributes
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The octree's folder, or a COPC file
    source: PathBuf,
    /// The file to write, ending in .las or .laz; one that is there is replaced
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Only points within this box of world coordinates: XMIN,YMIN,XMAX,YMAX or
    /// XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX
    #[arg(long, value_name = "BOX", value_parser = bounds, allow_hyphen_values = true)]
    bounds: Option<BoundsArgument>,
    /// Only the points of the levels 0 (the root) to N: fewer, evenly spread
    #[arg(long, value_name = "N")]
    level: Option<u8>,
    /// The point format, 0 to 10; what the points had, or what holds them, if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=10))]
    point_format: Option<u8>,
    /// Threads to work with; all that the machine or container grants if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory to work with, as in 512M or 16G; a quarter of what there is if not given
    #[arg(long, value_name = "BYTES", value_parser = arguments::parse_bytes)]
    memory_limit: Option<u64>,
}

/// The smallest and the largest corner.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BoundsArgument([f64; 3], [f64; 3]);

fn bounds(text: &str) -> Result<BoundsArgument, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let bounds = match numbers.as_deref() {
        Some(&[a, b, c, d]) => BoundsArgument([a, b, f64::NEG_INFINITY], [c, d, f64::INFINITY]),
        Some(&[a, b, c, d, e, f]) => BoundsArgument([a, b, c], [d, e, f]),
        _ => {
            return Err(format!(
                "{text:?} is no box; write XMIN,YMIN,XMAX,YMAX, with ZMIN and ZMAX if you like"
            ));
        }
    };
    match (0..3).all(|axis| bounds.0[axis] <= bounds.1[axis]) {
        true => Ok(bounds),
        false => Err(format!("{text:?} is no box: a smallest coordinate is larger than the largest")),
    }
}

pub fn run(arguments: Arguments) -> Exit {
    let pool = match arguments::pool(arguments.threads) {
        Ok(pool) => pool,
        Err(error) => return failed(&error),
    };
    let request = ExportRequest {
        source: arguments.source,
        output: arguments.output,
        bounds: arguments.bounds.map(|BoundsArgument(low, high)| (low, high)),
        level: arguments.level,
        point_format: arguments.point_format,
        memory_limit: arguments.memory_limit.unwrap_or_else(limits::default_memory_limit),
    };
    match pool.install(|| export(&request)) {
        Ok(exported) => {
            let (path, points) = (Plain(request.output.display()), grouped(exported.points));
            say!("{path}: {points} points of point format {}", exported.point_format);
            Exit::Done
        }
        Err(error) => failed(&error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_read_flat_and_whole() {
        assert_eq!(bounds("1, 2,3,4").unwrap().0[..2], [1.0, 2.0]);
        assert_eq!(bounds("-1,2,-3,4,5,6.5"), Ok(BoundsArgument([-1.0, 2.0, -3.0], [4.0, 5.0, 6.5])));
        for text in ["", "1,2,3", "1,2,0,4", "a,b,c,d", "1,2,3,NaN"] {
            assert!(bounds(text).is_err(), "{text}");
        }
    }
}
