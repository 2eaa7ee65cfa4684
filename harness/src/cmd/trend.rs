//! `trend`: how cells developed over recorded results, and where they changed.

use super::Outcome;
use super::output::{self, Format};
use crate::exit::Exit;
use crate::file;
use crate::report::rows::Rows;
use crate::trend::plot;
use crate::trend::series::{Figure, Series, read_folder, series};
use anyhow::bail;
use std::path::PathBuf;

/// Follow cells over recorded results: history, change points, a picture
///
/// A series is a cell on a machine; other compilers, dependencies or kernels do not begin a new one. Changes are found by
/// E-divisive with permutation tests; about ten results are needed before one can be significant.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of result files (.json) and histories (.jsonl), searched with its subfolders
    #[arg(value_name = "FOLDER", default_value = "bench_results")]
    folder: PathBuf,
    /// What is followed
    #[arg(long, value_enum, default_value_t)]
    figure: Figure,
    /// Only cells whose "mesh workload backend" contains this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// A change counts where at most this share of random orders has one as clear
    #[arg(long, value_name = "P", default_value_t = 0.01, value_parser = probability)]
    significance: f64,
    /// Draw all series here
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// End in exit code 3 where the last change of a series is for the worse
    #[arg(long)]
    fail_on_slower: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

fn probability(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.001..1.0).contains(&value) {
        Ok(value)
    } else {
        Err("must be at least 0.001 and below 1".to_owned())
    }
}

/// Reads, finds, prints.
///
/// # Errors
/// Where the folder cannot be read, holds no result, or the picture cannot be written.
pub fn run(args: &Args) -> Outcome {
    let results = read_folder(&args.folder)?;
    if results.is_empty() {
        bail!(
            "{}: no result files; record some with `run --out {0}/<date>-<machine>/<name>.json`",
            args.folder.display()
        );
    }
    let mut found = series(&results, args.figure, args.significance);
    if let Some(text) = &args.only {
        found.retain(|s| format!("{} {} {}", s.mesh, s.workload, s.backend).contains(text));
    }
    if let Some(path) = &args.plot {
        let picture = plot::svg(&found, args.figure)?;
        file::write_atomically(path, |out| out.write_all(picture.as_bytes()))?;
        eprintln!("{}: {} series", path.display(), found.len());
    }
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&found)?,
        format => rows(&found, args.figure).render(format),
    })?;
    let slower = |s: &Series| s.last_change().is_some_and(|(change, _)| change.ratio > 1.0);
    Ok(if args.fail_on_slower && found.iter().any(slower) { Exit::Regression } else { Exit::Ok })
}

fn rows(series: &[Series], figure: Figure) -> Rows {
    let unit = figure.unit();
    let mut rows = Rows::new([
        "mesh",
        "workload",
        "backend",
        "thr",
        "results",
        &format!("first {unit}"),
        &format!("last {unit}"),
        "ratio",
        "history",
        "last change",
    ]);
    for s in series {
        let (first, last) =
            (s.points.first().map_or(0.0, |p| p.value), s.points.last().map_or(0.0, |p| p.value));
        let change = s.last_change().map_or_else(String::new, |(change, point)| {
            let day: String = point.time.chars().take(10).collect();
            let commit = point
                .commit
                .as_deref()
                .map_or_else(String::new, |c| format!(" {}", c.chars().take(9).collect::<String>()));
            let others: Vec<&str> = point.changed.iter().filter_map(|c| c.split(':').next()).collect();
            let also =
                if others.is_empty() { String::new() } else { format!("; also new: {}", others.join(", ")) };
            format!("x{:.2} on {day}{commit} (p {:.3}){also}", change.ratio, change.p)
        });
        rows.push([
            &s.mesh,
            &s.workload,
            &s.backend,
            &s.threads.to_string(),
            &s.points.len().to_string(),
            &format!("{first:.3}"),
            &format!("{last:.3}"),
            &format!("{:.2}", last / first),
            &s.sparkline(),
            &change,
        ]);
    }
    rows
}
