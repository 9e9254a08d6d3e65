//! Survey: what the inputs hold, where it lies, and how to cut it up. One pass
//! over the points where the headers told the truth about the box, one more
//! where they did not, and one for each refinement of places that are too dense
//! ("Fast Out-of-Core Octree Generation", 4.1, counting and merging).
//!
//! While memory allows, the decoded records are kept: decoding is the dearest
//! step of a LAZ conversion and is done once.

use std::path::PathBuf;
use std::sync::Mutex;

use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::options::Options;
use super::workers;
use crate::cloud::census::Census;
use crate::cloud::cube::Cube;
use crate::cloud::lattice::{self, Lattice, Requantise, SourceGrid};
use crate::cloud::plan::{self, Plan};
use crate::cloud::record::{self, Source, Unified};
use crate::format::las::{LasFile, Slice};
use crate::format::potree;

/// One input file that has points.
pub struct Input {
    pub las: LasFile,
    pub source: Source,
    pub requantise: Requantise,
}

/// A slice of an input, and its records where they were kept.
pub struct Unit {
    pub input: usize,
    pub slice: Slice,
    pub kept: Mutex<Option<Vec<u8>>>,
}

/// What the later stages go by.
pub struct Survey {
    pub inputs: Vec<Input>,
    pub units: Vec<Unit>,
    pub points: u64,
    pub lattice: Lattice,
    pub cube: Cube,
    pub unified: Unified,
    pub plan: Plan,
    pub projection: String,
    /// Whether all records are in memory.
    pub in_core: bool,
    /// Times that the points were gone through.
    pub passes: u32,
    /// What the files were found to say that is not so, or odd.
    pub notes: Vec<String>,
}

/// Memory that indexing a chunk of so many points takes, in bytes: two arrays
/// of items and the finished records beside the raw ones.
pub fn chunk_memory(points: u64, raw: u64, record: u64) -> u64 {
    points * (2 * 16 + 1 + raw + 2 * record) + (12 << 20)
}

/// Surveys the inputs, each a file.
pub fn survey(paths: &[PathBuf], options: &Options, context: &Context) -> Result<Survey> {
    let (files, mut notes) = open_all(paths, context)?;
    let points: u64 = files.iter().map(|f| f.header().points).sum();
    if points == 0 {
        let names: Vec<String> = paths.iter().map(|p| p.display().to_string()).collect();
        return Err(StageError::NoPoints(names.join(", ")));
    }
    let sources: Vec<Source> = files
        .iter()
        .map(|f| Source {
            format: f.header().point_format,
            record_length: f.header().record_length,
            extra: f.header().extra.clone(),
        })
        .collect();
    let units = cut_into_units(&files, points);
    let in_core = fits_in_core(&files, &units, points, context);
    let mut counter = Counter { files: &files, units: &units, keep: in_core, context, passes: 0 };

    context.progress.begin(Stage::Survey, points);
    let hints: Vec<SourceGrid> = files.iter().map(hinted_grid).collect();
    let hinted = Counting::new(&hints, points);
    let found = counter.first_pass(&hinted)?;
    let grids: Vec<SourceGrid> = found.iter().map(|f| f.grid).collect();
    let mut counting = Counting::new(&grids, points);
    if counting.lattice == hinted.lattice && counting.cube == hinted.cube {
        counting = hinted;
    } else {
        let lying = hints.iter().zip(&grids).zip(&files).filter(|((h, g), _)| h != g);
        notes.extend(lying.take(5).map(|(_, f)| {
            format!("{}: the header's bounding box is not the points' own", f.path().display())
        }));
        counter.count_again(&counting)?;
    }
    let limit = plan::chunk_limit(points);
    while counting.census.refine(limit) {
        counter.count_again(&counting)?;
    }
    let passes = counter.passes;

    let ored: Vec<(Source, Vec<u8>)> =
        sources.iter().cloned().zip(found.into_iter().map(|f| f.ored)).collect();
    let mut unified = Unified::new(&ored, &options.attributes);
    check_wanted(options, &unified)?;
    let Counting { lattice, requantise, cube, census } = counting;
    let position = &mut unified.schema.attributes[0];
    (position.scale, position.offset) = (lattice.scale.to_vec(), lattice.offset.to_vec());
    let projection = projection(&files, &mut notes);
    let inputs = files
        .into_iter()
        .zip(sources)
        .zip(requantise)
        .map(|((las, source), requantise)| Input { las, source, requantise })
        .collect();
    let plan = Plan::new(census, limit);
    Ok(Survey { inputs, units, points, lattice, cube, unified, plan, projection, in_core, passes, notes })
}

