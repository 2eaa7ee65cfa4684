//! All tests of the workspace, with the reference programs in reach, and a closing summary.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};

use crate::{TestOptions, cache, python, shell, system};

/// Test runs: the workspace with its default features (doc tests included), then the kill table of deliberately broken
/// variants and the feature sets of lapsolve, which the first run leaves out.
const RUNS: [&[&str]; 4] = [
    &["--workspace"],
    &["--package", "lapbench", "--features", "mutants", "--lib", "verify::mutants"],
    &["--package", "lapsolve", "--no-default-features"],
    &["--package", "lapsolve", "--features", "sprs-ldl"],
];

/// Sets up, runs every test even after a failure, prints a summary and fails if any test did.
pub fn run(options: &TestOptions) -> anyhow::Result<()> {
    let variables = environment(options)?;
    let mut summary = Vec::new();
    let mut failed = Vec::new();
    for run in RUNS {
        let mut command = shell::cargo(&["test", "--release", "--no-fail-fast"]);
        command.args(run).envs(variables.iter().map(|(name, value)| (name, value)));
        let line = shell::line(&command);
        summary.push(format!("cargo test {}", run.join(" ")));
        if !tee(&mut command, &mut summary)? {
            failed.push(line);
        }
    }
    println!("\nSummary");
    summary.iter().for_each(|line| println!("{line}"));
    if !failed.is_empty() {
        bail!("tests failed:\n  {}", failed.join("\n  "));
    }
    Ok(())
}

/// Where the tests find the references and peers, and what must not be skipped.
fn environment(options: &TestOptions) -> anyhow::Result<Vec<(&'static str, PathBuf)>> {
    let mut variables = Vec::new();
    if !options.no_setup {
        system::install(system::FOR_TESTS)?;
        system::install_optional(system::FOR_BROWSER);
        variables.push(("LAPBENCH_REFERENCE", python::install()?));
    }
    variables.push(("LAPBENCH_CACHE", cache::folder()?));
    if let Some(require) = &options.require {
        variables.push(("LAPBENCH_REQUIRE", require.into()));
    }
    Ok(variables)
}

/// Runs the tests, shows their output as it comes and keeps the lines of the summary: results, failures, skips.
fn tee(command: &mut Command, summary: &mut Vec<String>) -> anyhow::Result<bool> {
    eprintln!("xtask: {}", shell::line(command));
    let mut child = command.stdout(Stdio::piped()).spawn().context("cannot start cargo")?;
    let output = child.stdout.take().expect("stdout is piped");
    for line in BufReader::new(output).split(b'\n') {
        let line = line?;
        let text = String::from_utf8_lossy(&line);
        let mut out = std::io::stdout().lock();
        writeln!(out, "{text}")?;
        if text.starts_with("test result:") || text.contains("SKIPPED") || text.ends_with("... FAILED") {
            summary.push(format!("  {text}"));
        }
    }
    Ok(child.wait()?.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_failures_and_skips_are_kept_and_the_exit_status_counts() {
        let script = "echo noise; echo 'SKIPPED a: no data'; echo 'test a::b ... FAILED'; echo 'test result: FAILED. 3'";
        let mut summary = Vec::new();
        assert!(tee(&mut shell::command("sh", &["-c", script]), &mut summary).unwrap());
        assert_eq!(summary, ["  SKIPPED a: no data", "  test a::b ... FAILED", "  test result: FAILED. 3"]);
        assert!(!tee(&mut shell::command("sh", &["-c", "exit 101"]), &mut summary).unwrap());
    }
}
