//! Writes the points of an octree or a COPC file as LAS or LAZ.

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::cloud::{CloudReader, PlacedNode};
use super::pick::Pick;
use super::{ExportError, ExportRequest, Exported};
use crate::format::copc::{Described, RecordLayout};
use crate::format::las::{GpsEpoch, LasOptions, LasWriter};
use crate::octree::record::raw_position;
use crate::platform::disk::Disk;

/// Exports to a hidden file beside the output, which gets its name when all points are in
/// it. Works on the threads of the current rayon pool.
///
/// # Errors
/// Where the source cannot be read, the output not written, or a value does not fit the
/// point format.
pub fn export(request: &ExportRequest) -> Result<Exported, ExportError> {
    let is_compressed = match ending(&request.output).as_deref() {
        Some("laz") => true,
        Some("las") => false,
        _ => return Err(ExportError::Ending(request.output.clone())),
    };
    let cloud = CloudReader::open(&request.source, request.memory_limit)?;
    if is_same(&request.source, &request.output) {
        return Err(ExportError::Itself(request.output.clone()));
    }
    let pick = Pick::new(&cloud.schema, cloud.has_averages);
    let layout = match request.point_format {
        Some(format) => RecordLayout::of_format(&pick.schema, &Described::default(), format)?,
        None => RecordLayout::of_las(&pick.schema, &Described::default(), cloud.fits_legacy)?,
    };
    let nodes: Vec<&PlacedNode> =
        cloud.nodes.iter().filter(|node| is_wanted(&cloud, node, request)).collect();
    let points = nodes.iter().map(|node| u64::from(node.points)).sum();
    let options = options(&cloud, &layout, is_compressed, points)?;
    let disk = Disk::new();
    let part = hidden(&request.output);
    let written = write(&cloud, &nodes, &pick, &layout, &options, request, (&disk, &part));
    match written {
        Ok(points) => {
            disk.rename(&part, &request.output)?;
            Ok(Exported { points, point_format: layout.point_format() })
        }
        Err(error) => {
            // The first error is the one that matters.
            let _ = disk.remove_file(&part);
            Err(error)
        }
    }
}

fn write(
    cloud: &CloudReader,
    nodes: &[&PlacedNode],
    pick: &Pick,
    layout: &RecordLayout,
    options: &LasOptions,
    request: &ExportRequest,
    (disk, part): (&Disk, &Path),
) -> Result<u64, ExportError> {
    let mut writer = LasWriter::create_on(disk, part, options)?;
    writer.set_gps_time(cloud.gps_time);
    let mut points = 0;
    let room = request.memory_limit / 4;
    let mut rest = nodes;
    while !rest.is_empty() {
        // As many nodes as the memory has room for, but always one.
        let mut cost = 0;
        let fits = rest.iter().take_while(|node| {
            cost += cloud.cost(node);
            cost <= room
        });
        let (batch, later) = rest.split_at(fits.count().clamp(1, rest.len()));
        rest = later;
        let read = |node: &&PlacedNode| -> Result<Vec<u8>, ExportError> {
            let mut records = pick.apply(cloud.read(node)?);
            if let Some(bounds) = request.bounds {
                records = within(cloud, &records, pick.schema.record_size(), bounds);
            }
            if let Some(what) = layout.misfit(&records) {
                return Err(ExportError::Misfit { what, instead: roomy(layout.point_format()) });
            }
            let mut las = Vec::new();
            layout.promote(&records, &mut las);
            Ok(las)
        };
        for las in batch.par_iter().map(read).collect::<Vec<_>>() {
            let las = las?;
            points += (las.len() / layout.record_length()) as u64;
            writer.write(&las)?;
        }
    }
    writer.finish()?;
    Ok(points)
}

/// Whether a node may have points that are wanted.
fn is_wanted(cloud: &CloudReader, node: &PlacedNode, request: &ExportRequest) -> bool {
    if node.points == 0 || request.level.is_some_and(|level| node.level > level) {
        return false;
    }
    let Some((low, high)) = request.bounds else { return true };
    let side = cloud.side / f64::from(node.level).exp2();
    (0..3).all(|axis| {
        let from = cloud.corner[axis] + side * node.cell[axis] as f64;
        // Cubes of others may be a unit beside their points.
        let slack = 2.0 * cloud.scale[axis].abs();
        from - slack <= high[axis] && low[axis] <= from + side + slack
    })
}

/// The records within a box of world coordinates, faces included.
fn within(cloud: &CloudReader, records: &[u8], size: usize, (low, high): ([f64; 3], [f64; 3])) -> Vec<u8> {
    let mut inside = Vec::new();
    for record in records.chunks_exact(size) {
        let stored = raw_position(record);
        let is_inside = (0..3).all(|axis| {
            let world = f64::from(stored[axis]) * cloud.scale[axis] + cloud.offset[axis];
            low[axis] <= world && world <= high[axis]
        });
        if is_inside {
            inside.extend_from_slice(record);
        }
    }
    inside
}

fn options(
    cloud: &CloudReader,
    layout: &RecordLayout,
    compressed: bool,
    points: u64,
) -> Result<LasOptions, ExportError> {
    let format = layout.point_format();
    let is_unusual =
        matches!(cloud.gps_time, GpsEpoch::Standard { .. }) && cloud.gps_time != GpsEpoch::ADJUSTED;
    if is_unusual && format < 6 {
        let what = format!("GPS times that are {} need LAS 1.5", cloud.gps_time.describe());
        return Err(ExportError::Misfit { what, instead: roomy(format) });
    }
    let minor = match format {
        6.. if is_unusual => 5,
        6.. => 4,
        _ if points > u64::from(u32::MAX) => 4,
        4..=5 => 3,
        _ => 2,
    };
    Ok(LasOptions {
        version: (1, minor),
        point_format: format,
        scale: cloud.scale,
        offset: cloud.offset,
        compressed,
        extra: layout.extra_fields(),
        crs: cloud.crs.clone(),
        software: format!("lodestone {}", env!("CARGO_PKG_VERSION")),
    })
}

/// The point format with the same fields, and room for all their values.
fn roomy(format: u8) -> u8 {
    match format {
        2 | 3 => 7,
        4 => 9,
        5 => 10,
        0 | 1 => 6,
        other => other,
    }
}

fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase())
}

fn hidden(output: &Path) -> PathBuf {
    let name = output.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    output.with_file_name(format!(".{name}.part"))
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((fs::canonicalize(a), fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}
