//! Verdicts and which of them goes first.

use super::evidence::Evidence;
use super::rules::{CONTENDED_SHARE, CONTROL_DRIFT, CONTROL_SHIFT, Rules};
use super::series::Series;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What the gate says of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Verdict {
    /// The machine was disturbed: the control kernel moved, or other processes took the machine.
    Contaminated,
    /// Slower by more than the margin, and a fresh repetition agrees.
    Regressed,
    /// Faster by more than the margin.
    Improved,
    /// The whole interval lies within the equivalence bound.
    Same,
    /// None of these can be said.
    Inconclusive,
    /// Only the head program has it.
    New,
    /// Only the base program has it.
    Removed,
    /// A process crashed, gave no answer or a wrong one.
    Failed,
}

impl Verdict {
    /// The word in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Contaminated => "CONTAMINATED",
            Self::Regressed => "REGRESSED",
            Self::Improved => "IMPROVED",
            Self::Same => "SAME",
            Self::Inconclusive => "INCONCLUSIVE",
            Self::New => "NEW",
            Self::Removed => "REMOVED",
            Self::Failed => "FAILED",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Judges by the interval alone.
pub fn of_interval(evidence: &Evidence, rules: &Rules) -> Verdict {
    let (margin, same) = (rules.log_margin(), rules.log_equivalence());
    if evidence.low > margin {
        Verdict::Regressed
    } else if evidence.high < -margin {
        Verdict::Improved
    } else if evidence.low > -same && evidence.high < same {
        Verdict::Same
    } else {
        Verdict::Inconclusive
    }
}

/// Why the times of a series mean nothing, if so. The tested cells have no say in it: only the control kernel, which runs
/// between their processes, and the kernel's account of who used the machine. A neighbour that disturbs both sides alike is
/// noise, not contamination; that it does so the control kernel has to show.
pub fn contamination(series: &Series, alpha: f64, rules: &Rules) -> Option<String> {
    let control = Evidence::of(&series.control, alpha)?;
    let moved = control.low > CONTROL_DRIFT || control.high < -CONTROL_DRIFT;
    let percent = |log: f64| 100.0 * log.exp_m1();
    if moved || control.estimate.abs() > CONTROL_SHIFT {
        return Some(format!("the control kernel itself moved by {:+.1}%", percent(control.estimate)));
    }
    let (n, contended) = (series.contended.len(), series.contended.iter().filter(|&&c| c).count());
    let disturbed = contended as f64 > CONTENDED_SHARE * n as f64;
    let vouches = of_interval(&control, rules) == Verdict::Same;
    (disturbed && !vouches).then(|| {
        format!(
            "other processes took the machine in {contended} of {n} couples, perhaps more from one side: control kernel {:+.1}% to {:+.1}%",
            percent(control.low),
            percent(control.high)
        )
    })
}

/// Judges a series at a look: contamination goes before everything else.
pub fn of_series(series: &Series, alpha: f64, rules: &Rules) -> (Verdict, Option<String>) {
    if let Some(why) = contamination(series, alpha, rules) {
        return (Verdict::Contaminated, Some(why));
    }
    let verdict = Evidence::of(&series.differences, alpha)
        .map_or(Verdict::Inconclusive, |evidence| of_interval(&evidence, rules));
    (verdict, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evidence(low: f64, high: f64) -> Evidence {
        let estimate = 0.5 * (low + high);
        Evidence { couples: 16, alpha: 0.003, estimate, low, high, autocorrelation: 0.0, widening: 1.0 }
    }

    #[test]
    fn intervals_decide() {
        let of = |low, high| of_interval(&evidence(low, high), &Rules::default());
        assert_eq!(of(0.021, 0.30), Verdict::Regressed);
        assert_eq!(of(0.019, 0.30), Verdict::Inconclusive); // margin not cleared
        assert_eq!(of(-0.2, -0.021), Verdict::Improved);
        assert_eq!(of(-0.028, 0.028), Verdict::Same);
        assert_eq!(of(-0.028, 0.031), Verdict::Inconclusive);
        assert_eq!(of(0.0205, 0.0255), Verdict::Regressed); // beyond the margin goes before within the bound
    }

    fn series(difference: f64, control: f64, contended: usize) -> Series {
        Series {
            differences: (0..16).map(|i| difference + 1e-4 * f64::from(i % 5)).collect(),
            control: (0..16).map(|i| control + 1e-4 * f64::from(i % 5)).collect(),
            contended: (0..16).map(|i| i < contended).collect(),
        }
    }

    #[test]
    fn contamination_goes_first_and_the_cells_have_no_say_in_it() {
        let of = |s: Series| of_series(&s, 0.003, &Rules::default()).0;
        assert_eq!(of(series(0.2, 0.0, 0)), Verdict::Regressed);
        assert_eq!(of(series(0.2, 0.015, 0)), Verdict::Contaminated);
        assert_eq!(of(series(0.2, -0.015, 0)), Verdict::Contaminated);
        assert_eq!(of(series(0.0, 0.0, 0)), Verdict::Same);
    }

    /// A neighbour that is there all the time is no excuse where the control kernel shows that both sides had it.
    #[test]
    fn a_fair_neighbour_is_noise_and_one_that_may_be_unfair_is_contamination() {
        let of = |s: &Series| of_series(s, 0.003, &Rules::default()).0;
        assert_eq!(of(&series(0.2, 0.0, 16)), Verdict::Regressed);
        let mut wide = series(0.2, 0.0, 16);
        wide.control = (0..16).map(|i| if i % 2 == 0 { -0.05 } else { 0.05 }).collect();
        assert_eq!(of(&wide), Verdict::Contaminated);
        wide.contended = (0..16).map(|i| i < 4).collect();
        assert_eq!(of(&wide), Verdict::Regressed);
    }

    /// A control that jumps about so much that its interval says nothing is judged by its estimate.
    #[test]
    fn a_wild_control_is_contamination() {
        let mut wild = series(0.0, 0.0, 0);
        wild.control = (0..16).map(|i| if i % 4 == 0 { -0.1 } else { 0.12 }).collect();
        assert_eq!(of_series(&wild, 0.003, &Rules::default()).0, Verdict::Contaminated);
    }
}
