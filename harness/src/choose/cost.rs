//! What a use of a backend costs in time, as a straight line over the number of frames.

use super::question::{Question, Updates};
use serde::Serialize;

/// Times in nanoseconds: `set_up + first + (N - 1) (solve + change / every)` for N frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cost {
    /// From the matrix to the prepared handle: ordering, symbolic and numeric factorisation, upload.
    pub set_up: f64,
    /// The first solve, which touches its memory for the first time.
    pub first: f64,
    /// A later solve (median).
    pub solve: f64,
    /// New values, edited constraints, or a fresh preparation where constraints cannot be edited (median); 0 where nothing
    /// changes.
    pub change: f64,
    /// Whether a change is a fresh preparation.
    pub prepares_anew: bool,
}

impl Cost {
    /// A frame with its share of the changes.
    pub fn frame(&self, question: &Question) -> f64 {
        match question.updates {
            Updates::Never => self.solve,
            _ => self.solve + self.change / question.update_every as f64,
        }
    }

    /// The longest frame: one with a change.
    pub fn longest_frame(&self, question: &Question) -> f64 {
        if question.updates == Updates::Never { self.solve } else { self.solve + self.change }
    }

    /// All frames and the set-up.
    pub fn total(&self, question: &Question) -> f64 {
        self.set_up + self.first + (question.frames - 1) as f64 * self.frame(question)
    }

    /// Number of frames from which on `self` is the cheaper of the two; none where it never is, 1 where it always is.
    pub fn cheaper_from(&self, other: &Self, question: &Question) -> Option<u64> {
        let ahead = (self.set_up + self.first) - (other.set_up + other.first);
        let gain = other.frame(question) - self.frame(question);
        if ahead <= 0.0 {
            return (gain >= 0.0).then_some(1);
        }
        (gain > 0.0).then(|| 2 + (ahead / gain) as u64).filter(|&n| n <= 1_000_000_000)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::choose) fn question(updates: Updates, frames: u64) -> Question {
        Question { frames, updates, threads: Some(1), ..Question::default() }
    }

    fn cost(set_up: f64, solve: f64, change: f64) -> Cost {
        Cost { set_up, first: solve, solve, change, prepares_anew: false }
    }

    #[test]
    fn totals_are_a_straight_line() {
        let c = cost(100.0, 2.0, 10.0);
        assert_eq!(c.total(&question(Updates::Never, 1)), 102.0);
        assert_eq!(c.total(&question(Updates::Never, 11)), 122.0);
        assert_eq!(c.total(&question(Updates::Values, 11)), 222.0);
        let seldom = Question { update_every: 5, ..question(Updates::Values, 11) };
        assert_eq!((c.total(&seldom), c.longest_frame(&seldom)), (142.0, 12.0));
    }

    #[test]
    fn crossovers_are_where_the_lines_meet() {
        let (direct, iterative) = (cost(100.0, 1.0, 0.0), cost(10.0, 10.0, 0.0));
        let q = question(Updates::Never, 1);
        let n = direct.cheaper_from(&iterative, &q).unwrap();
        let at = |c: &Cost, frames| c.total(&question(Updates::Never, frames));
        assert!(at(&direct, n) <= at(&iterative, n) && at(&direct, n - 1) >= at(&iterative, n - 1), "{n}");
        assert_eq!(iterative.cheaper_from(&direct, &q), None);
        assert_eq!(direct.cheaper_from(&cost(200.0, 2.0, 0.0), &q), Some(1));
        assert_eq!(cost(200.0, 2.0, 0.0).cheaper_from(&direct, &q), None);
    }
}
