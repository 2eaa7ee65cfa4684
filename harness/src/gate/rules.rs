//! What is fixed before anything is measured.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Margins and looks of the gate. All of it is chosen before the first measurement, so that nobody can look until
/// something is significant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Rules {
    /// A change must exceed this to count (0.02: 2% slower, or faster by a factor 1.02).
    pub margin: f64,
    /// Two sides are the same when the whole interval lies within this (0.03: a factor between 1 / 1.03 and 1.03).
    pub equivalence: f64,
    /// When the data are looked at.
    pub looks: Vec<Look>,
}

/// One look at the data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Look {
    /// After so many couples.
    pub couples: usize,
    /// One-sided error that this look may make.
    pub alpha: f64,
}

/// Neighbouring couples that correlate more than this widen the interval: about 1 / sqrt(32) above the -1 / n that independent
/// couples show, so rarely reached by chance at the last look.
pub const AUTOCORRELATION: f64 = 0.2;

/// The control kernel shares no code with what is tested; when its couples move by more than this the machine did it.
/// Half the margin: what moves the control by less cannot carry a cell across the margin.
pub const CONTROL_DRIFT: f64 = 0.01;

/// Where the control's estimate exceeds this the cell is contaminated, however wide the control's interval is.
pub const CONTROL_SHIFT: f64 = 0.02;

/// Share of couples that may be disturbed by other processes: the Hodges-Lehmann estimate bears 29% of outliers. Beyond it the
/// control kernel must be SAME on both sides, by the rule for cells.
pub const CONTENDED_SHARE: f64 = 0.25;

impl Default for Rules {
    /// 10 couples are the fewest with which the exact test reaches 0.001; the three errors add up to 0.01 a side.
    fn default() -> Self {
        let look = |couples, alpha| Look { couples, alpha };
        Self {
            margin: 0.02,
            equivalence: 0.03,
            looks: vec![look(10, 0.001), look(16, 0.003), look(32, 0.006)],
        }
    }
}

impl Rules {
    /// The margin as a difference of logarithms.
    pub fn log_margin(&self) -> f64 {
        self.margin.ln_1p()
    }

    /// The equivalence bound as a difference of logarithms.
    pub fn log_equivalence(&self) -> f64 {
        self.equivalence.ln_1p()
    }

    /// Couples at the last look.
    pub fn most_couples(&self) -> usize {
        self.looks.last().map_or(0, |look| look.couples)
    }

    /// The first look after more than `couples` couples.
    pub fn next_look(&self, couples: usize) -> Option<Look> {
        self.looks.iter().copied().find(|look| look.couples > couples)
    }

    /// The look that falls due at exactly `couples` couples.
    pub fn look_at(&self, couples: usize) -> Option<Look> {
        self.looks.iter().copied().find(|look| look.couples == couples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::signed_rank;

    #[test]
    fn every_look_can_reach_its_level_and_all_spend_one_per_cent() {
        let rules = Rules::default();
        assert!(rules.looks.iter().all(|look| signed_rank::outside(look.couples, look.alpha).is_some()));
        assert!((rules.looks.iter().map(|look| look.alpha).sum::<f64>() - 0.01).abs() < 1e-12);
        assert_eq!(rules.next_look(10).map(|look| look.couples), Some(16));
        assert_eq!((rules.next_look(32), rules.look_at(11), rules.most_couples()), (None, None, 32));
    }
}
