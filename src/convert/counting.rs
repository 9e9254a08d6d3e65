//! Counting: the survey's passes over the points. The first finds the true
//! bounds and which bytes are used while it counts on the grid that the headers
//! promise; another follows where they were wrong, and one for each refinement
//! of places that are too dense.

use std::sync::Mutex;

use super::checkpoint::receipt::JournalEntry;
use super::checkpoint::scratch::Scratch;
use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::free_space::check_free_space;
use super::options::GuardMode;
use super::values::coordinate_frame::CoordinateFrame;
use super::values::counting_result::{CountingResult, FileStatistics};
use super::values::inlier_region::InlierRegion;
use super::values::input_slice::{CachedRecords, InputSlice};
use super::workers;
use crate::format::las::{LasFile, returns_of};
use crate::octree::chunk_plan;
use crate::octree::counting_grid::CountingGrid;
use crate::octree::lattice::SourceGrid;
use crate::octree::record;

/// The grid a header claims; harmless where it lies, since what is found
/// decides.
fn hinted_grid(file: &LasFile) -> SourceGrid {
    let h = file.header();
    SourceGrid::around(h.scale, h.offset, h.min, h.max)
}

/// A census on its base.
struct Counting {
    base: CoordinateFrame,
    census: CountingGrid,
}

impl Counting {
    fn new(grids: &[SourceGrid], points: u64) -> Counting {
        let base = CoordinateFrame::new(grids);
        let (cube, lattice) = (&base.cube, &base.lattice);
        let (min, max) = (cube.tree(lattice.min), cube.tree(lattice.max));
        let census = CountingGrid::new(cube.bits, min, max, chunk_plan::census_cells(points));
        Counting { base, census }
    }
}

/// Whether the header counts other returns than there are. One that counts
/// none says nothing; nor can one be right for points that are missing.
fn belies_returns(found: &FileStatistics, file: &LasFile) -> bool {
    let header = file.header();
    let said = header.returns.iter().zip(&found.returns[1..]);
    header.missing == 0 && said.into_iter().any(|(said, counted)| said != counted)
}

/// Whether the header's box is another than the points' own. Points that are
/// missing may have reached farther, and those that are there may not.
fn belies_box(found: &FileStatistics, file: &LasFile) -> bool {
    let (said, there) = (hinted_grid(file), &found.grid);
    match file.header().missing {
        0 => said != *there,
        _ => (0..3).any(|a| there.min[a] < said.min[a] || there.max[a] > said.max[a]),
    }
}

/// Whether a coordinate is at a limit of 32-bit integers.
fn is_saturated(record: &[u8]) -> bool {
    record::raw_position(record).iter().any(|raw| matches!(*raw, i32::MIN | i32::MAX))
}

/// Says how many points have coordinates that were cut off, and in which files.
fn note_saturated(found: &[FileStatistics], files: &[LasFile]) -> Option<String> {
    let cut: Vec<_> = found.iter().zip(files).filter(|(found, _)| found.saturated > 0).collect();
    let points: u64 = cut.iter().map(|(found, _)| found.saturated).sum();
    let named: Vec<String> =
        cut.iter().take(MOST_NAMED).map(|(_, file)| file.path().display().to_string()).collect();
    let more = match cut.len().checked_sub(MOST_NAMED) {
        Some(more @ 1..) => format!(" and {more} more files"),
        _ => String::new(),
    };
    (points > 0).then(|| {
        format!(
            "{points} points of {}{more} have a coordinate at the limit of 32-bit integers: the program that \
             wrote it could not hold the true one with the scale and offset of its header. Where they lie is \
             lost; export them again with an offset near the points, or a coarser scale",
            named.join(", ")
        )
    })
}

/// Files of which the same is to be told, each by its name up to here.
const MOST_NAMED: usize = 5;

/// Says of each file what is not so in it; of many, how many more there are.
fn tell<'f>(lying: impl Iterator<Item = &'f LasFile>, what: &str, repairs: &mut Vec<String>) {
    let lying: Vec<&LasFile> = lying.collect();
    let named = lying.iter().take(MOST_NAMED);
    repairs.extend(
        named.map(|file| format!("{}: the header's {what} not the points' own", file.path().display())),
    );
    if let Some(more @ 1..) = lying.len().checked_sub(MOST_NAMED) {
        let files = if more == 1 { "file" } else { "files" };
        repairs.push(format!("and {more} more {files} of which the header's {what} not the points' own"));
    }
}

