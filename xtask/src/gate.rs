//! What the gate is worth: simulated runs, and real runs of two builds of which one is slowed down on purpose.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use serde_json::Value;

use crate::{shell, splice};

/// Where the real runs are recorded, a line for each cell of each run.
const RECORD: &str = "bench_results/gate-runs.csv";

const COLUMNS: &str =
    "time,machine,load,head_percent,neighbour,cell,slowed,verdict,change,low,high,couples,seconds,exit_code";

/// What a run judges unless told otherwise: solves that the slow-down reaches, and a set-up that it does not.
const CELLS: &str = "body:50000/harmonic/framechol-f64/setup,body:50000/harmonic/framechol-f64/solve,\
body:50000/poisson/framechol-mixed/solve";

/// Real runs to be made.
#[derive(clap::Args)]
pub struct Runs {
    /// By how much the solves of head are slower, in percent; below 0 they are faster, 0 compares a build with itself
    #[arg(long, default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-50..=200))]
    head: i32,
    /// Number of runs; 0 only writes the table anew
    #[arg(long, default_value_t = 1)]
    times: u32,
    /// A thread of this program works all the time
    #[arg(long)]
    neighbour: bool,
    /// A program without the feature `inject`, instead of building one
    #[arg(long, requires = "slowed")]
    plain: Option<PathBuf>,
    /// One with it
    #[arg(long, requires = "plain")]
    slowed: Option<PathBuf>,
    /// Cells to judge
    #[arg(long, default_value = CELLS)]
    cells: String,
    /// Time of a run
    #[arg(long, default_value = "90s")]
    time_budget: String,
}

/// Simulates and writes the table into METHODOLOGY.
pub fn simulation(runs: usize) -> anyhow::Result<()> {
    let runs = runs.to_string();
    let mut command = shell::cargo(&["run", "--release", "--quiet", "--package", "lapbench", "--", "gate"]);
    let output = command.args(["--simulate", &runs, "--format", "markdown"]).output()?;
    if !output.status.success() {
        bail!("{}: {}", shell::line(&command), String::from_utf8_lossy(&output.stderr));
    }
    splice::into("METHODOLOGY.md", "gate-simulation", &String::from_utf8(output.stdout)?)
}

/// Builds, runs, records, and writes the table of all recorded runs into METHODOLOGY.
pub fn runs(runs: &Runs) -> anyhow::Result<()> {
    if runs.times > 0 {
        let [plain, slowed] = match (&runs.plain, &runs.slowed) {
            (Some(plain), Some(slowed)) => [plain.clone(), slowed.clone()],
            _ => [build("plain", &[])?, build("slowed", &["--features", "inject"])?],
        };
        for run in 1..=runs.times {
            eprintln!("xtask: run {run} of {}", runs.times);
            record(runs, &one(runs, &plain, &slowed)?)?;
        }
    }
    let path = shell::root().join(RECORD);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {RECORD}"))?;
    splice::into("METHODOLOGY.md", "gate-runs", &table(&text)?)
}

/// The program with these arguments of cargo, kept as `target/gate/NAME`.
fn build(name: &str, arguments: &[&str]) -> anyhow::Result<PathBuf> {
    let target = shell::root().join("target");
    let mut command = shell::cargo(&["build", "--release", "--package", "lapbench", "--bin", "lapbench"]);
    shell::run(command.args(arguments).arg("--target-dir").arg(&target))?;
    let folder = target.join("gate");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let kept = folder.join(name);
    fs::copy(target.join("release/lapbench"), &kept)
        .with_context(|| format!("cannot write {}", kept.display()))?;
    Ok(kept)
}

/// One run of the gate; its report.
fn one(runs: &Runs, plain: &PathBuf, slowed: &PathBuf) -> anyhow::Result<Value> {
    let (base, head) = match runs.head {
        0 => (plain, plain),
        1.. => (plain, slowed),
        _ => (slowed, plain),
    };
    let ratio = 1.0 + f64::from(runs.head) / 100.0;
    let share = if ratio >= 1.0 { ratio - 1.0 } else { 1.0 / ratio - 1.0 };
    let mut command = Command::new(plain);
    command.arg("gate").arg("--base").arg(base).arg("--head").arg(head).current_dir(shell::root());
    command.args(["--cells", &runs.cells, "--time-budget", &runs.time_budget, "--format", "json"]);
    command.env("LAPBENCH_INJECT", format!("solve:{share}"));
    let output = beside(runs.neighbour, || command.output().context("cannot start the gate"))?;
    eprint!("{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).with_context(|| format!("no report of {}", shell::line(&command)))
}

/// Does `work` while, if asked for, another thread of this process is busy.
fn beside<T>(busy: bool, work: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(!busy);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                std::hint::spin_loop();
            }
        });
        let result = work();
        done.store(true, Ordering::Relaxed);
        result
    })
}

