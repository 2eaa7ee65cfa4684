//! Rounds, looks, the repetition: the order in which a gate run does things, on any [`Bench`].

use super::bench::{Bench, Fault};
use super::couple::{Couple, Side};
use super::evidence::Evidence;
use super::rules::{Look, Rules};
use super::series::Series;
use super::verdict::{self, Verdict};
use crate::statistics::random::Random;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// What a gate run measures, and how long it may take.
#[derive(Clone, Debug)]
pub struct Sequence {
    /// Margins and looks.
    pub rules: Rules,
    /// Number of measures (cells) of each case; 0 leaves a case out.
    pub measures: Vec<usize>,
    /// The case that also runs the copy of the base program.
    pub copy_case: Option<usize>,
    /// Time for everything.
    pub budget: Duration,
    /// Seed of the order of cases within rounds.
    pub seed: u64,
}

/// What was concluded of one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Conclusion {
    /// The verdict.
    pub verdict: Verdict,
    /// Why, where the interval alone does not say it.
    pub reason: Option<String>,
    /// The interval at the look that decided, or the last one.
    pub evidence: Option<Evidence>,
    /// The same of the control kernel.
    pub control: Option<Evidence>,
}

/// The couples of all cases in one arm, and what they gave.
#[derive(Clone, Debug, Default)]
pub struct Arm {
    /// Couples of each case.
    pub couples: Vec<Vec<Couple>>,
    /// Void couples of each case.
    pub faults: Vec<Vec<Fault>>,
    /// Conclusions of each case, one for each measure; empty for a case that took no part.
    pub conclusions: Vec<Vec<Conclusion>>,
}

/// A finished run.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The first series of all cases, and the A/A arm.
    pub first: Arm,
    /// The fresh repetition of the cases that seemed slower.
    pub repetition: Arm,
    /// Final conclusions of each case, one for each measure.
    pub conclusions: Vec<Vec<Conclusion>>,
}

/// Share of the time that is kept for the repetition.
const RESERVE: f64 = 0.25;

/// So many void couples end a case.
const MOST_FAULTS: usize = 3;

impl Sequence {
    /// Runs everything; `progress` hears of every round.
    pub fn run(&self, bench: &mut dyn Bench, progress: &mut dyn FnMut(&str)) -> Finished {
        let all = vec![true; self.measures.len()];
        let first = self.arm(bench, &all, self.copy_case, self.budget.mul_f64(1.0 - RESERVE), 0, progress);
        let slower: Vec<bool> = first
            .conclusions
            .iter()
            .map(|cells| cells.iter().any(|c| c.verdict == Verdict::Regressed))
            .collect();
        let repetition = if slower.contains(&true) {
            progress("repeating what seems slower, with fresh processes");
            self.arm(bench, &slower, None, self.budget, 1, progress)
        } else {
            Arm::default()
        };
        let conclusions = self.agree(&first, &repetition);
        Finished { first, repetition, conclusions }
    }

    /// REGRESSED stands only where the repetition says so too.
    fn agree(&self, first: &Arm, repetition: &Arm) -> Vec<Vec<Conclusion>> {
        let mut conclusions = first.conclusions.clone();
        if let Some(why) = self.copy_moved(first) {
            for conclusion in conclusions.iter_mut().flatten().filter(|c| c.verdict != Verdict::Failed) {
                conclusion.verdict = Verdict::Contaminated;
                conclusion.reason = Some(why.clone());
            }
        }
        for (case, cells) in conclusions.iter_mut().enumerate() {
            for (measure, conclusion) in cells.iter_mut().enumerate() {
                if conclusion.verdict == Verdict::Regressed {
                    let again = repetition.conclusions.get(case).and_then(|cells| cells.get(measure));
                    confirm(conclusion, again);
                }
            }
        }
        conclusions
    }

