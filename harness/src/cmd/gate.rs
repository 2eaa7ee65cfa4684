//! `gate`: is head slower than base? For continuous integration on machines that are not quiet.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::exit::Exit;
use crate::file;
use crate::gate::cell::{Case, Cell, DEFAULT, DEFAULT_FOREIGN};
use crate::gate::output::{annotations, bencher, benchmark_action, junit, markdown, table};
use crate::gate::report::GateReport;
use crate::gate::run::{Done, Order};
use crate::gate::side::{self, Program};
use crate::gate::simulation::{recorded, recorded::Recording, table as proof};
use crate::gate::{builds, counters, run as gate_run};
use anyhow::Context as _;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Judge whether one build is slower than another, interleaved on this machine (for continuous integration)
///
/// Base and head run in turn in fresh processes, A B B A. A cell is REGRESSED where the interval of the change clears the margin of 2%
/// and a fresh repetition agrees; SAME within 3%; CONTAMINATED where a control kernel moved; else INCONCLUSIVE, with the change that
/// would have been found. Counters without noise (fill, flops, bytes, allocations, iterations) stand in front.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The program to compare with: a build of lapbench
    #[arg(long, value_name = "BIN", requires = "head", conflicts_with_all = ["base_rev", "base_peer"])]
    base: Option<PathBuf>,
    /// The program to judge: a build of lapbench
    #[arg(long, value_name = "BIN")]
    head: Option<PathBuf>,
    /// Build base from this revision, and head from the working tree unless --head is given
    #[arg(long, value_name = "REV", conflicts_with = "base_peer")]
    base_rev: Option<String>,
    /// A foreign solver to compare with: of the catalogue, NAME=COMMAND, or a command
    #[arg(long, value_name = "COMMAND", requires = "head_peer", conflicts_with = "head")]
    base_peer: Option<String>,
    /// The foreign solver to judge
    #[arg(long, value_name = "COMMAND", requires = "base_peer")]
    head_peer: Option<String>,
    /// What to judge: MESH/WORKLOAD/BACKEND/setup|solve|frame; without BACKEND for foreign solvers [default: six cells on
    /// body:50000 and body:100000]
    #[arg(long, value_name = "CELL", value_delimiter = ',')]
    cells: Vec<Cell>,
    /// Time for everything but builds: 240, 90s, 4m
    #[arg(long, value_name = "TIME", default_value = "4m", value_parser = duration)]
    time_budget: Duration,
    /// Threads of every process: one is least disturbed
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: u16,
    /// Seed of the order of cells within rounds
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// The committed counters
    #[arg(long, value_name = "FILE.json", default_value = "bench_results/counters.json")]
    baseline: PathBuf,
    /// Write head's counters there: commit the file with the change that moved them
    #[arg(long)]
    update_baseline: bool,
    /// End in exit code 5 where a cell is INCONCLUSIVE or CONTAMINATED
    #[arg(long)]
    strict: bool,
    /// Compare although compiler, flags or profile differ
    #[arg(long)]
    allow_env_mismatch: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// The whole report, with every time
    #[arg(long, value_name = "FILE.json", help_heading = "Files")]
    out: Option<PathBuf>,
    /// For job summaries and comments; also appended to $GITHUB_STEP_SUMMARY where that is set
    #[arg(long, value_name = "FILE.md", help_heading = "Files")]
    markdown: Option<PathBuf>,
    /// JUnit
    #[arg(long, value_name = "FILE.xml", help_heading = "Files")]
    junit: Option<PathBuf>,
    /// github-action-benchmark's customSmallerIsBetter
    #[arg(long, value_name = "FILE.json", help_heading = "Files")]
    smaller_is_better: Option<PathBuf>,
    /// Bencher Metric Format
    #[arg(long, value_name = "FILE.json", help_heading = "Files")]
    bencher: Option<PathBuf>,
    /// Noise of this run of two identical programs, for --noise
    #[arg(long, value_name = "FILE.json", help_heading = "Proof")]
    noise_out: Option<PathBuf>,
    /// Measure nothing: simulate so many gate runs under every kind of noise and print how often they say what
    #[arg(long, value_name = "RUNS", help_heading = "Proof", conflicts_with_all = ["base", "head", "base_rev", "base_peer"])]
    simulate: Option<usize>,
    /// Recorded noise for --simulate [default: A/A runs of a shared two-core machine]
    #[arg(long, value_name = "FILE.json", help_heading = "Proof", requires = "simulate")]
    noise: Option<PathBuf>,
}

/// 240, 240s, 4m, 0.1h.
fn duration(text: &str) -> Result<Duration, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 's')) => (&text[..at], 1.0),
        Some((at, 'm')) => (&text[..at], 60.0),
        Some((at, 'h')) => (&text[..at], 3600.0),
        _ => (text, 1.0),
    };
    let seconds =
        number.trim().parse::<f64>().map_err(|_| "expected seconds, or a number with s, m or h")? * unit;
    if (1.0..=86_400.0).contains(&seconds) {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err("must be between a second and a day".into())
    }
}

