//! What the GPS times of a file count from (LAS 1.5, global encoding), and how
//! they are moved to count from elsewhere without a bit being lost.

use std::path::Path;

use super::error::LasError;

/// What GPS times count from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GpsEpoch {
    /// Seconds since the beginning of a week that the file does not name.
    Week,
    /// Standard GPS time less `offset` × 10^6 seconds. Up to LAS 1.4 the offset is
    /// always 1000.
    Standard { offset: u16 },
}

/// Seconds that an offset of 1 stands for.
const OFFSET_UNIT: f64 = 1e6;
/// The bits of the global encoding: standard time, and an offset of its own.
const STANDARD_BIT: u16 = 1;
const OFFSET_BIT: u16 = 1 << 6;

impl GpsEpoch {
    /// The offset of "adjusted standard GPS time", the only one before LAS 1.5.
    pub const ADJUSTED: GpsEpoch = GpsEpoch::Standard { offset: 1000 };

    /// By the global encoding and, since LAS 1.5, the header's time offset.
    pub(super) fn of(encoding: u16, time_offset: Option<u16>, notes: &mut Vec<String>) -> GpsEpoch {
        match (encoding & STANDARD_BIT != 0, encoding & OFFSET_BIT != 0, time_offset) {
            (true, true, Some(offset)) => GpsEpoch::Standard { offset },
            (true, _, _) => GpsEpoch::ADJUSTED,
            (false, true, Some(_)) => {
                notes.push(
                    "its GPS times should have a time offset, but are marked as seconds of the week; the \
                     offset is ignored"
                        .to_string(),
                );
                GpsEpoch::Week
            }
            (false, _, _) => GpsEpoch::Week,
        }
    }

    /// Its bits of the global encoding, and the header's time offset where only
    /// LAS 1.5 can say it.
    pub(super) fn encoding(self) -> (u16, Option<u16>) {
        match self {
            GpsEpoch::Week => (0, None),
            GpsEpoch::ADJUSTED => (STANDARD_BIT, None),
            GpsEpoch::Standard { offset } => (STANDARD_BIT | OFFSET_BIT, Some(offset)),
        }
    }

    /// In words for a person.
    pub fn describe(self) -> String {
        match self {
            GpsEpoch::Week => "seconds of the GPS week".to_string(),
            GpsEpoch::Standard { offset } => format!("standard GPS time minus {offset}000000 s"),
        }
    }
}

/// Where the GPS time stands in a record, for the formats that have one.
fn position(point_format: u8) -> Option<usize> {
    match point_format {
        1 | 3..=5 => Some(20),
        6..=10 => Some(22),
        _ => None,
    }
}

/// From one time offset to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TimeShift {
    pub from: u16,
    to: u16,
    at: usize,
}

impl TimeShift {
    /// Nothing where no time is to be moved, or cannot be: the seconds of an
    /// unknown week have no place among others.
    pub fn new(from: GpsEpoch, to: GpsEpoch, point_format: u8) -> Option<TimeShift> {
        match (from, to, position(point_format)) {
            (GpsEpoch::Standard { offset: from }, GpsEpoch::Standard { offset: to }, Some(at))
                if from != to =>
            {
                Some(TimeShift { from, to, at })
            }
            _ => None,
        }
    }

    /// The way back.
    pub fn reversed(self) -> TimeShift {
        TimeShift { from: self.to, to: self.from, at: self.at }
    }

    /// Moves the times of all records, or fails at the first that would be
    /// rounded.
    pub fn apply(self, path: &Path, records: &mut [u8], record_length: usize) -> Result<(), LasError> {
        let seconds = (f64::from(self.from) - f64::from(self.to)) * OFFSET_UNIT;
        for record in records.chunks_exact_mut(record_length) {
            let Some(time) = record[self.at..].first_chunk_mut::<8>() else { continue };
            let value = f64::from_le_bytes(*time);
            if !value.is_finite() {
                continue;
            }
            let moved = exact_sum(value, seconds).ok_or_else(|| {
                LasError::unsupported(
                    path,
                    format!(
                        "its GPS times have the time offset {}, those of other files of the data set {}, and \
                         {value} cannot be moved from one to the other without rounding; convert the files of \
                         each time offset apart",
                        self.from, self.to
                    ),
                )
            })?;
            *time = moved.to_le_bytes();
        }
        Ok(())
    }
}

/// The sum, if it is one without rounding (Knuth's two-sum: the error of a sum of
/// two floats is a float).
fn exact_sum(a: f64, b: f64) -> Option<f64> {
    let sum = a + b;
    let of_b = sum - a;
    let error = (a - (sum - of_b)) + (b - of_b);
    (error == 0.0).then_some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_encoding_says_what_times_count_from() {
        let of = |encoding, offset| GpsEpoch::of(encoding, offset, &mut Vec::new());
        assert_eq!(of(0, None), GpsEpoch::Week);
        assert_eq!(of(1, None), GpsEpoch::ADJUSTED);
        assert_eq!(of(1, Some(7)), GpsEpoch::ADJUSTED);
        assert_eq!(of(1 | 1 << 6, Some(7)), GpsEpoch::Standard { offset: 7 });
        // Before LAS 1.5 the bit means nothing.
        assert_eq!(of(1 | 1 << 6, None), GpsEpoch::ADJUSTED);
        let mut notes = Vec::new();
        assert_eq!(GpsEpoch::of(1 << 6, Some(7), &mut notes), GpsEpoch::Week);
        assert_eq!(notes.len(), 1);
        for time in [GpsEpoch::Week, GpsEpoch::ADJUSTED, GpsEpoch::Standard { offset: 1400 }] {
            let (bits, offset) = time.encoding();
            assert_eq!(of(bits, offset), time);
        }
    }

    #[test]
    fn a_time_that_would_be_rounded_is_refused() {
        let shift = TimeShift { from: 1400, to: 1000, at: 0 };
        let path = Path::new("a.las");
        let mut exact = 1234.5f64.to_le_bytes();
        shift.apply(path, &mut exact, 8).unwrap();
        assert_eq!(f64::from_le_bytes(exact), 400_001_234.5);
        let mut fine = 1_234.567_890_123_f64.to_le_bytes();
        let error = shift.apply(path, &mut fine, 8).unwrap_err().to_string();
        assert!(error.contains("time offset 1400") && error.contains("apart"), "{error}");
        let mut none = f64::NAN.to_le_bytes();
        shift.apply(path, &mut none, 8).unwrap();
        assert_eq!(none, f64::NAN.to_le_bytes());
    }

    proptest! {
        /// What is moved can be moved back, to the bit.
        #[test]
        fn moved_times_come_back(time in -1e12f64..1e12, from in 0u16..3000, to in 0u16..3000) {
            let seconds = (f64::from(from) - f64::from(to)) * OFFSET_UNIT;
            if let Some(moved) = exact_sum(time, seconds) {
                prop_assert_eq!(exact_sum(moved, -seconds), Some(time));
            }
        }
    }
}
