//! Sentences about results that a newcomer understands and an expert accepts.

use super::numbers::{milliseconds, significant};
use super::ranking::{Class, LEVELS};
use super::view::{Group, Hardware, View, is_valid, median_ms, steady};
use crate::record::names::{Precision, Status};
use crate::record::rate::{Rate, Share};
use crate::record::result::{Cell, ResultFile};
use crate::statistics::ranking::rank;

/// What kind of statement it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// A finding.
    Plain,
    /// A reason for doubt.
    Warning,
    /// Something is wrong.
    Bad,
}

/// A statement.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Statement {
    /// Its kind.
    pub tone: Tone,
    /// Its words.
    pub text: String,
}

/// The most important things to know about a result, in order.
pub fn verdict(view: &View<'_>) -> Vec<Statement> {
    let plain = |text| Statement { tone: Tone::Plain, text };
    let mut statements = vec![plain(counts(view.result))];
    statements.extend(doubts(view.result).into_iter().map(|text| Statement { tone: Tone::Warning, text }));
    statements.extend(wrong(view).map(|text| Statement { tone: Tone::Bad, text }));
    statements.extend(view.groups.iter().filter_map(|group| fastest(view, group)).map(plain));
    statements
}

fn counts(result: &ResultFile) -> String {
    let right = result.cells.iter().filter(|cell| cell.status == Status::Ok).count();
    let all = result.cells.len();
    format!("{right} of {all} combinations of mesh, task and solver were measured and gave right answers.")
}

/// Why the times might not hold.
fn doubts(result: &ResultFile) -> Vec<String> {
    let mut doubts = Vec::new();
    if !result.quotable {
        doubts.push("This was a shortened run: good for a look, not for a statement.".to_owned());
    }
    if result.cells.iter().any(|cell| !cell.complete) {
        doubts.push("The run was cut short: some rows are incomplete.".to_owned());
    }
    let contended = |cell: &&Cell| is_contended(cell);
    let count = result.cells.iter().filter(contended).count();
    if count > 0 {
        let all = result.cells.len();
        doubts.push(format!(
            "Other work on the machine disturbed more than a fifth of the rounds of {count} of {all} cells (marked \
             \u{26a0}): ratios within this file are still fair, because all solvers took turns; absolute times may be too long."
        ));
    }
    doubts
}

/// Whether more than a fifth of a cell's rounds were disturbed.
pub fn is_contended(cell: &Cell) -> bool {
    5 * cell.contention.contended > cell.contention.rounds
}

fn wrong<'a>(view: &'a View<'_>) -> impl Iterator<Item = String> + 'a {
    view.result.cells.iter().filter(|cell| cell.status == Status::Invalid).map(|cell| {
        let reason = cell.reason.as_deref().unwrap_or("no reason given");
        format!(
            "{} gave a wrong answer on {}, {}: {reason}. It has no time.",
            view.label(cell),
            cell.mesh.name,
            cell.workload
        )
    })
}

/// The class that a group's sentence is about: f64 on the processor, as many threads as there are, at the loosest level
/// that iterative solvers of the default tolerance reach.
fn main_class(group: &Group<'_>) -> Option<Class> {
    let candidates = group.valid().filter(|cell| Hardware::of(cell) == Hardware::Cpu);
    let threads =
        candidates.filter(|cell| cell.precision == Some(Precision::F64)).map(|cell| cell.threads).max()?;
    let class = |level| Class {
        workload: group.workload.to_owned(),
        precision: Precision::F64,
        hardware: Hardware::Cpu,
        threads,
        level,
    };
    let count = |level: f64| group.cells.iter().filter(|cell| class(level).holds(cell)).count();
    LEVELS
        .into_iter()
        .rev()
        .skip(1)
        .find(|&level| count(level) > 0)
        .map(class)
        .or_else(|| Some(class(LEVELS[0])))
}

fn fastest(view: &View<'_>, group: &Group<'_>) -> Option<String> {
    let class = main_class(group)?;
    let cells: Vec<&Cell> = group.cells.iter().copied().filter(|cell| class.holds(cell)).collect();
    let time = |cell: &&Cell| {
        let median = median_ms(cell)?;
        let (low, high) = super::view::interval_ms(cell).unwrap_or((median, median));
        Some((median, low, high))
    };
    let times: Vec<_> = cells.iter().map(|cell| vec![time(cell)]).collect();
    let standings = rank(&times);
    let best = cells[standings.first()?.solver];
    let names = |rank: usize| -> Vec<String> {
        standings.iter().filter(|s| s.rank == rank).map(|s| view.label(cells[s.solver])).collect()
    };
    let (leaders, unit) = (names(1), group.unit());
    let who = match leaders.len() {
        1 => format!("{} is the fastest", leaders[0]),
        _ => format!("{} are equally fast", listed(&leaders)),
    };
    let rate =
        best.frames_per_second.map_or_else(String::new, |fps| format!(", {} per second", significant(fps)));
    let mut text = format!(
        "{}: among right answers with an error of at most {:.0e} (f64, {} thread{}), {who} with {} {unit}{}{rate}",
        group.title(),
        class.level,
        class.threads,
        if class.threads == 1 { "" } else { "s" },
        milliseconds(steady(best).p50?),
        interval(best),
    );
    if let Some(next) = standings.iter().find(|s| s.rank > 1) {
        let ratio = next.penalised / standings[0].penalised;
        text += &format!(
            "; the next, {}, takes {} times as long",
            view.label(cells[next.solver]),
            significant(ratio)
        );
    }
    text.push('.');
    if let Some(words) = interactive(best) {
        text += &format!(" {}: {words}.", view.label(best));
    }
    Some(text)
}

