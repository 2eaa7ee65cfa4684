//! What a series of differences says, and what it could say.

use super::rules::{AUTOCORRELATION, Rules};
use crate::statistics::hodges_lehmann::{self, Interval};
use crate::statistics::{autocorrelation, normal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Estimate and interval of a series of log ratios.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Evidence {
    /// Couples it rests on.
    pub couples: usize,
    /// One-sided error of the interval.
    pub alpha: f64,
    /// Hodges-Lehmann estimate of ln(head / base).
    pub estimate: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Correlation of neighbouring couples.
    pub autocorrelation: f64,
    /// Factor by which the exact interval was widened for it; 1 below the threshold.
    pub widening: f64,
}

/// Probability with which the detectable effect is to be found, and with which the couples still needed would decide.
const POWER: f64 = 0.9;

/// Most couples that are ever named as needed: beyond that the answer is "not on this machine".
const MOST_NEEDED: f64 = 10_000.0;

impl Evidence {
    /// The exact interval at one-sided level `alpha`, widened where neighbouring couples are not independent. `None` where
    /// there are too few differences for the level.
    pub fn of(differences: &[f64], alpha: f64) -> Option<Self> {
        let r = autocorrelation::lag1(differences);
        let widening = if r > AUTOCORRELATION { autocorrelation::widening(r) } else { 1.0 };
        let Interval { estimate, low, high } =
            hodges_lehmann::interval(differences, alpha)?.widened(widening);
        Some(Self { couples: differences.len(), alpha, estimate, low, high, autocorrelation: r, widening })
    }

    /// Standard error that a normal interval of this width would have.
    fn standard_error(&self) -> f64 {
        0.5 * (self.high - self.low) / normal::upper_quantile(self.alpha)
    }

    /// The slow-down (0.05: 5%) that so many couples with so much noise would call REGRESSED with probability 0.9: the
    /// margin, and the interval's reach at that power on top.
    pub fn detectable(&self, rules: &Rules) -> f64 {
        let reach = normal::upper_quantile(self.alpha) + normal::upper_quantile(1.0 - POWER);
        (rules.log_margin() + reach * self.standard_error()).exp_m1()
    }

    /// Couples beyond these that would decide with probability 0.9, if the estimate is the truth and the noise stays: until
    /// the interval fits between the estimate and the farthest border that it could clear. `None` where no number here
    /// would do.
    pub fn couples_needed(&self, rules: &Rules) -> Option<usize> {
        let size = self.estimate.abs();
        let gap = (size - rules.log_margin()).max(rules.log_equivalence() - size);
        let alpha = rules.looks.last()?.alpha;
        let reach = normal::upper_quantile(alpha) + normal::upper_quantile(1.0 - POWER);
        let of_one = self.standard_error() * (self.couples as f64).sqrt();
        let total = (reach * of_one / gap).powi(2).ceil();
        (gap > 0.0 && total <= MOST_NEEDED).then(|| (total as usize).saturating_sub(self.couples).max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::random::Random;

    fn noise(n: usize, centre: f64, sd: f64, seed: u64) -> Vec<f64> {
        let mut random = Random::new(seed);
        (0..n).map(|_| centre + sd * random.normal()).collect()
    }

    #[test]
    fn ten_couples_are_the_fewest() {
        assert_eq!(Evidence::of(&noise(9, 0.0, 0.01, 1), 0.001), None);
        let d = noise(10, 0.0, 0.01, 1);
        let all = Evidence::of(&d, 0.001).unwrap();
        let smallest = d.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(all.low <= smallest && all.high > all.estimate); // the smallest itself, unless widened
    }

    #[test]
    fn dependent_couples_widen_the_interval() {
        let mut slow: Vec<f64> = noise(32, 0.0, 0.01, 2);
        slow.sort_by(f64::total_cmp); // a trend: neighbours are alike
        let trend = Evidence::of(&slow, 0.006).unwrap();
        let exact = hodges_lehmann::interval(&slow, 0.006).unwrap();
        assert!(trend.autocorrelation > 0.5 && trend.widening > 1.7);
        assert!((0.5 * (trend.high - trend.low) - trend.widening * exact.half_width()).abs() < 1e-12);
    }

    /// With noise 2% a couple, 32 couples: margin 1.98% + (2.51 + 1.28) 2% / sqrt(32) = 3.3%.
    #[test]
    fn detectable_effects_are_found_nine_times_in_ten() {
        let rules = Rules::default();
        let typical: Vec<f64> = (0..200)
            .map(|seed| Evidence::of(&noise(32, 0.0, 0.02, seed), 0.006).unwrap().detectable(&rules))
            .collect();
        let effect = typical.iter().sum::<f64>() / 200.0;
        assert!((0.031..0.038).contains(&effect), "{effect}");
        let found = (0..1000)
            .filter(|seed| {
                let d = noise(32, effect.ln_1p(), 0.02, 5_000 + seed);
                hodges_lehmann::interval(&d, 0.006).unwrap().low > rules.log_margin()
            })
            .count();
        assert!((850..970).contains(&found), "{found} of 1000");
    }

    #[test]
    fn more_couples_are_needed_where_the_estimate_is_near_a_border() {
        let rules = Rules::default();
        let needed = |centre: f64| {
            let d: Vec<f64> = noise(32, 0.0, 0.08, 9).iter().map(|x| x + centre).collect();
            Evidence::of(&d, 0.006).unwrap().couples_needed(&rules)
        };
        let (plain, large) = (needed(0.0).unwrap(), needed(0.2).unwrap());
        assert!(plain > large, "{plain} {large}");
        assert_eq!(large, 1);
    }
}
