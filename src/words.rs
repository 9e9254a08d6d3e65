//! What people write for values, and how numbers are written for people: names of
//! a choice in any letter case, yes and no in the usual words.

use std::fmt::{self, Write as _};

use clap::ValueEnum;
use serde::de::{Deserialize, Deserializer, Error, Visitor};

/// Breaks lines, moves the cursor, turns text around, or cannot be seen.
pub fn is_invisible(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200B}' | '\u{200E}' | '\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}' | '\u{FEFF}')
}

/// What ASPRS calls a class of points (LAS 1.4 R15, table 17).
pub fn class_name(code: i64) -> Option<&'static str> {
    const NAMES: [&str; 19] = [
        "never classified",
        "unclassified",
        "ground",
        "low vegetation",
        "medium vegetation",
        "high vegetation",
        "building",
        "low noise",
        "model key",
        "water",
        "rail",
        "road",
        "overlap",
        "wire guard",
        "wire conductor",
        "tower",
        "wire connector",
        "bridge deck",
        "high noise",
    ];
    NAMES.get(usize::try_from(code).ok()?).copied()
}

/// A text of others (a path, a name, an error that has one in it) for a log or a
/// terminal: what could forge a line or reach the screen's controls is escaped.
#[derive(Debug, Clone, Copy)]
pub struct Plain<T>(pub T);

/// The same for a text of several lines, whose ends and tabs stay.
#[derive(Debug, Clone, Copy)]
pub struct Lines<T>(pub T);

impl<T: fmt::Display> fmt::Display for Plain<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(Escaping { into: f, keeps: |_| false }, "{}", self.0)
    }
}

impl<T: fmt::Display> fmt::Display for Lines<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(Escaping { into: f, keeps: |c| matches!(c, '\n' | '\t') }, "{}", self.0)
    }
}

/// Writes on what is written to it, escaped in a way that JSON reads too.
struct Escaping<W> {
    into: W,
    keeps: fn(char) -> bool,
}

impl<W: fmt::Write> fmt::Write for Escaping<W> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut rest = text;
        while let Some(at) = rest.find(|c: char| is_invisible(c) && !(self.keeps)(c)) {
            let c = rest[at..].chars().next().unwrap_or_default();
            self.into.write_str(&rest[..at])?;
            match c {
                '\n' => self.into.write_str("\\n")?,
                '\r' => self.into.write_str("\\r")?,
                '\t' => self.into.write_str("\\t")?,
                c => write!(self.into, "\\u{:04x}", u32::from(c))?,
            }
            rest = &rest[at + c.len_utf8()..];
        }
        self.into.write_str(rest)
    }
}

/// The choice that a text names, in any letter case and with `-` or `_`; the error
/// tells what there is to choose from.
pub fn choice<T: ValueEnum>(text: &str) -> Result<T, String> {
    let name = text.trim().replace('_', "-");
    T::from_str(&name, true).or_else(|_| T::from_str(text.trim(), true)).map_err(|_| {
        let known: Vec<String> = T::value_variants()
            .iter()
            .filter_map(|value| Some(format!("`{}`", value.to_possible_value()?.get_name())))
            .collect();
        format!("`{text}` is none of {}", known.join(", "))
    })
}

/// Reads an enum from its name by [`choice`].
#[macro_export]
#[doc(hidden)]
macro_rules! deserialize_choice {
    ($($name:ty),+ $(,)?) => {$(
        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
                let text = <String as serde::Deserialize>::deserialize(deserializer)?;
                $crate::words::choice(&text).map_err(serde::de::Error::custom)
            }
        }
    )+};
}

/// Yes or no, as people write it.
pub fn yes_or_no(text: &str) -> Result<bool, String> {
    match text.trim().to_lowercase().as_str() {
        "true" | "yes" | "on" | "1" | "y" | "t" => Ok(true),
        "false" | "no" | "off" | "0" | "n" | "f" => Ok(false),
        _ => Err(format!(
            "`{text}` is neither yes nor no; write `true` or `false`, yes or no, on or off, 1 or 0"
        )),
    }
}

