//! The choice in three sentences: what it costs, why it wins, what it keeps.

use super::cost::Cost;
use super::question::{Question, Updates};
use super::ranking::Ranked;

/// Three sentences on the first of `ranked`; says what is missing where nobody is left.
pub fn explain(ranked: &[Ranked], question: &Question) -> String {
    let Some(first) = ranked.first() else { return "No backend keeps every rule.".to_owned() };
    [costs(first, question), why(ranked, question), keeps(first, question)].join(" ")
}

fn costs(first: &Ranked, question: &Question) -> String {
    let cost = &first.figures.cost;
    let frames = if question.frames == 1 {
        format!("its one solve takes {}", time(cost.first))
    } else {
        format!("a frame takes {}{}", time(cost.frame(question)), parts(cost, question))
    };
    let plural = if question.frames == 1 { "" } else { "s" };
    let (name, set_up, total) = (&first.figures.backend, time(cost.set_up), time(first.total));
    format!("{name} is prepared in {set_up} and {frames}: {total} for {} frame{plural}.", question.frames)
}

fn parts(cost: &Cost, question: &Question) -> String {
    let what = match (question.updates, cost.prepares_anew) {
        (Updates::Never, _) => return String::new(),
        (_, true) => "to prepare anew",
        (Updates::Constraints, false) => "to edit the constraints",
        (Updates::Values, false) => "to take new values",
    };
    let every = if question.update_every == 1 {
        String::new()
    } else {
        format!(" every {} frames", question.update_every)
    };
    format!(" ({} {what}{every}, {} to solve)", time(cost.change), time(cost.solve))
}

fn why(ranked: &[Ranked], question: &Question) -> String {
    let first = &ranked[0];
    let Some(next) = ranked.get(1) else {
        return "Nothing else keeps every rule, or it was stopped because it cost more.".to_owned();
    };
    let name = &next.figures.backend;
    let (a, b) = (&first.figures.cost, &next.figures.cost);
    if next.ties {
        return format!(
            "{name} cannot be told from it ({} in all), so other reasons may decide between the two.",
            time(next.total)
        );
    }
    let lead = format!("The next one, {name}, takes {:.2} times as long", next.ratio);
    let (set_up, frame) = (a.set_up + a.first <= b.set_up + b.first, a.frame(question) <= b.frame(question));
    match (set_up, frame) {
        (true, true) => {
            format!("{lead}, slower both to prepare and in a frame, so the number of frames does not matter.")
        }
        (false, true) => match a.cheaper_from(b, question) {
            Some(from) => {
                format!("{lead}: it is prepared sooner, but from {from} frames on the faster frame pays.")
            }
            None => format!("{lead}."),
        },
        _ => match b.cheaper_from(a, question) {
            Some(from) => format!("{lead}: its frame is faster, which pays from {from} frames on only."),
            None => format!("{lead}."),
        },
    }
}

fn keeps(first: &Ranked, question: &Question) -> String {
    let figures = &first.figures;
    let error = match (figures.error, figures.error_is_certain || figures.solves == 0) {
        (Some(error), true) => {
            format!("Its error is at most {error:.0e} ({:.0e} asked for)", question.accuracy)
        }
        (Some(residual), false) => {
            format!("Its relative residual is {residual:.0e}, and no more can be certified on this mesh")
        }
        (None, _) => match figures.tolerance {
            Some(tolerance) => format!("It stops at a relative residual of {tolerance:.0e}"),
            None => format!("It stops at a relative residual of {:.0e}", question.accuracy),
        },
    };
    let memory = figures
        .peak_bytes
        .map_or_else(String::new, |b| format!(", its process takes {:.0} MB", b as f64 * 1e-6));
    let late = match (figures.late, question.budget_ms) {
        (Some(late), Some(budget)) => {
            format!(", and {:.1}% of its frames were over {budget} ms", 100.0 * late)
        }
        _ => String::new(),
    };
    format!("{error}{memory}{late}.")
}

/// Nanoseconds in a fitting unit, three digits.
pub fn time(ns: f64) -> String {
    let (value, unit) = match ns {
        ns if ns < 1e6 => (ns * 1e-3, "us"),
        ns if ns < 1e9 => (ns * 1e-6, "ms"),
        ns if ns < 120e9 => (ns * 1e-9, "s"),
        ns => (ns / 60e9, "min"),
    };
    let decimals = if value < 10.0 {
        2
    } else if value < 100.0 {
        1
    } else {
        0
    };
    format!("{value:.decimals$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::cost::tests::question;
    use crate::choose::figures::Figures;
    use crate::choose::ranking::rank;

    fn figures(backend: &str, set_up: f64, solve: f64, change: f64) -> Figures {
        let cost = Cost { set_up, first: solve, solve, change, prepares_anew: false };
        Figures {
            backend: backend.into(),
            cost,
            error: Some(1e-12),
            error_is_certain: true,
            ..Figures::default()
        }
    }

    #[test]
    fn three_sentences_with_the_crossover() {
        let q = question(Updates::Never, 1000);
        let all = vec![figures("a", 1e9, 1e6, 0.0), figures("b", 1e8, 1e8, 0.0)];
        let text = explain(&rank(all, &q), &q);
        assert_eq!(text.matches(". ").count(), 2, "{text}");
        for part in [
            "a is prepared in 1.00 s",
            "a frame takes 1.00 ms",
            "2.00 s for 1000 frames",
            "b, takes 50.05 times",
            "from 10 frames on",
            "at most 1e-12",
        ] {
            assert!(text.contains(part), "{part} is not in: {text}");
        }
    }

    #[test]
    fn changes_are_told_apart_from_solves() {
        let q = question(Updates::Values, 10);
        let text = explain(&rank(vec![figures("a", 1e6, 1e6, 3e6)], &q), &q);
        assert!(
            text.contains("a frame takes 4.00 ms (3.00 ms to take new values, 1.00 ms to solve)"),
            "{text}"
        );
        assert_eq!(explain(&[], &q), "No backend keeps every rule.");
    }

    #[test]
    fn units() {
        assert_eq!([1234.0, 1.5e6, 2.5e9, 6e12].map(time), ["1.23 us", "1.50 ms", "2.50 s", "100 min"]);
    }
}
