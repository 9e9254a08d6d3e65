//! What several commands read from their arguments.

use crate::platform::limits;

/// Threads to work with; all that the machine or container grants if their number is not
/// given.
pub(super) fn pool(threads: Option<u16>) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let threads = threads.map_or_else(limits::threads, usize::from);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()
}

/// Bytes from `512M`, `16GiB`, `1.5g` or a plain number; K, M, G and T are
/// powers of 1024.
pub(super) fn parse_bytes(text: &str) -> Result<u64, String> {
    let lower = text.trim().to_ascii_lowercase();
    let digits = lower.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match lower[digits.len()..].trim_end_matches('b').trim_end_matches('i') {
        "" => 1u64,
        "k" => 1 << 10,
        "m" => 1 << 20,
        "g" => 1 << 30,
        "t" => 1 << 40,
        unit => return Err(format!("{unit:?} is no unit of memory; use K, M, G or T")),
    };
    let number: f64 =
        digits.trim().parse().map_err(|_| format!("{text:?} is no amount of memory, such as 512M"))?;
    let bytes = number * factor as f64;
    if !(1.0..9e18).contains(&bytes) {
        return Err(format!("{text:?} is no sensible amount of memory"));
    }
    Ok(bytes as u64)
}

/// A count as people write it: 1000, 20M, 2G.
pub(super) fn count(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor: u64 = match &text[digits.len()..] {
        "" => 1,
        "k" | "K" => 1_000,
        "m" | "M" => 1_000_000,
        "g" | "G" => 1_000_000_000,
        _ => return Err("write a number, with k, M or G behind it if you like".to_string()),
    };
    let number: u64 = digits.replace('_', "").parse().map_err(|_| format!("{digits:?} is not a number"))?;
    match number.checked_mul(factor) {
        Some(points) if points > 0 => Ok(points),
        Some(_) => Err("there must be at least one point".to_string()),
        None => Err("that is more than 64 bits count".to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_as_people_write_it() {
        assert_eq!(parse_bytes("512M"), Ok(512 << 20));
        assert_eq!(parse_bytes("16GiB"), Ok(16 << 30));
        assert_eq!(parse_bytes("1.5g"), Ok(3 << 29));
        assert_eq!(parse_bytes("1000"), Ok(1000));
        assert!(
            parse_bytes("12 parsecs").is_err() && parse_bytes("-1G").is_err() && parse_bytes("").is_err()
        );
    }

    #[test]
    fn counts_are_read_as_people_write_them() {
        assert_eq!(count("1000"), Ok(1000));
        assert_eq!(count("20M"), Ok(20_000_000));
        assert_eq!(count("2_000k"), Ok(2_000_000));
        for wrong in ["", "0", "M", "1T", "-3", "1.5M", "99999999999G"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
    }
}
