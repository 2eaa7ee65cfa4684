//! `compare`: result files cell by cell, ratios with intervals, the largest change first.

use super::Outcome;
use super::output::{self, Format};
use crate::exit::Exit;
use crate::record;
use crate::record::names::Status;
use crate::record::result::{Cell, ResultFile};
use crate::report::rows::Rows;
use crate::report::table;
use crate::statistics::blocks::block_medians;
use crate::statistics::rank_sum::{self, Ratio};
use serde::Serialize;
use std::path::PathBuf;

/// Compare result files cell by cell: ratios with intervals, the largest change first
///
/// The first file is what the others are compared with. A single file is compared with itself: every backend with the
/// fastest one of its mesh, workload, threads and precision. Runs at different times differ by more than their intervals
/// say; for a verdict on a change measure both interleaved.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Result files; the first one is the base
    #[arg(value_name = "FILE.json", required = true)]
    files: Vec<PathBuf>,
    /// Compare although the machines or builds differ
    #[arg(long)]
    allow_env_mismatch: bool,
    /// Changes that count as none, in percent
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent)]
    margin: f64,
    /// Confidence of the intervals
    #[arg(long, value_name = "SHARE", default_value_t = 0.95, value_parser = confidence)]
    confidence: f64,
    /// End in exit code 3 where a cell is slower by more than the margin
    #[arg(long)]
    fail_on_slower: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

fn percent(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=1000.0).contains(&value) { Ok(value) } else { Err("must be between 0 and 1000".to_owned()) }
}

fn confidence(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.5..1.0).contains(&value) { Ok(value) } else { Err("must be at least 0.5 and below 1".to_owned()) }
}

/// What the interval of a ratio says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    /// All of the interval is above the margin.
    Slower,
    /// All of it is below.
    Faster,
    /// All of it is within.
    Same,
    /// The base of its group itself.
    Fastest,
    /// It reaches over an end of the margin, or there are too few samples for an interval.
    Unclear,
}

impl Verdict {
    fn of(ratio: Option<Ratio>, margin: f64) -> Self {
        let Some(Ratio { low, high, .. }) = ratio else { return Verdict::Unclear };
        let limit = 1.0 + 0.01 * margin;
        if low > limit {
            Verdict::Slower
        } else if high < 1.0 / limit {
            Verdict::Faster
        } else if low >= 1.0 / limit && high <= limit {
            Verdict::Same
        } else {
            Verdict::Unclear
        }
    }

    fn name(self) -> &'static str {
        match self {
            Verdict::Slower => "slower",
            Verdict::Faster => "faster",
            Verdict::Same => "same",
            Verdict::Fastest => "fastest",
            Verdict::Unclear => "unclear",
        }
    }
}

/// A cell of two results.
#[derive(Debug, Serialize)]
struct Pair {
    /// File of the head; null where a file is compared with itself.
    file: Option<String>,
    mesh: String,
    workload: String,
    backend: String,
    threads: usize,
    /// The fastest of the group, where a file is compared with itself.
    base_backend: Option<String>,
    base_status: Option<Status>,
    head_status: Option<Status>,
    base_p50_ns: Option<u64>,
    head_p50_ns: Option<u64>,
    /// head / base of the steady solves or frames: above 1 is slower (Hodges-Lehmann over blocks of the raw samples).
    ratio: Option<f64>,
    /// Ends of its distribution-free interval; null where there are too few samples.
    ratio_low: Option<f64>,
    ratio_high: Option<f64>,
    verdict: Verdict,
    /// head / base of the set-up times, each measured once.
    setup_ratio: Option<f64>,
    iterations: [Option<u32>; 2],
    factor_nonzeros: [Option<u64>; 2],
    /// What is wrong whatever the noise, or worth knowing.
    note: Option<&'static str>,
}

