//! Virtual point clouds (`.vpc`): many COPC files as one, by a list of STAC items with boxes,
//! counts, systems and statistics, as QGIS, PDAL and untwine read it.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Value, json};

use super::ExportError;
use super::overview::Overview;
use crate::format::copc::{CopcFile, ENDING};
use crate::format::crs::ToDegrees;
use crate::format::finished::copc_in;
use crate::format::las::GpsEpoch;
use crate::octree::attribute::Scalar;

/// Points on an edge of a box whose place on Earth is looked up: edges are curves there.
const STEPS: u32 = 8;
/// Seconds from the beginning of 1970 to that of GPS time, and what adjusted times lack.
const GPS_EPOCH: f64 = 315_964_800.0;
const ADJUSTED: f64 = 1e9;
/// Leap seconds since 2017.
const LEAP_SECONDS: f64 = 18.0;
const DAY: i64 = 86_400;

/// A virtual point cloud, and the files that are not in it with the reason.
#[derive(Debug)]
pub struct Vpc {
    pub json: String,
    pub files: usize,
    pub points: u64,
    pub left_out: Vec<(PathBuf, String)>,
}

/// Lists COPC files. Paths in the list are relative to the folder `beside` which it will
/// lie. The overviews are not to be among the files.
pub fn list(files: &[PathBuf], beside: &Path, overviews: &[Overview], memory_limit: u64) -> Vpc {
    let share = memory_limit / rayon::current_num_threads().max(1) as u64;
    let overviews: Vec<(Option<&str>, String)> = overviews
        .iter()
        .map(|overview| (overview.crs.as_deref(), relative(&overview.path, beside)))
        .collect();
    let item = |path: &PathBuf| item(path, &relative(path, beside), &overviews, share);
    let items: Vec<Result<(Value, u64), ExportError>> = files.par_iter().map(item).collect();
    let (mut features, mut points, mut left_out) = (Vec::new(), 0, Vec::new());
    for (path, item) in files.iter().zip(items) {
        match item {
            Ok((item, count)) => {
                points += count;
                features.push(item);
            }
            Err(error) => left_out.push((path.clone(), error.to_string())),
        }
    }
    name_uniquely(&mut features);
    let files = features.len();
    let all = json!({ "type": "FeatureCollection", "features": features });
    Vpc { json: format!("{all:#}\n"), files, points, left_out }
}

/// COPC files in a folder and one level below it, sorted; hidden folders are passed over.
pub fn found(folder: &Path) -> Vec<PathBuf> {
    let mut files = copc_in(folder);
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        if !is_hidden && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            files.extend(copc_in(&entry.path()));
        }
    }
    files.sort();
    files
}

/// A path as the list has it: from the list's own folder.
fn relative(path: &Path, beside: &Path) -> String {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let (path, beside) = (absolute(path), absolute(beside));
    match path.strip_prefix(&beside) {
        Ok(below) => format!("./{}", below.display()),
        Err(_) => path.display().to_string(),
    }
}

/// Two files of one name in two folders are two items.
fn name_uniquely(features: &mut [Value]) {
    let mut taken = std::collections::HashSet::new();
    for feature in features {
        let name = feature["id"].as_str().unwrap_or_default().to_string();
        let mut unique = name.clone();
        let mut number = 2;
        while !taken.insert(unique.clone()) {
            unique = format!("{name}-{number}");
            number += 1;
        }
        feature["id"] = json!(unique);
    }
}

