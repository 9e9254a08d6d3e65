//! Where an axis begins and ends, and the round numbers on it: 1, 2, 5 and their
//! powers of ten.

use super::data::{Axis, Scale};
use super::number;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    /// The axis reaches from here …
    pub low: f64,
    /// … to here.
    pub high: f64,
    /// Values with their labels, rising.
    pub major: Vec<(f64, String)>,
    /// Where a logarithmic axis has lines between.
    pub minor: Vec<f64>,
}

/// Values closer to each other than this share of their size are one.
const SAME: f64 = 1e-9;

/// For an axis that is to show all these values with so many labels at most (no
/// fewer than four are asked for); nothing where no value has a place on it.
pub(super) fn ticks(axis: &Axis, values: impl Iterator<Item = f64>, most: usize) -> Option<Ticks> {
    let mut range: Option<(f64, f64)> = None;
    for value in values.filter(|value| axis.takes(*value)) {
        range = Some(range.map_or((value, value), |(low, high)| (low.min(value), high.max(value))));
    }
    let (low, high) = range?;
    let most = most.max(4);
    Some(match axis.scale {
        Scale::Linear => {
            let (low, high) = spread(low, high);
            // Zero belongs to it where that costs little of the picture.
            let low = if low > 0.0 && low < 0.5 * high { 0.0 } else { low };
            let high = if high < 0.0 && high > 0.5 * low { 0.0 } else { high };
            linear(low, high, most)
        }
        Scale::Log => {
            let (low, high) = if high - low <= SAME * high { (low / 2.0, high * 2.0) } else { (low, high) };
            // Less than a decade has too few of 1, 2, 5.
            let fine = (high < 4.0 * low).then(|| linear(low, high, most)).filter(|ticks| ticks.low > 0.0);
            fine.unwrap_or_else(|| logarithmic(low, high, most))
        }
    })
}

/// A range around equal values.
fn spread(low: f64, high: f64) -> (f64, f64) {
    let size = low.abs().max(high.abs());
    match size {
        0.0 => (0.0, 1.0),
        _ if high - low <= SAME * size => (low - 0.5 * size, high + 0.5 * size),
        _ => (low, high),
    }
}

fn linear(low: f64, high: f64, most: usize) -> Ticks {
    let mut step = floor_125((high - low) / most as f64);
    let ends = |step: Round| (step.steps(low).floor(), step.steps(high).ceil());
    while ends(step).1 - ends(step).0 + 1.0 > most as f64 {
        step = Round(step.0 + 1);
    }
    let (first, last) = ends(step);
    let size = step.value();
    let values: Vec<f64> = count(first, last).map(|k| k * size + 0.0).collect();
    let labels = number::multiples(&values, size);
    Ticks {
        low: first * size,
        high: last * size,
        minor: Vec::new(),
        major: values.into_iter().zip(labels).collect(),
    }
}

fn count(first: f64, last: f64) -> impl Iterator<Item = f64> {
    (0..=(last - first) as u64).map(move |k| first + k as f64)
}

fn logarithmic(low: f64, high: f64, most: usize) -> Ticks {
    let (first, last) = (floor_125(low), ceil_125(high));
    let all = || (first.0..=last.0).map(Round);
    let labelled = |value: f64| (value, number::round(value));
    let decades = (last.0 - first.0) / 3;
    let within = |value: &f64| (first.value()..=last.value()).contains(value);
    let major: Vec<(f64, String)> = if all().count() <= most {
        all().map(|round| labelled(round.value())).collect()
    } else {
        let powers: Vec<Round> = all().filter(|round| round.mantissa() == 1).collect();
        let stride = powers.len().div_ceil(most);
        powers.into_iter().step_by(stride).map(|round| labelled(round.value())).collect()
    };
    let minor = all().filter(|round| round.mantissa() == 1 || *round == first);
    let minor =
        minor.flat_map(|power| (1..=9).map(move |m| Round(power.0.div_euclid(3) * 3).value() * f64::from(m)));
    let minor: Vec<f64> = match decades {
        0..=6 => minor.filter(within).collect(),
        7..=40 => all().filter(|round| round.mantissa() == 1).map(Round::value).collect(),
        _ => Vec::new(),
    };
    Ticks { low: first.value(), high: last.value(), major, minor }
}

/// 1, 2, 5, 10, 20, 50, … by number; 0 is 1, and -1 is 0.5.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Round(i32);