/// For fields of a file that are `true`, `"yes"`, `1` or not there.
pub fn optional_switch<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<bool>, D::Error> {
    struct Switch;
    impl Visitor<'_> for Switch {
        type Value = bool;
        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("yes or no")
        }
        fn visit_bool<E: Error>(self, value: bool) -> Result<bool, E> {
            Ok(value)
        }
        fn visit_str<E: Error>(self, text: &str) -> Result<bool, E> {
            yes_or_no(text).map_err(E::custom)
        }
        fn visit_i64<E: Error>(self, number: i64) -> Result<bool, E> {
            yes_or_no(&number.to_string()).map_err(E::custom)
        }
        fn visit_u64<E: Error>(self, number: u64) -> Result<bool, E> {
            yes_or_no(&number.to_string()).map_err(E::custom)
        }
    }
    struct Value(bool);
    impl<'de> Deserialize<'de> for Value {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Value, D::Error> {
            deserializer.deserialize_any(Switch).map(Value)
        }
    }
    Ok(Option::<Value>::deserialize(deserializer)?.map(|value| value.0))
}

/// A number for people: as it is written usually, without the noise of binary digits
/// behind the fifteenth, and where that would be a row of zeros with its power of ten.
pub fn number(value: f64) -> String {
    plainly(rounded(value, 15))
}

/// A number of single precision, which has noise behind its seventh digit: the shortest
/// that is read as the same.
pub fn number_32(value: f32) -> String {
    plainly(value.to_string().parse().unwrap_or(f64::from(value)))
}

fn plainly(value: f64) -> String {
    match value.abs() {
        size if size.is_finite() && size != 0.0 && !(1e-6..1e15).contains(&size) => format!("{value:e}"),
        _ => value.to_string(),
    }
}

/// A number with its digits in groups of three.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

/// To so many digits that matter. What would overflow stays as it is.
pub fn rounded(value: f64, digits: usize) -> f64 {
    let text = format!("{value:.*e}", digits.saturating_sub(1));
    text.parse().ok().filter(|number: &f64| number.is_finite()).unwrap_or(value)
}

/// Decimals that tell the steps of this scale apart; three where it is none.
pub fn decimals(scale: f64) -> usize {
    // What is a hair beside a round number by its binary digits is that number.
    let scale = rounded(scale.abs(), 9);
    let steps = (-scale.log10() - 1e-9).ceil();
    if !steps.is_finite() {
        return 3;
    }
    let least = steps.clamp(0.0, 12.0) as usize;
    // Steps of 0.25 have two.
    let written = scale.to_string().split_once('.').map_or(0, |(_, decimals)| decimals.len());
    if written <= least + 3 { written.max(least) } else { least }
}

