//! `choose`, `cost-model`, `compare`, `trend` and `doctor` from outside.

use super::lapbench;
use serde_json::Value;

fn json(arguments: &str) -> (i32, Value) {
    let output = lapbench(&format!("{arguments} --format json"));
    let text = String::from_utf8_lossy(&output.stdout);
    let value = serde_json::from_str(&text)
        .unwrap_or_else(|e| panic!("{arguments}: {e}: {}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code().expect("an exit code"), value)
}

fn rule<'a>(answer: &'a Value, backend: &str) -> Option<&'a str> {
    let excluded = answer["excluded"].as_array().expect("rows");
    excluded.iter().find(|row| row["backend"] == backend).and_then(|row| row["rule"].as_str())
}

#[test]
fn a_choice_keeps_the_rules_and_gives_its_evidence() {
    let (code, answer) =
        json("choose --mesh sphere:3 --frames 100 --threads 1 --accuracy 1e-8 --gpu no --licence permissive");
    assert_eq!((code, answer["predicted"].as_bool()), (0, Some(false)));
    let ranked = answer["ranked"].as_array().expect("rows");
    assert!(ranked.len() >= 2 && ranked[0]["figures"]["backend"] == answer["choice"], "{answer}");
    let totals: Vec<f64> = ranked.iter().filter_map(|r| r["total"].as_f64()).collect();
    assert!(totals.is_sorted() && totals.len() == ranked.len(), "{totals:?}");
    for row in ranked {
        let figures = &row["figures"];
        assert!(figures["error"].as_f64().is_some_and(|e| e <= 1e-8), "{figures}");
        assert!(
            figures["solves"].as_u64().is_some_and(|n| n > 0) && figures["peak_bytes"].is_u64(),
            "{figures}"
        );
    }
    // A wrong answer is never chosen, a missing device is said, a slow one is slow.
    assert_eq!(rule(&answer, "wrong"), Some("accuracy"));
    assert_eq!(rule(&answer, "absent"), Some("unavailable"));
    assert_eq!(rule(&answer, "framechol-f32"), Some("accuracy"));
    assert_ne!(answer["choice"], "slow");
    assert_eq!(answer["explanation"].as_str().map(|text| text.matches(". ").count()), Some(2), "{answer}");
    assert!(answer["program"].as_str().is_some_and(|p| p.contains("registry::find")));
}

#[test]
fn changes_count_into_the_total() {
    for updates in ["values", "constraints"] {
        let (code, answer) =
            json(&format!("choose --mesh sphere:3 --frames 50 --threads 1 --updates {updates}"));
        assert_eq!(code, 0);
        let first = &answer["ranked"][0];
        let cost = &first["figures"]["cost"];
        let of = |name: &str| cost[name].as_f64().expect("a number");
        assert!(of("change") > 0.0);
        let total = of("set_up") + of("first") + 49.0 * (of("solve") + of("change"));
        assert!((first["total"].as_f64().expect("a number") / total - 1.0).abs() < 1e-9, "{first}");
    }
}

#[test]
fn a_choice_that_cannot_be_made_is_exit_code_1_and_says_why() {
    let (code, answer) = json("choose --mesh sphere:2 --frames 2 --threads 1 --budget-ms 0.000001");
    assert_eq!((code, &answer["choice"]), (1, &Value::Null));
    assert_eq!(rule(&answer, "framechol-f64"), Some("deadline"));
    let (code, answer) = json("choose --mesh sphere:2 --frames 2 --threads 1 --max-memory 1MB");
    assert_eq!((code, rule(&answer, "framechol-f64")), (1, Some("memory")));
    let (code, answer) = json("choose --mesh sphere:2 --threads 1 --gpu yes --quick");
    assert_eq!((code, rule(&answer, "framechol-f64")), (1, Some("gpu")));
    assert_eq!(lapbench("choose --mesh absent.ply").status.code(), Some(1));
    assert_eq!(lapbench("choose --mesh sphere:2 --accuracy 2").status.code(), Some(2));
    assert_eq!(
        lapbench("choose --mesh sphere:2 --workload poisson --updates constraints").status.code(),
        Some(1)
    );
}

#[test]
fn predictions_say_so_and_how_far_they_are_off() {
    let output = lapbench("choose --mesh sphere:3 --threads 1 --quick");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("PREDICTED") && text.contains("factors"), "{text}");
    let (_, answer) = json("choose --mesh sphere:3 --threads 1 --quick");
    assert_eq!(answer["predicted"], true);
    assert!(answer["prediction_errors"]["solve"]["p90"].as_f64().is_some_and(|f| f > 1.0), "{answer}");
}

