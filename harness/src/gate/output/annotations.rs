//! GitHub workflow commands: what a reviewer sees beside the change.

use crate::gate::report::{GateReport, percent};
use crate::gate::verdict::Verdict;

/// One line per cell or counter that needs eyes.
pub fn render(report: &GateReport) -> String {
    let mut lines = String::new();
    for cell in &report.cells {
        let level = match cell.conclusion.verdict {
            Verdict::Regressed | Verdict::Removed | Verdict::Failed => "error",
            Verdict::Contaminated | Verdict::Inconclusive => "warning",
            Verdict::Improved | Verdict::New | Verdict::Same => continue,
        };
        let says = format!("{} {} {}", cell.name, cell.change(), cell.remark());
        lines += &line(level, &format!("lapbench gate: {}", cell.conclusion.verdict), says.trim());
    }
    for change in report.counters.iter().filter(|change| change.fails) {
        let grown = percent(change.now / change.before - 1.0);
        let says = format!(
            "{}: {} grew from {} to {} ({grown}); update the baseline in this change if that is meant",
            change.case, change.counter, change.before, change.now
        );
        lines += &line("error", "lapbench gate: counter grew", &says);
    }
    lines
}

/// `::error title=..::..` with the characters escaped that would end a property or the command.
fn line(level: &str, title: &str, message: &str) -> String {
    let data = |text: &str| text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A");
    let property = |text: &str| data(text).replace(':', "%3A").replace(',', "%2C");
    format!("::{level} title={}::{}\n", property(title), data(message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;

    #[test]
    fn only_what_needs_eyes() {
        let text = render(&report(&[Verdict::Same, Verdict::Regressed, Verdict::Inconclusive]));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2);
        assert!(lines[0].starts_with("::error title=lapbench gate%3A REGRESSED::body:9/"), "{text}");
        assert!(lines[0].contains("+5.1%25"));
        assert!(lines[1].starts_with("::warning "));
    }

    #[test]
    fn a_message_cannot_start_a_command_of_its_own() {
        assert_eq!(line("error", "t", "a\n::error::b"), "::error title=t::a%0A::error::b\n");
    }
}