    /// The base program against its own copy, judged like any cell: a difference there is the machine's.
    fn copy_moved(&self, first: &Arm) -> Option<String> {
        let case = self.copy_case?;
        (0..self.measures[case]).find_map(|measure| {
            let series = Series::of(&first.couples[case], Side::Copy, Side::Base, measure);
            let look = self.rules.looks.iter().rfind(|look| look.couples <= series.differences.len())?;
            let evidence = Evidence::of(&series.first(look.couples).differences, look.alpha)?;
            let moved = matches!(
                verdict::of_interval(&evidence, &self.rules),
                Verdict::Regressed | Verdict::Improved
            );
            moved.then(|| {
                let change = 100.0 * evidence.estimate.exp_m1();
                format!("the base program differs from its own copy by {change:+.1}%")
            })
        })
    }

    /// One series of all cases that take part: rounds of one couple each, in shuffled order, until every cell is decided, the
    /// last look is done, or the next look would come after `deadline`.
    fn arm(
        &self,
        bench: &mut dyn Bench,
        takes_part: &[bool],
        copy_case: Option<usize>,
        deadline: Duration,
        number: u64,
        progress: &mut dyn FnMut(&str),
    ) -> Arm {
        let mut random = Random::new(self.seed.wrapping_add(number.wrapping_mul(0x51_7c_c1)));
        let mut states: Vec<State> = self.measures.iter().map(|&measures| State::new(measures)).collect();
        for (state, &part) in states.iter_mut().zip(takes_part) {
            state.live = part && !state.decided.is_empty();
        }
        for round in 0.. {
            self.drop_what_is_out_of_time(&mut states, bench.elapsed(), deadline);
            let mut live: Vec<usize> = (0..states.len()).filter(|&case| states[case].live).collect();
            if live.is_empty() {
                break;
            }
            progress(&format!(
                "couple {} of at most {}, {} cases",
                round + 1,
                self.rules.most_couples(),
                live.len()
            ));
            random.shuffle(&mut live);
            for case in live {
                let begin = bench.elapsed();
                let outcome = bench.couple(case, states[case].couples.len(), copy_case == Some(case));
                states[case].spent += bench.elapsed().saturating_sub(begin);
                states[case].take(outcome, &self.rules);
            }
        }
        let mut arm = Arm::default();
        for (state, &part) in states.into_iter().zip(takes_part) {
            arm.conclusions.push(if part { state.conclusions(&self.rules) } else { Vec::new() });
            arm.couples.push(state.couples);
            arm.faults.push(state.faults);
        }
        arm
    }

    /// Gives up the slowest cases until the others reach their next look in time: half a look says nothing.
    fn drop_what_is_out_of_time(&self, states: &mut [State], now: Duration, deadline: Duration) {
        loop {
            let needs: Vec<Duration> =
                states.iter().map(|state| state.until_next_look(&self.rules)).collect();
            if now + needs.iter().sum::<Duration>() <= deadline {
                return;
            }
            let slowest = (0..states.len()).filter(|&case| states[case].live).max_by_key(|&case| needs[case]);
            match slowest {
                Some(case) => states[case].live = false,
                None => return,
            }
        }
    }
}

/// A case in the making.
struct State {
    couples: Vec<Couple>,
    faults: Vec<Fault>,
    /// One for each measure; `None` while it is open.
    decided: Vec<Option<Conclusion>>,
    live: bool,
    spent: Duration,
}

impl State {
    fn new(measures: usize) -> Self {
        let decided = vec![None; measures];
        Self { couples: Vec::new(), faults: Vec::new(), decided, live: true, spent: Duration::ZERO }
    }

    fn until_next_look(&self, rules: &Rules) -> Duration {
        let attempts = self.couples.len() + self.faults.len();
        let next = rules.next_look(self.couples.len()).filter(|_| self.live);
        match next {
            Some(look) if attempts > 0 => {
                self.spent.mul_f64((look.couples - self.couples.len()) as f64 / attempts as f64)
            }
            _ => Duration::ZERO,
        }
    }

