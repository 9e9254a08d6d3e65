//! Overviews of virtual point clouds: some points of all the files that share a coordinate
//! reference system, as one COPC file of bounded size that programs show from afar.
//!
//! Each file has a part of its points by the area that it covers, so that no file is shown
//! denser than its neighbors: its coarse levels, and of the finest that has a place, as of
//! nodes with more points than a node's grid has room for, every k-th point.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::ExportError;
use crate::convert::context::Context;
use crate::convert::formats::Formats;
use crate::convert::options::{GuardMode, Options};
use crate::convert::request::ConversionRequest;
use crate::convert::run;
use crate::format::copc::{CopcEntry, CopcFile, ENDING};
use crate::format::finished::copc_in;
use crate::format::las::{GpsEpoch, LasFile, LasOptions, LasWriter, record_length};

/// Points of an overview at most, but for one of each node.
const MAX_POINTS: u64 = 1_000_000;
/// And this part of all points at most: an overview is to be quicker to show than the files.
const MAX_PART: u64 = 4;
/// Points of a node that count: on a surface, a root has about one in each cell of 128².
const MAX_NODE_POINTS: u32 = 128 * 128;
/// Bytes of a record where its GPS time stands, in the point formats of COPC.
const TIME: std::ops::Range<usize> = 22..30;

/// A file that shows others from afar.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Overview {
    pub path: PathBuf,
    /// The coordinate reference system of the files that it shows; nothing if it shows all.
    pub crs: Option<String>,
}

/// Where overviews lie, and which files there are known to be none but ours.
#[derive(Debug, Clone)]
pub struct Place {
    folder: PathBuf,
    stem: String,
    own: Vec<PathBuf>,
}

impl Place {
    /// Beside a list, under its name. Ours are those files that the list now names as
    /// overviews; others of such names stay what they are.
    pub fn of_list(list: &Path) -> Place {
        let folder = list.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new(".")).to_path_buf();
        let stem = list.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let known: Value =
            fs::read(list).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
        let features = known["features"].as_array().map(Vec::as_slice).unwrap_or_default();
        let named = |path: &Path| {
            let href = format!("./{}", path.file_name().unwrap_or_default().to_string_lossy());
            features.iter().any(|feature| feature["assets"]["overview"]["href"] == href)
        };
        let own = named_so(&folder, &stem).into_iter().filter(|path| named(path)).collect();
        Place { folder, stem, own }
    }

    /// Beside a list, in a folder where nobody else puts files.
    pub fn of_own_folder(folder: &Path, stem: &str) -> Place {
        Place { folder: folder.to_path_buf(), stem: stem.to_string(), own: named_so(folder, stem) }
    }

    /// Whether a file is an overview that was made here, not a member of the list.
    pub fn has(&self, path: &Path) -> bool {
        let is_here = || {
            let folders = [path.parent(), Some(&*self.folder)];
            let [a, b] = folders.map(|folder| folder.and_then(|folder| fs::canonicalize(folder).ok()));
            a.is_some() && a == b
        };
        self.own.iter().any(|own| own.file_name() == path.file_name()) && is_here()
    }

    /// The overviews that are there now.
    pub fn existing(&self) -> Vec<Overview> {
        let overview = |path: &PathBuf| {
            let crs = LasFile::open(path).ok()?.header().crs.as_ref().map(|crs| crs.text.clone());
            Some(Overview { path: path.clone(), crs: Some(crs.unwrap_or_default()) })
        };
        self.own.iter().filter_map(overview).collect()
    }

    /// A name that is ours already and not taken again, or one that nothing has.
    fn free(&self, taken: &[Overview]) -> PathBuf {
        let is_free = |path: &PathBuf| {
            let is_taken = taken.iter().any(|overview| overview.path == *path);
            !is_taken && (self.own.contains(path) || fs::symlink_metadata(path).is_err())
        };
        let numbered = |number: u32| match number {
            1 => self.folder.join(format!("{}-overview{ENDING}", self.stem)),
            _ => self.folder.join(format!("{}-overview-{number}{ENDING}", self.stem)),
        };
        // There are fewer files than numbers.
        (1..=u32::MAX).map(numbered).find(is_free).unwrap_or_else(|| numbered(1))
    }
}

