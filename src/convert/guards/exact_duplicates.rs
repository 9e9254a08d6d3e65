//! Twins: records that equal another in every attribute. On request all but the
//! first of each are set aside. Twins share a position and so a chunk, where a
//! set of hashes finds them in linear time.

use std::collections::HashSet;
use std::hash::{BuildHasherDefault, Hasher};

/// Hashes of records that were seen.
pub type Hashes = HashSet<u128, BuildHasherDefault<IdentityHasher>>;

/// Room for so many; it need not grow then, which would take half as much again.
pub fn hashes(records: usize) -> Hashes {
    Hashes::with_capacity_and_hasher(records, BuildHasherDefault::default())
}

/// Memory that [`find`] takes for so many points, in bytes: the standard library's
/// sets are at most seven eighths full, of a power of two, and take a byte more
/// than the hash; and the places of twins.
pub fn memory(points: u64) -> u64 {
    (points * 8 / 7).next_power_of_two() * 17 + points * 4
}

/// Names a record. Records come with the number of their layout: only within one
/// are bytes comparable.
pub fn hash(layout: usize, record: &[u8]) -> u128 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(layout as u64).to_le_bytes());
    hasher.update(record);
    // Half of the hash: no accident makes two of these equal.
    hasher.finalize().as_bytes().first_chunk::<16>().map_or(0, |half| u128::from_le_bytes(*half))
}

/// The places of all records, counted from 0, that equal one before them; there
/// are so many `points`.
pub fn find<'a>(points: usize, records: impl Iterator<Item = (usize, &'a [u8])>) -> Vec<u32> {
    let mut seen = hashes(points);
    let hashes = records.map(|(layout, record)| hash(layout, record));
    (0..).zip(hashes).filter(|(_, hash)| !seen.insert(*hash)).map(|(place, _)| place).collect()
}

/// The keys are hashes already.
#[derive(Default)]
pub struct IdentityHasher(u64);

impl Hasher for IdentityHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        self.0 = bytes.first_chunk::<8>().map_or(0, |half| u64::from_le_bytes(*half));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_memory_that_is_reckoned_with_is_that_of_the_set() {
        for points in [8, 10_000, 229_376, 229_377, 1_000_000] {
            let room = hashes(points).capacity() as u64;
            let reckoned = memory(points as u64) - points as u64 * 4;
            assert_eq!(reckoned, room * 8 / 7 * 17, "{points}");
        }
    }

    proptest! {
        #[test]
        fn every_record_but_the_first_of_its_kind_is_a_twin(
            records in prop::collection::vec((0usize..2, prop::collection::vec(0u8..3, 4)), 0..200),
        ) {
            let twins = find(records.len(), records.iter().map(|(layout, record)| (*layout, record.as_slice())));
            let expected: Vec<u32> =
                (0..records.len()).filter(|i| records[..*i].contains(&records[*i])).map(|i| i as u32).collect();
            prop_assert_eq!(twins, expected);
        }
    }
}
