//! Multisets of records as sums: each record is hashed to 128 bits, and the
//! hashes are added up, so that order and threads do not matter. Two multisets
//! with equal sums are equal but for a chance of one in 2^128 that no accident
//! meets. The sums are kept in buckets by the hash, so that where two differ
//! only the records of the differing buckets have to be looked at.

/// Buckets of a sum.
pub const BUCKETS: usize = 4096;

const KEYS: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xd1b5_4a32_d192_ed03, 0xaef1_7502_b3a1_9a4d];

/// The hash of a record: two lanes, one folding the full product of 64-bit
/// words, one multiplying and turning, mixed at the end.
pub fn digest(record: &[u8]) -> u128 {
    let mut folded = KEYS[0] ^ record.len() as u64;
    let mut turned = KEYS[1];
    for bytes in record.chunks(8) {
        let mut padded = [0; 8];
        padded[..bytes.len()].copy_from_slice(bytes);
        let word = u64::from_le_bytes(padded);
        let product = u128::from(folded ^ word ^ KEYS[2]) * u128::from(KEYS[0]);
        folded = (product as u64) ^ ((product >> 64) as u64).rotate_left(17);
        turned = (turned ^ word).wrapping_mul(KEYS[1]).rotate_left(29);
    }
    let high = mix(turned ^ folded.rotate_left(32));
    let low = mix(folded.wrapping_add(high));
    u128::from(high) << 64 | u128::from(low)
}

/// Every bit of the result depends on every bit of the value.
fn mix(mut value: u64) -> u64 {
    for key in [KEYS[1], KEYS[2]] {
        value = (value ^ value >> 32).wrapping_mul(key);
    }
    value ^ value >> 29
}

pub fn bucket_of(hash: u128) -> usize {
    (hash >> 116) as usize
}

/// A multiset of records.
#[derive(Debug, Clone)]
pub struct Sum {
    buckets: Vec<DigestBucket>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DigestBucket {
    pub count: u64,
    sum: u128,
}

impl Default for Sum {
    fn default() -> Sum {
        Sum { buckets: vec![DigestBucket::default(); BUCKETS] }
    }
}

impl Sum {
    pub fn add(&mut self, record: &[u8]) {
        let hash = digest(record);
        let bucket = &mut self.buckets[bucket_of(hash)];
        bucket.count += 1;
        bucket.sum = bucket.sum.wrapping_add(hash);
    }

    pub fn merge(&mut self, other: &Sum) {
        for (mine, theirs) in self.buckets.iter_mut().zip(&other.buckets) {
            mine.count += theirs.count;
            mine.sum = mine.sum.wrapping_add(theirs.sum);
        }
    }

    pub fn count(&self) -> u64 {
        self.buckets.iter().map(|bucket| bucket.count).sum()
    }

    /// The buckets in which two multisets differ, with how many records the two
    /// have in each together.
    pub fn differing(&self, other: &Sum) -> Vec<(usize, u64)> {
        let pairs = self.buckets.iter().zip(&other.buckets).enumerate();
        pairs.filter(|(_, (a, b))| a != b).map(|(index, (a, b))| (index, a.count + b.count)).collect()
    }
}

/// Groups of buckets, each with at most so many records (but at least a bucket).
pub fn passes(differing: &[(usize, u64)], records: u64) -> Vec<Vec<bool>> {
    let mut passes: Vec<Vec<bool>> = Vec::new();
    let mut held = u64::MAX;
    for &(bucket, count) in differing {
        held = held.saturating_add(count);
        if held > records {
            passes.push(vec![false; BUCKETS]);
            held = count;
        }
        if let Some(pass) = passes.last_mut() {
            pass[bucket] = true;
        }
    }
    passes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn passes_keep_to_the_memory() {
        let differing = [(1, 10), (2, 10), (7, 25), (9, 1)];
        let chosen = |pass: &Vec<bool>| (0..BUCKETS).filter(|&b| pass[b]).collect::<Vec<_>>();
        let passes: Vec<Vec<usize>> = passes(&differing, 20).iter().map(chosen).collect();
        assert_eq!(passes, [vec![1, 2], vec![7], vec![9]]);
    }

    #[test]
    fn every_bit_of_a_record_turns_half_of_the_hash() {
        let record = [7u8; 41];
        let hash = digest(&record);
        for bit in 0..record.len() * 8 {
            let mut changed = record;
            changed[bit / 8] ^= 1 << (bit % 8);
            let turned = (digest(&changed) ^ hash).count_ones();
            assert!((30..98).contains(&turned), "bit {bit} turns {turned} bits");
        }
    }

    /// Structured records, as point clouds have them: no two alike by chance,
    /// in either half of the hash.
    #[test]
    fn grids_do_not_collide() {
        let mut hashes = Vec::new();
        for x in 0..100u32 {
            for y in 0..100u32 {
                for z in 0..20u32 {
                    hashes.push(digest(&[x.to_le_bytes(), y.to_le_bytes(), z.to_le_bytes()].concat()));
                }
            }
        }
        for half in [0, 64] {
            let mut halves: Vec<u64> = hashes.iter().map(|hash| (hash >> half) as u64).collect();
            halves.sort_unstable();
            halves.dedup();
            assert_eq!(halves.len(), hashes.len());
        }
    }

    proptest! {
        #[test]
        fn sums_know_multisets(records in proptest::collection::vec(any::<[u8; 5]>(), 1..50), at in any::<prop::sample::Index>()) {
            let sum = |records: &[[u8; 5]]| {
                let mut sum = Sum::default();
                records.iter().for_each(|record| sum.add(record));
                sum
            };
            let whole = sum(&records);
            let mut parts = sum(&records[records.len() / 2..]);
            parts.merge(&sum(&records[..records.len() / 2]));
            prop_assert!(whole.differing(&parts).is_empty());
            let mut doubled = records.clone();
            doubled.push(records[at.index(records.len())]);
            prop_assert_eq!(whole.differing(&sum(&doubled)).len(), 1);
        }
    }
}
