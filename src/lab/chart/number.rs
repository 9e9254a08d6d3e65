//! Numbers as people read them: thousands apart, no more digits than matter.

/// Between thousands: narrow, and no place to break a line.
const GAP: char = '\u{202f}';

/// To three digits that matter; large ones whole, very large and very small ones by
/// powers of ten.
pub(super) fn figure(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        "–".to_string()
    } else if value == 0.0 {
        "0".to_string()
    } else if !(1e-4..1e12).contains(&size) {
        power(value, 2)
    } else {
        // 99.96 is 100, and not 100.0.
        let rounded: f64 = format!("{size:.2e}").parse().unwrap_or(size);
        grouped(value, (2 - rounded.log10().floor() as i32).max(0) as usize)
    }
}

/// As short as it is exact, for round numbers.
pub(super) fn round(value: f64) -> String {
    let size = value.abs();
    match size {
        0.0 => "0".to_string(),
        _ if !(1e-4..1e12).contains(&size) => power(value, 0),
        1e9.. => format!("{}{GAP}G", value / 1e9),
        1e6.. => format!("{}{GAP}M", value / 1e6),
        1e3.. => grouped(value, 0),
        _ => signed(format!("{value}")),
    }
}

/// Multiples of a step, all of them with the same digits.
pub(super) fn multiples(values: &[f64], step: f64) -> Vec<String> {
    let largest = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    let digits = |step: f64| (-(step * 1.000_001).log10().floor()).max(0.0) as usize;
    let (scale, suffix) = match largest {
        1e9.. => (1e9, "G"),
        1e6.. => (1e6, "M"),
        _ => (1.0, ""),
    };
    let write = |value: &f64| {
        if largest >= 1e12 || step < 1e-5 {
            let digits = (largest / step).log10().ceil().clamp(0.0, 12.0) as usize;
            return if value.abs() < step / 2.0 { "0".to_string() } else { power(*value, digits) };
        }
        let text = grouped(value / scale, digits(step / scale));
        if suffix.is_empty() || text == "0" { text } else { format!("{text}{GAP}{suffix}") }
    };
    values.iter().map(write).collect()
}

/// What it became, in per cent of what it was.
pub(super) fn change(now: f64, before: f64) -> String {
    let percent = (now / before - 1.0) * 100.0;
    let sign = if percent < 0.0 { "−" } else { "+" };
    match percent.abs() {
        size if !size.is_finite() => "–".to_string(),
        0.0..0.05 => format!("±0{GAP}%"),
        size @ 0.05..9.95 => format!("{sign}{size:.1}{GAP}%"),
        size if size < 1e5 => format!("{sign}{}{GAP}%", grouped(size, 0)),
        _ => format!("{}{GAP}×", figure(now / before)),
    }
}

/// A number of the chart's own, with its unit.
pub(super) fn with_unit(value: f64, unit: &str) -> String {
    let figure = figure(value);
    if unit.is_empty() { figure } else { format!("{figure} {unit}") }
}

fn power(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let mantissa =
        if mantissa.contains('.') { mantissa.trim_end_matches('0').trim_end_matches('.') } else { mantissa };
    let raised = exponent.chars().map(|c| match c {
        '-' => '⁻',
        digit => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit.to_digit(10).unwrap_or(0) as usize],
    });
    let raised: String = raised.collect();
    match mantissa {
        "1" => format!("10{raised}"),
        _ => format!("{}×10{raised}", signed(mantissa.to_string())),
    }
}

fn grouped(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let mut out = String::new();
    if value < 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
        out.push('−');
    }
    for (at, digit) in whole.chars().enumerate() {
        if at > 0 && (whole.len() - at) % 3 == 0 {
            out.push(GAP);
        }
        out.push(digit);
    }
    if !fraction.is_empty() {
        out.push('.');
        out.push_str(fraction);
    }
    out
}

fn signed(text: String) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_the_digits_that_matter() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1.00"),
            (0.012_345, "0.0123"),
            (99.96, "100"),
            (123.4, "123"),
            (1_234_567.0, "1\u{202f}234\u{202f}567"),
            (-0.5, "−0.500"),
            (1.5e-9, "1.5×10⁻⁹"),
            (1e15, "10¹⁵"),
            (f64::NAN, "–"),
        ] {
            assert_eq!(figure(value), text);
        }
    }

    #[test]
    fn round_numbers_are_short() {
        for (value, text) in [
            (0.001, "0.001"),
            (200.0, "200"),
            (20_000.0, "20\u{202f}000"),
            (5e6, "5\u{202f}M"),
            (2e10, "20\u{202f}G"),
            (2e-7, "2×10⁻⁷"),
            (1e-7, "10⁻⁷"),
        ] {
            assert_eq!(round(value), text);
        }
    }

    #[test]
    fn multiples_of_a_step_have_the_same_digits() {
        assert_eq!(multiples(&[0.0, 0.5, 1.0], 0.5), ["0.0", "0.5", "1.0"]);
        assert_eq!(multiples(&[0.0, 0.1], 0.1), ["0.0", "0.1"]);
        assert_eq!(
            multiples(&[0.0, 500_000.0, 1e6], 500_000.0),
            ["0.0\u{202f}M", "0.5\u{202f}M", "1.0\u{202f}M"]
        );
        assert_eq!(multiples(&[-1.0, 0.0], 1.0), ["−1", "0"]);
        assert_eq!(multiples(&[0.0, 2e-9], 2e-9), ["0", "2×10⁻⁹"]);
    }

    #[test]
    fn changes_are_told_in_per_cent() {
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
