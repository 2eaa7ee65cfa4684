//! A couple: fresh processes of both sides in mirrored order, and the difference they make.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whose process it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The program to compare with.
    Base,
    /// The program to judge.
    Head,
    /// A copy of the base program: the A/A arm.
    Copy,
}

/// One process: its times and what the control kernel took around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Slot {
    /// Whose.
    pub side: Side,
    /// Median time of each measure of the case, nanoseconds.
    pub times_ns: Vec<f64>,
    /// Mean time of the control kernel before and after it, nanoseconds.
    pub control_ns: f64,
}

/// The processes of one couple, in the order they ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Couple {
    /// Mirrored: A B B A, B A A B, or with the copy A B C C B A, C B A A B C.
    pub slots: Vec<Slot>,
    /// Other processes took so much of the machine that the times are doubtful.
    pub contended: bool,
}

/// The order of the processes in couple number `round`: it alternates, so that no side always begins.
pub fn order(round: usize, with_copy: bool) -> Vec<Side> {
    let mut half =
        if with_copy { vec![Side::Base, Side::Head, Side::Copy] } else { vec![Side::Base, Side::Head] };
    if round % 2 == 1 {
        half.reverse();
    }
    half.iter().chain(half.iter().rev()).copied().collect()
}

impl Couple {
    /// ln of (geometric mean time of `over`) / (geometric mean time of `under`) for one measure; `None` where a side is
    /// absent. A drift that is linear in the logarithm cancels, because the order is mirrored.
    pub fn difference(&self, over: Side, under: Side, measure: usize) -> Option<f64> {
        self.log_ratio(over, under, |slot| slot.times_ns[measure])
    }

    /// The same of the control kernel: what the machine did, not the programs.
    pub fn control(&self, over: Side, under: Side) -> Option<f64> {
        self.log_ratio(over, under, |slot| slot.control_ns)
    }

    fn log_ratio(&self, over: Side, under: Side, time: impl Fn(&Slot) -> f64) -> Option<f64> {
        let mean = |side: Side| {
            let logs: Vec<f64> =
                self.slots.iter().filter(|slot| slot.side == side).map(|slot| time(slot).ln()).collect();
            (!logs.is_empty()).then(|| logs.iter().sum::<f64>() / logs.len() as f64)
        };
        Some(mean(over)? - mean(under)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_mirrored_and_alternate() {
        use Side::{Base as A, Copy as C, Head as B};
        assert_eq!(order(0, false), [A, B, B, A]);
        assert_eq!(order(1, false), [B, A, A, B]);
        assert_eq!(order(4, true), [A, B, C, C, B, A]);
        assert_eq!(order(3, true), [C, B, A, A, B, C]);
    }

    /// Every slot 3% slower than the one before, head 10% slower than base: 10% come out, and nothing for the copy.
    #[test]
    fn a_drift_cancels() {
        for round in 0..2 {
            let slots = order(round, true).into_iter().enumerate().map(|(i, side)| {
                let own = if side == Side::Head { 1.1 } else { 1.0 };
                Slot {
                    side,
                    times_ns: vec![0.0, own * 1.03f64.powi(i as i32)],
                    control_ns: 1.03f64.powi(i as i32),
                }
            });
            let couple = Couple { slots: slots.collect(), contended: false };
            let found = couple.difference(Side::Head, Side::Base, 1).unwrap();
            assert!((found - 1.1f64.ln()).abs() < 1e-12, "{found}");
            assert!(couple.difference(Side::Copy, Side::Base, 1).unwrap().abs() < 1e-12);
            assert!(couple.control(Side::Head, Side::Base).unwrap().abs() < 1e-12);
        }
    }

    #[test]
    fn an_absent_side_has_no_difference() {
        assert_eq!(Couple::default().difference(Side::Head, Side::Base, 0), None);
    }
}
