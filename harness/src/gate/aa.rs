//! The A/A arm: how much the base program differs from its own copy, and how often that would be called a regression.

use super::couple::{Couple, Side};
use super::evidence::Evidence;
use super::rules::Rules;
use super::series::Series;
use super::verdict::{self, Verdict};
use crate::statistics::normal;
use crate::statistics::random::Random;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the A/A arm found on one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NoiseFloor {
    /// The cell.
    pub cell: String,
    /// Couples of base and copy.
    pub couples: usize,
    /// Standard deviation of their log ratios, robust: 1.4826 times the median absolute value.
    pub deviation: f64,
    /// Smallest slow-down that each look would find with probability 0.9 (0.05: 5%).
    pub detectable: Vec<Detectable>,
    /// Share of sign-flipped series that the looks call slower by more than the margin, before any repetition.
    pub false_alarms: f64,
    /// The same without a margin: what the looks themselves cost.
    pub false_alarms_without_margin: f64,
    /// Number of sign-flipped series.
    pub flips: usize,
}

/// What a look can find.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Detectable {
    /// After so many couples.
    pub couples: usize,
    /// Slow-down.
    pub effect: f64,
}

/// Sign-flipped series: the rate of a one per cent event comes out within 0.3 per cent.
const FLIPS: usize = 5_000;

/// Efficiency of the Hodges-Lehmann estimate against the mean under normal noise, 3 / pi.
const EFFICIENCY: f64 = 3.0 / std::f64::consts::PI;

impl NoiseFloor {
    /// Judges the base-copy series of `measure`; `None` where there are too few couples for the first look.
    pub fn of(cell: &str, couples: &[Couple], measure: usize, rules: &Rules, seed: u64) -> Option<Self> {
        let differences = Series::of(couples, Side::Copy, Side::Base, measure).differences;
        rules.looks.first().filter(|look| look.couples <= differences.len())?;
        let deviation = deviation(&differences);
        let detectable = rules.looks.iter().map(|look| {
            let reach = normal::upper_quantile(look.alpha) + normal::upper_quantile(0.1);
            let error = deviation / (EFFICIENCY * look.couples as f64).sqrt();
            Detectable { couples: look.couples, effect: (rules.log_margin() + reach * error).exp_m1() }
        });
        let without = Rules { margin: 0.0, ..rules.clone() };
        Some(Self {
            cell: cell.to_owned(),
            couples: differences.len(),
            deviation,
            detectable: detectable.collect(),
            false_alarms: false_alarms(&differences, rules, seed),
            false_alarms_without_margin: false_alarms(&differences, &without, seed),
            flips: FLIPS,
        })
    }
}

/// 1.4826 times the median absolute value: the standard deviation of normal noise around 0.
fn deviation(differences: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = differences.iter().map(|d| d.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    1.4826 * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)
}

/// How often the looks call a series REGRESSED whose differences have random signs: base and copy are the same program, so
/// each sign was as likely as the other.
fn false_alarms(differences: &[f64], rules: &Rules, seed: u64) -> f64 {
    let mut random = Random::new(seed);
    let mut alarms = 0;
    for _ in 0..FLIPS {
        let flipped: Vec<f64> =
            differences.iter().map(|d| if random.next_u64() >> 63 == 0 { *d } else { -d }).collect();
        alarms += usize::from(sounds_alarm(&flipped, rules));
    }
    alarms as f64 / FLIPS as f64
}

/// The first look that decides is the last.
fn sounds_alarm(differences: &[f64], rules: &Rules) -> bool {
    rules.looks.iter().filter(|look| look.couples <= differences.len()).find_map(|look| {
        let evidence = Evidence::of(&differences[..look.couples], look.alpha)?;
        let verdict = verdict::of_interval(&evidence, rules);
        (verdict != Verdict::Inconclusive).then_some(verdict == Verdict::Regressed)
    }) == Some(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::couple::{Slot, order};

    fn couples(sd: f64, n: usize) -> Vec<Couple> {
        let mut random = Random::new(4);
        (0..n)
            .map(|round| {
                let slots = order(round, true).into_iter().map(|side| Slot {
                    side,
                    times_ns: vec![1e6 * (sd * random.normal()).exp()],
                    control_ns: 1e6,
                });
                Couple { slots: slots.collect(), contended: false }
            })
            .collect()
    }

    /// Four processes of sd 2% each: (2% / sqrt 2) sqrt 2 = 2% a couple.
    #[test]
    fn the_floor_of_known_noise() {
        let floor = NoiseFloor::of("c", &couples(0.02, 32), 0, &Rules::default(), 1).unwrap();
        assert!((0.013..0.028).contains(&floor.deviation), "{floor:?}");
        let effects: Vec<f64> = floor.detectable.iter().map(|d| d.effect).collect();
        assert!(effects.is_sorted_by(|a, b| a > b) && effects[2] > 0.02 && effects[0] < 0.06, "{effects:?}");
        assert!(floor.false_alarms <= 0.001, "{floor:?}");
        // Without margin and equivalence the three looks would spend 0.01 at most; SAME ends many series before.
        assert!(floor.false_alarms_without_margin <= 0.012, "{floor:?}");
    }

    #[test]
    fn the_looks_spend_what_they_may() {
        let differences = Series::of(&couples(0.2, 32), Side::Copy, Side::Base, 0).differences;
        let rate = false_alarms(&differences, &Rules { margin: 0.0, ..Rules::default() }, 2);
        assert!((0.003..=0.011).contains(&rate), "{rate}");
    }

    #[test]
    fn too_few_couples_say_nothing() {
        assert_eq!(NoiseFloor::of("c", &couples(0.02, 9), 0, &Rules::default(), 1), None);
    }
}
