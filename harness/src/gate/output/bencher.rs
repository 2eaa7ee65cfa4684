//! Bencher Metric Format: `{cell: {latency: {value, lower_value, upper_value}}}`, nanoseconds.

use crate::gate::report::GateReport;
use serde_json::{Map, Value, json};

/// Head's times; the bounds are as far away as the ends of the interval are from the estimate.
pub fn render(report: &GateReport) -> Value {
    let mut cells = Map::new();
    for cell in &report.cells {
        let Some(ns) = cell.head_ns else { continue };
        let mut latency = json!({ "value": ns });
        if let Some(e) = cell.conclusion.evidence {
            latency["lower_value"] = json!(ns * (e.low - e.estimate).exp());
            latency["upper_value"] = json!(ns * (e.high - e.estimate).exp());
        }
        cells.insert(cell.name.clone(), json!({ "latency": latency }));
    }
    Value::Object(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::report::tests::report;
    use crate::gate::verdict::Verdict;

    #[test]
    fn the_documented_form() {
        let value = render(&report(&[Verdict::Same]));
        let (_, cell) = value.as_object().unwrap().iter().next().unwrap();
        let bound = |name: &str| cell["latency"][name].as_f64().unwrap();
        assert!(bound("lower_value") < bound("value") && bound("value") < bound("upper_value"), "{value}");
    }
}
