//! Cells as JUnit test cases, for the test reports of continuous integration.

use super::view::{View, steady};
use crate::record::names::Status;
use crate::record::result::{Cell, ResultFile};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::time::Duration;

/// One suite per mesh and workload, one test case per solver: a wrong answer is a failure, what broke is an error, what
/// is not there or does not do this is skipped. The time of a case is the median of its frames or solves.
///
/// # Errors
/// Where the result cannot be written as XML.
pub fn junit(results: &[(String, ResultFile)]) -> anyhow::Result<String> {
    let mut report = Report::new("lapbench");
    for (name, result) in results {
        let view = View::new(result);
        for group in &view.groups {
            let mut suite = TestSuite::new(format!("{name}: {}", group.title()));
            suite.add_test_cases(group.cells.iter().map(|cell| test_case(&view.label(cell), cell)));
            report.add_test_suite(suite);
        }
    }
    Ok(report.to_string()?)
}

fn test_case(label: &str, cell: &Cell) -> TestCase {
    let mut status = match cell.status {
        Status::Ok => TestCaseStatus::success(),
        Status::Invalid => TestCaseStatus::non_success(NonSuccessKind::Failure),
        Status::Error | Status::Oom | Status::Timeout => TestCaseStatus::non_success(NonSuccessKind::Error),
        Status::NotConverged | Status::Unavailable | Status::Unsupported => TestCaseStatus::skipped(),
    };
    if cell.status != Status::Ok {
        status.set_type(cell.status.name());
        status.set_message(cell.reason.as_deref().unwrap_or("no reason given"));
    }
    let mut case = TestCase::new(label, status);
    case.set_classname(format!("{}.{}", cell.mesh.name, cell.workload));
    if let Some(ns) = steady(cell).p50 {
        case.set_time(Duration::from_nanos(ns));
    }
    case
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_become_failures_errors_and_skips() {
        let cell = |backend: &str, status| Cell {
            backend: backend.into(),
            status,
            reason: Some("a <b> & c\u{1}".into()),
            ..Cell::default()
        };
        let result = ResultFile {
            schema_version: "1.1".into(),
            command: String::new(),
            quotable: true,
            environment: Default::default(),
            cells: vec![
                cell("good", Status::Ok),
                cell("wrong", Status::Invalid),
                cell("broken", Status::Error),
                cell("absent", Status::Unavailable),
            ],
        };
        let xml = junit(&[("r.json".into(), result)]).unwrap();
        assert!(
            xml.contains(r#"tests="4" skipped="1" failures="1" errors="1""#)
                || xml.contains(r#"tests="4" skipped="1" errors="1" failures="1""#),
            "{xml}"
        );
        assert!(xml.contains("a &lt;b&gt; &amp; c") && !xml.contains('\u{1}'), "{xml}");
    }
}
