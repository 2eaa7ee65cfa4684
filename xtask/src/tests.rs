//! All tests of the workspace, with the reference programs in reach, and a closing summary.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};

use crate::{TestOptions, cache, python, shell, system};

/// Test runs: the workspace with its default features (doc tests included), then the feature sets of lapsolve that
/// the first run leaves out.
const RUNS: [&[&str]; 3] = [
    &["--workspace"],
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
