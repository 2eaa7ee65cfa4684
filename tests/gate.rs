//! The gate from outside: exit codes and forms of output, on real processes. Its own test program, one test at a time: a busy
//! neighbour is exactly what the gate refuses to be judged beside.

use assert_cmd::Command;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_lapbench-faulty");
const GOOD: &str = "sphere:3/harmonic/dense/solve";

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// The gate over two programs in a folder without a baseline of counters.
fn gate(base: &Path, head: &Path, arguments: &str) -> Command {
    let mut command = Command::new(PROGRAM);
    command
        .args(["gate", "--baseline", "/nonexistent/counters.json", "--base"])
        .arg(base)
        .arg("--head")
        .arg(head);
    command.args(arguments.split_whitespace()).env_remove("GITHUB_STEP_SUMMARY").env_remove("GITHUB_ACTIONS");
    command
}

fn program() -> PathBuf {
    PROGRAM.into()
}

/// A program around the one under test.
fn script(folder: &TempDir, name: &str, text: &str) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// So little time that no look is reached.
const HARDLY_ANY_TIME: &str = "--time-budget 1s";

#[test]
fn usage_is_2() {
    for arguments in
        ["gate", "gate --base x", "gate --base x --head y --cells nonsense", "gate --time-budget never"]
    {
        Command::new(PROGRAM).args(arguments.split(' ')).assert().code(2);
    }
    let foreign = "gate --base-peer x --head-peer y --cells body:9/harmonic/dense/solve";
    Command::new(PROGRAM).args(foreign.split(' ')).assert().code(2);
    Command::new(PROGRAM)
        .args(["gate", "--base", PROGRAM, "--head", PROGRAM, "--cells", "sphere:3/harmonic"])
        .assert()
        .code(2);
}

#[test]
fn programs_that_are_none_are_1() {
    gate(Path::new("/nonexistent"), &program(), "").assert().code(1);
    gate(Path::new("/bin/echo"), &program(), "").assert().code(1);
    gate(&program(), &program(), "--cells sphere:3/harmonic/no-such-backend").assert().code(1);
    gate(&program(), &program(), "--cells /nonexistent.ply/harmonic/dense").assert().code(1);
}

#[test]
fn crashes_are_1_and_wrong_answers_4() {
    let _alone = alone();
    let cells = |backend: &str| format!("{HARDLY_ANY_TIME} --cells {GOOD},sphere:3/harmonic/{backend}/solve");
    for (backend, code) in [("panics", 1), ("exits", 1), ("wrong", 4), ("wrong-later", 4)] {
        let output = gate(&program(), &program(), &cells(backend)).assert().code(code);
        let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
        assert!(text.contains("FAILED"), "{backend}: {text}");
    }
}

#[test]
fn without_time_nothing_is_said_and_strict_makes_that_5() {
    let _alone = alone();
    let arguments = format!("{HARDLY_ANY_TIME} --cells {GOOD}");
    let output = gate(&program(), &program(), &arguments).assert().code(0);
    assert!(String::from_utf8_lossy(&output.get_output().stdout).contains("INCONCLUSIVE"));
    gate(&program(), &program(), &format!("{arguments} --strict")).assert().code(5);
}

#[test]
fn a_removed_backend_is_3_and_a_new_one_is_welcome() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let without = script(
        &folder,
        "without-exits",
        &format!(
            r#"if [ "$1" = list ]; then {PROGRAM} "$@" | sed 's/"exits"/"other"/'; else exec {PROGRAM} "$@"; fi"#
        ),
    );
    let arguments = format!("{HARDLY_ANY_TIME} --cells {GOOD},sphere:3/harmonic/exits/solve");
    let removed = gate(&program(), &without, &arguments).assert().code(3);
    assert!(String::from_utf8_lossy(&removed.get_output().stdout).contains("REMOVED"));
    let new = gate(&without, &program(), &arguments).assert().code(0);
    assert!(String::from_utf8_lossy(&new.get_output().stdout).contains("NEW"));
}

#[test]
fn other_builds_are_6_unless_allowed() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let debug = script(
        &folder,
        "debug",
        &format!(
            r#"if [ "$1" = list ]; then {PROGRAM} "$@" | sed 's/"release"/"debug"/'; else exec {PROGRAM} "$@"; fi"#
        ),
    );
    let arguments = format!("{HARDLY_ANY_TIME} --cells {GOOD}");
    gate(&debug, &program(), &arguments).assert().code(6);
    gate(&debug, &program(), &format!("{arguments} --allow-env-mismatch")).assert().code(0);
}

