//! L3 without a reference: all backends answered the same question; which of them is the outlier?

use super::finding::{Findings, Level, Outcome};
use super::reference::largest_difference;

/// Answers of several backends to one question.
pub struct Answers {
    scale: f64,
    all: Vec<Answer>,
}

struct Answer {
    id: String,
    limit: f64,
    x: Vec<f64>,
}

impl Answers {
    /// None yet; differences will be relative to `scale`.
    pub fn new(scale: f64) -> Self {
        Self { scale: if scale > 0.0 { scale } else { 1.0 }, all: Vec::new() }
    }

    /// The answer of backend `id`, which may be off by `limit` (relative).
    pub fn add(&mut self, id: &str, limit: f64, x: Vec<f64>) {
        self.all.push(Answer { id: id.to_owned(), limit, x });
    }

    /// Records the largest excess of a difference over what both may be off, and names the backend that is in most such
    /// pairs. `uncertainty` is how far two exact-arithmetic twins may be apart (0 where the problem is well conditioned).
    pub fn compare(&self, uncertainty: f64, findings: &mut Findings) {
        const CHECK: &str = "backends agree";
        if self.all.len() < 2 {
            return;
        }
        let tightest = self.all.iter().map(|a| a.limit).fold(f64::INFINITY, f64::min);
        if uncertainty / self.scale > 0.1 * tightest {
            let note = format!("two refined solutions differ by {:.1e}", uncertainty / self.scale);
            return findings.note(Level::Forward, CHECK, Outcome::NotCertifiable, note);
        }
        let (mut worst, mut votes) = (0.0f64, vec![0usize; self.all.len()]);
        for i in 0..self.all.len() {
            for j in i + 1..self.all.len() {
                let (a, b) = (&self.all[i], &self.all[j]);
                let share = largest_difference(&a.x, &b.x) / self.scale / (a.limit + b.limit);
                worst = worst.max(share);
                if share > 1.0 {
                    votes[i] += 1;
                    votes[j] += 1;
                }
            }
        }
        let most = (0..votes.len()).max_by_key(|&i| votes[i]).filter(|&i| votes[i] > 0);
        let note = match most {
            Some(i) => format!(
                "outlier {}: it differs from {} of {} others",
                self.all[i].id,
                votes[i],
                votes.len() - 1
            ),
            None => format!("{} backends; share of what each pair may differ", votes.len()),
        };
        findings.at_most(Level::Forward, CHECK, worst, 1.0, note);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outlier_is_named() {
        let mut answers = Answers::new(2.0);
        for (id, off) in [("a", 0.0), ("b", 1e-10), ("c", 1e-3), ("d", -1e-10)] {
            answers.add(id, 1e-9, vec![1.0, 2.0 + off]);
        }
        let mut findings = Findings::default();
        answers.compare(0.0, &mut findings);
        assert_eq!(findings.all[0].outcome, Outcome::Failed);
        assert!(
            findings.all[0].note.starts_with("outlier c: it differs from 3 of 3"),
            "{}",
            findings.all[0].note
        );
        answers.compare(1e-8, &mut findings);
        assert_eq!(findings.all[1].outcome, Outcome::NotCertifiable);
    }
}
