//! What lies behind the points that a header counts: further points, padding, or
//! something else. Told by looking at a bounded part of the bytes, never at all
//! of a large file's.

use super::LasError;
use super::declared_counts::{Behind, DeclaredCounts};
use super::header_totals::returns_of;
use super::source::FileReader;
use super::vlr;

/// Records that are looked at, spread evenly.
const MOST_SAMPLES: u64 = 4096;
/// Bytes of padding that are looked through, and of counted points that are gone
/// through to see whether the header is true of them alone.
const MOST_BYTES: u64 = 256 << 20;
const BLOCK: u64 = 1 << 20;

/// So many times as far as the known points reach, others may lie around them: a scan
/// that was flushed early goes on.
const AROUND: i64 = 8;

/// Where points may be expected, in the file's integers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reach {
    min: [i64; 3],
    max: [i64; 3],
}

impl Reach {
    const NOTHING: Reach = Reach { min: [i64::MAX; 3], max: [i64::MIN; 3] };

    /// The header's box; nothing where it has none that can be.
    pub fn of_header(raw: &las::raw::Header) -> Reach {
        let low = [raw.min_x, raw.min_y, raw.min_z];
        let high = [raw.max_x, raw.max_y, raw.max_z];
        let scale = [raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor];
        let offset = [raw.x_offset, raw.y_offset, raw.z_offset];
        let whole = |world: f64, axis: usize| ((world - offset[axis]) / scale[axis]).round() as i64;
        let ends: [(i64, i64); 3] = std::array::from_fn(|axis| {
            let (a, b) = (whole(low[axis], axis), whole(high[axis], axis));
            // Of a negative scale the larger integer is the lower end.
            (a.min(b), a.max(b))
        });
        let sane = (0..3).all(|axis| low[axis].is_finite() && low[axis] <= high[axis])
            && ends.iter().all(|(min, max)| *min >= i64::from(i32::MIN) && *max <= i64::from(i32::MAX));
        // A box from 0 to 0 was never set.
        match sane && low != high {
            true => Reach { min: ends.map(|end| end.0), max: ends.map(|end| end.1) },
            false => Reach::NOTHING,
        }
    }

    pub fn add(&mut self, record: &[u8]) {
        for (axis, value) in position(record).into_iter().enumerate() {
            self.min[axis] = self.min[axis].min(value);
            self.max[axis] = self.max[axis].max(value);
        }
    }

    fn union(self, other: Reach) -> Reach {
        Reach {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// Whether a record of any bytes would hardly lie in it by chance.
    pub fn tells(&self) -> bool {
        if self.min[0] > self.max[0] {
            return false;
        }
        let reach = (2 * AROUND + 1) as f64;
        let share = |axis: usize| reach * (self.max[axis] - self.min[axis] + 1) as f64 / (1u64 << 32) as f64;
        (0..3).map(share).map(|share| share.min(1.0)).product::<f64>() < 1.0 / 64.0
    }

    /// Whether a record may belong to the same cloud.
    pub fn holds(&self, record: &[u8]) -> bool {
        // One and the same byte throughout is padding, wherever it would lie.
        record.iter().any(|byte| *byte != record[0])
            && position(record).into_iter().enumerate().all(|(axis, value)| {
                let around = AROUND * (self.max[axis] - self.min[axis]).max(16);
                value >= self.min[axis] - around && value <= self.max[axis] + around
            })
    }
}

fn position(record: &[u8]) -> [i64; 3] {
    let integer =
        |at: usize| i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
    [integer(0), integer(4), integer(8)].map(i64::from)
}

/// So many of the records looked at belong to the cloud.
pub fn by_share(inside: u64, looked_at: u64) -> Behind {
    match looked_at {
        0 => Behind::Nothing,
        _ if inside * 10 >= looked_at * 9 => Behind::Points,
        _ if inside * 2 <= looked_at => Behind::NoPoints,
        _ => Behind::Unclear,
    }
}

/// The records of a plain LAS file.
pub struct PlainRecords<'a> {
    pub source: &'a FileReader,
    /// Where they begin.
    pub at: u64,
    pub length: u64,
    pub point_format: u8,
    pub raw: &'a las::raw::Header,
    /// Points by return, as the header says.
    pub returns: &'a [u64],
}

/// What was seen behind the counted records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordsBehind {
    pub behind: Behind,
    /// Whole records, the counted ones among them, without padding behind them.
    pub room: u64,
    /// Bytes behind those that are no whole record, or padding.
    pub rest: u64,
    pub header_is_exact: bool,
}

