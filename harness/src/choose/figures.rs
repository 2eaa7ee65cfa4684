//! What is known about one candidate, measured or predicted.

use super::cost::Cost;
use super::question::{Question, Updates};
use crate::record::result::Cell;
use crate::report::table;
use crate::statistics::percentiles::median;
use serde::Serialize;

/// Figures of a candidate.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Its name.
    pub backend: String,
    /// Times.
    pub cost: Cost,
    /// Distance from the refined reference, in the question's unit; the relative residual where there is none.
    pub error: Option<f64>,
    /// Whether the error is one: false where the system is too badly conditioned for a statement, or nothing was compared.
    pub error_is_certain: bool,
    /// Peak resident memory of its process, bytes.
    pub peak_bytes: Option<u64>,
    /// Relative residual that was asked of an iterative backend so that its error is small enough.
    pub tolerance: Option<f64>,
    /// Iterations of a solve.
    pub iterations: Option<u32>,
    /// Share of the measured frames that were over the budget.
    pub late: Option<f64>,
    /// Number of timed solves behind the median; 0 for a prediction.
    pub solves: usize,
    /// Number of set-ups in fresh processes; 0 for a prediction.
    pub set_ups: usize,
    /// Median solve of every round, nanoseconds: how much it varies.
    #[serde(skip)]
    pub rounds: Vec<f64>,
}

/// Samples beyond those of the row.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Set-ups in fresh processes, nanoseconds.
    pub set_ups: Vec<u64>,
    /// First solves in fresh processes, nanoseconds.
    pub firsts: Vec<u64>,
    /// Changes, nanoseconds.
    pub changes: Vec<u64>,
    /// Whether they are fresh preparations.
    pub prepares_anew: bool,
    /// Median solves of the rounds, nanoseconds.
    pub rounds: Vec<f64>,
}

impl Samples {
    /// Takes in the set-up and the first solve of a row.
    pub fn add_set_up(&mut self, row: &Cell) {
        self.set_ups.extend(table::set_up(row));
        self.firsts.extend(row.phases_ns.first_solve);
    }
}

impl Figures {
    /// Figures of a measured row.
    pub fn measured(row: &Cell, samples: &Samples, question: &Question) -> Self {
        let middle = |times: &[u64]| {
            let mut sorted = times.to_vec();
            sorted.sort_unstable();
            median(&sorted).map(|t| t as f64)
        };
        let set_up = middle(&samples.set_ups).unwrap_or(0.0);
        let first = middle(&samples.firsts).unwrap_or(0.0);
        let (change, prepares_anew) = match (question.updates, middle(&samples.changes)) {
            (Updates::Never, _) => (0.0, false),
            (_, Some(change)) => (change, samples.prepares_anew),
            (_, None) => (set_up, true),
        };
        let solve = middle(&row.samples_ns).unwrap_or(first);
        let cost = Cost { set_up, first, solve, change, prepares_anew };
        let accuracy = &row.accuracy;
        let certain = accuracy.forward_error.is_some() && accuracy.certifiable != Some(false);
        let late = question.budget_ms.filter(|_| !row.samples_ns.is_empty()).map(|budget| {
            let change = if question.updates == Updates::Never { 0.0 } else { cost.change };
            let late = row.samples_ns.iter().filter(|&&t| t as f64 + change > budget * 1e6).count();
            late as f64 / row.samples_ns.len() as f64
        });
        Self {
            backend: row.backend.clone(),
            cost,
            error: if certain { accuracy.forward_error } else { accuracy.relative_residual },
            error_is_certain: certain,
            peak_bytes: row.peak_rss_bytes,
            tolerance: row.tolerance,
            iterations: row.iterations,
            late,
            solves: row.samples_ns.len(),
            set_ups: samples.set_ups.len(),
            rounds: samples.rounds.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::cost::tests::question;
    use crate::record::result::{Accuracy, Phases};

    fn row() -> Cell {
        Cell {
            backend: "a".into(),
            phases_ns: Phases { numeric: Some(100), first_solve: Some(9), ..Phases::default() },
            samples_ns: vec![5, 4, 6],
            accuracy: Accuracy {
                forward_error: Some(1e-12),
                relative_residual: Some(1e-9),
                ..Accuracy::default()
            },
            ..Cell::default()
        }
    }

    #[test]
    fn medians_of_what_was_measured() {
        let mut samples = Samples::default();
        samples.add_set_up(&row());
        let asked = Question { budget_ms: Some(5.5e-6), ..question(Updates::Never, 10) };
        let figures = Figures::measured(&row(), &samples, &asked);
        assert_eq!((figures.cost.set_up, figures.cost.first, figures.cost.solve), (100.0, 9.0, 5.0));
        assert_eq!((figures.error, figures.late), (Some(1e-12), Some(1.0 / 3.0)));
    }

    #[test]
    fn without_edits_a_change_is_a_fresh_preparation() {
        let mut samples = Samples::default();
        samples.add_set_up(&row());
        let cost =
            |samples: &Samples| Figures::measured(&row(), samples, &question(Updates::Constraints, 10)).cost;
        assert_eq!((cost(&samples).change, cost(&samples).prepares_anew), (100.0, true));
        samples.changes = vec![30];
        assert_eq!((cost(&samples).change, cost(&samples).prepares_anew), (30.0, false));
    }

    #[test]
    fn where_nothing_can_be_certified_the_residual_speaks() {
        let mut row = row();
        row.accuracy.certifiable = Some(false);
        let figures = Figures::measured(&row, &Samples::default(), &question(Updates::Never, 10));
        assert_eq!((figures.error, figures.error_is_certain), (Some(1e-9), false));
    }
}
