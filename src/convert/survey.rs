//! Survey: what the inputs hold, where it lies, and how to cut it up. One pass
//! over the points where the headers told the truth about the box, one more
//! where they did not, and one for each refinement of places that are too dense
//! ("Fast Out-of-Core Octree Generation", 4.1, counting and merging).
//!
//! While memory allows, the decoded records are kept: decoding is the dearest
//! step of a LAZ conversion and is done once.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::checkpoint::receipt::{self, ConversionKey};
use super::checkpoint::scratch::Scratch;
use super::context::Context;
use super::counting::CountingPasses;
use super::error::{Result, StageError};
use super::gps_times;
use super::guards::damaged_input;
use super::memory_estimate::chunk_memory;
use super::options::{Damaged, Options};
use super::reference::{self, ReferenceSystem};
use super::values::coordinate_frame::CoordinateFrame;
use super::values::copc_plan::CopcPlan;
use super::values::counted_inputs::Survey;
use super::values::counting_result::CountingResult;
use super::values::inlier_region::InlierRegion;
use super::values::input_slice::{CachedRecords, ConversionInput, InputSlice};
use super::workers;
use crate::format::las::{GpsEpoch, LasFile};
use crate::octree::chunk_plan::{self, ChunkPlan};
use crate::octree::record::{self, RecordFormat, UnifiedSchema};

/// The inputs with their headers read, and how they will be gone through.
pub struct OpenedInputs {
    files: Vec<LasFile>,
    gps_time: Option<GpsEpoch>,
    units: Vec<InputSlice>,
    points: u64,
    missing: u64,
    /// Whether all records fit the memory.
    pub in_core: bool,
    /// What the files were found to say that is not so; the points decided.
    pub repairs: Vec<String>,
    /// What else is odd about them.
    pub notes: Vec<String>,
}

/// Opens the inputs, each a file.
pub fn open(paths: &[PathBuf], options: &Options, context: &Context) -> Result<OpenedInputs> {
    let ReadableFiles { mut files, missing, repairs, mut notes } = open_all(paths, options.damaged, context)?;
    let gps_time = gps_times::bring_together(&mut files, options.format, &mut notes)?;
    let points: u64 = files.iter().map(|f| f.header().points).sum();
    if points == 0 {
        let names: Vec<String> = paths.iter().map(|p| p.display().to_string()).collect();
        return Err(StageError::NoPoints(names.join(", ")));
    }
    let units = cut_into_units(&files, points);
    let in_core = fits_in_core(&files, &units, points, options, context);
    Ok(OpenedInputs { files, gps_time, units, points, missing, in_core, repairs, notes })
}

impl OpenedInputs {
    /// What tells this conversion from any other: the program, the options, the
    /// inputs as they are now, and where the octree goes.
    pub fn identity(&self, options: &Options, output: &Path) -> ConversionKey {
        let mut hasher = blake3::Hasher::new();
        let mut add = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        add(receipt::FORMAT.as_bytes());
        add(serde_json::to_string(options).unwrap_or_default().as_bytes());
        add(std::path::absolute(output).unwrap_or_else(|_| output.into()).as_os_str().as_encoded_bytes());
        for file in &self.files {
            add(file.path().as_os_str().as_encoded_bytes());
            add(file.stamp().as_bytes());
            add(&file.header().points.to_le_bytes());
        }
        *hasher.finalize().as_bytes()
    }
}

