//! Twins: records that equal another in every attribute. On request all but the
//! first of each are set aside. Twins share a position and so a chunk, where a
//! set of hashes finds them in linear time.

use std::collections::HashSet;
use std::hash::{BuildHasherDefault, Hasher};

/// The places of all records, counted from 0, that equal one before them.
/// Records come with the number of their layout: only within one are bytes
/// comparable.
pub fn find<'a>(records: impl Iterator<Item = (usize, &'a [u8])>) -> Vec<u32> {
    let mut seen: HashSet<u128, BuildHasherDefault<Taken>> = HashSet::default();
    let hashes = records.map(|(layout, record)| {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(layout as u64).to_le_bytes());
        hasher.update(record);
        // Half of the hash: no accident makes two of these equal.
        let hash = hasher.finalize();
        hash.as_bytes().first_chunk::<16>().map_or(0, |half| u128::from_le_bytes(*half))
    });
    (0..).zip(hashes).filter(|(_, hash)| !seen.insert(*hash)).map(|(place, _)| place).collect()
}

/// The keys are hashes already.
#[derive(Default)]
struct Taken(u64);

impl Hasher for Taken {
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

    proptest! {
        #[test]
        fn every_record_but_the_first_of_its_kind_is_a_twin(
            records in prop::collection::vec((0usize..2, prop::collection::vec(0u8..3, 4)), 0..200),
        ) {
            let twins = find(records.iter().map(|(layout, record)| (*layout, record.as_slice())));
            let expected: Vec<u32> =
                (0..records.len()).filter(|i| records[..*i].contains(&records[*i])).map(|i| i as u32).collect();
            prop_assert_eq!(twins, expected);
        }
    }
}