/// A file of which nothing is left has no bounds; those of a point that is left
/// will do.
fn fill_in(found: &mut [FileStatistics]) {
    let Some(some) = found.iter().find(|f| f.grid.min[0] <= f.grid.max[0]).map(|f| f.grid) else { return };
    for FileStatistics { grid, .. } in found.iter_mut().filter(|f| f.grid.min[0] > f.grid.max[0]) {
        let at = std::array::from_fn(|a| {
            let world = f64::from(some.min[a]) * some.scale[a] + some.offset[a];
            ((world - grid.offset[a]) / grid.scale[a]).round() as i32
        });
        (grid.min, grid.max) = (at, at);
    }
}

/// Goes through all units, from memory where they are kept.
pub struct CountingPasses<'a> {
    pub files: &'a [LasFile],
    pub units: &'a [InputSlice],
    /// Whether decoded records are to stay in memory.
    pub keep: bool,
    pub scratch: Option<&'a Scratch>,
    pub context: &'a Context,
    pub guard: GuardMode,
    /// The part of the cloud that is counted; all of it at first.
    pub region: InlierRegion,
}

/// Records looked at together: small enough to stay in the core's cache over
/// the loops that go through them.
const BLOCK: usize = 2048;

impl CountingPasses<'_> {
    /// Goes through the points as often as it takes, unless an earlier run has.
    pub fn findings(mut self, points: u64) -> Result<(CountingResult, CoordinateFrame)> {
        if let Some(scratch) = self.scratch {
            for (unit, _) in self.units.iter().zip(0..).filter(|(_, n)| scratch.past.has_records(*n)) {
                *unit.kept() = CachedRecords::Scratch;
            }
            if let Some(findings) = scratch.take_findings() {
                let grids: Vec<SourceGrid> = findings.found.iter().map(|f| f.grid).collect();
                return Ok((findings, CoordinateFrame::new(&grids)));
            }
            check_free_space(&self.context.disk, &scratch.folder, self.missing_in(scratch)?)?;
        }
        let hints: Vec<SourceGrid> = self.files.iter().map(hinted_grid).collect();
        let (mut found, mut counting) = self.fit(&hints, points)?;
        let mut repairs = Vec::new();
        let lying = |belies: fn(&FileStatistics, &LasFile) -> bool| {
            let all = found.iter().zip(self.files);
            all.filter(move |(found, file)| belies(found, file)).map(|(_, file)| file)
        };
        tell(lying(belies_box), "bounding box is", &mut repairs);
        tell(lying(belies_returns), "counts by return are", &mut repairs);
        while self.guard != GuardMode::Keep
            && let Some(kept) = self.region.next(&counting.census, points)
        {
            let hints = self.region.restrict(counting.base, &counting.census, kept, self.files);
            (found, counting) = self.fit(&hints, points)?;
        }
        let notes = note_saturated(&found, self.files).into_iter().chain(self.region.note(points)).collect();
        let limit = chunk_plan::chunk_limit(points);
        while counting.census.refine(limit) {
            self.count_again(&counting)?;
        }
        let Counting { base, census } = counting;
        let findings = CountingResult { found, census, region: self.region, repairs, notes };
        match self.scratch {
            Some(scratch) => Ok((scratch.surveyed(findings)?, base)),
            None => Ok((findings, base)),
        }
    }

    /// Counts on a grid fitted to the points' true bounds, going by hints at
    /// first.
    fn fit(&mut self, hints: &[SourceGrid], points: u64) -> Result<(Vec<FileStatistics>, Counting)> {
        let hinted = Counting::new(hints, points);
        let mut found = self.first_pass(&hinted)?;
        fill_in(&mut found);
        let grids: Vec<SourceGrid> = found.iter().map(|f| f.grid).collect();
        let counting = Counting::new(&grids, points);
        if counting.base.lattice == hinted.base.lattice && counting.base.cube == hinted.base.cube {
            return Ok((found, hinted));
        }
        self.count_again(&counting)?;
        Ok((found, counting))
    }

    /// Bytes that the runs will need on disk beyond what they have.
    fn missing_in(&self, scratch: &Scratch) -> Result<u64> {
        let bytes = |f: &LasFile| f.header().points * f.header().record_length as u64;
        let all: u64 = self.files.iter().map(bytes).sum();
        Ok(all.saturating_sub(scratch.runs.allocated()?))
    }

    /// Counts on the hinted grid and finds the true bounds and used bits.
    fn first_pass(&mut self, hinted: &Counting) -> Result<Vec<FileStatistics>> {
        let start: Vec<FileStatistics> = self
            .files
            .iter()
            .map(|f| {
                let h = f.header();
                let (min, max) = ([i32::MAX; 3], [i32::MIN; 3]);
                let grid = SourceGrid { scale: h.scale, offset: h.offset, min, max };
                FileStatistics { grid, ored: vec![0; h.record_length], returns: [0; 16], saturated: 0 }
            })
            .collect();
        let found: Vec<Mutex<FileStatistics>> = start.into_iter().map(Mutex::new).collect();
        self.each_unit(|unit, records| {
            let length = self.files[unit.input].header().record_length;
            let requantise = &hinted.base.requantise[unit.input];
            let mut looker = Looker::new(self.files[unit.input].header().point_format, length);
            let mut tally = hinted.census.tally();
            let mut inside = Vec::new();
            for block in records.chunks(BLOCK * length) {
                looker.look_at_all(block);
                let block = self.region.of(unit.input, block, length, &mut inside);
                looker.look(block);
                let trees = block
                    .chunks_exact(length)
                    .map(|r| hinted.base.cube.tree(requantise.stored(record::raw_position(r))));
                // Points outside the hinted box show in the bounds.
                tally.count(trees);
            }
            looker.add_to(&mut found[unit.input].lock().unwrap_or_else(|e| e.into_inner()));
            Ok(())
        })?;
        Ok(found.into_iter().map(|f| f.into_inner().unwrap_or_else(|e| e.into_inner())).collect())
    }

    fn count_again(&mut self, counting: &Counting) -> Result<()> {
        self.each_unit(|unit, records| {
            let las = &self.files[unit.input];
            let requantise = &counting.base.requantise[unit.input];
            let length = las.header().record_length;
            let mut inside = Vec::new();
            let mut tally = counting.census.tally();
            for block in records.chunks(BLOCK * length) {
                let trees = self
                    .region
                    .of(unit.input, block, length, &mut inside)
                    .chunks_exact(length)
                    .map(|r| counting.base.cube.tree(requantise.stored(record::raw_position(r))));
                if tally.count(trees) > 0 {
                    return Err(StageError::changed(las));
                }
            }
            Ok(())
        })
    }

    fn each_unit(&self, work: impl Fn(&InputSlice, &[u8]) -> Result<()> + Sync) -> Result<()> {
        let context = self.context;
        let points = self.units.iter().map(|u| u64::from(u.slice.points)).sum();
        context.progress.begin(Stage::Survey, points);
        workers::in_order(context.threads, self.units.len(), &context.cancel, Vec::new, |buffer, i| {
            let unit = &self.units[i];
            let las = &self.files[unit.input];
            let mut kept = unit.kept();
            match (&*kept, self.scratch) {
                (CachedRecords::Memory(records), _) => work(unit, records)?,
                (CachedRecords::Scratch, Some(scratch)) => {
                    buffer.resize(unit.slice.points as usize * las.header().record_length, 0);
                    scratch.runs.read_exact_at(buffer, unit.at)?;
                    work(unit, buffer)?;
                }
                _ => {
                    las.read(unit.slice, buffer)?;
                    work(unit, buffer)?;
                    if self.keep {
                        *kept = CachedRecords::Memory(std::mem::take(buffer));
                    } else if let Some(scratch) = self.scratch
                        && las.header().compressed
                    {
                        // Decoding is the dearest step of all; once is enough.
                        scratch.runs.write_all_at(buffer, unit.at)?;
                        let end = unit.at + buffer.len() as u64;
                        scratch.receipt(&JournalEntry::Spooled { unit: i as u32, end })?;
                        *kept = CachedRecords::Scratch;
                    }
                }
            }
            context.progress.advance(u64::from(unit.slice.points));
            Ok(())
        })
    }
}