/// Opens all files; those without points are left out.
fn open_all(paths: &[PathBuf], context: &Context) -> Result<(Vec<LasFile>, Vec<String>)> {
    let opened: Vec<Mutex<Option<LasFile>>> = paths.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        paths.len(),
        &context.cancel,
        || (),
        |(), i| {
            let file = LasFile::open(&paths[i])?;
            *opened[i].lock().unwrap_or_else(|e| e.into_inner()) = Some(file);
            Ok(())
        },
    )?;
    let mut notes = Vec::new();
    let mut files = Vec::new();
    for file in opened.into_iter().filter_map(|f| f.into_inner().ok().flatten()) {
        let name = file.path().display();
        notes.extend(file.header().notes.iter().map(|n| format!("{name}: {n}")));
        if file.header().points > 0 {
            files.push(file);
        } else {
            notes.push(format!("{name}: holds no points"));
        }
    }
    Ok((files, notes))
}

/// Slices small enough to keep all cores busy to the end, large enough that
/// their parts for one chunk are worth a read.
fn cut_into_units(files: &[LasFile], points: u64) -> Vec<Unit> {
    let slice = (points / 64).clamp(50_000, 1_000_000) as u32;
    let mut units = Vec::new();
    for (input, file) in files.iter().enumerate() {
        let slices = file.slices(slice).into_iter();
        units.extend(slices.map(|slice| Unit { input, slice, kept: Mutex::new(None) }));
    }
    units
}

/// Whether all raw records fit the memory limit beside the work on them.
fn fits_in_core(files: &[LasFile], units: &[Unit], points: u64, context: &Context) -> bool {
    let raw: u64 = files.iter().map(|f| f.header().points * f.header().record_length as u64).sum();
    let longest = files.iter().map(|f| f.header().record_length as u64).max().unwrap_or(0);
    let slice = units.iter().map(|u| u64::from(u.slice.points)).max().unwrap_or(0) * longest;
    let chunk = points.min(plan::chunk_limit(points));
    let work = context.threads as u64 * (slice + chunk_memory(chunk, 0, longest + 8));
    raw + work + plan::census_cells(points) * 16 + (32 << 20) <= context.memory_limit
}

/// The grid a header claims; harmless where it lies, since what is found
/// decides.
fn hinted_grid(file: &LasFile) -> SourceGrid {
    let h = file.header();
    let raw = |world: f64, axis: usize| ((world - h.offset[axis]) / h.scale[axis]).round() as i32;
    let min: [i32; 3] = std::array::from_fn(|a| raw(h.min[a], a));
    let max: [i32; 3] = std::array::from_fn(|a| raw(h.max[a], a).max(min[a]));
    SourceGrid { scale: h.scale, offset: h.offset, min, max }
}

/// A census on a certain lattice and cube.
struct Counting {
    lattice: Lattice,
    requantise: Vec<Requantise>,
    cube: Cube,
    census: Census,
}

impl Counting {
    fn new(grids: &[SourceGrid], points: u64) -> Counting {
        let (lattice, requantise) = lattice::choose(grids, potree::morton::viewer_may_misread);
        let cube = Cube::around(&lattice);
        let (min, max) = (cube.tree(lattice.min), cube.tree(lattice.max));
        let census = Census::new(cube.bits, min, max, plan::census_cells(points));
        Counting { lattice, requantise, cube, census }
    }
}

/// What the first pass finds in one file.
#[derive(Clone)]
struct Found {
    grid: SourceGrid,
    ored: Vec<u8>,
}

/// Goes through all units, from memory where they are kept.
struct Counter<'a> {
    files: &'a [LasFile],
    units: &'a [Unit],
    keep: bool,
    context: &'a Context,
    passes: u32,
}

/// Records looked at together: small enough to stay in the core's cache over
/// the loops that go through them.
const BLOCK: usize = 2048;