    fn take(&mut self, outcome: Result<Couple, Fault>, rules: &Rules) {
        match outcome {
            Ok(couple) => self.couples.push(couple),
            Err(fault) => {
                self.faults.push(fault);
                self.live = self.faults.len() < MOST_FAULTS;
                return;
            }
        }
        let Some(look) = rules.look_at(self.couples.len()) else { return };
        let is_last = look.couples == rules.most_couples();
        for measure in 0..self.decided.len() {
            if self.decided[measure].is_some() {
                continue;
            }
            let conclusion = self.look(measure, look, rules);
            let clear = matches!(conclusion.verdict, Verdict::Regressed | Verdict::Improved | Verdict::Same);
            if clear || is_last {
                self.decided[measure] = Some(conclusion);
            }
        }
        self.live = self.decided.iter().any(Option::is_none);
    }

    fn look(&self, measure: usize, look: Look, rules: &Rules) -> Conclusion {
        let series = Series::of(&self.couples, Side::Head, Side::Base, measure).first(look.couples);
        let (verdict, reason) = verdict::of_series(&series, look.alpha, rules);
        let evidence = Evidence::of(&series.differences, look.alpha);
        Conclusion { verdict, reason, evidence, control: Evidence::of(&series.control, look.alpha) }
    }

    /// What is to be said of each measure at the end.
    fn conclusions(&self, rules: &Rules) -> Vec<Conclusion> {
        let last = rules.looks.iter().rfind(|look| look.couples <= self.couples.len());
        (0..self.decided.len())
            .map(|measure| match (&self.decided[measure], last) {
                (Some(conclusion), _) => conclusion.clone(),
                _ if self.faults.len() >= MOST_FAULTS => {
                    self.without_statement(Verdict::Failed, &self.faults[0].reason)
                }
                (None, Some(&look)) => self.look(measure, look, rules),
                (None, None) => self.without_statement(
                    Verdict::Inconclusive,
                    "the time was over before the first look; raise --time-budget or take fewer cells",
                ),
            })
            .collect()
    }

    fn without_statement(&self, verdict: Verdict, reason: &str) -> Conclusion {
        Conclusion { verdict, reason: Some(reason.to_owned()), evidence: None, control: None }
    }
}