#[test]
fn a_single_file_ranks_its_backends() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json").display().to_string();
    let run = format!(
        "run --quick --mesh sphere:2 --workload harmonic --threads 1 --cell-time 0.3 --backend dense,slow --out {out}"
    );
    assert_eq!(lapbench(&run).status.code(), Some(0));
    let (code, pairs) = json(&format!("compare {out}"));
    assert_eq!((code, &pairs[0]["backend"], &pairs[1]["backend"]), (0, &"dense".into(), &"slow".into()));
    assert!(
        pairs[1]["ratio_low"].as_f64().is_some_and(|r| r > 2.0) && pairs[1]["verdict"] == "slower",
        "{pairs}"
    );
}

#[test]
fn other_machines_do_not_compare_unless_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (here, there) = (folder.path().join("here.json"), folder.path().join("there.json"));
    let run =
        "run --quick --mesh sphere:2 --workload harmonic --threads 1 --cell-time 0.1 --backend dense --out";
    assert_eq!(lapbench(&format!("{run} {}", here.display())).status.code(), Some(0));
    let text =
        std::fs::read_to_string(&here).expect("text").replacen("\"cpu\":", "\"cpu\":\"other\",\"x\":", 1);
    std::fs::write(&there, text).expect("written");
    let compare = format!("compare {} {} {}", here.display(), here.display(), there.display());
    assert_eq!(lapbench(&compare).status.code(), Some(6));
    for format in ["human", "csv", "markdown"] {
        let output = lapbench(&format!("{compare} --allow-env-mismatch --format {format}"));
        assert_eq!(output.status.code(), Some(0));
        assert!(String::from_utf8_lossy(&output.stdout).contains("there.json"));
    }
    let (_, pairs) = json(&format!("{compare} --allow-env-mismatch"));
    assert_eq!(pairs.as_array().map(Vec::len), Some(2));
    // The same file twice: no change, and an interval around 1.
    assert!(
        pairs[0]["ratio_low"].as_f64() <= Some(1.0) && pairs[0]["ratio_high"].as_f64() >= Some(1.0),
        "{pairs}"
    );
}

#[test]
fn trends_are_read_from_folders() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let day = folder.path().join("2026-01-01-here");
    let run = format!(
        "run --quick --mesh sphere:2 --workload harmonic --threads 1 --cell-time 0.05 --backend dense --out {}",
        day.join("a.json").display()
    );
    assert_eq!(lapbench(&run).status.code(), Some(0));
    let plot = folder.path().join("trend.svg");
    let arguments = format!("trend {} --plot {}", folder.path().display(), plot.display());
    let (code, series) = json(&arguments);
    assert_eq!((code, series.as_array().map(Vec::len)), (0, Some(1)));
    assert!(std::fs::read_to_string(&plot).expect("a picture").starts_with("<svg"));
    assert_eq!(lapbench("trend /no/such/folder").status.code(), Some(1));
    let empty = tempfile::tempdir().expect("a temporary folder");
    let output = lapbench(&format!("trend {}", empty.path().display()));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--out"));
}

#[test]
fn a_machine_that_tells_nothing_is_no_panic() {
    let empty = tempfile::tempdir().expect("a temporary folder");
    let (code, report) = json(&format!("doctor --seconds 0 --root {}", empty.path().display()));
    assert_eq!(code, 0);
    let findings = report["findings"].as_array().expect("rows");
    let of = |subject: &str| findings.iter().find(|f| f["subject"] == subject).expect("a finding");
    assert_eq!((&of("governor")["found"], &of("governor")["good"]), (&"unknown".into(), &Value::Null));
    assert_eq!(of("Vulkan loader")["good"], false);
    assert!(
        findings.iter().all(|f| f["good"] != false || f["remedy"].as_str().is_some_and(|r| !r.is_empty()))
    );
}

#[test]
fn the_noise_floor_is_measured() {
    let (code, report) = json("doctor --seconds 0.3");
    let findings = report["findings"].as_array().expect("rows");
    let of = |subject: &str| findings.iter().find(|f| f["subject"] == subject).expect("a finding");
    assert_eq!(code, 0);
    assert!(
        of("noise floor")["found"].as_str().is_some_and(|text| text.starts_with("A/A: half of")),
        "{report}"
    );
    assert!(of("memory bandwidth")["found"].as_str().is_some_and(|text| text.contains("1: ")), "{report}");
}
