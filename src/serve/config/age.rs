//! Ages as people write them: `30d`, `12h`, `2w`; a bare number is days.

use std::str::FromStr;

use serde::{Deserialize, Deserializer};

const HOUR: i64 = 3_600_000;

/// Milliseconds, not negative, and at most a century.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Age(pub i64);

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no age; write it as in 30d, 12h or 2w")]
pub struct AgeError(String);

impl FromStr for Age {
    type Err = AgeError;

    fn from_str(text: &str) -> Result<Age, AgeError> {
        let wrong = || AgeError(text.to_string());
        let lower = text.trim().to_ascii_lowercase();
        let (digits, unit) = match lower.strip_suffix(['h', 'd', 'w']) {
            Some(digits) => (digits, &lower[digits.len()..]),
            None => (lower.as_str(), "d"),
        };
        let unit = match unit {
            "h" => HOUR,
            "w" => 7 * 24 * HOUR,
            _ => 24 * HOUR,
        };
        let number: u32 = digits.parse().map_err(|_| wrong())?;
        let age = i64::from(number).saturating_mul(unit);
        if age > 36_525 * 24 * HOUR { Err(wrong()) } else { Ok(Age(age)) }
    }
}

impl<'de> Deserialize<'de> for Age {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Age, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_are_read_as_people_write_them() {
        for (text, hours) in [("30d", 720), ("12h", 12), ("2W", 336), ("1", 24), ("0d", 0)] {
            assert_eq!(text.parse(), Ok(Age(hours * HOUR)), "{text}");
        }
        for text in ["", "d", "-1d", "1.5d", "30 minutes", "999999999w"] {
            assert!(text.parse::<Age>().is_err(), "{text}");
        }
    }
}
