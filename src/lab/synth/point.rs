//! A point of a synthetic scene, and its bytes as a LAS record of any point
//! format (LAS 1.4 R15, tables 7 to 17).

use super::noise::round;

/// Scale and offset of a file: world = stored × scale + offset, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FileLattice {
    pub scale: [f64; 3],
    pub offset: [f64; 3],
}

impl FileLattice {
    pub fn uniform(scale: f64, offset: [f64; 3]) -> FileLattice {
        FileLattice { scale: [scale; 3], offset }
    }
}

/// One return of one pulse.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Point {
    /// Metres from the scene's origin.
    pub place: [f64; 3],
    pub intensity: u16,
    /// This return's number, from 1, and how many its pulse had.
    pub return_number: u8,
    pub returns: u8,
    /// The mirror moves towards positive angles.
    pub forward: bool,
    /// The last point of a scan line.
    pub edge: bool,
    /// Inside the overlap of two flight strips (formats 6 and up).
    pub overlap: bool,
    pub class: u8,
    /// Units of 0.006 degrees.
    pub angle: i16,
    pub user_data: u8,
    pub source: u16,
    /// Adjusted standard GPS time, seconds.
    pub time: f64,
    pub rgb: [u16; 3],
    pub nir: u16,
}

/// Bytes of a wave packet's description. Synthetic points have no waveform,
/// which descriptor index 0 says.
const WAVE_PACKET: [u8; 29] = [0; 29];

impl Point {
    /// Appends the record of this point on the lattice of a file whose offset
    /// lies `shift` metres from the scene's origin.
    pub fn encode(&self, scale: [f64; 3], shift: [f64; 3], format: u8, out: &mut Vec<u8>) {
        for axis in 0..3 {
            // `as` clamps; no scene reaches beyond its lattice (see the tests).
            let stored = round((self.place[axis] - shift[axis]) / scale[axis]) as i32;
            out.extend_from_slice(&stored.to_le_bytes());
        }
        out.extend_from_slice(&self.intensity.to_le_bytes());
        if format < 6 {
            self.encode_old(out)
        } else {
            self.encode_new(out)
        }
        if !matches!(format, 0 | 2) {
            out.extend_from_slice(&self.time.to_le_bytes());
        }
        if matches!(format, 2 | 3 | 5 | 7 | 8 | 10) {
            for channel in self.rgb {
                out.extend_from_slice(&channel.to_le_bytes());
            }
        }
        if matches!(format, 8 | 10) {
            out.extend_from_slice(&self.nir.to_le_bytes());
        }
        if matches!(format, 4 | 5 | 9 | 10) {
            out.extend_from_slice(&WAVE_PACKET);
        }
    }

    fn encode_old(&self, out: &mut Vec<u8>) {
        let returns = self.return_number.min(7) | self.returns.min(7) << 3;
        out.push(returns | u8::from(self.forward) << 6 | u8::from(self.edge) << 7);
        out.push(self.class & 31);
        out.push((i32::from(self.angle) * 3 / 500) as i8 as u8);
        out.push(self.user_data);
        out.extend_from_slice(&self.source.to_le_bytes());
    }

    fn encode_new(&self, out: &mut Vec<u8>) {
        out.push(self.return_number.min(15) | self.returns.min(15) << 4);
        out.push(u8::from(self.overlap) << 3 | u8::from(self.forward) << 6 | u8::from(self.edge) << 7);
        out.push(self.class);
        out.push(self.user_data);
        out.extend_from_slice(&self.angle.to_le_bytes());
        out.extend_from_slice(&self.source.to_le_bytes());
    }
}

/// A colour of 8 bits a channel under a light of about 1, with a grain drawn
/// from `hash`, as 16 bits a channel.
pub fn paint(base: [u8; 3], light: f64, hash: u64) -> [u16; 3] {
    let light = light * (0.94 + 0.12 * super::noise::unit(hash));
    base.map(|channel| (f64::from(channel) * 257.0 * light).clamp(0.0, 65535.0) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::las::record_length;

    #[test]
    fn records_have_the_length_of_their_format() {
        for format in 0..=10 {
            let mut bytes = Vec::new();
            Point::default().encode([0.01; 3], [0.0; 3], format, &mut bytes);
            assert_eq!(Some(bytes.len()), record_length(format), "format {format}");
        }
    }

    #[test]
    fn fields_stand_where_the_standard_puts_them() {
        let point = Point {
            place: [1.0, -2.0, 3.456],
            intensity: 0x1234,
            return_number: 2,
            returns: 3,
            edge: true,
            class: 6,
            angle: -2500,
            source: 9,
            time: 1.5,
            rgb: [1, 2, 3],
            ..Point::default()
        };
        let mut old = Vec::new();
        point.encode([0.01; 3], [0.0; 3], 3, &mut old);
        assert_eq!(i32::from_le_bytes([old[4], old[5], old[6], old[7]]), -200);
        assert_eq!(i32::from_le_bytes([old[8], old[9], old[10], old[11]]), 346);
        assert_eq!((old[14], old[15], old[16] as i8), (0b1001_1010, 6, -15));
        assert_eq!(&old[20..28], &1.5f64.to_le_bytes());
        assert_eq!(&old[28..], &[1, 0, 2, 0, 3, 0]);
        let mut new = Vec::new();
        point.encode([0.01; 3], [0.0; 3], 6, &mut new);
        assert_eq!((new[14], new[15], new[16]), (0x32, 0x80, 6));
        assert_eq!(i16::from_le_bytes([new[18], new[19]]), -2500);
    }
}
