//! Order of those that keep every rule.

use super::figures::Figures;
use super::question::Question;
use crate::statistics::rank_sum;

/// A candidate in its place.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Ranked {
    /// Its figures.
    pub figures: Figures,
    /// All frames and the set-up, nanoseconds.
    pub total: f64,
    /// Total over that of the first.
    pub ratio: f64,
    /// Whether its total cannot be told from that of the first.
    pub ties: bool,
}

/// Totals closer than this are ties whatever the rounds say: two runs on one machine differ by as much.
const INDISTINCT: f64 = 1.02;

/// Cheapest first.
pub fn rank(mut figures: Vec<Figures>, question: &Question) -> Vec<Ranked> {
    let total = |f: &Figures| f.cost.total(question);
    figures.sort_by(|a, b| total(a).total_cmp(&total(b)));
    let Some(best) = figures.first().cloned() else { return Vec::new() };
    let ranked = |figures: Figures| {
        let total = total(&figures);
        let ratio = total / best.cost.total(question);
        let ties = figures.backend != best.backend && ties(&best, &figures, question);
        Ranked { figures, total, ratio, ties }
    };
    figures.into_iter().map(ranked).collect()
}

/// Whether `other` may be as cheap as `best`: the 95% interval of its solves, by rounds, allows a total within [`INDISTINCT`].
fn ties(best: &Figures, other: &Figures, question: &Question) -> bool {
    let slack = match rank_sum::ratio(&best.rounds, &other.rounds, 0.95) {
        Some(ratio) => ratio.low / ratio.estimate,
        None => 1.0,
    };
    let mut fastest = other.cost;
    fastest.solve *= slack.min(1.0);
    fastest.total(question) <= INDISTINCT * best.cost.total(question)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::cost::{Cost, tests::question};
    use crate::choose::question::Updates;

    fn figures(backend: &str, set_up: f64, rounds: [f64; 6]) -> Figures {
        let solve = rounds.iter().sum::<f64>() / 6.0;
        let cost = Cost { set_up, first: solve, solve, change: 0.0, prepares_anew: false };
        Figures { backend: backend.into(), cost, rounds: rounds.to_vec(), ..Figures::default() }
    }

    #[test]
    fn the_number_of_frames_decides() {
        let all = || {
            vec![
                figures("direct", 1000.0, [10.0, 10.1, 9.9, 10.0, 10.0, 10.0]),
                figures("iterative", 100.0, [50.0, 51.0, 49.0, 50.0, 50.0, 50.0]),
            ]
        };
        let first = |n| rank(all(), &question(Updates::Never, n))[0].figures.backend.clone();
        assert_eq!((first(1), first(100)), ("iterative".into(), "direct".into()));
        assert!(rank(Vec::new(), &question(Updates::Never, 1)).is_empty());
    }

    #[test]
    fn scatter_makes_ties() {
        let scattered = [10.0, 12.0, 9.0, 11.0, 10.5, 9.5];
        let tie = |other: [f64; 6]| {
            let all = vec![figures("a", 0.0, scattered), figures("b", 0.0, other)];
            rank(all, &question(Updates::Never, 1000))[1].ties
        };
        assert!(tie([10.2, 12.5, 9.1, 11.4, 10.6, 9.6]));
        assert!(!tie([20.2, 22.5, 19.1, 21.4, 20.6, 19.6]));
    }
}
