//! The gate's result: what it concluded, on what grounds, and every time it measured.

use super::aa::NoiseFloor;
use super::bench::Fault;
use super::counters::Change;
use super::couple::Couple;
use super::rules::Rules;
use super::sequence::Conclusion;
use super::verdict::Verdict;
use crate::environment::{BuildRecord, Environment};
use crate::exit::Exit;
use crate::record::names::Status;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Version of what is written here.
pub const SCHEMA_VERSION: &str = "1.0";

/// A gate run, whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GateReport {
    /// Major and minor version, "1.0".
    pub schema_version: String,
    /// The command line that made it.
    pub command: String,
    /// The code with which the command ended, and what it means.
    pub exit_code: u8,
    /// In words.
    pub exit: String,
    /// The program to compare with.
    pub base: ProgramRecord,
    /// The program to judge.
    pub head: ProgramRecord,
    /// The machine.
    pub environment: Environment,
    /// Margins and looks, fixed beforehand.
    pub rules: Rules,
    /// Seed of the order of cases.
    pub seed: u64,
    /// Threads of every process.
    pub threads: usize,
    /// Time the run took, seconds.
    pub seconds: f64,
    /// The verdicts.
    pub cells: Vec<CellReport>,
    /// Counters that changed.
    pub counters: Vec<Change>,
    /// Where the committed counters are; null where there are none.
    pub baseline: Option<String>,
    /// The A/A arm.
    pub noise_floor: Vec<NoiseFloor>,
    /// Every couple.
    pub cases: Vec<CaseReport>,
}

/// A program.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ProgramRecord {
    /// Path or name.
    pub name: String,
    /// How it was built, where it says so.
    pub build: Option<BuildRecord>,
}

/// A cell and its verdict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CellReport {
    /// `MESH/WORKLOAD/BACKEND/MEASURE`.
    pub name: String,
    /// What was concluded.
    #[serde(flatten)]
    pub conclusion: Conclusion,
    /// Median time of the base processes, nanoseconds.
    pub base_ns: Option<f64>,
    /// Median time of the head processes, nanoseconds.
    pub head_ns: Option<f64>,
    /// Slow-down that this much noise and so many couples would find with probability 0.9 (0.05: 5%).
    pub detectable: Option<f64>,
    /// Couples still needed for a statement, if the estimate is the truth; null where none would do, or none are needed.
    pub couples_needed: Option<usize>,
    /// The interval of the fresh repetition, where there was one.
    pub repetition: Option<Conclusion>,
}

/// A case and what its processes took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CaseReport {
    /// `MESH/WORKLOAD/BACKEND`.
    pub name: String,
    /// What is judged of each process.
    pub measures: Vec<String>,
    /// The first series.
    pub couples: Vec<Couple>,
    /// The repetition.
    pub repetition: Vec<Couple>,
    /// Processes that crashed or answered wrongly.
    pub faults: Vec<Fault>,
}

impl GateReport {
    /// The code that follows: wrong answers, then regressions, removed cells and grown counters, then crashes, then (only if
    /// `strict`) what remained open.
    pub fn exit(&self, strict: bool) -> Exit {
        let mut exit = Exit::Ok;
        for fault in self.cases.iter().flat_map(|case| &case.faults) {
            exit = exit.or(if fault.status == Status::Invalid { Exit::Invalid } else { Exit::Error });
        }
        for cell in &self.cells {
            exit = exit.or(match cell.conclusion.verdict {
                Verdict::Regressed | Verdict::Removed => Exit::Regression,
                Verdict::Failed => Exit::Error,
                Verdict::Inconclusive | Verdict::Contaminated if strict => Exit::Inconclusive,
                _ => Exit::Ok,
            });
        }
        if self.counters.iter().any(|change| change.fails) {
            exit = exit.or(Exit::Regression);
        }
        exit
    }

    /// Cells with a verdict.
    pub fn with_verdict(&self, verdict: Verdict) -> impl Iterator<Item = &CellReport> {
        self.cells.iter().filter(move |cell| cell.conclusion.verdict == verdict)
    }
}

impl CellReport {
    /// A cell of which only the verdict is known.
    pub fn unmeasured(name: String, verdict: Verdict, reason: String) -> Self {
        let conclusion = Conclusion { verdict, reason: Some(reason), evidence: None, control: None };
        Self {
            name,
            conclusion,
            base_ns: None,
            head_ns: None,
            detectable: None,
            couples_needed: None,
            repetition: None,
        }
    }

    /// "+5.1%", or nothing.
    pub fn change(&self) -> String {
        self.conclusion.evidence.map_or_else(String::new, |e| percent(e.estimate.exp_m1()))
    }