impl PlainRecords<'_> {
    /// Looks at what lies between the counted records and `end`.
    pub fn look(&self, counted: u64, end: u64) -> Result<RecordsBehind, LasError> {
        let from = self.at + counted * self.length;
        let room = (end - self.at) / self.length;
        let look = |behind, room: u64| RecordsBehind {
            behind,
            room,
            rest: end - self.at - room * self.length,
            header_is_exact: false,
        };
        if room <= counted {
            return Ok(look(Behind::Nothing, room));
        }
        let padded_from = self.padding(from, end)?;
        if padded_from == from {
            return Ok(look(Behind::Padding, room));
        }
        // Padding only if it is more than the end of a record may be.
        let last = match end - padded_from >= 2 * self.length {
            true => (padded_from - self.at).div_ceil(self.length).min(room),
            false => room,
        };
        if vlr::is_extended_record(self.source, from)? {
            return Ok(look(Behind::NoPoints, room));
        }
        let mut reach = match Reach::of_header(self.raw) {
            reach if reach.tells() => reach,
            _ => Reach::NOTHING,
        };
        let mut among = Reach::NOTHING;
        self.sample(0, counted, |record| among.add(record))?;
        reach = reach.union(among);
        if !reach.tells() {
            return Ok(look(Behind::Unclear, last));
        }
        let (mut inside, mut all) = (0, 0);
        self.sample(counted, last, |record| {
            inside += u64::from(reach.holds(record));
            all += 1;
        })?;
        let behind = by_share(inside, all);
        let header_is_exact = behind == Behind::Points && counted > 0 && self.header_is_exact(counted)?;
        Ok(RecordsBehind { header_is_exact, ..look(behind, last) })
    }

    /// Where the bytes begin that are all the same up to `end`; holes of a sparse
    /// file are not read.
    fn padding(&self, from: u64, end: u64) -> Result<u64, LasError> {
        let mut last = [0];
        self.source.read_exact_at(&mut last, end - 1)?;
        let mut padded_from = end;
        let mut block = Vec::new();
        while padded_from > from && end - padded_from < MOST_BYTES {
            if last[0] == 0 {
                padded_from = self.source.hole_before(padded_from, from);
                if padded_from == from {
                    break;
                }
            }
            let length = (padded_from - from).min(BLOCK);
            block.resize(length as usize, 0);
            self.source.read_exact_at(&mut block, padded_from - length)?;
            match block.iter().rposition(|byte| *byte != last[0]) {
                Some(place) => return Ok(padded_from - length + place as u64 + 1),
                None => padded_from -= length,
            }
        }
        Ok(padded_from)
    }

    /// Hands over some of the records `from..to`, evenly spread.
    fn sample(&self, from: u64, to: u64, mut each: impl FnMut(&[u8])) -> Result<(), LasError> {
        let all = to.saturating_sub(from);
        let samples = all.min(MOST_SAMPLES);
        let mut record = vec![0; self.length as usize];
        for number in 0..samples {
            let place = from + (u128::from(all) * u128::from(number) / u128::from(samples)) as u64;
            self.source.read_exact_at(&mut record, self.at + place * self.length)?;
            each(&record);
        }
        Ok(())
    }

    /// Whether box and counts by return are those of the counted records alone.
    /// Not known of very many; then it is not.
    fn header_is_exact(&self, counted: u64) -> Result<bool, LasError> {
        if counted * self.length > MOST_BYTES {
            return Ok(false);
        }
        let (mut reach, mut returns) = (Reach::NOTHING, [0; 16]);
        let each = (BLOCK / self.length).max(1);
        let mut block = Vec::new();
        let mut done = 0;
        while done < counted {
            let records = (counted - done).min(each);
            block.resize((records * self.length) as usize, 0);
            self.source.read_exact_at(&mut block, self.at + done * self.length)?;
            block.chunks_exact(self.length as usize).for_each(|record| reach.add(record));
            returns_of(self.point_format, &block, self.length as usize, &mut returns);
            done += records;
        }
        let said = self.returns.iter().zip(&returns[1..]);
        let returns_agree =
            DeclaredCounts::of(self.raw).by_return == 0 || said.into_iter().all(|(a, b)| a == b);
        Ok(returns_agree && reach == Reach::of_header(self.raw))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(position: [i32; 3]) -> Vec<u8> {
        position.iter().flat_map(|value| value.to_le_bytes()).chain([9; 8]).collect()
    }

    #[test]
    fn what_is_near_the_cloud_belongs_to_it() {
        let mut reach = Reach::NOTHING;
        assert!(!reach.tells());
        reach.add(&record([0, 0, 0]));
        reach.add(&record([1000, 2000, 30]));
        assert!(reach.tells());
        for (near, inside) in [([1, 1, 1], true), ([8999, 17_999, 270], true), ([9001, 0, 0], false)] {
            assert_eq!(reach.holds(&record(near)), inside, "{near:?}");
        }
        assert!(!reach.holds(&[0; 20]), "zeros are no point");
        assert!(!reach.holds(b"PROJCS[\"somewhere in space\"]"));
    }

    #[test]
    fn a_box_of_everything_tells_nothing() {
        let mut reach = Reach::NOTHING;
        reach.add(&record([i32::MIN; 3]));
        reach.add(&record([i32::MAX; 3]));
        assert!(!reach.tells());
    }

    #[test]
    fn most_of_the_records_decide() {
        assert_eq!(by_share(0, 0), Behind::Nothing);
        assert_eq!(by_share(10, 10), Behind::Points);
        assert_eq!(by_share(2, 10), Behind::NoPoints);
        assert_eq!(by_share(7, 10), Behind::Unclear);
    }
}