#[test]
fn counters_that_grew_are_3_until_the_baseline_is_updated() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let baseline = folder.path().join("counters.json");
    let run = |extra: &str| {
        let mut command = Command::new(PROGRAM);
        command.args(["gate", "--base", PROGRAM, "--head", PROGRAM, "--baseline"]).arg(&baseline);
        command.args(format!("{HARDLY_ANY_TIME} --cells {GOOD} {extra}").split_whitespace()).assert()
    };
    run("--update-baseline").code(0);
    run("").code(0);
    let text = fs::read_to_string(&baseline).unwrap();
    assert!(text.contains("\"factor_nonzeros\""), "{text}");
    let fewer = text.lines().map(|line| match line.split_once("\"factor_nonzeros\": ") {
        Some((indent, _)) => format!("{indent}\"factor_nonzeros\": 1,"),
        None => line.to_owned(),
    });
    fs::write(&baseline, fewer.collect::<Vec<_>>().join("\n")).unwrap();
    let grown = run("").code(3);
    assert!(String::from_utf8_lossy(&grown.get_output().stdout).contains("FAILS"));
    run("--update-baseline").code(0);
    run("").code(0);
}

/// Fill, flops, bytes and allocations of the default cells are what stands in the repository, or less.
#[test]
fn the_committed_counters_hold() {
    let _alone = alone();
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench_results/counters.json");
    let text = fs::read_to_string(&committed).expect("bench_results/counters.json is committed");
    let counters: serde_json::Value = serde_json::from_str(&text).unwrap();
    for cell in lapbench::gate::cell::DEFAULT {
        let (case, _) = cell.rsplit_once('/').unwrap();
        assert!(counters[case]["factor_bytes"].is_u64(), "{case} is not in {}", committed.display());
        assert_eq!(counters[case]["allocations_per_frame"], 0.0, "{case}");
    }
    let mut command = Command::new(PROGRAM);
    command.args(["gate", "--base", PROGRAM, "--head", PROGRAM, "--time-budget", "1s", "--baseline"]);
    let output = command.arg(&committed).assert().code(0);
    let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(text.contains("no counter grew"), "{text}");
}

#[test]
fn a_slower_head_is_3_and_every_report_says_so() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let slower = script(&folder, "slower", &format!("LAPBENCH_INJECT=solve:1.0 exec {PROGRAM} \"$@\""));
    let path = |name: &str| folder.path().join(name);
    let mut command = gate(&program(), &slower, &format!("--time-budget 60s --cells {GOOD}"));
    for (option, name) in [
        ("--out", "gate.json"),
        ("--junit", "junit.xml"),
        ("--markdown", "gate.md"),
        ("--smaller-is-better", "benchmark.json"),
        ("--bencher", "bencher.json"),
    ] {
        command.arg(option).arg(path(name));
    }
    command.env("GITHUB_STEP_SUMMARY", path("summary.md")).env("GITHUB_ACTIONS", "true");
    let output = command.output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    let report: serde_json::Value = serde_json::from_slice(&fs::read(path("gate.json")).unwrap()).unwrap();
    let verdict = report["cells"][0]["verdict"].as_str().unwrap().to_owned();
    // Twice as slow: nothing but a disturbed machine may hide it, and then the report must say so.
    let expected = match verdict.as_str() {
        "REGRESSED" => 3,
        "CONTAMINATED" => 0,
        other => panic!("{other}: {report}"),
    };
    assert_eq!(output.status.code(), Some(expected), "{stderr}");
    assert_eq!(report["exit_code"], expected);
    if verdict == "REGRESSED" {
        let change = report["cells"][0]["evidence"]["estimate"].as_f64().unwrap().exp();
        assert!((1.7..2.4).contains(&change), "{change}");
        assert!(
            stderr.contains("::error title=lapbench gate%3A REGRESSED::sphere:3/harmonic/dense/solve"),
            "{stderr}"
        );
        assert!(fs::read_to_string(path("junit.xml")).unwrap().contains("failures=\"1\""));
    }
    for name in ["gate.md", "summary.md", "junit.xml"] {
        assert!(fs::read_to_string(path(name)).unwrap().contains(&verdict), "{name}");
    }
    for name in ["benchmark.json", "bencher.json"] {
        assert!(fs::read_to_string(path(name)).unwrap().contains(GOOD), "{name}");
    }
}