impl Counter<'_> {
    /// Counts on the hinted grid and finds the true bounds and used bits.
    fn first_pass(&mut self, hinted: &Counting) -> Result<Vec<Found>> {
        self.passes += 1;
        let start: Vec<Found> = self
            .files
            .iter()
            .map(|f| {
                let h = f.header();
                let (min, max) = ([i32::MAX; 3], [i32::MIN; 3]);
                let grid = SourceGrid { scale: h.scale, offset: h.offset, min, max };
                Found { grid, ored: vec![0; h.record_length] }
            })
            .collect();
        let found: Vec<Mutex<Found>> = start.into_iter().map(Mutex::new).collect();
        self.each_unit(|unit, records| {
            let length = self.files[unit.input].header().record_length;
            let requantise = &hinted.requantise[unit.input];
            let mut looker = Looker::new(length);
            for block in records.chunks(BLOCK * length) {
                looker.look(block);
                let trees = block
                    .chunks_exact(length)
                    .map(|r| hinted.cube.tree(requantise.stored(record::raw_position(r))));
                // Points outside the hinted box show in the bounds.
                hinted.census.count(trees);
            }
            looker.add_to(&mut found[unit.input].lock().unwrap_or_else(|e| e.into_inner()));
            Ok(())
        })?;
        Ok(found.into_iter().map(|f| f.into_inner().unwrap_or_else(|e| e.into_inner())).collect())
    }

    fn count_again(&mut self, counting: &Counting) -> Result<()> {
        self.passes += 1;
        self.context
            .progress
            .begin(Stage::Survey, self.units.iter().map(|u| u64::from(u.slice.points)).sum());
        self.each_unit(|unit, records| {
            let las = &self.files[unit.input];
            let requantise = &counting.requantise[unit.input];
            let trees = records
                .chunks_exact(las.header().record_length)
                .map(|r| counting.cube.tree(requantise.stored(record::raw_position(r))));
            match counting.census.count(trees) {
                0 => Ok(()),
                _ => Err(StageError::InputChanged(las.path().to_path_buf())),
            }
        })
    }

    fn each_unit(&self, work: impl Fn(&Unit, &[u8]) -> Result<()> + Sync) -> Result<()> {
        let context = self.context;
        workers::in_order(context.threads, self.units.len(), &context.cancel, Vec::new, |buffer, i| {
            let unit = &self.units[i];
            let mut kept = unit.kept.lock().unwrap_or_else(|e| e.into_inner());
            match &*kept {
                Some(records) => work(unit, records)?,
                None => {
                    self.files[unit.input].read(unit.slice, buffer)?;
                    work(unit, buffer)?;
                    if self.keep {
                        *kept = Some(std::mem::take(buffer));
                    }
                }
            }
            context.progress.advance(u64::from(unit.slice.points));
            Ok(())
        })
    }
}

/// Bounds and used bits of records of one length.
struct Looker {
    length: usize,
    min: [i32; 3],
    max: [i32; 3],
    /// Eight records ORed side by side, so that whole words can be.
    ored: Vec<u64>,
}

impl Looker {
    fn new(length: usize) -> Looker {
        Looker { length, min: [i32::MAX; 3], max: [i32::MIN; 3], ored: vec![0; length] }
    }

    fn look(&mut self, records: &[u8]) {
        for r in records.chunks_exact(self.length) {
            let p = record::raw_position(r);
            for a in 0..3 {
                self.min[a] = self.min[a].min(p[a]);
                self.max[a] = self.max[a].max(p[a]);
            }
        }
        let mut eights = records.chunks_exact(8 * self.length);
        for eight in &mut eights {
            for (to, word) in self.ored.iter_mut().zip(eight.as_chunks::<8>().0) {
                *to |= u64::from_le_bytes(*word);
            }
        }
        for (i, byte) in eights.remainder().iter().enumerate() {
            self.ored[i / 8] |= u64::from(*byte) << (8 * (i % 8));
        }
    }

    fn add_to(&self, found: &mut Found) {
        for a in 0..3 {
            found.grid.min[a] = found.grid.min[a].min(self.min[a]);
            found.grid.max[a] = found.grid.max[a].max(self.max[a]);
        }
        let bytes: Vec<u8> = self.ored.iter().flat_map(|w| w.to_le_bytes()).collect();
        record::or_records(&mut found.ored, &bytes);
    }
}

/// The first file's reference system that says something; the others are
/// noted where they differ.
fn projection(files: &[LasFile], notes: &mut Vec<String>) -> String {
    let mut chosen: Option<&str> = None;
    for file in files {
        let Some(crs) = &file.header().crs else { continue };
        match chosen {
            None => chosen = Some(&crs.text),
            Some(first) if first != crs.text => notes.push(format!(
                "{}: its coordinate reference system differs from the first file's, which is kept",
                file.path().display()
            )),
            Some(_) => {}
        }
    }
    chosen.unwrap_or_default().to_string()
}

/// A name that was asked for must exist somewhere, used or not.
fn check_wanted(options: &Options, unified: &Unified) -> Result<()> {
    let kept = unified.schema.attributes.iter().map(|a| &a.name);
    let known: Vec<&str> = kept.chain(&unified.unused).chain(&unified.left_out).map(String::as_str).collect();
    for wanted in &options.attributes {
        if !known.iter().any(|name| name.eq_ignore_ascii_case(wanted)) {
            return Err(StageError::UnknownAttribute { wanted: wanted.clone(), known: known.join(", ") });
        }
    }
    Ok(())
}