/// Bounds, used bits and returns of records of one file.
struct Looker {
    point_format: u8,
    length: usize,
    returns: [u64; 16],
    saturated: u64,
    min: [i32; 3],
    max: [i32; 3],
    /// Eight records ORed side by side, so that whole words can be.
    ored: Vec<u64>,
}

impl Looker {
    fn new(point_format: u8, length: usize) -> Looker {
        let (min, max) = ([i32::MAX; 3], [i32::MIN; 3]);
        Looker { point_format, length, returns: [0; 16], saturated: 0, min, max, ored: vec![0; length] }
    }

    /// At all of its points, outliers too.
    fn look_at_all(&mut self, records: &[u8]) {
        self.saturated += records.chunks_exact(self.length).filter(|r| is_saturated(r)).count() as u64;
        returns_of(self.point_format, records, self.length, &mut self.returns);
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

    fn add_to(&self, found: &mut FileStatistics) {
        for a in 0..3 {
            found.grid.min[a] = found.grid.min[a].min(self.min[a]);
            found.grid.max[a] = found.grid.max[a].max(self.max[a]);
        }
        found.saturated += self.saturated;
        for (sum, more) in found.returns.iter_mut().zip(self.returns) {
            *sum += more;
        }
        let bytes: Vec<u8> = self.ored.iter().flat_map(|w| w.to_le_bytes()).collect();
        record::or_records(&mut found.ored, &bytes);
    }
}
