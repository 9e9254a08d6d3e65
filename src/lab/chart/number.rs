//! Numbers as people read them: thousands apart, no more digits than matter.

/// Between thousands: narrow, and no place to break a line.
const GAP: &str = "\u{202f}";

/// To three digits that matter; large ones whole, very large and very small ones by
/// powers of ten.
pub(super) fn figure(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if !value.is_finite() => "–".to_string(),
        0.0 => "0".to_string(),
        1e-4..1e12 => {
            // 99.96 is 100, and not 100.0.
            let rounded: f64 = format!("{size:.2e}").parse().unwrap_or(size);
            decimals(value, (2 - rounded.log10().floor() as i32).max(0) as usize)
        }
        _ => format!("{value:.2e}"),
    }
}

/// With so many decimals.
pub(super) fn decimals(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let whole = text.split('.').next().map_or(0, str::len);
    let sign = if value < 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b)) { "−" } else { "" };
    let digits = text.chars().enumerate().map(|(at, digit)| {
        let gap = if at > 0 && at < whole && (whole - at) % 3 == 0 { GAP } else { "" };
        format!("{gap}{digit}")
    });
    sign.to_string() + &digits.collect::<String>()
}

/// What it became, in percent of what it was.
pub(super) fn change(now: f64, before: f64) -> String {
    let percent = (now / before - 1.0) * 100.0;
    let sign = if percent < 0.0 { "−" } else { "+" };
    match percent.abs() {
        size if !size.is_finite() => "–".to_string(),
        0.0..0.05 => format!("±0{GAP}%"),
        size @ 0.05..9.95 => format!("{sign}{size:.1}{GAP}%"),
        size if size < 1e5 => format!("{sign}{}{GAP}%", decimals(size, 0)),
        _ => format!("{}{GAP}×", figure(now / before)),
    }
}

/// A quantity by name, as "time (ns)", or a value, as "3 ns".
pub(super) fn with_unit(what: &str, unit: &str, brackets: bool) -> String {
    match (unit.is_empty(), brackets) {
        (true, _) => what.to_string(),
        (_, true) => format!("{what} ({unit})"),
        (_, false) => format!("{what} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_matter() {
        for (value, text) in [
            (0.0, "0"),
            (0.012_345, "0.0123"),
            (99.96, "100"),
            (-1.5, "−1.50"),
            (1_234_567.0, "1\u{202f}234\u{202f}567"),
            (f64::NAN, "–"),
            (1e-7, "1.00e-7"),
        ] {
            assert_eq!(figure(value), text);
        }
    }

    #[test]
    fn changes_are_told_in_percent() {
        for (now, before, text) in [
            (1.0, 1.0, "±0\u{202f}%"),
            (0.5, 1.0, "−50\u{202f}%"),
            (1.021, 1.0, "+2.1\u{202f}%"),
            (1e6, 1.0, "1\u{202f}000\u{202f}000\u{202f}×"),
            (1.0, 0.0, "–"),
        ] {
            assert_eq!(change(now, before), text);
        }
    }
}
