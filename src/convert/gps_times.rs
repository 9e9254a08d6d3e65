//! GPS times of a data set: since LAS 1.5 each file may count them from elsewhere,
//! and an octree has one attribute for all. They are moved to one offset where
//! that loses nothing; a time that would be rounded ends the conversion.

use super::error::{Result, StageError};
use super::formats::Formats;
use crate::format::las::{GpsEpoch, LasFile};

/// Files that are named one by one.
const MOST_NAMED: usize = 5;

/// Has all files count their GPS times from one place: the latest of their time
/// offsets, since times become smaller by that and so keep all their digits. Gives
/// what they count from, where any says so. A COPC file is one of LAS 1.4, which knows
/// but one time offset, and says of all times at once what they are.
pub fn bring_together(
    files: &mut [LasFile],
    formats: Formats,
    notes: &mut Vec<String>,
) -> Result<Option<GpsEpoch>> {
    let has_times = |file: &&LasFile| !matches!(file.header().point_format, 0 | 2);
    let offsets = files.iter().filter(has_times).filter_map(|file| match file.header().gps_time {
        GpsEpoch::Standard { offset } => Some(offset),
        GpsEpoch::Week => None,
    });
    let Some(latest) = offsets.max() else { return Ok(None) };
    let mut common = GpsEpoch::Standard { offset: latest };
    if formats.copc && common != GpsEpoch::ADJUSTED {
        if formats.potree {
            return Err(StageError::NotForCopc(format!(
                "its GPS times are {}, which the octree keeps and COPC cannot say; convert to each format by \
                 itself",
                common.describe()
            )));
        }
        common = GpsEpoch::ADJUSTED;
    }
    let mut moved = 0;
    for file in files.iter_mut() {
        let before = file.header().gps_time;
        file.count_times_from(common);
        if file.header().gps_time != before {
            moved += 1;
            if moved <= MOST_NAMED {
                let (name, before, after) = (file.path().display(), before.describe(), common.describe());
                notes.push(format!(
                    "{name}: its GPS times are {before}; they were moved, exactly, to {after}"
                ));
            }
        }
    }
    if moved > MOST_NAMED {
        notes.push(format!("the GPS times of {} more files were moved likewise", moved - MOST_NAMED));
    }
    let of_weeks = files.iter().filter(has_times).filter(|file| file.header().gps_time == GpsEpoch::Week);
    match of_weeks.count() {
        0 => {}
        weeks if formats.copc => {
            return Err(StageError::NotForCopc(format!(
                "the GPS times of {weeks} of {} files are seconds of the week, those of the others {}, and one \
                 file cannot hold both; convert the files of each kind apart",
                files.len(),
                common.describe()
            )));
        }
        weeks => notes.push(format!(
            "the GPS times of {weeks} of {} files are marked as seconds of the week, those of the others as \
             {}: they cannot be compared",
            files.len(),
            common.describe()
        )),
    }
    Ok(Some(common))
}