/// Files with names of overviews, one for each system: `NAME-overview`, `NAME-overview-2`, …
fn named_so(folder: &Path, stem: &str) -> Vec<PathBuf> {
    let is_named_so = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let rest =
            name.strip_suffix(ENDING).and_then(|name| name.strip_prefix(stem)?.strip_prefix("-overview"));
        rest.is_some_and(|rest| {
            rest.is_empty() || rest.strip_prefix('-').is_some_and(|number| number.parse::<u32>().is_ok())
        })
    };
    copc_in(folder).into_iter().filter(is_named_so).collect()
}

/// What is looked at of a file to choose its points.
struct Member {
    path: PathBuf,
    gps_time: GpsEpoch,
    points: u64,
    /// What it covers of the ground, in square units of its system.
    area: f64,
    /// Points that count, by level.
    levels: Vec<u64>,
}

/// The finest level that has a place, and the part of its points that has.
type Limit = (u8, f64);

/// Makes an overview for each coordinate reference system that at least two of the files
/// have, and removes those that have no such files any more. A file that cannot be read is
/// passed over. What is made is complete before it gets its name.
///
/// # Errors
/// Where a file's points cannot be read or an overview not be written. Then those of before
/// stay.
pub fn update(files: &[PathBuf], place: &mut Place, context: &Context) -> Result<Vec<Overview>, ExportError> {
    let mut groups: BTreeMap<String, Vec<Member>> = BTreeMap::new();
    for path in files {
        if context.cancel.is_cancelled() {
            return Err(ExportError::Cancelled);
        }
        let Ok(file) = CopcFile::open(path, context.memory_limit) else { continue };
        let crs = file.header.crs.as_ref().map(|crs| crs.text.clone()).unwrap_or_default();
        groups.entry(crs).or_default().push(member(&file));
    }
    groups.retain(|_, members| members.len() > 1);
    let before = place.existing();
    let mut made: Vec<Overview> = Vec::new();
    let scratch = place.folder.join(format!(".{}-overview", place.stem));
    // Names stay with their systems, so that a list of before names no wrong file.
    let (kept, new): (Vec<_>, Vec<_>) =
        groups.iter().partition(|(crs, _)| before.iter().any(|one| one.crs.as_ref() == Some(*crs)));
    for (crs, members) in kept.into_iter().chain(new) {
        let known = before.iter().find(|one| one.crs.as_ref() == Some(crs)).map(|one| one.path.clone());
        let path = known.unwrap_or_else(|| place.free(&[&before[..], &made].concat()));
        context.disk.empty_dir(&scratch)?;
        let written = write(crs, members, &scratch, &path, context);
        let cleared = context.disk.remove_dir_all(&scratch);
        written?;
        cleared?;
        made.push(Overview { path, crs: Some(crs.clone()) });
    }
    for path in std::mem::take(&mut place.own) {
        if !made.iter().any(|overview| overview.path == path) {
            context.disk.remove_file(&path)?;
        }
    }
    place.own = made.iter().map(|overview| overview.path.clone()).collect();
    Ok(made)
}

fn member(file: &CopcFile) -> Member {
    let mut levels = Vec::new();
    for entry in file.nodes().iter().filter(|entry| entry.points > 0) {
        let level = usize::from(entry.key.level);
        levels.resize(levels.len().max(level + 1), 0);
        levels[level] += u64::from(entry.points.min(MAX_NODE_POINTS));
    }
    let front = &file.front;
    let [x, y] = [0, 1].map(|axis| (front.max[axis] - front.min[axis]).max(0.0));
    // A line covers something too.
    let width = 1e-3 * x.max(y).max(front.scale[0].abs());
    Member {
        path: file.path().to_path_buf(),
        gps_time: file.header.gps_time,
        points: front.points,
        area: (x + width) * (y + width),
        levels,
    }
}

