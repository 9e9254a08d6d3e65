//! Damaged chunks: never a panic, never success where `laz` fails, and never other
//! records. Runs for `LODESTONE_FUZZ_SECONDS` (2), and says what it saw.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use lodestone::format::laz::LazError;

use super::*;

/// Chunks that are damaged between two looks at the clock.
const BATCH: u64 = 100;
/// For each chunk that both decode, so many are decoded by ours alone, which only must not
/// panic: `laz` takes a hundred times as long to set up.
const ALONE: u64 = 20;

/// One kind of points, with sound chunks of it.
struct Seeds {
    oracle: Oracle,
    decoder: Decoder,
    /// Bytes in front of what is coded.
    front: usize,
    /// Points and bytes.
    chunks: Vec<(usize, Vec<u8>)>,
}

fn seeds(dice: &mut Dice) -> Vec<Seeds> {
    let mut all = Vec::new();
    for (point_format, version) in KINDS {
        for extra in [0, 2] {
            let oracle = Oracle::new(point_format, extra, version);
            let shape = RecordShape::new(point_format, usize::from(extra), version).unwrap();
            let chunks = (0..24)
                .map(|_| {
                    let points = [1, 2, 3, 5, 10, 30, 100, 400][dice.below(8) as usize];
                    let records = records(point_format, oracle.length, points, dice.below(1 << 40));
                    (points, oracle.encode(&records))
                })
                .collect();
            let layers = match point_format {
                6 => 9,
                7 => 10,
                _ => 11,
            };
            let sizes = if oracle.layered { 4 + 4 * (layers + usize::from(extra)) } else { 0 };
            let front = oracle.length + sizes;
            all.push(Seeds { oracle, decoder: Decoder::new(shape), front, chunks });
        }
    }
    all
}

/// Damages what is coded, mostly; and seldom changes the length, which is seen at once.
fn damage(dice: &mut Dice, chunk: &mut Vec<u8>, front: usize) {
    for _ in 0..=dice.below(3) {
        let from = if dice.below(8) == 0 { 0 } else { front.min(chunk.len().saturating_sub(1)) };
        let at = from + dice.below((chunk.len() - from).max(1) as u64) as usize;
        if at >= chunk.len() {
            return;
        }
        match dice.below(12) {
            0 if dice.below(6) == 0 => chunk.truncate(at),
            1 if dice.below(6) == 0 => chunk.push(dice.below(256) as u8),
            0..=2 => {
                let to = (at + dice.below(40) as usize).min(chunk.len());
                chunk[at..to].fill([0, 0xFF, 0x55, 0xEE][dice.below(4) as usize]);
            }
            3 => {
                let to = (at + dice.below(40) as usize).min(chunk.len());
                chunk[at..to].fill_with(|| dice.below(256) as u8);
            }
            4..8 => chunk[at] ^= 1 << dice.below(8),
            _ => chunk[at] = dice.below(256) as u8,
        }
    }
}

/// What became of a damaged chunk; `Err` for what must not be.
fn verdict(seeds: &mut Seeds, chunk: &[u8], points: usize) -> Result<&'static str, String> {
    let mut records = vec![0; points * seeds.oracle.length];
    let decoder = &mut seeds.decoder;
    let own = catch_unwind(AssertUnwindSafe(|| decoder.decode(chunk, &mut records)))
        .map_err(|_| "a panic".to_string())?;
    match own {
        // `laz` would make room for whatever the layers say, or follow the switches by
        // recursion until its stack overflows.
        Err(LazError::TooShort(_) | LazError::Layers(..) | LazError::Points(..)) => {
            return Ok("an error: its front contradicts its bytes (not given to laz)");
        }
        Err(LazError::Switches) => return Ok("an error: too many switches of GPS times (not given to laz)"),
        _ => {}
    }
    let oracle = catch_unwind(AssertUnwindSafe(|| seeds.oracle.decode(chunk, points)));
    match (own, oracle) {
        (Ok(()), Ok(Ok(of_laz))) if of_laz == records => Ok("the same records"),
        (Ok(()), Ok(Ok(_))) => Err("other records".to_string()),
        (Ok(()), Ok(Err(reason))) => Err(format!("records where laz says: {reason}")),
        (Ok(()), Err(_)) => Err("records where laz panics".to_string()),
        (Err(_), Ok(Err(_))) => Ok("errors of both"),
        (Err(_), Err(_)) => Ok("an error where laz panics"),
        (Err(LazError::Beginning), Ok(Ok(_))) => Ok("an error where laz has records: no such beginning"),
        (Err(error), Ok(Ok(_))) => Err(format!("laz has records; {error}")),
    }
}

/// `laz` follows switches of GPS times by recursion; ours does not.
const STACK: usize = 1 << 30;

#[test]
fn damaged_chunks_are_errors_or_the_same_records() {
    let thread = std::thread::Builder::new().stack_size(STACK).spawn(compare).unwrap();
    thread.join().unwrap();
}

fn compare() {
    let wish = std::env::var("LODESTONE_FUZZ_SECONDS").unwrap_or_default();
    let seconds: f64 = if wish.is_empty() { 2.0 } else { wish.parse().expect("a number of seconds") };
    let seed = std::env::var("LODESTONE_FUZZ_SEED")
        .map_or_else(|_| u64::from(std::process::id()), |seed| seed.parse().expect("a number"));
    std::panic::set_hook(Box::new(|_| {})); // laz panics now and then
    let mut dice = Dice::new(seed);
    let mut all = seeds(&mut dice);
    let mut seen = BTreeMap::<&str, u64>::new();
    let (start, mut looked, mut alone) = (Instant::now(), 0u64, 0u64);
    let mut failure = None;
    while failure.is_none() && (looked == 0 || start.elapsed().as_secs_f64() < seconds) {
        for _ in 0..BATCH {
            let number = dice.below(all.len() as u64) as usize;
            let seeds = &mut all[number];
            let (points, sound) = seeds.chunks[dice.below(seeds.chunks.len() as u64) as usize].clone();
            let mut records = vec![0; points * seeds.oracle.length];
            for _ in 0..ALONE {
                let mut chunk = sound.clone();
                damage(&mut dice, &mut chunk, seeds.front);
                let decoder = &mut seeds.decoder;
                let decoded = catch_unwind(AssertUnwindSafe(|| decoder.decode(&chunk, &mut records)));
                if decoded.is_err() {
                    failure = Some(format!("a panic: {points} points, {:?}, {chunk:?}", seeds.oracle.items));
                }
            }
            alone += ALONE;
            let mut chunk = sound;
            damage(&mut dice, &mut chunk, seeds.front);
            match verdict(seeds, &chunk, points) {
                Ok(verdict) => *seen.entry(verdict).or_default() += 1,
                Err(what) => {
                    let found = std::env::temp_dir().join(format!("lodestone-laz-{seed}"));
                    std::fs::write(&found, &chunk).unwrap();
                    let found = found.display();
                    let items = &seeds.oracle.items;
                    failure = Some(format!("{what}: {points} points of {items:?}, seed {seed}, see {found}"));
                    break;
                }
            }
        }
        looked += BATCH;
        if looked.is_multiple_of(100_000) {
            eprintln!("{looked}: {seen:?}");
        }
    }
    let _ = std::panic::take_hook();
    println!("{alone} damaged chunks by ours alone, and {looked} by both");
    println!("in {:.0} s:", start.elapsed().as_secs_f64());
    for (what, count) in seen {
        println!("{count:>12} {what}");
    }
    assert_eq!(failure, None);
}