/// Appends the cells of a report to the record.
fn record(runs: &Runs, report: &Value) -> anyhow::Result<()> {
    let path = shell::root().join(RECORD);
    let mut text = fs::read_to_string(&path).unwrap_or_else(|_| format!("{COLUMNS}\n"));
    for cell in report["cells"].as_array().context("a report without cells")? {
        let name = cell["name"].as_str().unwrap_or_default();
        let percent = |member: &str| {
            let log = cell["evidence"][member].as_f64();
            log.map_or_else(String::new, |log| format!("{:.2}", 100.0 * log.exp_m1()))
        };
        let machine =
            report["environment"]["fingerprint"]["cpu"].as_str().unwrap_or("unknown").replace(',', " ");
        writeln!(
            text,
            "{},{machine},{:.1},{},{},{name},{},{},{},{},{},{},{:.0},{}",
            report["environment"]["info"]["time"].as_str().unwrap_or_default(),
            report["environment"]["info"]["load1"].as_f64().unwrap_or(f64::NAN),
            runs.head,
            runs.neighbour,
            runs.head != 0 && name.ends_with("/solve"),
            cell["verdict"].as_str().unwrap_or_default(),
            percent("estimate"),
            percent("low"),
            percent("high"),
            cell["evidence"]["couples"],
            report["seconds"].as_f64().unwrap_or(0.0),
            report["exit_code"]
        )?;
    }
    fs::write(&path, text).with_context(|| format!("cannot write {RECORD}"))
}

/// What runs of one kind said.
#[derive(Default)]
struct Kind {
    /// Exit code and seconds, by time of the run.
    runs: BTreeMap<String, (i32, f64)>,
    /// Verdicts of the cells that were slowed, or of all where none was.
    of_slowed: BTreeMap<String, usize>,
    of_others: BTreeMap<String, usize>,
    changes: Vec<f64>,
    /// Load of the machine as each run began: processes that wanted a processor, in the mean of a minute.
    loads: Vec<f64>,
}

/// The record as a table, a row for each kind of run.
fn table(record: &str) -> anyhow::Result<String> {
    let mut kinds: BTreeMap<(bool, i32), Kind> = BTreeMap::new();
    for line in record.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [time, _, load, head, neighbour, _, slowed, verdict, change, _, _, _, seconds, exit] = fields[..]
        else {
            bail!("{RECORD}: a line of {} fields: {line}", fields.len());
        };
        let kind = kinds.entry((neighbour == "true", head.parse()?)).or_default();
        if kind.runs.insert(time.to_owned(), (exit.parse()?, seconds.parse()?)).is_none() {
            kind.loads.push(load.parse()?);
        }
        let verdicts = if slowed == "true" { &mut kind.of_slowed } else { &mut kind.of_others };
        *verdicts.entry(verdict.to_owned()).or_default() += 1;
        if slowed == "true" || head == "0" {
            kind.changes.extend(change.parse::<f64>());
        }
    }
    let mut text = String::from(
        "| solves of head | busy neighbour | load before | runs | failed | the slowed cells | the others | median change (range) | seconds |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for ((neighbour, head), kind) in &mut kinds {
        let failed = kind.runs.values().filter(|(exit, _)| *exit == 3).count();
        let seconds = kind.runs.values().map(|(_, seconds)| seconds).sum::<f64>() / kind.runs.len() as f64;
        writeln!(
            text,
            "| {} | {} | {} | {} | {failed} | {} | {} | {} | {seconds:.0} |",
            if *head == 0 { "the same program".to_owned() } else { format!("{head:+}%") },
            if *neighbour { "yes" } else { "" },
            range(&kind.loads),
            kind.runs.len(),
            counted(&kind.of_slowed),
            counted(&kind.of_others),
            spread(&mut kind.changes)
        )?;
    }
    Ok(text)
}

fn counted(verdicts: &BTreeMap<String, usize>) -> String {
    verdicts.iter().map(|(verdict, n)| format!("{n} {verdict}")).collect::<Vec<_>>().join(", ")
}

fn range(loads: &[f64]) -> String {
    let (low, high) = loads.iter().fold((f64::INFINITY, 0.0f64), |(low, high), &l| (low.min(l), high.max(l)));
    format!("{low:.0} to {high:.0}")
}

fn spread(changes: &mut [f64]) -> String {
    changes.sort_by(f64::total_cmp);
    let (Some(low), Some(high)) = (changes.first(), changes.last()) else { return String::new() };
    format!("{:+.1}% ({low:+.1} to {high:+.1})", changes[changes.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_a_kind_are_one_row() {
        let line = |time: &str, cell: &str, slowed: bool, verdict: &str, exit: i32| {
            format!("{time},cpu,3,5,false,{cell},{slowed},{verdict},5.1,4,6,10,30,{exit}\n")
        };
        let record = format!("{COLUMNS}\n")
            + &line("t1", "a/solve", true, "REGRESSED", 3)
            + &line("t1", "a/setup", false, "SAME", 3)
            + &line("t2", "a/solve", true, "INCONCLUSIVE", 0)
            + &line("t2", "a/setup", false, "SAME", 0);
        let row = table(&record).unwrap().lines().nth(2).unwrap().to_owned();
        let expected =
            "| +5% |  | 3 to 3 | 2 | 1 | 1 INCONCLUSIVE, 1 REGRESSED | 2 SAME | +5.1% (+5.1 to +5.1) | 30 |";
        assert_eq!(row, expected);
        assert!(table("header\nbroken,line\n").is_err());
    }
}