/// Surveys the inputs. Out of core, decoded LAZ goes to the scratch, and what
/// an earlier run put there is not decoded again.
pub fn survey(
    opened: OpenedInputs,
    options: &Options,
    scratch: Option<&Scratch>,
    context: &Context,
) -> Result<Survey> {
    let OpenedInputs { files, gps_time, units, points, missing, in_core, mut repairs, mut notes } = opened;
    let sources: Vec<RecordFormat> = files
        .iter()
        .map(|f| RecordFormat {
            format: f.header().point_format,
            record_length: f.header().record_length,
            extra: f.header().extra.clone(),
        })
        .collect();
    let counter = CountingPasses {
        files: &files,
        units: &units,
        keep: in_core,
        scratch,
        context,
        guard: options.outliers,
        region: InlierRegion::default(),
    };
    let (findings, base) =
        counter.findings(points).map_err(|error| damaged_input::explain(error, context))?;
    let CountingResult { found, census, region, repairs: more, notes: odd } = findings;
    repairs.extend(more);
    notes.extend(odd);
    let limit = chunk_plan::chunk_limit(points);

    let ored: Vec<(RecordFormat, Vec<u8>)> =
        sources.iter().cloned().zip(found.into_iter().map(|f| f.ored)).collect();
    let mut unified = UnifiedSchema::new(&ored, &options.attributes, options.lod_color.second());
    check_wanted(options, &unified)?;
    let CoordinateFrame { lattice, requantise, cube } = base;
    let position = &mut unified.schema.attributes[0];
    (position.scale, position.offset) = (lattice.scale.to_vec(), lattice.offset.to_vec());
    let ReferenceSystem { crs, projection } =
        reference::find(&files, options.crs.as_deref(), &lattice, &mut notes);
    let layouts = layouts(&files, &sources);
    let inputs = files
        .into_iter()
        .zip(sources)
        .zip(requantise)
        .zip(layouts)
        .map(|(((las, source), requantise), layout)| ConversionInput { las, source, requantise, layout });
    let plan = ChunkPlan::new(census, limit);
    let inputs: Vec<ConversionInput> = inputs.collect();
    let mut survey = Survey {
        inputs,
        units,
        points,
        missing,
        region,
        lattice,
        cube,
        unified,
        plan,
        projection,
        crs,
        gps_time,
        copc: None,
        in_core,
        repairs,
        notes,
    };
    if options.format.copc {
        survey.copc = Some(CopcPlan::new(&mut survey)?);
    }
    Ok(survey)
}

/// The inputs that have points, what they lack, and what is odd about all.
struct ReadableFiles {
    files: Vec<LasFile>,
    missing: u64,
    repairs: Vec<String>,
    notes: Vec<String>,
}

/// Opens all files; those without points are left out.
fn open_all(paths: &[PathBuf], damaged: Damaged, context: &Context) -> Result<ReadableFiles> {
    let opened: Vec<Mutex<Option<LasFile>>> = paths.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        paths.len(),
        &context.cancel,
        || (),
        |(), i| {
            let file = damaged_input::open(&paths[i], damaged, context)?;
            *opened[i].lock().unwrap_or_else(|e| e.into_inner()) = Some(file);
            Ok(())
        },
    )?;
    let mut opened: Vec<LasFile> = opened.into_iter().filter_map(|f| f.into_inner().ok().flatten()).collect();
    if damaged == Damaged::Keep {
        opened = damaged_input::leave_out(opened, context)?;
    }
    let (mut repairs, mut notes) = (Vec::new(), Vec::new());
    let mut files = Vec::new();
    let missing = opened.iter().map(|file| file.header().missing).sum();
    for file in opened {
        let name = file.path().display();
        repairs.extend(file.header().notes.iter().map(|n| format!("{name}: {n}")));
        if file.header().points > 0 {
            files.push(file);
        } else {
            notes.push(format!("{name}: holds no points"));
        }
    }
    Ok(ReadableFiles { files, missing, repairs, notes })
}

/// Slices of a cloud, but for the longest of records, and a cloud of many files.
const MOST_UNITS: u64 = 1 << 16;

