//! Has the GPS times of a file count from elsewhere than in the file itself.

use super::error::LasError;
use super::gps_time::{GpsEpoch, TimeShift};
use super::reader::LasFile;

impl LasFile {
    /// Has the GPS times count from elsewhere. Seconds of a week stay as they are,
    /// since nobody knows of which; reading fails at a time that would be rounded.
    /// Called again, it counts from what the file itself says.
    pub fn count_times_from(&mut self, gps_time: GpsEpoch) {
        let own = self.own_gps_time();
        self.time_shift = TimeShift::new(own, gps_time, self.header.point_format);
        self.header.gps_time = if self.time_shift.is_some() { gps_time } else { own };
    }

    /// What the GPS times count from in the file itself.
    pub fn own_gps_time(&self) -> GpsEpoch {
        self.time_shift.map_or(self.header.gps_time, |shift| GpsEpoch::Standard { offset: shift.from })
    }

    /// Has times of records that were read count from where they do in the file.
    pub fn move_times_back(&self, records: &mut [u8], record_length: usize) -> Result<(), LasError> {
        match self.time_shift {
            None => Ok(()),
            Some(shift) => shift.reversed().apply(self.path(), records, record_length),
        }
    }
}