impl Round {
    fn mantissa(self) -> i32 {
        [1, 2, 5][self.0.rem_euclid(3) as usize]
    }

    /// The double next to it, which powers of ten by multiplication would miss.
    fn value(self) -> f64 {
        format!("{}e{}", self.mantissa(), self.0.div_euclid(3)).parse().unwrap_or(1.0)
    }

    /// How many of these steps lead to a value, whole where it is but for the last bits.
    fn steps(self, value: f64) -> f64 {
        let steps = value / self.value();
        let whole = steps.round();
        if (steps - whole).abs() <= SAME { whole } else { steps }
    }
}

/// The next lower round number.
pub(super) fn below(value: f64) -> Option<f64> {
    (1e-300..1e300).contains(&value).then(|| floor_125(value).value())
}

fn floor_125(value: f64) -> Round {
    let mut round = Round(3 * value.log10().floor() as i32 + 3);
    while round.value() > value {
        round = Round(round.0 - 1);
    }
    round
}

fn ceil_125(value: f64) -> Round {
    let round = floor_125(value);
    if round.value() < value { Round(round.0 + 1) } else { round }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn labels(axis: &Axis, values: &[f64], most: usize) -> Vec<String> {
        let ticks = ticks(axis, values.iter().copied(), most).unwrap();
        ticks.major.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        let (linear, log) = (Axis::linear("", ""), Axis::log("", ""));
        assert_eq!(labels(&linear, &[3.0, 97.0], 6), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(&linear, &[9.7, 10.4], 5), ["9.6", "9.8", "10.0", "10.2", "10.4"]);
        assert_eq!(labels(&linear, &[-1.0, 1.0], 6), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&log, &[12.6, 310.0], 9), ["10", "20", "50", "100", "200", "500"]);
        assert_eq!(labels(&log, &[0.003, 40.0], 6), ["0.01", "0.1", "1", "10"]);
        // Less than a decade.
        assert_eq!(labels(&log, &[95.0, 105.0], 6), ["95", "100", "105"]);
    }

    #[test]
    fn equal_values_and_none() {
        let (linear, log) = (Axis::linear("", ""), Axis::log("", ""));
        assert_eq!(labels(&linear, &[0.0, 0.0], 6), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(&log, &[7.0], 6), ["2", "5", "10", "20"]);
        assert!(ticks(&linear, [f64::NAN, f64::INFINITY].into_iter(), 6).is_none());
        assert!(ticks(&log, [0.0, -1.0].into_iter(), 6).is_none());
        assert!(ticks(&log, [].into_iter(), 6).is_none());
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
            let ticks = ticks(&axis, values.into_iter(), most);
            prop_assert_eq!(ticks.is_some(), !shown.is_empty());
            let Some(ticks) = ticks else { return Ok(()) };
            prop_assert!(ticks.low < ticks.high && ticks.low.is_finite() && ticks.high.is_finite());
            for value in shown {
                // But for the last bits, which no pixel shows.
                let slack = 1e-8 * value.abs().max(ticks.high - ticks.low);
                prop_assert!(ticks.low - slack <= value && value <= ticks.high + slack, "{value} in {ticks:?}");
            }
            prop_assert!((2..=most).contains(&ticks.major.len()), "{ticks:?}");
            prop_assert!(ticks.major.windows(2).all(|pair| pair[0].0 < pair[1].0), "{ticks:?}");
            prop_assert!(ticks.major.windows(2).all(|pair| pair[0].1 != pair[1].1), "{ticks:?}");
            let within = |value: f64| (ticks.low..=ticks.high).contains(&value);
            prop_assert!(ticks.major.iter().all(|(value, _)| within(*value)), "{ticks:?}");
            prop_assert!(ticks.minor.iter().all(|value| within(*value)), "{ticks:?}");
        }

        #[test]
        fn steps_are_one_two_or_five(low in -1e6..1e6, width in 1e-3..1e6, most in 4_usize..12) {
            let ticks = ticks(&Axis::linear("", ""), [low, low + width].into_iter(), most).unwrap();
            let step = (ticks.high - ticks.low) / (ticks.major.len() - 1) as f64;
            let mantissa = step / 10_f64.powf((step * 1.000_001).log10().floor());
            prop_assert!([1.0, 2.0, 5.0].iter().any(|round| (mantissa - round).abs() < 1e-4), "{step}");
        }
    }
}
