//! Moves the fields of raw records to where the octree's schema has them: many
//! records at once, field by field, so that each move is a short loop of fixed
//! width and not a list that is gone through for every record.

use super::standard_fields::FieldLocation;

/// The moves that turn one source's raw records into octree records.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordConverter {
    /// Bytes of an octree record.
    size: usize,
    /// From, to, how many bytes.
    copies: Vec<(usize, usize, usize)>,
    /// From, how far to shift, mask, to.
    bits: Vec<(usize, u8, u8, usize)>,
    /// Bytes of an octree record that the source has no field for.
    zeros: Vec<usize>,
}

impl RecordConverter {
    /// From a source's places, with the attribute of each, to the attributes'
    /// offsets in records of `size` bytes.
    pub(super) fn new(
        places: &[(usize, FieldLocation)],
        offsets: &[Option<usize>],
        size: usize,
    ) -> RecordConverter {
        let mut mover = RecordConverter { size, ..RecordConverter::default() };
        let mut filled = vec![false; size];
        filled[..POSITION].fill(true);
        for (index, place) in places {
            let Some(to) = offsets[*index] else { continue };
            let len = match *place {
                FieldLocation::Bytes { at, len } => {
                    mover.copies.push((at, to, len));
                    len
                }
                FieldLocation::Bits { at, shift, mask } => {
                    mover.bits.push((at, shift, mask, to));
                    1
                }
            };
            filled[to..to + len].fill(true);
        }
        mover.zeros = (0..size).filter(|byte| !filled[*byte]).collect();
        // Fields that are neighbours on both sides move as one.
        mover.copies.sort_unstable();
        let mut joined: Vec<(usize, usize, usize)> = Vec::new();
        for (at, to, len) in mover.copies {
            match joined.last_mut() {
                Some((a, t, l)) if *a + *l == at && *t + *l == to => *l += len,
                _ => joined.push((at, to, len)),
            }
        }
        mover.copies = joined;
        mover
    }

    /// Fills the octree records in `out` from as many raw records of `length`
    /// bytes, but for the position. Whatever `out` held before is gone.
    pub fn apply(&self, raw: &[u8], length: usize, out: &mut [u8]) {
        for &(at, to, len) in &self.copies {
            match len {
                1 => self.column::<1>(raw, length, at, out, to),
                2 => self.column::<2>(raw, length, at, out, to),
                4 => self.column::<4>(raw, length, at, out, to),
                6 => self.column::<6>(raw, length, at, out, to),
                8 => self.column::<8>(raw, length, at, out, to),
                10 => self.column::<10>(raw, length, at, out, to),
                12 => self.column::<12>(raw, length, at, out, to),
                18 => self.column::<18>(raw, length, at, out, to),
                _ => {
                    for (from, into) in raw.chunks_exact(length).zip(out.chunks_exact_mut(self.size)) {
                        into[to..to + len].copy_from_slice(&from[at..at + len]);
                    }
                }
            }
        }
        for &(at, shift, mask, to) in &self.bits {
            for (from, into) in raw.chunks_exact(length).zip(out.chunks_exact_mut(self.size)) {
                into[to] = from[at] >> shift & mask;
            }
        }
        for &to in &self.zeros {
            out.chunks_exact_mut(self.size).for_each(|into| into[to] = 0);
        }
    }

    /// Copies one field of a fixed width.
    fn column<const N: usize>(&self, raw: &[u8], length: usize, at: usize, out: &mut [u8], to: usize) {
        for (from, into) in raw.chunks_exact(length).zip(out.chunks_exact_mut(self.size)) {
            into[to..to + N].copy_from_slice(&from[at..at + N]);
        }
    }
}

/// Bytes of the position, which is moved with its lattice.
const POSITION: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn neighbours_on_both_sides_move_as_one() {
        let bytes = |at, len| FieldLocation::Bytes { at, len };
        let places = [(0, bytes(12, 2)), (1, bytes(16, 2)), (2, bytes(18, 8)), (3, bytes(30, 1))];
        let mover = RecordConverter::new(&places, &[Some(12), Some(17), Some(19), None], 27);
        assert_eq!(mover.copies, vec![(12, 12, 2), (16, 17, 10)]);
        assert_eq!(mover.zeros, vec![14, 15, 16]);
    }

    proptest! {
        /// Each field lands at its place, whatever its width, and what has no
        /// source is zero.
        #[test]
        fn fields_are_moved_one_by_one(
            widths in proptest::collection::vec((1usize..20, any::<bool>(), any::<bool>()), 0..6),
            bytes in proptest::collection::vec(any::<u8>(), 600),
        ) {
            let (mut at, mut to) = (POSITION, POSITION);
            let (mut places, mut offsets, mut expected) = (Vec::new(), Vec::new(), Vec::new());
            for (index, (width, gap, is_bits)) in widths.iter().enumerate() {
                to += usize::from(*gap);
                offsets.push(Some(to));
                if *is_bits {
                    places.push((index, FieldLocation::Bits { at, shift: 3, mask: 7 }));
                    expected.push((at, to, 1, true));
                    to += 1;
                } else {
                    places.push((index, FieldLocation::Bytes { at, len: *width }));
                    expected.push((at, to, *width, false));
                    to += width;
                }
                at += width;
            }
            let mover = RecordConverter::new(&places, &offsets, to);
            let raw = &bytes[..bytes.len() / at * at];
            let mut out = vec![0xaa; raw.len() / at * to];
            mover.apply(raw, at, &mut out);
            for (raw, out) in raw.chunks_exact(at).zip(out.chunks_exact(to)) {
                let mut plain = vec![0; to];
                plain[..POSITION].fill(0xaa);
                for (from, into, len, is_bits) in &expected {
                    for byte in 0..*len {
                        let value = raw[from + byte];
                        plain[into + byte] = if *is_bits { value >> 3 & 7 } else { value };
                    }
                }
                prop_assert_eq!(out, plain.as_slice());
            }
        }
    }
}
