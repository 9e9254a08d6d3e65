//! Moves the fields of an octree's records to those of LAS records and back: a block of
//! records at once, field by field, so that each move is a short loop of fixed width.

/// Records of a block; both sides of it stay in the processor's nearest cache.
const BLOCK: usize = 256;
/// Degrees of a unit of the scan angle of the formats 6 to 10.
const ANGLE_UNIT: f64 = 0.006;

#[derive(Debug, Clone, PartialEq)]
pub struct Moves {
    /// Bytes of an octree's record and of a LAS record.
    octree: usize,
    las: usize,
    /// From the octree, to LAS, how many bytes.
    copies: Vec<(usize, usize, usize)>,
    bits: Vec<Bits>,
    rank: Option<Rank>,
    /// The scan angle of each rank, as if it were a `u8`.
    angles: Vec<i16>,
}

/// Some bits of one byte of a LAS record, which have a byte for themselves in the octree.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bits {
    octree: usize,
    las: usize,
    shift: u8,
    mask: u8,
}

/// A scan angle in whole degrees, which becomes one in units of 0.006.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rank {
    octree: usize,
    las: usize,
    /// Where the octree has an angle in fine units too, which is 0 of points that have a
    /// rank.
    angle: Option<usize>,
}

impl Moves {
    /// From octree records of so many bytes.
    pub fn new(octree: usize) -> Moves {
        let angles = (0..=u8::MAX).map(|rank| (f64::from(rank as i8) / ANGLE_UNIT).round() as i16).collect();
        Moves { octree, las: 0, copies: Vec::new(), bits: Vec::new(), rank: None, angles }
    }

    pub fn copy(&mut self, octree: usize, las: usize, length: usize) {
        match self.copies.last_mut() {
            // Fields that are neighbours on both sides move as one.
            Some((o, l, n)) if *o + *n == octree && *l + *n == las => *n += length,
            _ => self.copies.push((octree, las, length)),
        }
    }

    pub fn bits(&mut self, octree: usize, las: usize, shift: u8, mask: u8) {
        self.bits.push(Bits { octree, las, shift, mask });
    }

    pub fn rank(&mut self, octree: usize, las: usize, angle: Option<usize>) {
        self.rank = Some(Rank { octree, las, angle });
    }

    /// To LAS records of so many bytes.
    pub fn finish(&mut self, las: usize) {
        self.las = las;
    }

    pub fn promote(&self, octree: &[u8], las: &mut Vec<u8>) {
        las.clear();
        las.resize(octree.len() / self.octree * self.las, 0);
        let blocks = octree.chunks(BLOCK * self.octree).zip(las.chunks_mut(BLOCK * self.las));
        for (from, to) in blocks {
            for &(at, into, length) in &self.copies {
                columns(from, self.octree, at, to, self.las, into, length);
            }
            for bits in &self.bits {
                for (from, to) in pairs(from, self.octree, to, self.las) {
                    to[bits.las] |= (from[bits.octree] & bits.mask) << bits.shift;
                }
            }
            let Some(rank) = self.rank else { continue };
            for (from, to) in pairs(from, self.octree, to, self.las) {
                let angle = &mut to[rank.las..rank.las + 2];
                // Beside a fine angle, which was copied before, rank 0 says nothing.
                if rank.angle.is_none() || angle == [0, 0] {
                    angle.copy_from_slice(&self.angles[usize::from(from[rank.octree])].to_le_bytes());
                }
            }
        }
    }

    pub fn demote(&self, las: &[u8], octree: &mut Vec<u8>) {
        octree.clear();
        octree.resize(las.len() / self.las * self.octree, 0);
        let blocks = las.chunks(BLOCK * self.las).zip(octree.chunks_mut(BLOCK * self.octree));
        for (from, to) in blocks {
            for &(into, at, length) in &self.copies {
                columns(from, self.las, at, to, self.octree, into, length);
            }
            for bits in &self.bits {
                for (from, to) in pairs(from, self.las, to, self.octree) {
                    to[bits.octree] = from[bits.las] >> bits.shift & bits.mask;
                }
            }
            let Some(rank) = self.rank else { continue };
            for (from, to) in pairs(from, self.las, to, self.octree) {
                let angle = i16::from_le_bytes([from[rank.las], from[rank.las + 1]]);
                match rank.angle {
                    None => to[rank.octree] = (f64::from(angle) * ANGLE_UNIT).round() as i8 as u8,
                    // The rank came with the extra bytes; the angle is its own only if it
                    // is not the rank's.
                    Some(fine)
                        if to[rank.octree] != 0 && angle == self.angles[usize::from(to[rank.octree])] =>
                    {
                        to[fine..fine + 2].fill(0);
                    }
                    Some(_) => {}
                }
            }
        }
    }

    /// The first value that has more bits than its field: where it lies in the octree's
    /// record, the value, and the largest that fits.
    pub fn misfit(&self, octree: &[u8]) -> Option<(usize, u8, u8)> {
        self.bits.iter().find_map(|bits| {
            let values = octree.chunks_exact(self.octree).map(|record| record[bits.octree]);
            let mut wide = values.filter(|value| value & !bits.mask != 0);
            wide.next().map(|value| (bits.octree, value, bits.mask))
        })
    }
}

/// Records of one size beside as many of another.
fn pairs<'a>(
    from: &'a [u8],
    from_size: usize,
    to: &'a mut [u8],
    to_size: usize,
) -> impl Iterator<Item = (&'a [u8], &'a mut [u8])> {
    from.chunks_exact(from_size).zip(to.chunks_exact_mut(to_size))
}

/// Copies one field of as many records.
fn columns(
    from: &[u8],
    from_size: usize,
    at: usize,
    to: &mut [u8],
    to_size: usize,
    into: usize,
    length: usize,
) {
    fn fixed<const N: usize>(
        from: &[u8],
        from_size: usize,
        at: usize,
        to: &mut [u8],
        to_size: usize,
        into: usize,
    ) {
        for (from, to) in pairs(from, from_size, to, to_size) {
            to[into..into + N].copy_from_slice(&from[at..at + N]);
        }
    }
    match length {
        1 => fixed::<1>(from, from_size, at, to, to_size, into),
        2 => fixed::<2>(from, from_size, at, to, to_size, into),
        4 => fixed::<4>(from, from_size, at, to, to_size, into),
        6 => fixed::<6>(from, from_size, at, to, to_size, into),
        8 => fixed::<8>(from, from_size, at, to, to_size, into),
        10 => fixed::<10>(from, from_size, at, to, to_size, into),
        14 => fixed::<14>(from, from_size, at, to, to_size, into),
        16 => fixed::<16>(from, from_size, at, to, to_size, into),
        _ => {
            for (from, to) in pairs(from, from_size, to, to_size) {
                to[into..into + length].copy_from_slice(&from[at..at + length]);
            }
        }
    }
}
