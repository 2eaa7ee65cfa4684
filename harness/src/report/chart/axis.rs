//! Axes: ranges with margins, and where their ticks stand.

use crate::report::numbers::significant;

/// An axis with its values, linear or logarithmic.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What is on it, with the unit.
    pub label: String,
    /// Base-10 logarithm instead of the value itself.
    pub logarithmic: bool,
    low: f64,
    high: f64,
}

/// A tick of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// In the axis' own coordinate (logarithms where it is logarithmic).
    pub at: f64,
    /// What stands there.
    pub label: String,
}

impl Axis {
    /// An axis from 0 that holds `values`.
    pub fn linear(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let most = values.into_iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        let high = if most > 0.0 { 1.05 * most } else { 1.0 };
        Self { label: label.to_owned(), logarithmic: false, low: 0.0, high }
    }

    /// A logarithmic axis that holds the positive ones of `values`, with a margin, and spans at least half a decade.
    pub fn logarithmic(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let logs = values.into_iter().filter(|v| v.is_finite() && *v > 0.0).map(f64::log10);
        let (low, high) =
            logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let margin = 0.05 * (high - low) + (0.5 - (high - low)).max(0.0) / 2.0 + 0.02;
        Self { label: label.to_owned(), logarithmic: true, low: low - margin, high: high + margin }
    }

    /// A value in the axis' coordinate; none for what a logarithm does not have.
    pub fn place(&self, value: f64) -> Option<f64> {
        let at = if self.logarithmic { value.log10() } else { value };
        at.is_finite().then_some(at)
    }

    /// Both ends, in the axis' coordinate.
    pub fn range(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Ticks inside of the range: powers of ten (of 2 and 5 times them too where there is room), or round numbers.
    pub fn ticks(&self) -> Vec<Tick> {
        let values = if self.logarithmic { self.round_powers() } else { self.round_numbers() };
        let tick = |value: f64| Some(Tick { at: self.place(value)?, label: short(value) });
        values.into_iter().filter_map(tick).filter(|t| (self.low..=self.high).contains(&t.at)).collect()
    }

    fn round_powers(&self) -> Vec<f64> {
        let span = self.high - self.low;
        let step = (span / 7.0).ceil().max(1.0) as i32;
        let within: &[f64] = if span < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let (first, last) = (self.low.floor() as i32, self.high.ceil() as i32);
        let decades = (first..=last).filter(|d| step == 1 || d.rem_euclid(step) == 0);
        decades.flat_map(|d| within.iter().map(move |w| w * 10f64.powi(d))).collect()
    }

    fn round_numbers(&self) -> Vec<f64> {
        let rough = (self.high - self.low) / 5.0;
        let decade = 10f64.powf(rough.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].map(|s| s * decade).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        (first..first + 12).map(|i| i as f64 * step).collect()
    }
}

/// A tick's value: plain from a thousandth to a hundred thousand, else as a power of ten; millions and thousands in letters.
fn short(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if !(0.9e-3..0.9e7).contains(&size) {
        format!("{value:.0e}")
    } else if size >= 0.99e6 {
        format!("{}M", trimmed(value / 1e6))
    } else if size >= 0.99e4 {
        format!("{}K", trimmed(value / 1e3))
    } else {
        trimmed(value)
    }
}

fn trimmed(value: f64) -> String {
    let text = significant(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn linear_axes_have_round_ticks() {
        assert_eq!(labels(&Axis::linear("", [3.0, 9.0])), ["0", "2", "4", "6", "8"]);
        assert_eq!(labels(&Axis::linear("", [])), ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
    }

    #[test]
    fn logarithmic_axes_have_powers_of_ten() {
        assert_eq!(labels(&Axis::logarithmic("", [0.5, 2000.0])), ["1", "10", "100", "1000"]);
        assert_eq!(labels(&Axis::logarithmic("", [30e3, 1e6])), ["50K", "100K", "200K", "500K", "1M"]);
        assert_eq!(labels(&Axis::logarithmic("", [1e-16, 1e-4])).len(), 7);
        let single = labels(&Axis::logarithmic("", [1.0]));
        assert!(single.contains(&"1".to_owned()), "{single:?}");
        assert!(!labels(&Axis::logarithmic("", [0.0, f64::NAN])).is_empty());
    }
}