impl Pair {
    fn of(base: Option<&Cell>, head: Option<&Cell>, args: &Args) -> Option<Self> {
        let known = base.or(head)?;
        let ok = |cell: Option<&Cell>| cell.is_some_and(|c| c.status == Status::Ok);
        let plain = |f: fn(&Cell) -> Option<u64>| {
            let (b, h) = (f(base?)?, f(head?)?);
            (b > 0).then(|| h as f64 / b as f64)
        };
        let interval = match (base, head) {
            (Some(b), Some(h)) if ok(base) && ok(head) => {
                rank_sum::ratio(&block_medians(&b.samples_ns), &block_medians(&h.samples_ns), args.confidence)
            }
            _ => None,
        };
        let mut pair = Self {
            file: None,
            mesh: known.mesh.name.clone(),
            workload: known.workload.clone(),
            backend: known.backend.clone(),
            threads: known.threads,
            base_backend: None,
            base_status: base.map(|c| c.status),
            head_status: head.map(|c| c.status),
            base_p50_ns: base.and_then(table::median),
            head_p50_ns: head.and_then(table::median),
            ratio: interval.map(|r| r.estimate).or_else(|| plain(table::median)),
            ratio_low: interval.map(|r| r.low),
            ratio_high: interval.map(|r| r.high),
            verdict: Verdict::of(interval, args.margin),
            setup_ratio: plain(table::set_up),
            iterations: [base.and_then(|c| c.iterations), head.and_then(|c| c.iterations)],
            factor_nonzeros: [base.and_then(|c| c.factor.nonzeros), head.and_then(|c| c.factor.nonzeros)],
            note: None,
        };
        pair.note = pair.got_worse().or_else(|| pair.remark(base, head));
        Some(pair)
    }

    /// A cell that is gone, one that is no longer ok, or a counter that grew: wrong whatever the noise.
    fn got_worse(&self) -> Option<&'static str> {
        let grew = |a: Option<u64>, b: Option<u64>| a.zip(b).is_some_and(|(a, b)| b > a);
        let [i0, i1] = self.iterations.map(|i| i.map(u64::from));
        match (self.base_status, self.head_status) {
            (_, None) => Some("removed"),
            (Some(Status::Ok), Some(head)) if head != Status::Ok => Some("no longer ok"),
            (Some(_), _) if grew(i0, i1) => Some("more iterations"),
            (Some(_), _) if grew(self.factor_nonzeros[0], self.factor_nonzeros[1]) => Some("more fill"),
            _ => None,
        }
    }

    fn remark(&self, base: Option<&Cell>, head: Option<&Cell>) -> Option<&'static str> {
        let other_mesh = |b: &Cell, h: &Cell| b.mesh.sha256 != h.mesh.sha256;
        match (self.base_status, self.head_status) {
            (None, _) => Some("new"),
            (Some(a), Some(b)) if a != Status::Ok && b == Status::Ok => Some("now ok"),
            _ if base.zip(head).is_some_and(|(b, h)| other_mesh(b, h)) => Some("another mesh of that name"),
            _ => None,
        }
    }

    /// Size of the change, for the order: what is gone first, then the largest ratio either way.
    fn change(&self) -> f64 {
        match self.ratio {
            _ if self.head_status.is_none() => f64::INFINITY,
            Some(ratio) if ratio > 0.0 => ratio.ln().abs(),
            _ => 0.0,
        }
    }
}

/// Compares and prints.
///
/// # Errors
/// Where a file cannot be read or is no result file.
pub fn run(args: &Args) -> Outcome {
    let results: Vec<ResultFile> =
        args.files.iter().map(|path| record::file::read(path)).collect::<Result<_, _>>()?;
    let (base, heads) = results.split_first().expect("clap asks for one file");
    for (head, path) in heads.iter().zip(&args.files[1..]) {
        let differences = base.environment.fingerprint.differences(&head.environment.fingerprint);
        if !differences.is_empty() {
            eprintln!("{}: another environment: {}", path.display(), differences.join("; "));
            if !args.allow_env_mismatch {
                eprintln!(
                    "times of different machines or builds do not compare; --allow-env-mismatch prints them anyway"
                );
                return Ok(Exit::Incomparable);
            }
        }
    }
    if results.iter().any(|result| !result.quotable) {
        eprintln!("at least one result is of a shortened run: not quotable");
    }
    let mut pairs = if heads.is_empty() { within(base, args) } else { between(base, heads, args) };
    if !heads.is_empty() {
        pairs.sort_by(|a, b| b.change().total_cmp(&a.change()));
    }
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&pairs)?,
        format => rows(&pairs, heads.len()).render(format),
    })?;
    let worse = |pair: &Pair| {
        !heads.is_empty()
            && (pair.got_worse().is_some() || args.fail_on_slower && pair.verdict == Verdict::Slower)
    };
    Ok(if pairs.iter().any(worse) { Exit::Regression } else { Exit::Ok })
}