/// Holds a REGRESSED against its repetition.
fn confirm(conclusion: &mut Conclusion, again: Option<&Conclusion>) {
    let percent = |c: &Conclusion| {
        c.evidence.map_or_else(|| "nothing".to_owned(), |e| format!("{:+.1}%", 100.0 * e.estimate.exp_m1()))
    };
    match again {
        Some(again) if again.verdict == Verdict::Regressed => {
            conclusion.reason = Some(format!("a fresh repetition agrees: {}", percent(again)));
        }
        Some(again) => {
            conclusion.verdict = match again.verdict {
                Verdict::Contaminated => Verdict::Contaminated,
                _ => Verdict::Inconclusive,
            };
            conclusion.reason = Some(format!(
                "{} at first, but a fresh repetition says {} ({}){}",
                percent(conclusion),
                again.verdict,
                percent(again),
                again.reason.as_ref().map_or_else(String::new, |why| format!(": {why}"))
            ));
        }
        None => {
            conclusion.verdict = Verdict::Inconclusive;
            conclusion.reason = Some("there was no time to repeat it; raise --time-budget".into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::couple::{Slot, order};
    use crate::record::names::Status;

    /// A machine without noise to speak of: head is `head(arm)` times as slow, a couple takes a second.
    struct Script {
        clock: u64,
        calls: Vec<usize>,
        head: fn(usize) -> f64,
        copy: f64,
        control: f64,
        broken: usize,
    }

    impl Bench for Script {
        fn elapsed(&self) -> Duration {
            Duration::from_secs(self.clock)
        }

        fn couple(&mut self, case: usize, round: usize, with_copy: bool) -> Result<Couple, Fault> {
            self.clock += 1;
            self.calls[case] += 1;
            if self.calls[case] <= self.broken {
                let reason = "killed by signal 9".to_owned();
                return Err(Fault { side: Side::Head, status: Status::Error, reason });
            }
            let jitter = 1.0 + 1e-3 * ((self.clock * 7919 % 13) as f64 - 6.0);
            let slots = order(round, with_copy).into_iter().map(|side| {
                let (own, control) = match side {
                    Side::Base => (1.0, 1.0),
                    Side::Head => ((self.head)(self.calls[case]) * jitter, self.control),
                    Side::Copy => (self.copy * jitter, 1.0),
                };
                Slot { side, times_ns: vec![1e6 * own], control_ns: 1e6 * control }
            });
            Ok(Couple { slots: slots.collect(), contended: false })
        }
    }

    fn run(head: fn(usize) -> f64, budget: u64, change: impl FnOnce(&mut Script)) -> (Finished, Script) {
        let mut script = Script { clock: 0, calls: vec![0; 2], head, copy: 1.0, control: 1.0, broken: 0 };
        change(&mut script);
        let sequence = Sequence {
            rules: Rules::default(),
            measures: vec![1, 1],
            copy_case: Some(0),
            budget: Duration::from_secs(budget),
            seed: 1,
        };
        (sequence.run(&mut script, &mut |_| {}), script)
    }

    fn verdicts(finished: &Finished) -> Vec<Verdict> {
        finished.conclusions.iter().flatten().map(|c| c.verdict).collect()
    }

    #[test]
    fn clear_cases_need_ten_couples_and_regressions_twenty() {
        let (same, script) = run(|_| 1.0, 1000, |_| {});
        assert_eq!((verdicts(&same), script.calls), (vec![Verdict::Same; 2], vec![10, 10]));
        let (slower, script) = run(|_| 1.1, 1000, |_| {});
        assert_eq!((verdicts(&slower), script.calls), (vec![Verdict::Regressed; 2], vec![20, 20]));
        assert!(slower.conclusions[0][0].reason.as_ref().unwrap().contains("agrees"));
        assert_eq!(verdicts(&run(|_| 0.9, 1000, |_| {}).0), [Verdict::Improved; 2]);
    }

    #[test]
    fn a_regression_that_does_not_come_back_is_none() {
        let (finished, _) = run(|call| if call <= 10 { 1.1 } else { 1.0 }, 1000, |_| {});
        assert_eq!(verdicts(&finished), [Verdict::Inconclusive; 2]);
        assert!(finished.conclusions[0][0].reason.as_ref().unwrap().contains("repetition says SAME"));
    }

    #[test]
    fn without_time_nothing_is_claimed() {
        let (finished, script) = run(|_| 1.1, 12, |_| {});
        assert!(script.clock <= 12, "{}", script.clock);
        assert_eq!(verdicts(&finished), [Verdict::Inconclusive; 2]);
        // Enough for the first series of both, not for the repetition.
        let (finished, _) = run(|_| 1.1, 29, |_| {});
        assert!(verdicts(&finished).contains(&Verdict::Inconclusive));
    }

    #[test]
    fn a_moved_control_or_copy_contaminates() {
        let (finished, _) = run(|_| 1.1, 1000, |script| script.control = 1.03);
        assert_eq!(verdicts(&finished), [Verdict::Contaminated; 2]);
        let (finished, _) = run(|_| 1.1, 1000, |script| script.copy = 1.04);
        assert_eq!(verdicts(&finished), [Verdict::Contaminated; 2]);
        assert!(finished.conclusions[1][0].reason.as_ref().unwrap().contains("own copy"));
    }

    #[test]
    fn one_crash_voids_a_couple_and_three_a_case() {
        let (finished, script) = run(|_| 1.0, 1000, |script| script.broken = 1);
        assert_eq!((verdicts(&finished), script.calls), (vec![Verdict::Same; 2], vec![11, 11]));
        assert_eq!(finished.first.faults[0].len(), 1);
        let (finished, script) = run(|_| 1.0, 1000, |script| script.broken = 1000);
        assert_eq!((verdicts(&finished), script.calls), (vec![Verdict::Failed; 2], vec![3, 3]));
    }
}
