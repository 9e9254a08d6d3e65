//! The fields that are decoded here come out as `laz` decodes them, and damage
//! ends them.

use std::io::Cursor;

use laz::record::RecordDecompressor;
use proptest::prelude::*;

use super::super::coding::Coding;
use super::*;

/// Records whose fields change now and then, as a scanner's do: several returns,
/// channels and sequences of times.
fn records(point_format: u8, length: usize, points: usize, seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut dice = move |below: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % below
    };
    let time_at = if point_format < 6 { 20 } else { 22 };
    let mut record = vec![0u8; length];
    let mut times = [1e5f64, 3e8, -7.0, 2e5];
    let mut all = Vec::new();
    for _ in 0..points {
        for axis in 0..3 {
            let at = 4 * axis;
            let c = i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
            let step = if dice(50) == 0 { dice(1 << 32) as i32 } else { dice(400) as i32 - 200 };
            record[at..at + 4].copy_from_slice(&c.wrapping_add(step).to_le_bytes());
        }
        for byte in 12..length {
            if dice(4) == 0 && !(time_at..time_at + 8).contains(&byte) {
                record[byte] = dice(256) as u8;
            }
        }
        if dice(3) > 0 {
            let lines = if dice(9) == 0 { 4 } else { 1 };
            let line = dice(lines) as usize;
            times[line] += [1e-6, 1e-6, 2e-6, 0.5, 1e9][dice(5) as usize];
            record[time_at..time_at + 8].copy_from_slice(&times[line].to_le_bytes());
        }
        all.extend_from_slice(&record);
    }
    all
}

fn coding(point_format: u8) -> Coding {
    let vlr = laz::LazVlrBuilder::default().with_point_format(point_format, 0).unwrap().build();
    Coding::new(vlr.items(), point_format).unwrap()
}

fn decoded(mut decoder: impl RecordDecompressor<Cursor<Vec<u8>>>, length: usize) -> io::Result<Vec<u8>> {
    let mut records = vec![0; length];
    decoder.decompress_many(&mut records).map(|()| records)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn what_was_written_comes_out(format in prop::sample::select(vec![1u8, 3, 6, 7, 8]), seed in any::<u64>()) {
        let coding = coding(format);
        let records = records(format, coding.record_length, 700, seed);
        let chunk = coding.encode(&records).unwrap();
        let input = Cursor::new(chunk.clone());
        let ours = match coding.layered {
            true => decoded(layered(&coding.items, input).unwrap(), records.len()),
            false => decoded(sequential(&coding.items, input).unwrap(), records.len()),
        };
        prop_assert!(ours.unwrap() == records);
    }
}

/// Found by fuzzing: a layer of times that is nothing but ones, as flash memory that
/// was erased, is a switch of sequences without end. `laz` follows it by recursion
/// and overflows any stack.
#[test]
fn times_that_switch_without_end_are_an_error() {
    for format in [1, 6] {
        let coding = coding(format);
        let records = records(format, coding.record_length, 2000, 1);
        let good = coding.encode(&records).unwrap();
        let front = if coding.layered { coding.layered_front() } else { coding.record_length };
        let mut errors = 0;
        for fill in [0x00, 0x55, 0xAA, 0xEE, 0xFE, 0xFF] {
            let mut bad = good.clone();
            // All of the stream, or the last layer, which is that of the times.
            let from = if coding.layered { front + (good.len() - front) * 4 / 5 } else { front + 50 };
            bad[from..].fill(fill);
            let mut out = vec![0; records.len()];
            errors += usize::from(coding.decoder().decode(&bad, &mut out).is_err());
        }
        assert!(errors > 0, "format {format}: none of the damage was seen");
    }
}
