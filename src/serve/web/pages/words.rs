//! Figures as people read them on a page: short, with a unit, never raw.

use crate::platform::clock::Millis;
use crate::words;

/// Points: `9 876`, `531.7 k`, `2.8 M`, `1.2 G`.
pub(super) fn points(points: u64) -> String {
    match points {
        0..10_000 => grouped(points),
        _ => scaled(points as f64, &["", " k", " M", " G", " T", " P"]),
    }
}

/// Bytes in decimal units, as file managers tell them.
pub(super) fn bytes(bytes: u64) -> String {
    match bytes {
        1 => "1 byte".to_string(),
        0..1000 => format!("{bytes} bytes"),
        _ => scaled(bytes as f64, &["", " kB", " MB", " GB", " TB", " PB"]),
    }
}

fn scaled(mut value: f64, units: &[&str]) -> String {
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < units.len() {
        value /= 1000.0;
        unit += 1;
    }
    let digits = if value < 99.95 && unit > 0 { 1 } else { 0 };
    let text = format!("{value:.digits$}");
    let text = text.strip_suffix(".0").unwrap_or(&text);
    format!("{text}{}", units[unit])
}

/// A number with its digits in groups of three.
pub(super) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A number and the word for what it counts.
pub(super) fn counted(number: u64, one: &str, many: &str) -> String {
    format!("{} {}", grouped(number), if number == 1 { one } else { many })
}

/// A duration, in its two largest units. A clock that was set back in between makes
/// it negative; then nobody knows it.
pub(super) fn duration(millis: Millis) -> String {
    let seconds = millis / 1000;
    match seconds {
        _ if millis < 0 => "—".to_string(),
        0 if millis < 100 => "< 0.1 s".to_string(),
        0..10 => format!("{:.1} s", millis as f64 / 1000.0),
        10..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        3600..86_400 => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
        _ => format!("{} d {} h", seconds / 86_400, seconds / 3600 % 24),
    }
}

/// What is left of a wait: no more exact than anybody can know.
pub(super) fn left(seconds: f64) -> String {
    match seconds {
        ..1.0 => "a moment left".to_string(),
        ..90.0 => format!("{seconds:.0} s left"),
        ..5400.0 => format!("{:.0} min left", seconds / 60.0),
        ..172_800.0 => format!("{:.1} h left", seconds / 3600.0),
        _ => format!("{:.0} days left", seconds / 86_400.0),
    }
}

/// How long ago a time was.
pub(super) fn ago(then: Millis, now: Millis) -> String {
    let seconds = (now - then) / 1000;
    match seconds {
        // By a clock that was set back.
        ..-60 => "in the future".to_string(),
        -60..5 => "just now".to_string(),
        5..60 => format!("{seconds} s ago"),
        60..3600 => format!("{} min ago", seconds / 60),
        3600..86_400 => format!("{} h ago", seconds / 3600),
        86_400..172_800 => "yesterday".to_string(),
        _ => format!("{} days ago", seconds / 86_400),
    }
}

/// A figure of a cloud, as a range's end: without needless digits.
pub(super) fn figure(value: f64) -> String {
    if !value.is_finite() {
        return "—".to_string();
    }
    // Four decimals, and of what is below one as many digits.
    let digits = (value.abs().log10().floor() + 5.0).clamp(5.0, 15.0);
    match words::number(words::rounded(value, digits as usize)).as_str() {
        "-0" => "0".to_string(),
        text => text.to_string(),
    }
}

/// A coordinate on a lattice of this scale.
pub(super) fn coordinate(value: f64, scale: f64) -> String {
    if value.is_finite() { words::coordinate(value, scale) } else { "—".to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_short_and_carry_their_unit() {
        let texts = [0, 9_999, 531_662, 2_834_350, 999_999, 1_200_000_000].map(points);
        assert_eq!(texts, ["0", "9\u{202f}999", "532 k", "2.8 M", "1 M", "1.2 G"]);
        let texts = [0, 1, 999, 2_227_771, 41_000_000_000].map(bytes);
        assert_eq!(texts, ["0 bytes", "1 byte", "999 bytes", "2.2 MB", "41 GB"]);
        let texts = [420, 59_000, 185_000, 7_620_000, 356_400_000, -5].map(duration);
        assert_eq!(texts, ["0.4 s", "59 s", "3 min 05 s", "2 h 07 min", "4 d 3 h", "—"]);
        assert_eq!([0, 99, 100].map(duration), ["< 0.1 s", "< 0.1 s", "0.1 s"]);
        let times = [3, -30, 70, 7_200, -3_600, 90_000].map(|seconds| ago(0, 1000 * seconds));
        assert_eq!(times, ["just now", "just now", "1 min ago", "2 h ago", "in the future", "yesterday"]);
        let texts = [0.2, 80.0, 200.0, 7200.0].map(left);
        assert_eq!(texts, ["a moment left", "80 s left", "3 min left", "2.0 h left"]);
        let texts = [0.0, 358.28000000000003, -0.00000001, 1795822986.5, 2e20].map(figure);
        assert_eq!(texts, ["0", "358.28", "-1e-8", "1795822986.5", "2e20"]);
        let texts = [-0.0, 0.000123456, 12.34567, 1e-7, 366_616.600_000_000_03].map(figure);
        assert_eq!(texts, ["0", "0.00012346", "12.3457", "1e-7", "366616.6"]);
        assert_eq!(coordinate(-122.419_415_52, 1e-7), "-122.4194155");
        assert_eq!(coordinate(f64::NAN, 0.01), "—");
        assert_eq!(figure(f64::NAN), "—");
    }
}
