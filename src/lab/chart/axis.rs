//! An axis: which values have a place on it, where it begins and ends, and the round
//! numbers on it: 1, 2, 5 and their powers of ten.

use super::number;

/// How an axis counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    #[default]
    Linear,
    /// Every decade as long as the next. What is not above zero has no place on it.
    Log,
}

/// Which end of an axis one wants to be at.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Better {
    #[default]
    Lower,
    Higher,
    Neither,
}

/// What is measured, in which unit (may be empty), and how.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    pub title: String,
    pub unit: String,
    pub scale: Scale,
    pub better: Better,
}

impl Axis {
    pub fn linear(title: &str, unit: &str) -> Axis {
        Axis { title: title.to_string(), unit: unit.to_string(), ..Axis::default() }
    }

    pub fn log(title: &str, unit: &str) -> Axis {
        Axis { scale: Scale::Log, ..Axis::linear(title, unit) }
    }

    /// The same axis with another good end than the lower one.
    pub fn better(self, better: Better) -> Axis {
        Axis { better, ..self }
    }

    /// Whether a value has a place on it. What is beyond these bounds is no
    /// measurement, and steps between such values would not be numbers.
    pub(super) fn takes(&self, value: f64) -> bool {
        let size = if self.scale == Scale::Log { value } else { value.abs() };
        (1e-300..1e300).contains(&size) || (self.scale == Scale::Linear && value == 0.0)
    }

    pub(super) fn words(&self) -> String {
        number::with_unit(&self.title, &self.unit, true)
    }

    /// A value of it, and what it was in an earlier run.
    pub(super) fn said(&self, now: f64, before: Option<f64>) -> String {
        let unit = |value| number::with_unit(&number::figure(value), &self.unit, false);
        let was = before.map(|was| format!(", before {} ({})", unit(was), number::change(now, was)));
        format!("{}: {}{}", self.title, unit(now), was.unwrap_or_default())
    }
}

/// From values to places along one direction of a drawing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    /// Values with their labels, rising.
    pub major: Vec<(f64, String)>,
    /// Where a logarithmic axis has lines between.
    pub minor: Vec<f64>,
    from: f64,
    to: f64,
}

/// Values closer to each other than this share of their size are one.
const SAME: f64 = 1e-9;

impl Ruler {
    /// Shows all these values with so many labels at most (at least four); nothing
    /// where no value has a place on the axis.
    pub fn new(axis: &Axis, values: impl Iterator<Item = f64>, most: usize) -> Option<Ruler> {
        let values = || values.filter(|value| axis.takes(*value));
        let (low, high) = values().fold(None, |range: Option<(f64, f64)>, v| {
            Some(range.map_or((v, v), |(a, b)| (a.min(v), b.max(v))))
        })?;
        let size = low.abs().max(high.abs());
        let equal = high - low <= SAME * size;
        Some(match axis.scale {
            Scale::Linear if size == 0.0 => linear(0.0, 1.0, most),
            Scale::Linear if equal => linear(low.min(0.0), high.max(0.0), most),
            // Zero belongs to it where that costs little of the picture.
            Scale::Linear if low > 0.0 && low < 0.5 * high => linear(0.0, high, most),
            Scale::Linear if high < 0.0 && high > 0.5 * low => linear(low, 0.0, most),
            Scale::Linear => linear(low, high, most),
            Scale::Log if equal => logarithmic(low / 2.0, high * 2.0, most),
            Scale::Log => {
                // Less than a decade has too few of 1, 2, 5.
                let fine =
                    (high < 4.0 * low).then(|| linear(low, high, most)).filter(|ruler| ruler.low > 0.0);
                fine.map_or_else(
                    || logarithmic(low, high, most),
                    |ruler| Ruler { scale: Scale::Log, ..ruler },
                )
            }
        })
    }

    pub fn between(self, from: f64, to: f64) -> Ruler {
        Ruler { from, to, ..self }
    }

    pub fn without_minor(self) -> Ruler {
        Ruler { minor: Vec::new(), ..self }
    }

    /// Where a value is; one beyond an end is put at the end.
    pub fn at(&self, value: f64) -> f64 {
        let bent = |value: f64| if self.scale == Scale::Log { value.max(self.low).ln() } else { value };
        let (low, high) = (bent(self.low), bent(self.high));
        self.from + (self.to - self.from) * ((bent(value) - low) / (high - low)).clamp(0.0, 1.0)
    }
}

fn linear(low: f64, high: f64, most: usize) -> Ruler {
    let mut step = floor_125((high - low) / most as f64);
    let ends = |step: i32| (steps(low, step).floor(), steps(high, step).ceil());
    while ends(step).1 - ends(step).0 + 1.0 > most as f64 {
        step += 1;
    }
    let ((first, last), size) = (ends(step), round(step));
    let largest = low.abs().max(high.abs());
    let label = |value: f64| match value {
        _ if value.abs() < size / 2.0 && size < 1e-5 => "0".to_string(),
        _ if largest >= 1e9 || size < 1e-5 => {
            let digits = (largest / size).log10().ceil().clamp(0.0, 12.0) as usize;
            format!("{value:.digits$e}")
        }
        _ => number::decimals(value, (-(size * 1.000_001).log10().floor()).max(0.0) as usize),
    };
    let values = (0..=(last - first) as u64).map(|k| (first + k as f64) * size + 0.0);
    let major = values.map(|value| (value, label(value))).collect();
    let (low, high) = (first * size, last * size);
    Ruler { scale: Scale::Linear, low, high, major, minor: Vec::new(), from: 0.0, to: 1.0 }
}

