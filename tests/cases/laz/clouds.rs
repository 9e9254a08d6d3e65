//! Clouds that visit all of the codec: fields that change seldom and often, steps of all
//! sizes, several returns, scanner channels, and flight lines by turns.

pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % limit
    }

    fn one_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }
}

/// Random records of a format whose standard fields are followed by extra bytes.
pub fn records(point_format: u8, length: usize, points: usize, seed: u64) -> Vec<u8> {
    let mut dice = Dice::new(seed + 1);
    // How often things change is another in each cloud: never to always.
    let rates: Vec<u64> =
        (0..length).map(|_| [1, 2, 5, 50, u64::MAX >> 12][dice.below(5) as usize]).collect();
    let steps = [1, 3, 100, 1 << 14, 1 << 22, 1 << 31][dice.below(6) as usize];
    let wild = [1, 40, u64::MAX >> 12][dice.below(3) as usize];
    let channels = [1, 1, 2, 4][dice.below(4) as usize];
    let time_at = match point_format {
        1 | 3 => Some(20),
        6..=8 => Some(22),
        _ => None,
    };
    let mut record: Vec<u8> = (0..length).map(|_| dice.below(256) as u8).collect();
    let mut times = [1e5f64, 3e8, -7.0, 2e5, 0.0, 1e-300];
    let mut step = 1e-6;
    let mut all = Vec::with_capacity(points * length);
    for _ in 0..points {
        for axis in 0..3 {
            let at = 4 * axis;
            let mut word = [0; 4];
            word.copy_from_slice(&record[at..at + 4]);
            let by =
                if dice.one_in(wild) { dice.below(1 << 32) as i32 } else { dice.below(2 * steps) as i32 };
            let moved = i32::from_le_bytes(word).wrapping_add(by).wrapping_sub(steps as i32);
            record[at..at + 4].copy_from_slice(&moved.to_le_bytes());
        }
        for at in 12..length {
            if dice.one_in(rates[at]) && !time_at.is_some_and(|time| (time..time + 8).contains(&at)) {
                // A small step, mostly.
                let by = if dice.one_in(3) { dice.below(256) } else { dice.below(3) };
                record[at] = record[at].wrapping_add(by as u8);
            }
        }
        if point_format >= 6 {
            let channel = if dice.one_in(7) { dice.below(channels) } else { u64::from(record[15] >> 4 & 3) };
            record[15] = record[15] & !0x30 | (channel.min(channels - 1) as u8) << 4;
        }
        if let Some(at) = time_at
            && dice.below(3) > 0
        {
            let line = if dice.one_in(9) { dice.below(6) as usize } else { 0 };
            if dice.one_in(50) {
                step = [1e-6, 1e-9, 0.5, 1e9, -1e-6, 1e-3][dice.below(6) as usize];
            }
            let multiple = [0.0, 1.0, 1.0, 1.0, 2.0, 3.0, 20.0, 700.0, -1.0, -40.0][dice.below(10) as usize];
            times[line] += step * multiple;
            let bits = if dice.one_in(500) { dice.below(u64::MAX) } else { times[line].to_bits() };
            // The sign of a zero is a case of its own.
            let bits = if bits == (-0.0f64).to_bits() { 0 } else { bits };
            record[at..at + 8].copy_from_slice(&bits.to_le_bytes());
        }
        all.extend_from_slice(&record);
    }
    all
}
