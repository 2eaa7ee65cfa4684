//! A gate run on this machine, from two programs to a report.

use super::aa::NoiseFloor;
use super::bench::Fault;
use super::cell::Case;
use super::counters::{self, Baseline, Change, Counters};
use super::couple::{Couple, Side};
use super::laboratory::Laboratory;
use super::report::{CaseReport, CellReport, GateReport, ProgramRecord, SCHEMA_VERSION};
use super::rules::Rules;
use super::sequence::{Conclusion, Finished, Sequence};
use super::side::Program;
use super::verdict::Verdict;
use crate::environment::{self, Environment};
use anyhow::bail;
use lapsolve::registry::Entry;
use std::path::Path;
use std::time::{Duration, Instant};

/// What is to be compared.
pub struct Order<'a> {
    /// The program to compare with.
    pub base: &'a Program,
    /// The program to judge.
    pub head: &'a Program,
    /// On what.
    pub cases: Vec<Case>,
    /// Threads of every process.
    pub threads: usize,
    /// Time for everything.
    pub budget: Duration,
    /// Seed of the order of cases.
    pub seed: u64,
    /// Committed counters.
    pub baseline: Option<&'a Path>,
    /// Backends of this program: they solve for reference.
    pub backends: &'a [Entry],
}

/// What came of it.
pub struct Done {
    /// The report; exit code and command are for the caller to fill in.
    pub report: GateReport,
    /// Head's counters, for an update of the baseline.
    pub counters: Baseline,
}

/// Inspects every case once, then measures what both sides have.
///
/// # Errors
/// Cells that neither side has, meshes or baselines that cannot be read, no place for temporary files.
pub fn run(order: &Order<'_>, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Done> {
    let begin = Instant::now();
    let mut environment = Environment::read();
    let ticks = environment::processor_ticks();
    let committed = order.baseline.map(counters::read).transpose()?.flatten();
    let (shared, mut cells) = sort(order)?;
    progress("making meshes and reference solutions");
    let mut laboratory =
        Laboratory::new(&shared, [order.base, order.head], order.backends, order.threads, begin)?;
    let inspected = inspect(&laboratory, &shared, committed.as_ref(), progress);
    let measures: Vec<usize> = shared
        .iter()
        .zip(&inspected.faults)
        .map(|(case, faults)| if faults.is_empty() { case.measures.len() } else { 0 })
        .collect();
    let copy_case =
        (0..measures.len()).rev().max_by_key(|&case| measures[case]).filter(|&case| measures[case] > 0);
    let rules = Rules::default();
    let sequence =
        Sequence { rules: rules.clone(), measures, copy_case, budget: order.budget, seed: order.seed };
    let finished = sequence.run(&mut laboratory, progress);
    cells.extend(cell_reports(&shared, &inspected, &finished, &rules));
    environment.info.load1_end = environment::load1();
    environment.info.steal = stolen_share(ticks, environment::processor_ticks());
    let record = |program: &Program| ProgramRecord { name: program.name(), build: program.record().cloned() };
    let report = GateReport {
        schema_version: SCHEMA_VERSION.into(),
        command: String::new(),
        exit_code: 0,
        exit: String::new(),
        base: record(order.base),
        head: record(order.head),
        environment,
        seed: order.seed,
        threads: order.threads,
        seconds: begin.elapsed().as_secs_f64(),
        cells,
        counters: inspected.changes,
        baseline: order.baseline.filter(|_| committed.is_some()).map(|path| path.display().to_string()),
        noise_floor: noise_floor(&shared, copy_case, &finished, &rules, order.seed),
        cases: case_reports(&shared, inspected.faults, finished),
        rules,
    };
    Ok(Done { report, counters: inspected.counters })
}

/// The cases that both sides have, and the cells that only one has.
fn sort(order: &Order<'_>) -> anyhow::Result<(Vec<Case>, Vec<CellReport>)> {
    let (mut shared, mut cells) = (Vec::new(), Vec::new());
    for case in &order.cases {
        let (verdict, reason) = match (order.base.lacks(case), order.head.lacks(case)) {
            (None, None) => {
                shared.push(case.clone());
                continue;
            }
            (Some(base), Some(head)) => bail!("{case}: neither side can: base: {base}; head: {head}"),
            (Some(base), None) => (Verdict::New, format!("base: {base}")),
            (None, Some(head)) => (Verdict::Removed, format!("head: {head}")),
        };
        for &measure in &case.measures {
            cells.push(CellReport::unmeasured(case.cell_name(measure), verdict, reason.clone()));
        }
    }
    Ok((shared, cells))
}

