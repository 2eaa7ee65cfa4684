//! JUnit: one test case per cell and per counter that changed.

use super::table;
use crate::gate::report::GateReport;
use crate::gate::verdict::Verdict;
use anyhow::Context;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::time::Duration;

/// The report as XML: slower, removed and grown are failures, crashes errors, what stayed open is skipped.
///
/// # Errors
/// Where it cannot be serialised.
pub fn render(report: &GateReport) -> anyhow::Result<String> {
    let mut suite = TestSuite::new("lapbench gate");
    for cell in &report.cells {
        let mut status = match cell.conclusion.verdict {
            Verdict::Regressed | Verdict::Removed => TestCaseStatus::non_success(NonSuccessKind::Failure),
            Verdict::Failed => TestCaseStatus::non_success(NonSuccessKind::Error),
            Verdict::Contaminated | Verdict::Inconclusive => TestCaseStatus::skipped(),
            Verdict::Improved | Verdict::New | Verdict::Same => TestCaseStatus::success(),
        };
        let says = format!("{} {} {}", cell.conclusion.verdict, cell.change(), cell.remark());
        status.set_message(says.trim());
        let mut case = TestCase::new(cell.name.as_str(), status);
        case.set_classname("lapbench.gate");
        case.set_time(Duration::from_nanos(cell.head_ns.unwrap_or(0.0) as u64));
        suite.add_test_case(case);
    }
    for change in &report.counters {
        let mut status = if change.fails {
            TestCaseStatus::non_success(NonSuccessKind::Failure)
        } else {
            TestCaseStatus::success()
        };
        status.set_message(format!("from {} to {}", change.before, change.now));
        let mut case = TestCase::new(format!("{}/{}", change.case, change.counter), status);
        case.set_classname("lapbench.counters");
        suite.add_test_case(case);
    }
    suite.set_time(Duration::from_secs_f64(report.seconds.max(0.0)));
    suite.set_system_out(table::noise(report));
    let mut junit = Report::new("lapbench");
    junit.add_test_suite(suite);
    junit.to_string().context("the JUnit report")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;

    #[test]
    fn verdicts_become_states() {
        use Verdict::*;
        let xml = render(&report(&[Same, Regressed, Inconclusive, Failed])).unwrap();
        assert!(
            xml.contains("tests=\"4\"") && xml.contains("failures=\"1\"") && xml.contains("errors=\"1\""),
            "{xml}"
        );
        assert_eq!(xml.matches("<skipped").count(), 1);
        assert!(xml.contains("&lt;b&gt;&amp;|0"), "{xml}");
    }
}