    /// "+4.2% to +6.0%", or nothing.
    pub fn interval(&self) -> String {
        self.conclusion.evidence.map_or_else(String::new, |e| {
            format!("{} to {}", percent(e.low.exp_m1()), percent(e.high.exp_m1()))
        })
    }

    /// What is worth saying besides the numbers.
    pub fn remark(&self) -> String {
        let mut parts: Vec<String> = self.conclusion.reason.iter().cloned().collect();
        if self.conclusion.verdict == Verdict::Inconclusive {
            if let Some(effect) = self.detectable {
                parts.push(format!("would find {}", percent(effect)));
            }
            match self.couples_needed {
                Some(more) => parts.push(format!("about {more} more couples needed")),
                None if self.detectable.is_some() => parts.push("no number of couples would do here".into()),
                None => {}
            }
        }
        if let Some(e) = self.conclusion.evidence.filter(|e| e.widening > 1.0) {
            parts.push(format!(
                "interval widened {:.1}x: neighbouring couples correlate {:.2}",
                e.widening, e.autocorrelation
            ));
        }
        parts.join("; ")
    }
}

/// 0.051 as "+5.1%".
pub fn percent(share: f64) -> String {
    format!("{:+.1}%", 100.0 * share)
}

#[cfg(test)]
pub(in crate::gate) mod tests {
    use super::*;
    use crate::gate::couple::Side;
    use crate::gate::evidence::Evidence;

    /// A report with one cell of each verdict in `verdicts`.
    pub fn report(verdicts: &[Verdict]) -> GateReport {
        let evidence = Evidence {
            couples: 16,
            alpha: 0.003,
            estimate: 0.05,
            low: 0.04,
            high: 0.06,
            autocorrelation: 0.0,
            widening: 1.0,
        };
        let cells = verdicts.iter().enumerate().map(|(i, &verdict)| CellReport {
            conclusion: Conclusion {
                verdict,
                reason: None,
                evidence: Some(evidence),
                control: Some(evidence),
            },
            base_ns: Some(1e6),
            head_ns: Some(1.05e6),
            detectable: Some(0.03),
            couples_needed: Some(7),
            ..CellReport::unmeasured(format!("body:9/harmonic/<b>&|{i}/solve"), verdict, String::new())
        });
        GateReport {
            schema_version: SCHEMA_VERSION.into(),
            command: "lapbench gate".into(),
            exit_code: 0,
            exit: String::new(),
            base: ProgramRecord { name: "base".into(), build: None },
            head: ProgramRecord { name: "head".into(), build: None },
            environment: Environment::default(),
            rules: Rules::default(),
            seed: 1,
            threads: 1,
            seconds: 60.0,
            cells: cells.collect(),
            counters: Vec::new(),
            baseline: None,
            noise_floor: Vec::new(),
            cases: vec![CaseReport::default()],
        }
    }

    #[test]
    fn exit_codes_follow_the_contract() {
        use Verdict::*;
        let exit = |verdicts: &[Verdict], strict| report(verdicts).exit(strict);
        assert_eq!(exit(&[Same, Improved, New], true), Exit::Ok);
        assert_eq!(exit(&[Same, Regressed, Inconclusive], false), Exit::Regression);
        assert_eq!(exit(&[Removed], false), Exit::Regression);
        assert_eq!(exit(&[Inconclusive, Contaminated], false), Exit::Ok);
        assert_eq!(exit(&[Inconclusive], true), Exit::Inconclusive);
        assert_eq!(exit(&[Contaminated], true), Exit::Inconclusive);
        assert_eq!(exit(&[Failed], false), Exit::Error);
        assert_eq!(exit(&[Failed, Regressed], false), Exit::Regression);
    }

    #[test]
    fn faults_and_counters_decide_too() {
        let mut report = report(&[Verdict::Same]);
        let fault = |status| Fault { side: Side::Head, status, reason: "r".into() };
        report.cases[0].faults = vec![fault(Status::Error)];
        assert_eq!(report.exit(false), Exit::Error);
        report.cases[0].faults = vec![fault(Status::Error), fault(Status::Invalid)];
        assert_eq!(report.exit(false), Exit::Invalid);
        report.cases[0].faults.clear();
        let now = crate::gate::counters::Counters { factor_nonzeros: Some(2), ..Default::default() };
        let before = crate::gate::counters::Counters { factor_nonzeros: Some(1), ..Default::default() };
        report.counters = crate::gate::counters::changes("c", &now, None, Some(&before));
        assert_eq!(report.exit(false), Exit::Regression);
    }

    #[test]
    fn comes_back_from_json_as_it_was() {
        let report = report(&[Verdict::Same, Verdict::Inconclusive]);
        let text = serde_json::to_string(&report).unwrap();
        assert!(text.contains("\"INCONCLUSIVE\""));
        assert_eq!(serde_json::from_str::<GateReport>(&text).unwrap(), report);
    }
}