/// " (95% interval 1.2 to 1.3)".
fn interval(cell: &Cell) -> String {
    let steady = steady(cell);
    match steady.p50_low.zip(steady.p50_high) {
        Some((low, high)) => {
            format!(" (95% interval of the median {} to {})", milliseconds(low), milliseconds(high))
        }
        None => String::new(),
    }
}

/// "interactive at 60 and 90 Hz with the whole frame for the solver; ...", by the rule of [`crate::record::rate`].
/// Nothing where no rate was tried.
pub fn interactive(cell: &Cell) -> Option<String> {
    let rates: Vec<f64> = cell.open_loop.iter().map(|run| run.hz).collect();
    if rates.is_empty() || !is_valid(cell) {
        return None;
    }
    let met = |share| -> Vec<String> {
        let met = rates.iter().filter(|&&hz| Rate::of_cell(cell, hz, share) == Rate::Met);
        met.map(f64::to_string).collect()
    };
    let undecided: Vec<String> = rates
        .iter()
        .filter(|&&hz| Rate::of_cell(cell, hz, Share::Whole) == Rate::Undecided)
        .map(f64::to_string)
        .collect();
    let (whole, half) = (met(Share::Whole), met(Share::Half));
    if whole.is_empty() && !undecided.is_empty() {
        return Some(format!("too few frames to say whether it is interactive at {} Hz", listed(&undecided)));
    }
    let mut text = match (whole.as_slice(), half.as_slice()) {
        ([], _) => {
            format!("not interactive at {} Hz", listed(&rates.iter().map(f64::to_string).collect::<Vec<_>>()))
        }
        (whole, []) => format!(
            "interactive at {} Hz if the solver has the whole frame, at none of the rates if it has half of it",
            listed(whole)
        ),
        (whole, half) => format!(
            "interactive at {} Hz if the solver has the whole frame, at {} Hz if it has half of it",
            listed(whole),
            listed(half)
        ),
    };
    if !undecided.is_empty() {
        text += &format!(" (too few frames to decide {} Hz)", listed(&undecided));
    }
    Some(text)
}

/// "a, b and c".
pub fn listed(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::result::{Accuracy, Contention, Mesh, OpenLoop, Summary};

    fn cell(backend: &str, ms: u64, error: f64) -> Cell {
        let accuracy =
            Accuracy { forward_error: Some(error), certifiable: Some(true), ..Accuracy::default() };
        Cell {
            mesh: Mesh { name: "m".into(), ..Mesh::default() },
            workload: "harmonic".into(),
            backend: backend.into(),
            status: Status::Ok,
            complete: true,
            precision: Some(Precision::F64),
            threads: 1,
            solve_ns: Summary::of(&[ms * 1_000_000; 9]),
            accuracy,
            ..Cell::default()
        }
    }

    fn words(cells: Vec<Cell>) -> String {
        let result = ResultFile {
            schema_version: "1.1".into(),
            command: String::new(),
            quotable: true,
            environment: Default::default(),
            cells,
        };
        verdict(&View::new(&result)).into_iter().map(|s| s.text + "\n").collect()
    }

    #[test]
    fn the_fastest_right_answer_is_named_with_its_lead() {
        let text = words(vec![cell("slow", 6, 1e-10), cell("quick", 2, 1e-14), cell("sloppy", 1, 1e-5)]);
        assert!(text.contains("quick is the fastest with 2.00 ms per solve"), "{text}");
        assert!(text.contains("slow, takes 3.00 times as long"), "{text}");
    }

    #[test]
    fn ties_and_wrong_answers_are_said() {
        let wrong =
            Cell { status: Status::Invalid, reason: Some("off by 1".into()), ..cell("wrong", 1, 1.0) };
        let text = words(vec![cell("a", 2, 1e-14), cell("b", 2, 1e-14), wrong]);
        assert!(
            text.contains("a and b are equally fast") && text.contains("off by 1. It has no time"),
            "{text}"
        );
    }

    #[test]
    fn disturbed_rounds_are_doubts() {
        let contention = Contention { rounds: 5, contended: 2, ..Contention::default() };
        assert!(words(vec![Cell { contention, ..cell("a", 1, 0.0) }]).contains("1 of 1 cells"));
    }

    #[test]
    fn interactive_needs_the_bound() {
        let run = |hz, frames| OpenLoop {
            hz,
            frames,
            miss_upper95: if frames > 298 { 0.0099 } else { 0.05 },
            half_misses: Some(frames),
            half_upper95: Some(1.0),
            half_lower95: Some(0.9),
            ..OpenLoop::default()
        };
        let cell = Cell { open_loop: vec![run(60.0, 300), run(90.0, 100)], ..cell("a", 1, 0.0) };
        assert_eq!(
            interactive(&cell).as_deref(),
            Some(
                "interactive at 60 Hz if the solver has the whole frame, at none of the rates if it has half of it (too few frames to decide 90 Hz)"
            )
        );
    }
}