/// Measures, writes every file that is asked for, prints.
///
/// # Errors
/// Programs that cannot be started or built, cells that neither has, files that cannot be read or written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    if let Some(runs) = args.simulate {
        return simulate(args, runs);
    }
    let Some((base, head)) = programs(args)? else {
        eprintln!(
            "error: give --base and --head, --base-rev, or --base-peer and --head-peer; see `lapbench gate --help`"
        );
        return Ok(Exit::Usage);
    };
    let foreign = matches!(base, Program::Foreign(_));
    let cells = match args.cells(foreign) {
        Ok(cells) => cells,
        Err(problem) => {
            eprintln!("error: {problem}");
            return Ok(Exit::Usage);
        }
    };
    let mismatches = side::mismatches(base.record(), head.record());
    if !mismatches.is_empty() {
        eprintln!("base and head are built differently: {}", mismatches.join("; "));
        if !args.allow_env_mismatch {
            eprintln!(
                "their times would tell that, not the change; --allow-env-mismatch compares them anyway"
            );
            return Ok(Exit::Incomparable);
        }
    }
    let order = Order {
        base: &base,
        head: &head,
        cases: Case::group(&cells),
        threads: args.threads.into(),
        budget: args.time_budget,
        seed: args.seed,
        baseline: (!foreign).then_some(args.baseline.as_path()),
        backends: &context.backends,
    };
    let Done { mut report, counters } = gate_run::run(&order, &mut progress())?;
    if args.update_baseline {
        counters::update(&args.baseline, &counters)?;
        report.counters.retain(|change| !change.fails);
        eprintln!("{}: updated; commit it with the change", args.baseline.display());
    }
    let exit = report.exit(args.strict);
    report.command = std::env::args().collect::<Vec<_>>().join(" ");
    (report.exit_code, report.exit) = (exit.code(), exit.to_string());
    write_files(args, &report)?;
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&report)?,
        Format::Markdown => markdown::render(&report),
        format => table::render(&report, format),
    })?;
    Ok(exit)
}

/// Base and head; `None` where they are not said.
fn programs(args: &Args) -> anyhow::Result<Option<(Program, Program)>> {
    Ok(match (&args.base, &args.head, &args.base_rev, &args.base_peer, &args.head_peer) {
        (Some(base), Some(head), ..) => Some((Program::build(base)?, Program::build(head)?)),
        (None, head, Some(revision), ..) => {
            let built = builds::build(revision, head.is_none())?;
            let head = head.as_ref().or(built.head.as_ref()).context("head is built or given")?;
            Some((Program::build(&built.base)?, Program::build(head)?))
        }
        (.., Some(base), Some(head)) => Some((Program::foreign(base)?, Program::foreign(head)?)),
        _ => None,
    })
}

impl Args {
    fn cells(&self, foreign: bool) -> Result<Vec<Cell>, String> {
        let defaults: &[&str] = if foreign { &DEFAULT_FOREIGN } else { &DEFAULT };
        let cells = match self.cells.as_slice() {
            [] => defaults.iter().map(|name| name.parse()).collect::<Result<Vec<Cell>, String>>()?,
            given => given.to_vec(),
        };
        match cells.iter().find(|cell| cell.backend.is_none() != foreign) {
            Some(_) if foreign => {
                Err("cells of foreign solvers have no backend: MESH/WORKLOAD/MEASURE".into())
            }
            Some(_) => Err("cells need a backend: MESH/WORKLOAD/BACKEND/MEASURE".into()),
            None => Ok(cells),
        }
    }
}

/// Steps on stderr: one line that is rewritten on a terminal, the large steps only elsewhere.
fn progress() -> impl FnMut(&str) {
    let terminal = std::io::stderr().is_terminal();
    let mut last = String::new();
    move |step: &str| {
        let kind = step.split(' ').next().unwrap_or_default().to_owned();
        if terminal {
            eprint!("\r\x1b[K{step}");
            let _ = std::io::stderr().flush(); // progress only
        } else if kind != last {
            eprintln!("{step}");
        }
        last = kind;
    }
}

fn write_files(args: &Args, report: &GateReport) -> anyhow::Result<()> {
    if std::io::stderr().is_terminal() {
        eprint!("\r\x1b[K");
    }
    let write = |path: &Option<PathBuf>, text: &dyn Fn() -> anyhow::Result<String>| -> anyhow::Result<()> {
        let Some(path) = path else { return Ok(()) };
        let text = text()?;
        Ok(file::write_atomically(path, |out| out.write_all(text.as_bytes()))?)
    };
    write(&args.out, &|| Ok(serde_json::to_string(report)? + "\n"))?;
    write(&args.markdown, &|| Ok(markdown::render(report)))?;
    write(&args.junit, &|| junit::render(report))?;
    write(&args.smaller_is_better, &|| Ok(serde_json::to_string_pretty(&benchmark_action::render(report))?))?;
    write(&args.bencher, &|| Ok(serde_json::to_string_pretty(&bencher::render(report))?))?;
    write(&args.noise_out, &|| Ok(recorded::of_report(report)?))?;
    if let Some(path) = std::env::var_os("GITHUB_STEP_SUMMARY").filter(|path| !path.is_empty()) {
        append(Path::new(&path), &markdown::render(report))?;
    }
    if std::env::var_os("GITHUB_ACTIONS").is_some_and(|value| value == "true") {
        eprint!("{}", annotations::render(report)); // the runner reads both streams; stdout is data
    }
    Ok(())
}

fn append(path: &Path, text: &str) -> anyhow::Result<()> {
    let open = || std::fs::OpenOptions::new().create(true).append(true).open(path);
    open()
        .and_then(|mut out| out.write_all(text.as_bytes()))
        .with_context(|| format!("cannot write {}", path.display()))
}

fn simulate(args: &Args, runs: usize) -> Outcome {
    let recording = args.noise.as_deref().map_or_else(|| Ok(Recording::built_in()), Recording::read)?;
    let rows = proof::simulate(runs, &recording, args.seed);
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&rows)?,
        format => proof::rows(&rows).render(format),
    })?;
    Ok(Exit::Ok)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read() {
        let seconds = |text: &str| duration(text).map(|d| d.as_secs_f64());
        assert_eq!((seconds("240"), seconds("4m"), seconds("0.5h")), (Ok(240.0), Ok(240.0), Ok(1800.0)));
        for wrong in ["", "m", "-4m", "0", "NaN", "1e9h", "4 apples"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }
}