fn logarithmic(low: f64, high: f64, most: usize) -> Ruler {
    let first = floor_125(low);
    let last = (first..).find(|k| round(*k) >= high).unwrap_or(first);
    let powers: Vec<i32> = (first..=last).filter(|k| k.rem_euclid(3) == 0).collect();
    let labelled: Vec<i32> = match (last - first + 1) as usize {
        // Few steps, of which each is labelled, or each second.
        steps if steps <= most || powers.len() < 2 => (first..=last).step_by(steps.div_ceil(most)).collect(),
        _ => powers.iter().copied().step_by(powers.len().div_ceil(most)).collect(),
    };
    let label = |value: f64| match value {
        1e-4..1e6 => number::decimals(value, (-(value * 1.000_001).log10().floor()).max(0.0) as usize),
        _ => format!("{value:e}"),
    };
    let major = labelled.into_iter().map(|k| (round(k), label(round(k)))).collect();
    let (low, high) = (round(first), round(last));
    let minor = powers.iter().copied().chain([first]).flat_map(|k| {
        let power = round(k.div_euclid(3) * 3);
        (1..10).map(move |m| power * f64::from(m))
    });
    let minor = minor.filter(|value| last - first < 20 && (low..=high).contains(value)).collect();
    Ruler { scale: Scale::Log, low, high, major, minor, from: 0.0, to: 1.0 }
}

/// 1, 2, 5, 10, 20, 50, … by number; 0 is 1, and -1 is 0.5. The double next to it, which
/// powers of ten by multiplication would miss.
fn round(number: i32) -> f64 {
    let digit = [1, 2, 5][number.rem_euclid(3) as usize];
    format!("{digit}e{}", number.div_euclid(3)).parse().unwrap_or(1.0)
}

/// The next lower round value of one above zero.
pub(super) fn round_below(value: f64) -> Option<f64> {
    (1e-300..1e300).contains(&value).then(|| round(floor_125(value)))
}

/// The number of the next lower round value.
fn floor_125(value: f64) -> i32 {
    let most = 3 * value.log10().floor() as i32 + 3;
    (0..4).map(|k| most - k).find(|k| round(*k) <= value).unwrap_or(most - 4)
}

/// How many of a round step lead to a value, whole where it is but for the last bits.
fn steps(value: f64, step: i32) -> f64 {
    let steps = value / round(step);
    if (steps - steps.round()).abs() <= SAME { steps.round() } else { steps }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn labels(axis: &Axis, values: &[f64], most: usize) -> Vec<String> {
        let ruler = Ruler::new(axis, values.iter().copied(), most).unwrap();
        ruler.major.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        let (linear, log) = (Axis::linear("", ""), Axis::log("", ""));
        assert_eq!(labels(&linear, &[3.0, 97.0], 6), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(&linear, &[9.7, 10.4], 5), ["9.6", "9.8", "10.0", "10.2", "10.4"]);
        assert_eq!(labels(&linear, &[-1.0, 1.0], 6), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&linear, &[0.0], 6), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(&log, &[12.6, 310.0], 9), ["10", "20", "50", "100", "200", "500"]);
        assert_eq!(labels(&log, &[0.003, 40.0], 6), ["0.01", "0.1", "1", "10"]);
        assert_eq!(labels(&log, &[95.0, 105.0], 6), ["95", "100", "105"]);
        assert!(Ruler::new(&log, [0.0, -1.0, f64::NAN].into_iter(), 6).is_none());
    }

    proptest! {
        #[test]
        fn ticks_cover_what_there_is(
            values in prop::collection::vec(prop_oneof![any::<f64>(), -1e3..1e3, 1e-9..1e9], 1..6),
            log: bool,
            most in 4_usize..12,
        ) {
            let axis = if log { Axis::log("", "") } else { Axis::linear("", "") };
            let shown: Vec<f64> = values.iter().copied().filter(|value| axis.takes(*value)).collect();
            let ruler = Ruler::new(&axis, values.into_iter(), most);
            prop_assert_eq!(ruler.is_some(), !shown.is_empty());
            let Some(ruler) = ruler else { return Ok(()) };
            prop_assert!(ruler.low < ruler.high && ruler.low.is_finite() && ruler.high.is_finite());
            for value in shown {
                // But for the last bits, which no pixel shows.
                let margin = 1e-8 * value.abs().max(ruler.high - ruler.low);
                prop_assert!(ruler.low - margin <= value && value <= ruler.high + margin, "{value} in {ruler:?}");
            }
            prop_assert!((2..=most).contains(&ruler.major.len()), "{ruler:?}");
            prop_assert!(ruler.major.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 != pair[1].1), "{ruler:?}");
            let mut lines = ruler.major.iter().map(|(value, _)| value).chain(&ruler.minor);
            prop_assert!(lines.all(|value| (ruler.low..=ruler.high).contains(value)), "{ruler:?}");
        }

        #[test]
        fn linear_steps_are_one_two_or_five(low in -1e6..1e6, width in 1e-3..1e6, most in 4_usize..12) {
            let ruler = Ruler::new(&Axis::linear("", ""), [low, low + width].into_iter(), most).unwrap();
            let step = (ruler.high - ruler.low) / (ruler.major.len() - 1) as f64;
            let mantissa = step / 10_f64.powf((step * 1.000_001).log10().floor());
            prop_assert!([1.0, 2.0, 5.0].iter().any(|round| (mantissa - round).abs() < 1e-4), "{step}");
        }
    }
}