/// What one process of each side told.
#[derive(Default)]
struct Inspected {
    /// Of each case.
    faults: Vec<Vec<Fault>>,
    /// Head's.
    counters: Baseline,
    changes: Vec<Change>,
}

/// One process of each side for every case: its counters, and whether it works at all. Files are in the page cache afterwards.
fn inspect(
    laboratory: &Laboratory,
    cases: &[Case],
    committed: Option<&Baseline>,
    progress: &mut dyn FnMut(&str),
) -> Inspected {
    let mut inspected = Inspected::default();
    for (index, case) in cases.iter().enumerate() {
        progress(&format!("counters of {case}"));
        let (base, head) = (laboratory.process(index, Side::Base), laboratory.process(index, Side::Head));
        if let Ok(row) = &head {
            let now = Counters::of(row);
            let before = base.as_ref().ok().map(Counters::of);
            let committed = committed.and_then(|committed| committed.get(&case.to_string()));
            inspected.changes.extend(counters::changes(&case.to_string(), &now, before.as_ref(), committed));
            inspected.counters.insert(case.to_string(), now);
        }
        inspected.faults.push([base, head].into_iter().filter_map(Result::err).collect());
    }
    inspected
}

fn cell_reports(
    cases: &[Case],
    inspected: &Inspected,
    finished: &Finished,
    rules: &Rules,
) -> Vec<CellReport> {
    let mut cells = Vec::new();
    for (index, case) in cases.iter().enumerate() {
        for (number, &measure) in case.measures.iter().enumerate() {
            let name = case.cell_name(measure);
            if let [fault, ..] = inspected.faults[index].as_slice() {
                let reason = format!("{:?}: {}: {}", fault.side, fault.status, fault.reason);
                cells.push(CellReport::unmeasured(name, Verdict::Failed, reason));
                continue;
            }
            let conclusion = finished.conclusions[index][number].clone();
            let couples = &finished.first.couples[index];
            let again = finished.repetition.conclusions.get(index).and_then(|cells| cells.get(number));
            cells.push(CellReport {
                name,
                base_ns: median(couples, Side::Base, number),
                head_ns: median(couples, Side::Head, number),
                detectable: conclusion.evidence.map(|evidence| evidence.detectable(rules)),
                couples_needed: needed(&conclusion, rules),
                repetition: again.cloned(),
                conclusion,
            });
        }
    }
    cells
}

fn needed(conclusion: &Conclusion, rules: &Rules) -> Option<usize> {
    conclusion
        .evidence
        .filter(|_| conclusion.verdict == Verdict::Inconclusive)
        .and_then(|evidence| evidence.couples_needed(rules))
}

fn median(couples: &[Couple], side: Side, measure: usize) -> Option<f64> {
    let slots = couples.iter().flat_map(|couple| &couple.slots).filter(|slot| slot.side == side);
    let mut times: Vec<f64> = slots.map(|slot| slot.times_ns[measure]).collect();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied()
}

fn noise_floor(
    cases: &[Case],
    copy_case: Option<usize>,
    finished: &Finished,
    rules: &Rules,
    seed: u64,
) -> Vec<NoiseFloor> {
    let Some(index) = copy_case else { return Vec::new() };
    let floor = |(number, &measure): (usize, &super::cell::Measure)| {
        let name = cases[index].cell_name(measure);
        NoiseFloor::of(&name, &finished.first.couples[index], number, rules, seed)
    };
    cases[index].measures.iter().enumerate().filter_map(floor).collect()
}

fn case_reports(cases: &[Case], inspected: Vec<Vec<Fault>>, finished: Finished) -> Vec<CaseReport> {
    let Finished { first, repetition, .. } = finished;
    let mut repeated = repetition.couples;
    repeated.resize(cases.len(), Vec::new());
    let mut again = repetition.faults;
    again.resize(cases.len(), Vec::new());
    let parts = first.couples.into_iter().zip(first.faults).zip(repeated).zip(again).zip(inspected);
    cases
        .iter()
        .zip(parts)
        .map(|(case, ((((couples, faults), repetition), again), inspected))| CaseReport {
            name: case.to_string(),
            measures: case.measures.iter().map(|measure| measure.name().to_owned()).collect(),
            couples,
            repetition,
            faults: [inspected, faults, again].concat(),
        })
        .collect()
}

fn stolen_share(begin: Option<(u64, u64)>, end: Option<(u64, u64)>) -> Option<f64> {
    let ((stolen, all), (stolen_end, all_end)) = begin.zip(end)?;
    let passed = all_end.checked_sub(all).filter(|&passed| passed > 0)?;
    Some(stolen_end.saturating_sub(stolen) as f64 / passed as f64)
}
