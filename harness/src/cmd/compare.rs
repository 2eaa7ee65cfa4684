//! `compare`: two result files cell by cell, plain ratios of medians.

use super::Outcome;
use super::output::{self, Format};
use crate::exit::Exit;
use crate::record;
use crate::record::names::Status;
use crate::record::result::Cell;
use crate::report::rows::Rows;
use crate::report::table;
use serde::Serialize;
use std::path::PathBuf;

/// Compare two result files cell by cell (ratios of medians; for a verdict measure both interleaved)
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The result to compare with
    base: PathBuf,
    /// The result to judge
    head: PathBuf,
    /// Compare although the machines or builds differ
    #[arg(long)]
    allow_env_mismatch: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// A cell of both results.
#[derive(Debug, Serialize)]
struct Pair {
    mesh: String,
    workload: String,
    backend: String,
    threads: usize,
    base_status: Status,
    head_status: Option<Status>,
    base_p50_ns: Option<u64>,
    head_p50_ns: Option<u64>,
    /// head / base: above 1 is slower.
    ratio: Option<f64>,
    /// head / base of the set-up times.
    setup_ratio: Option<f64>,
    iterations: [Option<u32>; 2],
    factor_nonzeros: [Option<u64>; 2],
}

impl Pair {
    fn of(base: &Cell, head: Option<&Cell>) -> Self {
        let ratio = |f: fn(&Cell) -> Option<u64>| {
            let (b, h) = (f(base)?, head.and_then(f)?);
            (b > 0).then(|| h as f64 / b as f64)
        };
        Self {
            mesh: base.mesh.name.clone(),
            workload: base.workload.clone(),
            backend: base.backend.clone(),
            threads: base.threads,
            base_status: base.status,
            head_status: head.map(|h| h.status),
            base_p50_ns: table::median(base),
            head_p50_ns: head.and_then(table::median),
            ratio: ratio(table::median),
            setup_ratio: ratio(table::set_up),
            iterations: [base.iterations, head.and_then(|h| h.iterations)],
            factor_nonzeros: [base.factor.nonzeros, head.and_then(|h| h.factor.nonzeros)],
        }
    }

    /// A cell that is gone, one that is no longer ok, or a counter that grew: wrong whatever the noise.
    fn got_worse(&self) -> Option<&'static str> {
        let grew = |a: Option<u64>, b: Option<u64>| a.zip(b).is_some_and(|(a, b)| b > a);
        let [i0, i1] = self.iterations.map(|i| i.map(u64::from));
        match self.head_status {
            None => Some("removed"),
            Some(head) if self.base_status == Status::Ok && head != Status::Ok => Some("no longer ok"),
            _ if grew(i0, i1) => Some("more iterations"),
            _ if grew(self.factor_nonzeros[0], self.factor_nonzeros[1]) => Some("more fill"),
            _ => None,
        }
    }
}

/// Compares and prints.
///
/// # Errors
/// Where a file cannot be read or is no result file.
pub fn run(args: &Args) -> Outcome {
    let (base, head) = (record::file::read(&args.base)?, record::file::read(&args.head)?);
    let differences = base.environment.fingerprint.differences(&head.environment.fingerprint);
    if !differences.is_empty() {
        eprintln!("the environments differ: {}", differences.join("; "));
        if !args.allow_env_mismatch {
            eprintln!(
                "times of different machines or builds do not compare; --allow-env-mismatch prints them anyway"
            );
            return Ok(Exit::Incomparable);
        }
    }
    if !(base.quotable && head.quotable) {
        eprintln!("at least one result is of a shortened run: not quotable");
    }
    let find = |cell: &Cell| head.cells.iter().find(|other| other.same_as(cell));
    let pairs: Vec<Pair> = base.cells.iter().map(|cell| Pair::of(cell, find(cell))).collect();
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&pairs)?,
        format => rows(&pairs).render(format),
    })?;
    let worse = pairs.iter().any(|pair| pair.got_worse().is_some());
    Ok(if worse { Exit::Regression } else { Exit::Ok })
}

fn rows(pairs: &[Pair]) -> Rows {
    let mut rows =
        Rows::new(["mesh", "workload", "backend", "thr", "base ms", "head ms", "ratio", "setup", "note"]);
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.3}"));
    let milliseconds = |ns: Option<u64>| number(ns.map(|ns| ns as f64 * 1e-6));
    for pair in pairs {
        rows.push([
            &pair.mesh,
            &pair.workload,
            &pair.backend,
            &pair.threads.to_string(),
            &milliseconds(pair.base_p50_ns),
            &milliseconds(pair.head_p50_ns),
            &number(pair.ratio),
            &number(pair.setup_ratio),
            pair.got_worse().unwrap_or_default(),
        ]);
    }
    rows
}