fn item(
    path: &Path,
    href: &str,
    overviews: &[(Option<&str>, String)],
    memory_limit: u64,
) -> Result<(Value, u64), ExportError> {
    let file = CopcFile::open(path, memory_limit)?;
    let front = &file.front;
    let crs = file.header.crs.as_ref().map_or("", |crs| crs.text.as_str());
    let native = [front.min, front.max].concat();
    let corners = ring([front.min[0], front.min[1]], [front.max[0], front.max[1]], 1);
    let (on_earth, degrees) = match degrees(crs, front.min, front.max) {
        Some(ring) => (bounds(&ring, front.min[2], front.max[2]), ring),
        None => (native.clone(), corners.clone()),
    };
    let columns = columns(&file);
    let schemas: Vec<Value> = columns
        .iter()
        .map(|(name, kind, size)| json!({ "name": name, "type": kind, "size": size }))
        .collect();
    let mut properties = json!({
        "datetime": datetime(&file),
        "pc:count": front.points,
        "pc:type": "lidar",
        "pc:encoding": "application/vnd.laszip+copc",
        "pc:schemas": schemas,
        "proj:wkt2": if crs.contains('[') { crs } else { "" },
        "proj:geometry": polygon(&corners),
        "proj:bbox": native,
    });
    if let Some(statistics) = statistics(&file, &columns) {
        properties["pc:statistics"] = statistics;
    }
    let mut assets =
        json!({ "data": { "href": href, "roles": ["data"], "type": "application/vnd.laszip+copc" } });
    if let Some((_, href)) = overviews.iter().find(|(of, _)| of.is_none_or(|of| of == crs)) {
        assets["overview"] =
            json!({ "href": href, "roles": ["overview"], "type": "application/vnd.laszip+copc" });
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let id = name.strip_suffix(ENDING).unwrap_or(&name);
    let item = json!({
        "type": "Feature",
        "stac_version": "1.0.0",
        "stac_extensions": [
            "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
            "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
        ],
        "id": id,
        "geometry": polygon(&degrees),
        "bbox": on_earth,
        "properties": properties,
        "links": [],
        "assets": assets,
    });
    Ok((item, front.points))
}

/// The outline of a rectangle, against the clock, the first point again at the end.
fn ring(min: [f64; 2], max: [f64; 2], steps: u32) -> Vec<[f64; 2]> {
    let corners = [[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]], [min[0], min[1]]];
    let mut ring = vec![corners[0]];
    for pair in corners.windows(2) {
        ring.extend((1..=steps).map(|step| {
            let part = f64::from(step) / f64::from(steps);
            [0, 1].map(|axis| {
                if step == steps {
                    pair[1][axis]
                } else {
                    pair[0][axis] + (pair[1][axis] - pair[0][axis]) * part
                }
            })
        }));
    }
    ring
}

/// The outline of a box in degrees, if it is known where on Earth it lies.
fn degrees(crs: &str, min: [f64; 3], max: [f64; 3]) -> Option<Vec<[f64; 2]>> {
    let to = ToDegrees::new(crs)?;
    ring([min[0], min[1]], [max[0], max[1]], STEPS).into_iter().map(|point| to.apply(point)).collect()
}

fn bounds(ring: &[[f64; 2]], low: f64, high: f64) -> Vec<f64> {
    let of = |axis: usize, pick: fn(f64, f64) -> f64| {
        ring.iter().map(|point| point[axis]).reduce(pick).unwrap_or(0.0)
    };
    vec![of(0, f64::min), of(1, f64::min), low, of(0, f64::max), of(1, f64::max), high]
}

fn polygon(ring: &[[f64; 2]]) -> Value {
    json!({ "type": "Polygon", "coordinates": [ring] })
}

