//! Recorded results of one cell on one machine, in the order of time.

use crate::environment::{Environment, Fingerprint};
use crate::file;
use crate::record;
use crate::record::names::Status;
use crate::record::result::{Cell, ResultFile};
use crate::report::table;
use crate::statistics::change_points::{ChangePoint, change_points};
use anyhow::Context;
use clap::ValueEnum;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    /// Median steady solve or frame, milliseconds
    #[default]
    Solve,
    /// Set-up, milliseconds
    SetUp,
    /// Peak memory of the cell's process, MB
    Memory,
}

impl Figure {
    /// The figure of a cell; none where it was not measured.
    pub fn of(self, cell: &Cell) -> Option<f64> {
        match self {
            Figure::Solve => table::median(cell).map(|ns| ns as f64 * 1e-6),
            Figure::SetUp => table::set_up(cell).map(|ns| ns as f64 * 1e-6),
            Figure::Memory => cell.peak_rss_bytes.map(|bytes| bytes as f64 * 1e-6),
        }
        .filter(|value| *value > 0.0)
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        if self == Figure::Memory { "MB" } else { "ms" }
    }
}

/// One recorded value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// UTC, ISO 8601.
    pub time: String,
    /// Commit of the program.
    pub commit: Option<String>,
    /// The file it stands in.
    pub file: String,
    /// The figure, in its unit.
    pub value: f64,
    /// What was another build or system than at the point before: compiler, dependencies, kernel.
    pub changed: Vec<String>,
}

/// All values of a cell on a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// The mesh.
    pub mesh: String,
    /// The workload.
    pub workload: String,
    /// The backend.
    pub backend: String,
    /// Threads.
    pub threads: usize,
    /// The processor.
    pub machine: String,
    /// Values in the order of time.
    pub points: Vec<Point>,
    /// Where they change.
    pub changes: Vec<ChangePoint>,
}

/// Folders below this depth are not searched: results lie two deep, and a link may lead in a circle.
const DEPTH: usize = 6;

/// Result files (`.json`) and histories (`.jsonl`) below `folder`, sorted by name. Other JSON files are left out, and said
/// so on stderr.
///
/// # Errors
/// Where the folder cannot be read or a result file is of another major version.
pub fn read_folder(folder: &Path) -> anyhow::Result<Vec<(PathBuf, ResultFile)>> {
    let mut files = Vec::new();
    if folder.is_file() {
        files.push(folder.to_owned());
    } else {
        walk(folder, 0, &mut files)?;
    }
    files.sort();
    let mut results = Vec::new();
    for path in files {
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => match record::file::read(&path) {
                Ok(result) => results.push((path, result)),
                Err(error) => eprintln!("left out: {error:#}"),
            },
            Some("jsonl") => {
                let bytes = file::read(&path)?;
                for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
                    match serde_json::from_slice(line) {
                        Ok(result) => results.push((path.clone(), result)),
                        Err(_) if line.is_empty() => {}
                        Err(error) => eprintln!("left out: {} line {}: {error}", path.display(), number + 1),
                    }
                }
            }
            _ => {}
        }
    }
    Ok(results)
}

fn walk(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("{} cannot be read; name a folder of results", folder.display()))?;
    for entry in entries.flatten() {
        let path = entry.path();
        if path.is_dir() && depth < DEPTH {
            walk(&path, depth + 1, files)?;
        } else if path.is_file() {
            files.push(path);
        }
    }
    Ok(())
}

/// One series for each cell and machine, sorted by name, with the changes that are significant. Cells that are not `ok`
/// have no value.
pub fn series(results: &[(PathBuf, ResultFile)], figure: Figure, significance: f64) -> Vec<Series> {
    let mut cells: BTreeMap<Key, Vec<Found<'_>>> = BTreeMap::new();
    for (path, result) in results {
        for cell in result.cells.iter().filter(|cell| cell.status == Status::Ok) {
            if let Some(value) = figure.of(cell) {
                cells.entry(key(cell, &result.environment.fingerprint)).or_default().push((
                    &result.environment,
                    path,
                    value,
                ));
            }
        }
    }
    cells.into_iter().map(|(key, found)| one(key, found, significance)).collect()
}

/// Mesh, its checksum, workload, backend, threads, machine.
type Key = (String, Option<String>, String, String, usize, String);

/// Where and when a value was recorded.
type Found<'a> = (&'a Environment, &'a PathBuf, f64);

fn key(cell: &Cell, print: &Fingerprint) -> Key {
    let Cell { mesh, workload, backend, threads, .. } = cell;
    (mesh.name.clone(), mesh.sha256.clone(), workload.clone(), backend.clone(), *threads, machine(print))
}

fn one(key: Key, mut found: Vec<Found<'_>>, significance: f64) -> Series {
    found.sort_by(|a, b| a.0.info.time.cmp(&b.0.info.time));
    let before = |i: usize| i.checked_sub(1).map(|j| found[j].0);
    let points: Vec<Point> = (0..found.len()).map(|i| point(before(i), found[i])).collect();
    let values: Vec<f64> = points.iter().map(|p| p.value).collect();
    let cpu = found.first().and_then(|f| f.0.fingerprint.cpu.clone());
    let (mesh, _, workload, backend, threads, _) = key;
    Series {
        mesh,
        workload,
        backend,
        threads,
        machine: cpu.unwrap_or_else(|| "unknown processor".to_owned()),
        changes: change_points(&values, significance),
        points,
    }
}