/// Every cell of the base or a head, with its counterpart.
fn between(base: &ResultFile, heads: &[ResultFile], args: &Args) -> Vec<Pair> {
    let find = |cells: &[Cell], cell: &Cell| cells.iter().position(|other| other.same_as(cell));
    let mut pairs = Vec::new();
    for (head, path) in heads.iter().zip(&args.files[1..]) {
        let of_base = base
            .cells
            .iter()
            .map(|cell| Pair::of(Some(cell), find(&head.cells, cell).map(|i| &head.cells[i]), args));
        let new = head.cells.iter().filter(|cell| find(&base.cells, cell).is_none());
        let name = path.display().to_string();
        pairs.extend(
            of_base
                .chain(new.map(|cell| Pair::of(None, Some(cell), args)))
                .flatten()
                .map(|pair| Pair { file: Some(name.clone()), ..pair }),
        );
    }
    pairs
}

/// Every valid cell with the fastest of its mesh, workload, threads, precision and kind of device, group by group.
fn within(result: &ResultFile, args: &Args) -> Vec<Pair> {
    let group = |c: &Cell| (c.mesh.name.clone(), c.workload.clone(), c.threads, c.precision, c.device_type);
    let valid = |c: &&Cell| c.status == Status::Ok && table::median(c).is_some();
    let mut pairs = Vec::new();
    let mut seen = Vec::new();
    for first in result.cells.iter().filter(valid) {
        if seen.contains(&group(first)) {
            continue;
        }
        seen.push(group(first));
        let mut cells: Vec<&Cell> =
            result.cells.iter().filter(valid).filter(|c| group(c) == group(first)).collect();
        cells.sort_by_key(|c| table::median(c));
        pairs.extend(cells.iter().filter_map(|&cell| {
            let mut pair = Pair::of(Some(cells[0]), Some(cell), args)?;
            pair.backend = cell.backend.clone();
            pair.base_backend = Some(cells[0].backend.clone());
            (pair.note, pair.iterations, pair.factor_nonzeros) =
                (None, [None, cell.iterations], [None, cell.factor.nonzeros]);
            if std::ptr::eq(cell, cells[0]) {
                (pair.verdict, pair.ratio_low, pair.ratio_high) = (Verdict::Fastest, None, None);
            }
            Some(pair)
        }));
    }
    pairs
}

fn rows(pairs: &[Pair], heads: usize) -> Rows {
    let last = if heads > 1 { "file" } else { "note" };
    let mut rows = Rows::new([
        "mesh", "workload", "backend", "thr", "base ms", "head ms", "ratio", "low", "high", "setup",
        "verdict", last,
    ]);
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.3}"));
    let milliseconds = |ns: Option<u64>| number(ns.map(|ns| ns as f64 * 1e-6));
    for pair in pairs {
        let note = match (&pair.file, &pair.base_backend) {
            (Some(file), _) if heads > 1 => format!("{file} {}", pair.note.unwrap_or_default()),
            (_, Some(base)) => format!("against {base}"),
            _ => pair.note.unwrap_or_default().to_owned(),
        };
        rows.push([
            &pair.mesh,
            &pair.workload,
            &pair.backend,
            &pair.threads.to_string(),
            &milliseconds(pair.base_p50_ns),
            &milliseconds(pair.head_p50_ns),
            &number(pair.ratio),
            &number(pair.ratio_low),
            &number(pair.ratio_high),
            &number(pair.setup_ratio),
            pair.verdict.name(),
            note.trim_end(),
        ]);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_follow_the_whole_interval() {
        let of =
            |low: f64, high: f64| Verdict::of(Some(Ratio { estimate: (low * high).sqrt(), low, high }), 5.0);
        assert_eq!(of(1.06, 1.2), Verdict::Slower);
        assert_eq!(of(0.8, 0.95), Verdict::Faster);
        assert_eq!(of(0.97, 1.04), Verdict::Same);
        assert_eq!([of(1.01, 1.2), of(0.9, 1.0)], [Verdict::Unclear; 2]);
        assert_eq!(Verdict::of(None, 5.0), Verdict::Unclear);
    }
}
