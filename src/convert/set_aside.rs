//! What is set aside: points that a guard keeps out of the octree, written as LAS
//! beside it, with all their attributes and a reason. Input = octree + set
//! aside, to the last point.
//!
//! Until they are written they are only ranges of records in the runs, so that a
//! crowd of forty million costs no memory.

use std::path::Path;

use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::options::{GuardMode, Options};
use super::values::counted_inputs::Survey;
use super::values::input_slice::ConversionInput;
use super::values::record_range::{ExcludedRange, RunSegment};
use super::values::runs::Runs;
use crate::format::las::{GpsEpoch, LasFile, LasOptions, LasWriter};
use crate::octree::attribute::{ExtraField, Scalar};

/// The file's name; where inputs differ in their layout, each layout gets one,
/// the second `set-aside-2.laz`.
pub const STEM: &str = "set-aside";

/// The extra field that holds the reason.
pub const REASON: &str = "set aside";

/// Writes what is to be set aside into the octree's folder; gives the names of
/// the files. Those are read back: what they say they hold is what was set aside.
pub fn write(
    survey: &Survey,
    runs: &Runs,
    ranges: &[ExcludedRange],
    options: &Options,
    folder: &Path,
    context: &Context,
) -> Result<Vec<String>> {
    let written: Vec<ExcludedRange> =
        ranges.iter().copied().filter(|range| range.reason.mode(options) == GuardMode::SetAside).collect();
    let mut layouts: Vec<&ConversionInput> = Vec::new();
    for range in &written {
        let input = input_of(survey, runs, range);
        if !layouts.iter().any(|other| other.layout == input.layout) {
            layouts.push(input);
        }
    }
    let points = written.iter().map(|range| u64::from(range.points)).sum();
    if points > 0 {
        // It may take as long as what came before.
        context.progress.begin(Stage::Index, points);
    }
    let (mut names, mut there) = (Vec::new(), 0);
    for (layout, number) in layouts.into_iter().zip(1..) {
        let extension = if is_compressible(layout.source.format) { "laz" } else { "las" };
        let name = match number {
            1 => format!("{STEM}.{extension}"),
            _ => format!("{STEM}-{number}.{extension}"),
        };
        let path = folder.join(&name);
        let mut writer = LasWriter::create_on(&context.disk, &path, &las_options(layout))?;
        writer.set_gps_time(layout.las.own_gps_time());
        for range in written.iter().filter(|range| input_of(survey, runs, range).layout == layout.layout) {
            append(&mut writer, layout, runs, range, context)?;
        }
        writer.finish()?;
        context.disk.sync_file(&path)?;
        there += LasFile::open(&path)?.header().points;
        names.push(name);
    }
    check_sum(points, there)?;
    Ok(names)
}

/// What is not in the octree is in the files beside it.
fn check_sum(points: u64, there: u64) -> Result<()> {
    match there == points {
        true => Ok(()),
        false => Err(StageError::Inconsistent(format!(
            "of {points} points that were set aside, {there} are in the files for them"
        ))),
    }
}

fn input_of<'s>(survey: &'s Survey, runs: &Runs, range: &ExcludedRange) -> &'s ConversionInput {
    &survey.inputs[runs.runs[range.run as usize].input]
}

/// Nobody compresses waveform packets.
fn is_compressible(format: u8) -> bool {
    !matches!(format, 4 | 5 | 9 | 10)
}

fn las_options(input: &ConversionInput) -> LasOptions {
    let header = input.las.header();
    let mut extra = header.extra.clone();
    // A file of points that were set aside may be converted in its turn.
    let taken = |name: &str| extra.iter().any(|field| field.name == name);
    let name = match taken(REASON) {
        false => REASON.to_string(),
        true => (2..).map(|n| format!("{REASON} {n}")).find(|name| !taken(name)).unwrap_or_default(),
    };
    extra.push(ExtraField {
        name,
        description: "1 outlier, 2 duplicate, 3 twin".into(),
        scalar: Scalar::U8,
        elements: 1,
        position: header.record_length,
        scale: Vec::new(),
        offset: Vec::new(),
    });
    LasOptions {
        // Only LAS 1.5 can say what unusual GPS times count from.
        version: match input.las.own_gps_time() {
            GpsEpoch::Standard { offset } if offset != 1000 && header.point_format >= 6 => (1, 5),
            _ => (1, 4),
        },
        point_format: header.point_format,
        scale: header.scale,
        offset: header.offset,
        compressed: is_compressible(header.point_format),
        extra,
        crs: header.crs_records.clone(),
        software: concat!("lodestone ", env!("CARGO_PKG_VERSION")).into(),
    }
}

/// Records that are copied at once.
const BLOCK: u32 = 1 << 16;

fn append(
    writer: &mut LasWriter,
    input: &ConversionInput,
    runs: &Runs,
    range: &ExcludedRange,
    context: &Context,
) -> Result<()> {
    let length = input.source.record_length;
    let mut buffer = Vec::new();
    let mut records = Vec::new();
    let mut done = 0;
    while done < range.points {
        if context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        let points = BLOCK.min(range.points - done);
        let part = RunSegment { run: range.run, first: range.first + done, points };
        let raw = runs.records(part, length, &mut buffer)?;
        records.clear();
        for record in raw.chunks_exact(length) {
            records.extend_from_slice(record);
            records.push(range.reason as u8);
        }
        // Beside the octree they count from where they did in their file.
        input.las.move_times_back(&mut records, length + 1)?;
        writer.write(&records)?;
        done += points;
        context.progress.advance(u64::from(points));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_hold_more_or_less_than_was_set_aside_are_not_published() {
        assert!(check_sum(7, 7).is_ok());
        for there in [0, 6, 8] {
            let error = check_sum(7, there).expect_err("another sum").to_string();
            assert!(error.contains(&format!("7 points that were set aside, {there} are")), "{error}");
        }
    }
}
