//! github-action-benchmark's `customSmallerIsBetter`: head's times for its charts.

use crate::gate::report::GateReport;
use serde_json::{Value, json};

/// One entry per measured cell: name, unit, value, and the interval of the change.
pub fn render(report: &GateReport) -> Value {
    let entry = |cell: &crate::gate::report::CellReport| {
        let ns = cell.head_ns?;
        let half = cell.conclusion.evidence.map(|e| 0.5 * (e.high.exp() - e.low.exp()) * ns * 1e-6);
        Some(json!({
            "name": cell.name,
            "unit": "ms",
            "value": ns * 1e-6,
            "range": half.map(|half| format!("± {half:.4}")).unwrap_or_default(),
            "extra": format!("{} {}", cell.conclusion.verdict, cell.interval()).trim_end(),
        }))
    };
    Value::Array(report.cells.iter().filter_map(entry).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;
    use crate::gate::verdict::Verdict;

    #[test]
    fn the_documented_form() {
        let value = render(&report(&[Verdict::Same]));
        assert_eq!(value[0]["unit"], "ms");
        assert!((value[0]["value"].as_f64().unwrap() - 1.05).abs() < 1e-12);
        assert!(value[0]["name"].is_string() && value[0]["range"].as_str().unwrap().starts_with('±'));
    }
}
