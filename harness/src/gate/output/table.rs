//! The report for people, and as rows of text.

use crate::cmd::output::Format;
use crate::gate::counters::Reference;
use crate::gate::report::{GateReport, percent};
use crate::gate::verdict::Verdict;
use crate::report::rows::Rows;

/// One row per cell.
pub fn cells(report: &GateReport) -> Rows {
    let mut rows =
        Rows::new(["cell", "verdict", "change", "interval", "base ms", "head ms", "couples", "remark"]);
    let milliseconds = |ns: Option<f64>| ns.map_or_else(String::new, |ns| format!("{:.3}", ns * 1e-6));
    for cell in &report.cells {
        let couples = cell.conclusion.evidence.map_or_else(String::new, |e| e.couples.to_string());
        rows.push([
            &cell.name,
            cell.conclusion.verdict.name(),
            &cell.change(),
            &cell.interval(),
            &milliseconds(cell.base_ns),
            &milliseconds(cell.head_ns),
            &couples,
            &cell.remark(),
        ]);
    }
    rows
}

/// One row per counter that changed.
pub fn counters(report: &GateReport) -> Rows {
    let mut rows = Rows::new(["case", "counter", "before", "now", "change", "against", ""]);
    for change in &report.counters {
        let against = match change.against {
            Reference::Baseline => "the committed baseline",
            Reference::Base => "the base program",
        };
        let share =
            if change.before > 0.0 { percent(change.now / change.before - 1.0) } else { String::new() };
        let says = match (change.fails, change.now > change.before) {
            (true, _) => "FAILS",
            (false, true) => "grew",
            (false, false) => "fell",
        };
        let [before, now] = [change.before, change.now].map(|x| x.to_string());
        rows.push([&change.case, &change.counter, &before, &now, &share, against, says]);
    }
    rows
}

/// One line per A/A cell: how much noise there is and what that allows.
pub fn noise(report: &GateReport) -> String {
    let line = |floor: &crate::gate::aa::NoiseFloor| {
        let effects: Vec<String> =
            floor.detectable.iter().map(|d| format!("{} in {}", percent(d.effect), d.couples)).collect();
        format!(
            "noise floor: {}: base and its own copy differ by {:.2}% a couple ({} couples); finds {} couples; \
            false alarms {:.2}% ({:.2}% without margin) of {} sign-flipped series\n",
            floor.cell,
            100.0 * floor.deviation,
            floor.couples,
            effects.join(", "),
            100.0 * floor.false_alarms,
            100.0 * floor.false_alarms_without_margin,
            floor.flips
        )
    };
    report.noise_floor.iter().map(line).collect()
}

/// Everything, in any form but JSON. CSV is the cells alone.
pub fn render(report: &GateReport, format: Format) -> String {
    let mut text = cells(report).render(format);
    if format == Format::Csv {
        return text;
    }
    if !report.counters.is_empty() {
        text += &format!("\n{}", counters(report).render(format));
    }
    text += &format!("\n{}", noise(report));
    for fault in report.cases.iter().flat_map(|case| case.faults.iter().map(move |fault| (case, fault))) {
        text += &format!("{}: {:?} {}: {}\n", fault.0.name, fault.1.side, fault.1.status, fault.1.reason);
    }
    text + &summary(report) + "\n"
}

/// The whole in one line.
pub fn summary(report: &GateReport) -> String {
    use Verdict::{Contaminated, Failed, Improved, Inconclusive, New, Regressed, Removed, Same};
    let counted = [Regressed, Removed, Failed, Contaminated, Inconclusive, Improved, New, Same];
    let counts: Vec<String> = counted
        .into_iter()
        .map(|verdict| (report.with_verdict(verdict).count(), verdict))
        .filter(|&(n, _)| n > 0)
        .map(|(n, verdict)| format!("{n} {verdict}"))
        .collect();
    let grown = report.counters.iter().filter(|change| change.fails).count();
    let counters = match (grown, &report.baseline) {
        (0, Some(_)) => "no counter grew".to_owned(),
        (0, None) => "no committed counters to hold them against".to_owned(),
        (n, _) => format!("{n} counters GREW"),
    };
    format!("{}; {counters}; {:.0} s", counts.join(", "), report.seconds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;

    #[test]
    fn every_verdict_is_counted_and_told() {
        let report = report(&[Verdict::Same, Verdict::Same, Verdict::Regressed, Verdict::Inconclusive]);
        assert!(summary(&report).starts_with("1 REGRESSED, 1 INCONCLUSIVE, 2 SAME; no committed counters"));
        let text = render(&report, Format::Human);
        assert!(text.contains("+5.1%") && text.contains("about 7 more couples needed"), "{text}");
        assert_eq!(render(&report, Format::Csv).lines().count(), 5);
    }
}