/// A coordinate on a lattice of this scale, in as many decimals as that can hold.
pub fn coordinate(value: f64, scale: f64) -> String {
    // Where a header lies, a coordinate may have three hundred digits.
    match value.abs() {
        size if size >= 1e15 => number(value),
        _ => format!("{value:.*}", decimals(scale)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_reaches_the_screen_is_escaped() {
        let text = "a\nb\u{1b}[31mred\u{7f}\u{85}\u{202e}gnp\tü😀";
        assert_eq!(Plain(text).to_string(), "a\\nb\\u001b[31mred\\u007f\\u0085\\u202egnp\\tü😀");
        assert_eq!(Lines("a\nb\tc\rd").to_string(), "a\nb\tc\\rd");
        let json = format!("\"{}\"", Plain("\u{85}\n"));
        assert_eq!(serde_json::from_str::<String>(&json).expect("JSON"), "\u{85}\n");
    }

    proptest! {
        #[test]
        fn nothing_invisible_is_left(text in ".*") {
            prop_assert!(!Plain(&text).to_string().contains(is_invisible));
            let lines = Lines(&text).to_string();
            prop_assert!(!lines.contains(|c| is_invisible(c) && !matches!(c, '\n' | '\t')));
        }
    }

    #[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
    enum Pace {
        Slow,
        #[value(alias = "UNCOMPRESSED")]
        VeryFast,
    }
    deserialize_choice!(Pace);

    #[test]
    fn choices_are_read_in_any_letter_case() {
        for (text, pace) in [
            ("slow", Pace::Slow),
            ("SLOW", Pace::Slow),
            (" Very_Fast ", Pace::VeryFast),
            ("very-FAST", Pace::VeryFast),
        ] {
            assert_eq!(choice(text), Ok(pace), "{text}");
        }
        assert_eq!(serde_json::from_str::<Pace>(r#""Uncompressed""#).ok(), Some(Pace::VeryFast));
        let error = serde_json::from_str::<Pace>(r#""best""#).expect_err("none").to_string();
        assert!(error.contains("`best` is none of `slow`, `very-fast`"), "{error}");
    }

    #[test]
    fn yes_and_no_are_read_as_people_write_them() {
        for yes in ["true", "TRUE", "Yes", "on", "ON", "1", " y "] {
            assert_eq!(yes_or_no(yes), Ok(true), "{yes}");
        }
        for no in ["false", "False", "NO", "off", "0", "n"] {
            assert_eq!(yes_or_no(no), Ok(false), "{no}");
        }
        for neither in ["", "2", "ja", "tru e"] {
            assert!(yes_or_no(neither).is_err(), "{neither}");
        }
        #[derive(serde::Deserialize)]
        struct Settings {
            #[serde(default, deserialize_with = "optional_switch")]
            on: Option<bool>,
        }
        for (text, on) in
            [("", None), ("on = 'Yes'", Some(true)), ("on = 0", Some(false)), ("on = true", Some(true))]
        {
            assert_eq!(toml::from_str::<Settings>(text).expect("read").on, on, "{text}");
        }
        assert!(
            toml::from_str::<Settings>("on = 2").is_err() && toml::from_str::<Settings>("on = 'x'").is_err()
        );
    }

    #[test]
    fn no_number_is_a_row_of_zeros() {
        for (value, text) in [
            (f64::MAX, "1.7976931348623157e308"),
            (-1e300, "-1e300"),
            (5e-324, "5e-324"),
            (0.0, "0"),
            (0.001, "0.001"),
            (1e-7, "1e-7"),
            (637_425.79, "637425.79"),
            (f64::NAN, "NaN"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn digits_stand_in_groups() {
        assert_eq!(
            (grouped(5), grouped(1234), grouped(10_653_336)),
            ("5".into(), "1 234".into(), "10 653 336".into())
        );
    }

    #[test]
    fn no_number_ends_in_binary_noise() {
        for (value, text) in [
            (366_616.600_000_000_03, "366616.6"),
            (-0.1 - 0.2, "-0.3"),
            (0.1 * 3.0, "0.3"),
            (245_370_417.414_215_7, "245370417.414216"),
            (1_f64 / 3.0, "0.333333333333333"),
        ] {
            assert_eq!(number(value), text);
        }
        for (value, text) in [
            (0.1_f32, "0.1"),
            (1.0 / 3.0, "0.33333334"),
            (f32::MIN_POSITIVE, "1.1754944e-38"),
            (f32::NAN, "NaN"),
        ] {
            assert_eq!(number_32(value), text);
        }
    }

    #[test]
    fn coordinates_have_the_decimals_of_their_scale() {
        for (value, scale, text) in [
            (366_616.600_000_000_03, 0.01, "366616.60"),
            (1.23456, 0.01, "1.23"),
            (-122.419_415_5, 1e-7, "-122.4194155"),
            (3.5, 1.0, "4"),
            (7.25, 0.25, "7.25"),
            (100.0, 0.3048, "100.0000"),
            (100.0, 1.0 / 3.0, "100.0"),
            (12.0, 100.0, "12"),
            (1.0, 0.010_000_000_000_000_002, "1.00"),
            (1.0, 0.009_999_999_999_999_998, "1.00"),
            (1.0, f64::NAN, "1.000"),
            (1.0, 0.0, "1.000"),
            (-1e300, 0.01, "-1e300"),
            (f64::INFINITY, 0.01, "inf"),
        ] {
            assert_eq!(coordinate(value, scale), text, "{value} by {scale}");
        }
    }

    proptest! {
        #[test]
        fn steps_of_a_lattice_are_told_apart(step in -1_000_000_i32..1_000_000, scale in 1e-7_f64..10.0) {
            let at = |step: i32| coordinate(f64::from(step) * scale + 1000.0, scale);
            // A scale that is no power of ten may put the end of a step anywhere.
            prop_assert_ne!(at(step), at(step + 1));
        }
    }
}