/// How much of each member there is room for.
fn limits(members: &[Member]) -> Vec<Limit> {
    let all: u64 = members.iter().map(|member| member.points).sum();
    let mut room = MAX_POINTS.min(all.div_ceil(MAX_PART)) as f64;
    let mut area: f64 = members.iter().map(|member| member.area).sum();
    let counted = |member: &Member| member.levels.iter().sum::<u64>() as f64;
    // What sparse ones leave is for the others: they come first.
    let mut order: Vec<usize> = (0..members.len()).collect();
    let density = |member: &Member| counted(member) / member.area;
    order.sort_by(|&a, &b| density(&members[a]).total_cmp(&density(&members[b])));
    let mut limits = vec![(0, 0.0); members.len()];
    for index in order {
        let member = &members[index];
        let share = (room * member.area / area).min(counted(member));
        limits[index] = limit(&member.levels, share);
        (room, area) = (room - share, area - member.area);
    }
    limits
}

/// Down to where levels have so many points.
fn limit(levels: &[u64], mut room: f64) -> Limit {
    for (level, points) in (0..).zip(levels) {
        let points = *points as f64;
        if points >= room {
            return (level, if points > 0.0 { room / points } else { 0.0 });
        }
        room -= points;
    }
    (u8::MAX, 1.0)
}

/// Points that are taken of a node with so many; of a root at least one, so that every file
/// is seen.
fn taken(entry: &CopcEntry, (finest, part): Limit) -> u32 {
    let most = entry.points.min(MAX_NODE_POINTS);
    let count = match entry.key.level.cmp(&finest) {
        Ordering::Less => most,
        Ordering::Equal => (f64::from(most) * part).ceil() as u32,
        Ordering::Greater => 0,
    };
    if entry.key.level == 0 { count.max(1).min(most) } else { count }
}