/// Slices small enough to keep all cores busy to the end, large enough that
/// their parts for one chunk are worth a read.
fn cut_into_units(files: &[LasFile], points: u64) -> Vec<InputSlice> {
    let most = points_of_a_unit(points);
    let mut units = Vec::new();
    let mut end = 0;
    for (input, file) in files.iter().enumerate() {
        for slice in file.slices(most) {
            units.push(InputSlice { input, slice, at: end, kept: Mutex::new(CachedRecords::Nowhere) });
            end += u64::from(slice.points) * file.header().record_length as u64;
        }
    }
    units
}

/// A LAZ header may promise billions of points for a few bytes; there must not be a
/// slice for each million of them.
fn points_of_a_unit(points: u64) -> u32 {
    (points / 64).clamp(50_000, 1_000_000).max(points / MOST_UNITS).min(u64::from(u32::MAX)) as u32
}

/// Points a thread up to which a cloud is converted in core, where nothing is
/// kept of it should it be interrupted: a minute or two of work.
const IN_CORE_POINTS: u64 = 100_000_000;

/// Whether all raw records fit the memory limit beside the work on them.
fn fits_in_core(
    files: &[LasFile],
    units: &[InputSlice],
    points: u64,
    options: &Options,
    context: &Context,
) -> bool {
    let raw: u64 = files.iter().map(|f| f.header().points * f.header().record_length as u64).sum();
    let longest = files.iter().map(|f| f.header().record_length as u64).max().unwrap_or(0);
    let slice = units.iter().map(|u| u64::from(u.slice.points)).max().unwrap_or(0) * longest;
    let chunk = points.min(chunk_plan::chunk_limit(points));
    let record = longest + 8 + options.lod_color.second().map_or(0, |_| 6);
    let work = context.threads as u64 * (slice + chunk_memory(chunk, 0, record, options));
    // What joins the chunks' roots waits for the merge.
    let joining = if options.format.copc { points * record } else { 0 };
    let needed = raw + joining + work + chunk_plan::census_cells(points) * 16 + (32 << 20);
    needed <= context.memory_limit && points <= IN_CORE_POINTS * context.threads as u64
}

/// For each input the first that has the same fields, scale, offset and kind of GPS
/// times.
fn layouts(files: &[LasFile], sources: &[RecordFormat]) -> Vec<usize> {
    // Tiles by the thousand may each have their own offset.
    let mut by_grid: HashMap<[u64; 6], Vec<usize>> = HashMap::new();
    let layout = |input: usize| {
        let header = files[input].header();
        let ([a, b, c], [d, e, f]) = (header.scale, header.offset);
        let alike = by_grid.entry([a, b, c, d, e, f].map(f64::to_bits)).or_default();
        let first = alike.iter().copied().find(|other| {
            sources[*other] == sources[input] && files[*other].own_gps_time() == files[input].own_gps_time()
        });
        first.unwrap_or_else(|| {
            alike.push(input);
            input
        })
    };
    (0..files.len()).map(layout).collect()
}

/// A name that was asked for must exist somewhere, used or not.
fn check_wanted(options: &Options, unified: &UnifiedSchema) -> Result<()> {
    if record::is_auto(&options.attributes) {
        return Ok(());
    }
    let kept = unified.schema.attributes.iter().map(|a| &a.name);
    let known: Vec<&str> = kept.chain(&unified.unused).chain(&unified.left_out).map(String::as_str).collect();
    for wanted in &options.attributes {
        if !known.iter().any(|name| name.eq_ignore_ascii_case(wanted)) {
            return Err(StageError::UnknownAttribute { wanted: wanted.clone(), known: known.join(", ") });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A LAZ header may promise as many points as no coder gets into its bytes, and
    /// must not have memory prepared for a slice of each million of them.
    #[test]
    fn a_promise_makes_no_more_slices_than_a_cloud_has() {
        for points in [1, 50_000, 10_000_000, 200_000_000_000, 1 << 47] {
            let slices = points / u64::from(points_of_a_unit(points));
            assert!(slices <= MOST_UNITS + 1, "{slices} slices for {points} points");
        }
    }
}