/// Fields as PDAL names them, with type and bytes.
fn columns(file: &CopcFile) -> Vec<(String, &'static str, usize)> {
    let mut columns: Vec<(String, &'static str, usize)> =
        ["X", "Y", "Z"].map(|name| (name.to_string(), "floating", 8)).to_vec();
    let mut add = |name: &str, kind, size| columns.push((name.to_string(), kind, size));
    add("Intensity", "unsigned", 2);
    for name in ["ReturnNumber", "NumberOfReturns", "ScanDirectionFlag", "EdgeOfFlightLine", "Classification"]
    {
        add(name, "unsigned", 1);
    }
    add("ScanAngleRank", "floating", 4);
    add("UserData", "unsigned", 1);
    add("PointSourceId", "unsigned", 2);
    add("GpsTime", "floating", 8);
    add("ScannerChannel", "unsigned", 1);
    if file.front.format() >= 7 {
        ["Red", "Green", "Blue"].into_iter().for_each(|name| add(name, "unsigned", 2));
    }
    if file.front.format() == 8 {
        add("Infrared", "unsigned", 2);
    }
    for field in file.header.extra.iter().filter(|field| field.elements == 1) {
        let kind = match field.scalar {
            Scalar::F32 | Scalar::F64 => "floating",
            Scalar::I8 | Scalar::I16 | Scalar::I32 | Scalar::I64 => "signed",
            Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => "unsigned",
        };
        add(&field.name, kind, field.scalar.size());
    }
    columns
}

/// The statistics that the file brings along, as QGIS or we wrote them.
fn statistics(file: &CopcFile, columns: &[(String, &'static str, usize)]) -> Option<Value> {
    let data = file.record("qgis", 0).ok()??;
    let known: Value = serde_json::from_slice(&data).ok()?;
    let known = known["stats"].as_object()?;
    let of_column = columns.iter().enumerate().filter_map(|(position, (name, ..))| {
        let one = known.get(name)?;
        let number = |key: &str| one[key].as_f64();
        let deviation = number("standard-deviation").unwrap_or(0.0);
        Some(json!({
            "name": name,
            "position": position,
            "average": number("mean")?,
            "count": one["count"].as_u64()?,
            "maximum": number("maximum")?,
            "minimum": number("minimum")?,
            "stddev": deviation,
            "variance": deviation * deviation,
        }))
    });
    let all: Vec<Value> = of_column.collect();
    (!all.is_empty()).then_some(Value::Array(all))
}

/// When the points were measured: by their GPS times if these count from a known moment,
/// else the day on which the inputs were made, else the beginning of 1970.
fn datetime(file: &CopcFile) -> String {
    let first = file.front.info.time.0;
    if file.header.gps_time == GpsEpoch::ADJUSTED && first.is_finite() && first != 0.0 {
        return moment((first + ADJUSTED + GPS_EPOCH - LEAP_SECONDS).clamp(0.0, 1e11) as i64);
    }
    match file.header.created {
        Some(created) => moment((days_before(i64::from(created.year)) + i64::from(created.day) - 1) * DAY),
        None => moment(0),
    }
}

/// Days from 1970 to the beginning of a year.
fn days_before(year: i64) -> i64 {
    let years = year - 1;
    let leaps = |years: i64| years.div_euclid(4) - years.div_euclid(100) + years.div_euclid(400);
    365 * (year - 1970) + leaps(years) - leaps(1969)
}

/// Seconds since 1970 as RFC 3339 writes them.
fn moment(seconds: i64) -> String {
    let (mut day, second) = (seconds.div_euclid(DAY), seconds.rem_euclid(DAY));
    let mut year = 1970 + day / 366;
    while days_before(year + 1) <= day {
        year += 1;
    }
    day -= days_before(year);
    let is_leap = days_before(year + 1) - days_before(year) == 366;
    let mut month = 0;
    let lengths = [31, if is_leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    while month < 11 && day >= lengths[month] {
        day -= lengths[month];
        month += 1;
    }
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{:02}-{:02}T{hour:02}:{minute:02}:{second:02}Z", month + 1, day + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_calendar() {
        assert_eq!(moment(0), "1970-01-01T00:00:00Z");
        assert_eq!(moment(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(moment(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(moment(1_735_689_600), "2025-01-01T00:00:00Z");
        assert_eq!(moment((days_before(2012) + 365) * DAY), "2012-12-31T00:00:00Z");
    }

    #[test]
    fn rings_go_round_and_close() {
        let ring = ring([0.0, 0.0], [8.0, 4.0], 2);
        assert_eq!(ring.len(), 9);
        assert_eq!((ring[0], ring[1], ring[4], ring[8]), ([0.0, 0.0], [4.0, 0.0], [8.0, 4.0], [0.0, 0.0]));
        assert_eq!(bounds(&ring, 1.0, 2.0), [0.0, 0.0, 1.0, 8.0, 4.0, 2.0]);
        let degrees = degrees("EPSG:32633", [400_000.0, 5e6, 0.0], [600_000.0, 5.1e6, 1.0]).unwrap();
        let high = degrees.iter().map(|point| point[1]).fold(0.0, f64::max);
        assert!(
            high > degrees[16][1].max(degrees[24][1]),
            "the upper edge is a curve, highest in its middle"
        );
        assert!(
            (45.0..47.0).contains(&degrees[0][1]) && (13.0..14.0).contains(&degrees[0][0]),
            "{degrees:?}"
        );
    }

    #[test]
    fn items_of_one_name_are_told_apart() {
        let mut items = [json!({ "id": "a" }), json!({ "id": "a" }), json!({ "id": "b" })];
        name_uniquely(&mut items);
        assert_eq!(items.map(|item| item["id"].as_str().unwrap().to_string()), ["a", "a-2", "b"]);
    }
}