fn point(before: Option<&Environment>, (environment, path, value): Found<'_>) -> Point {
    let changed =
        before.map_or_else(Vec::new, |before| before.fingerprint.differences(&environment.fingerprint));
    let info = &environment.info;
    Point {
        time: info.time.clone(),
        commit: info.commit.clone(),
        file: path.display().to_string(),
        value,
        changed,
    }
}

/// What makes a machine another one: times before and after do not compare. Compiler, dependencies and kernel are left out,
/// which is what a history is to show.
fn machine(print: &Fingerprint) -> String {
    let kept = Fingerprint {
        kernel: None,
        rustc: None,
        rustflags: None,
        dependencies_sha256: String::new(),
        ..print.clone()
    };
    serde_json::to_string(&kept).expect("plain data")
}

impl Series {
    /// Medians of a short line of blocks, lowest to highest.
    pub fn sparkline(&self) -> String {
        const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
        const WIDTH: usize = 24;
        let shown = &self.points[self.points.len().saturating_sub(WIDTH)..];
        let (low, high) = shown
            .iter()
            .fold((f64::INFINITY, 0.0f64), |(low, high), p| (low.min(p.value), high.max(p.value)));
        let bar = |p: &Point| {
            let share = if high > low { (p.value - low) / (high - low) } else { 0.5 };
            BARS[((share * 8.0) as usize).min(7)]
        };
        shown.iter().map(bar).collect()
    }

    /// Whether the last segment is slower (or larger) than the one before it.
    pub fn last_change(&self) -> Option<(&ChangePoint, &Point)> {
        self.changes.last().and_then(|change| Some((change, self.points.get(change.at)?)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::record::result::{Mesh, SCHEMA_VERSION, Summary};

    pub(in crate::trend) fn result(day: usize, nanoseconds: u64, cpu: &str) -> (PathBuf, ResultFile) {
        let mut environment = Environment::default();
        environment.info.time = format!("2026-01-{day:02}T00:00:00Z");
        environment.fingerprint.cpu = Some(cpu.to_owned());
        let cell = Cell {
            mesh: Mesh { name: "m".into(), ..Mesh::default() },
            workload: "harmonic".into(),
            backend: "a".into(),
            status: Status::Ok,
            threads: 1,
            solve_ns: Summary { p50: Some(nanoseconds), ..Summary::default() },
            ..Cell::default()
        };
        let result = ResultFile {
            schema_version: SCHEMA_VERSION.into(),
            command: "run".into(),
            quotable: true,
            environment,
            cells: vec![cell],
        };
        (PathBuf::from(format!("{day}.json")), result)
    }

    #[test]
    fn a_regression_is_dated() {
        let mut results: Vec<_> = (1..=20)
            .map(|day| {
                // Noise without a trend, which would be a change as well.
                let noise = 997 * (day as u64 * 7 % 13);
                result(day, if day < 12 { 1_000_000 } else { 1_200_000 } + noise, "x")
            })
            .collect();
        results.reverse(); // the order of files does not matter
        results.push(result(3, 9_000_000, "another machine"));
        let found = series(&results, Figure::Solve, 0.01);
        assert_eq!(found.len(), 2);
        let main = found.iter().find(|s| s.machine == "x").unwrap();
        let (change, point) = main.last_change().unwrap();
        assert_eq!((point.time.as_str(), main.changes.len()), ("2026-01-12T00:00:00Z", 1));
        assert!((change.ratio - 1.2).abs() < 0.02 && main.sparkline().chars().count() == 20);
    }

    #[test]
    fn another_compiler_is_noted_and_no_other_series() {
        let mut results = vec![result(1, 5, "x"), result(2, 5, "x")];
        results[1].1.environment.fingerprint.rustc = Some("rustc 2".into());
        let found = series(&results, Figure::Solve, 0.01);
        assert_eq!(found.len(), 1);
        assert!(found[0].points[1].changed[0].starts_with("rustc: "), "{found:?}");
    }

    #[test]
    fn folders_are_searched_and_what_is_no_result_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("2026-01-01-machine");
        std::fs::create_dir(&deep).unwrap();
        let text = record::file::text(&result(1, 5, "x").1);
        std::fs::write(deep.join("a.json"), &text).unwrap();
        std::fs::write(deep.join("package.json"), "{}").unwrap();
        let line = serde_json::to_string(&result(2, 6, "x").1).unwrap();
        std::fs::write(folder.path().join("history.jsonl"), format!("{line}\nrubbish\n{line}\n")).unwrap();
        let results = read_folder(folder.path()).unwrap();
        assert_eq!(results.len(), 3);
        assert_eq!(series(&results, Figure::Solve, 0.01)[0].points.len(), 3);
        assert!(read_folder(Path::new("/no/such/folder")).is_err());
    }
}