fn write(
    crs: &str,
    members: &[Member],
    scratch: &Path,
    path: &Path,
    context: &Context,
) -> Result<(), ExportError> {
    let limits = limits(members);
    // Seconds of the week and standard times do not go together; then there are none.
    let has_times = members.iter().all(|member| member.gps_time == members[0].gps_time);
    let mut inputs = Vec::new();
    for (number, member) in members.iter().enumerate() {
        if context.cancel.is_cancelled() {
            return Err(ExportError::Cancelled);
        }
        let input = scratch.join(format!("{number}.las"));
        thin(member, limits[number], has_times, &input, context)?;
        inputs.push(input);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let options = Options {
        format: Formats::COPC,
        name: Some(name.strip_suffix(ENDING).unwrap_or(&name).to_string()),
        crs: Some(crs.to_string()).filter(|crs| crs.contains('[')),
        // Few points of many clouds far apart are no outliers.
        outliers: GuardMode::Keep,
        duplicates: GuardMode::Keep,
        ..Options::default()
    };
    let output = scratch.join("made");
    let request = ConversionRequest {
        inputs,
        output: output.clone(),
        overwrite: true,
        keep_scratch: false,
        options,
        hashes: Default::default(),
    };
    let context = Context { scratch: scratch.join("scratch"), ..context.clone() };
    run::convert(&request, &context)
        .map_err(|error| ExportError::Overview { path: path.to_path_buf(), source: Box::new(error) })?;
    let made = copc_in(&output).into_iter().next().ok_or_else(|| ExportError::NoCloud(output.clone()))?;
    context.disk.rename(&made, path)?;
    Ok(())
}

/// Writes the points of one file that have a place, as LAS without its extra bytes.
fn thin(
    member: &Member,
    limit: Limit,
    has_times: bool,
    input: &Path,
    context: &Context,
) -> Result<(), ExportError> {
    let file = CopcFile::open(&member.path, context.memory_limit)?;
    let front = &file.front;
    let standard = record_length(front.format()).unwrap_or(front.record_length);
    let options = LasOptions {
        version: (1, 4),
        point_format: front.format(),
        scale: front.scale,
        offset: front.offset,
        compressed: false,
        extra: Vec::new(),
        crs: file.header.crs_records.clone(),
        software: format!("lodestone {}", env!("CARGO_PKG_VERSION")),
    };
    let mut writer = LasWriter::create_on(&context.disk, input, &options)?;
    writer.set_gps_time(if has_times { member.gps_time } else { GpsEpoch::Week });
    let mut reader = file.reader()?;
    for entry in file.nodes().iter().filter(|entry| entry.points > 0) {
        let count = taken(entry, limit) as usize;
        if count == 0 {
            continue;
        }
        let records = reader.read_las(entry)?;
        let points = records.len() / front.record_length;
        let mut thinned = Vec::with_capacity(count * standard);
        for number in 0..count {
            let at = number * points / count * front.record_length;
            let start = thinned.len();
            thinned.extend_from_slice(&records[at..at + standard]);
            if !has_times {
                thinned[start..][TIME].fill(0);
            }
        }
        writer.write(&thinned)?;
    }
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(points: u64, area: f64, levels: &[u64]) -> Member {
        Member { path: PathBuf::new(), gps_time: GpsEpoch::Week, points, area, levels: levels.to_vec() }
    }

    #[test]
    fn files_have_room_by_their_area() {
        let tile = |area| member(40_000_000, area, &[16_000, 64_000, 256_000, 1_024_000]);
        // A million for a hundred hectares: 250 000 and 750 000.
        assert_eq!(limits(&[tile(25.0), tile(75.0)]), [(2, 170.0 / 256.0), (3, 414.0 / 1_024.0)]);
        // What a sparse one leaves is for the other.
        let sparse = member(4_000_000, 50.0, &[100_000]);
        assert_eq!(limits(&[tile(50.0), sparse]), [(3, 564.0 / 1_024.0), (0, 1.0)]);
        // A quarter of all, at most.
        assert_eq!(limits(&[member(1_000, 1.0, &[600, 400])]), [(0, 250.0 / 600.0)]);
        // Of very many files, some points of each root.
        let many: Vec<Member> = (0..1_000).map(|_| tile(1.0)).collect();
        assert!(limits(&many).iter().all(|(level, part)| *level == 0 && (part * 16.0 - 1.0).abs() < 1e-6));
        // An empty file takes nothing.
        assert_eq!(limits(&[member(0, 1.0, &[])]), [(u8::MAX, 1.0)]);
    }

    #[test]
    fn nodes_give_no_more_than_their_part() {
        let entry = |level: u8, points: u32| CopcEntry {
            key: crate::octree::node::NodeKey { level, at: [0; 3] },
            offset: 0,
            size: 0,
            points,
        };
        assert_eq!(taken(&entry(2, 90_000), (3, 0.5)), MAX_NODE_POINTS);
        assert_eq!(taken(&entry(2, 1_001), (2, 0.5)), 501);
        assert_eq!(taken(&entry(2, 1_000), (1, 0.5)), 0);
        assert_eq!(taken(&entry(0, 1_000), (0, 0.0)), 1, "every file is seen");
    }

    #[test]
    fn only_known_overviews_are_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        for name in ["a-overview.copc.laz", "a-overview-2.copc.laz", "a-overview-x.copc.laz", "b.copc.laz"] {
            fs::write(at(name), b"").expect("written");
        }
        let list = at("a.vpc");
        let place = Place::of_list(&list);
        assert!(!place.has(&at("a-overview.copc.laz")), "no list names it");
        assert_eq!(place.free(&[]), at("a-overview-3.copc.laz"));
        let known = serde_json::json!({"features": [{"assets": {"overview": {"href": "./a-overview.copc.laz"}}},
            {"assets": {"overview": {"href": "./b.copc.laz"}}}]});
        fs::write(&list, known.to_string()).expect("written");
        let place = Place::of_list(&list);
        let is_own = |name: &str| place.has(&at(name));
        assert!(is_own("a-overview.copc.laz") && !is_own("a-overview-2.copc.laz") && !is_own("b.copc.laz"));
        assert_eq!(place.free(&[]), at("a-overview.copc.laz"));
        let own = Place::of_own_folder(folder.path(), "a");
        assert!(own.has(&at("a-overview-2.copc.laz")) && !own.has(&at("a-overview-x.copc.laz")));
    }
}
