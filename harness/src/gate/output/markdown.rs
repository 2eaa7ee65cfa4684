//! The report for a job summary or a comment.

use super::table;
use crate::cmd::output::Format;
use crate::gate::report::GateReport;
use crate::gate::verdict::Verdict;
use crate::report::rows::Rows;

/// GitHub drops a step summary of over 1 MiB without a word; this leaves room for what other steps wrote.
pub const MOST_BYTES: usize = 900 << 10;

/// The report, [`MOST_BYTES`] at most; what does not fit is counted.
pub fn render(report: &GateReport) -> String {
    let head = format!("## lapbench gate: {}\n\n{}\n\n", headline(report), table::summary(report));
    let mut tail = String::new();
    if !report.counters.is_empty() {
        tail += &format!("\n### Counters\n\n{}", capped(table::counters(report), MOST_BYTES / 4));
    }
    tail +=
        &format!("\n<details><summary>Noise and method</summary>\n\n{}\n", escaped(&table::noise(report)));
    tail += &format!(
        "Base `{}`, head `{}`, interleaved in fresh processes, {} threads, margin {}%, equivalence {}%.\n\n</details>\n",
        report.base.name.replace('`', "'"),
        report.head.name.replace('`', "'"),
        report.threads,
        100.0 * report.rules.margin,
        100.0 * report.rules.equivalence
    );
    let room = MOST_BYTES.saturating_sub(head.len() + tail.len());
    let text = head + &capped(table::cells(report), room) + &tail;
    cut(text, MOST_BYTES)
}

fn headline(report: &GateReport) -> &'static str {
    let any = |verdict| report.with_verdict(verdict).next().is_some();
    let grown = report.counters.iter().any(|change| change.fails);
    if any(Verdict::Failed) || report.cases.iter().any(|case| !case.faults.is_empty()) {
        "failed"
    } else if any(Verdict::Regressed) || any(Verdict::Removed) || grown {
        "regressed"
    } else if any(Verdict::Contaminated) || any(Verdict::Inconclusive) {
        "not everything could be decided"
    } else {
        "passed"
    }
}

/// As many rows as fit into `most` bytes, and how many do not.
fn capped(mut rows: Rows, most: usize) -> String {
    rows.rows.iter_mut().flatten().for_each(|cell| *cell = escaped(cell));
    let all = rows.rows.len();
    loop {
        let text = rows.render(Format::Markdown);
        if text.len() <= most || rows.rows.is_empty() {
            let left_out = all - rows.rows.len();
            let note = format!("\n{left_out} more rows do not fit; see the JSON report.\n");
            return if left_out > 0 { text + &note } else { text };
        }
        rows.rows.truncate(rows.rows.len() / 2);
    }
}

/// Names of files and messages of foreign programs as text, never as markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn cut(mut text: String, most: usize) -> String {
    let mut end = most.min(text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.truncate(end);
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;

    #[test]
    fn names_stay_text() {
        let text = render(&report(&[Verdict::Regressed]));
        assert!(text.starts_with("## lapbench gate: regressed"), "{text}");
        assert!(text.contains("&lt;b&gt;&amp;\\|0"), "{text}");
        assert!(!text.contains("<b>"));
    }

    #[test]
    fn however_many_cells_it_fits() {
        let text = render(&report(&vec![Verdict::Same; 20_000]));
        assert!(text.len() <= MOST_BYTES && text.len() > MOST_BYTES / 8, "{}", text.len());
        assert!(text.contains("more rows do not fit"));
    }
}
