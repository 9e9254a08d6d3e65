//! What a header says of its points (counts, returns, bounds), added up while
//! they are written; and the returns also while they are read, for headers lie.

/// What the header says of the points.
#[derive(Debug)]
pub struct HeaderTotals {
    points: u64,
    returns: [u64; 15],
    min: [i32; 3],
    max: [i32; 3],
    return_mask: u8,
}

/// The bits of a record's byte 14 that hold the return number.
fn return_mask(point_format: u8) -> u8 {
    if point_format < 6 { 0b0111 } else { 0b1111 }
}

/// Adds to the points by return; the first place is for points that say 0, which
/// is no return and has no place in a header.
pub fn returns_of(point_format: u8, records: &[u8], record_length: usize, returns: &mut [u64; 16]) {
    let mask = return_mask(point_format);
    for record in records.chunks_exact(record_length) {
        returns[usize::from(record[14] & mask)] += 1;
    }
}

impl HeaderTotals {
    pub fn new(point_format: u8) -> HeaderTotals {
        let return_mask = return_mask(point_format);
        HeaderTotals { points: 0, returns: [0; 15], min: [i32::MAX; 3], max: [i32::MIN; 3], return_mask }
    }

    pub fn add(&mut self, records: &[u8], record_length: usize) {
        for record in records.chunks_exact(record_length) {
            for axis in 0..3 {
                let at = 4 * axis;
                let value = i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
                self.min[axis] = self.min[axis].min(value);
                self.max[axis] = self.max[axis].max(value);
            }
            let number = record[14] & self.return_mask;
            // A return number of 0 is not one; the header has no place for it.
            if number > 0 {
                self.returns[usize::from(number) - 1] += 1;
            }
            self.points += 1;
        }
    }

    pub fn put_into(&self, header: &mut las::raw::Header) -> Result<(), String> {
        let legacy = header.point_data_record_format & 0x3F < 6;
        match u32::try_from(self.points) {
            // The legacy counts are for formats that old readers know.
            Ok(points) if legacy => {
                header.number_of_point_records = points;
                for (said, counted) in header.number_of_points_by_return.iter_mut().zip(self.returns) {
                    *said = counted as u32;
                }
            }
            Ok(_) => {}
            Err(_) if header.version.minor >= 4 => {}
            Err(_) => return Err(format!("{} points need LAS 1.4", self.points)),
        }
        header.large_file = (header.version.minor >= 4).then_some(las::raw::header::LargeFile {
            number_of_point_records: self.points,
            number_of_points_by_return: self.returns,
        });
        if self.points > 0 {
            let x = |value: i32| f64::from(value) * header.x_scale_factor + header.x_offset;
            let y = |value: i32| f64::from(value) * header.y_scale_factor + header.y_offset;
            let z = |value: i32| f64::from(value) * header.z_scale_factor + header.z_offset;
            let (min, max) = (self.min, self.max);
            // A negative scale turns them round.
            let ordered = |a: f64, b: f64| (a.min(b), a.max(b));
            (header.min_x, header.max_x) = ordered(x(min[0]), x(max[0]));
            (header.min_y, header.max_y) = ordered(y(min[1]), y(max[1]));
            (header.min_z, header.max_z) = ordered(z(min[2]), z(max[2]));
        }
        Ok(())
    }
}
