//! Keeps the result file up to date and shows progress.

use crate::engine::rounds::Observer;
use crate::environment::{self, Environment};
use crate::file::FileError;
use crate::record::file::write;
use crate::record::result::{Cell, Convergence, ResultFile, SCHEMA_VERSION};
use anyhow::Context;
use indicatif::ProgressBar;
use std::fs::OpenOptions;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The result in the making. Every change of a row is written: a finished row at once, others once a second.
pub struct Recorder {
    result: ResultFile,
    path: Option<PathBuf>,
    saved: Instant,
    /// Why the last write failed; measuring goes on, and the end of the run reports it.
    failed: Option<FileError>,
    ticks: Option<(u64, u64)>,
    progress: ProgressBar,
}

/// How often rows in the making are written.
const INTERVAL: Duration = Duration::from_secs(1);

impl Recorder {
    /// An empty result, to be written to `path`, whose folder is made if there is none.
    ///
    /// # Errors
    /// Where the folder cannot be made; [`save`](Self::save) finds out whether it is writable.
    pub fn new(path: Option<&PathBuf>, short: bool) -> anyhow::Result<Self> {
        if let Some(path) = path
            && let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty())
        {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("{}: its folder cannot be made", path.display()))?;
        }
        let command: Vec<String> = std::env::args().map(|a| shell_word(&a)).collect();
        let terminal = std::io::stderr().is_terminal() && std::env::var_os("CI").is_none();
        let progress = if terminal { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        progress.enable_steady_tick(Duration::from_millis(200));
        Ok(Self {
            result: ResultFile {
                schema_version: SCHEMA_VERSION.to_owned(),
                command: command.join(" "),
                quotable: !short,
                environment: Environment::read(),
                cells: Vec::new(),
            },
            path: path.cloned(),
            saved: Instant::now(),
            failed: None,
            ticks: environment::processor_ticks(),
            progress,
        })
    }

    /// Takes over the finished cells of an earlier result; what differs between its environment and this one.
    pub fn resume(&mut self, earlier: ResultFile) -> Vec<String> {
        let differences = self.result.environment.fingerprint.differences(&earlier.environment.fingerprint);
        self.result.quotable &= earlier.quotable;
        self.result.cells = earlier.cells.into_iter().filter(|cell| cell.complete).collect();
        differences
    }

    /// Finished cells.
    pub fn finished(&self) -> &[Cell] {
        &self.result.cells
    }

    /// Writes the result, if it has a place.
    ///
    /// # Errors
    /// Where that is not writable.
    pub fn save(&mut self) -> Result<(), FileError> {
        self.saved = Instant::now();
        self.path.as_ref().map_or(Ok(()), |path| write(path, &self.result))
    }

    /// Completes the environment, writes for the last time and appends to the history. Hands over the result, and whether
    /// it could be written.
    pub fn finish(mut self, history: Option<&Path>) -> (ResultFile, anyhow::Result<()>) {
        self.progress.finish_and_clear();
        let info = &mut self.result.environment.info;
        info.load1_end = environment::load1();
        info.steal = self.ticks.zip(environment::processor_ticks()).and_then(|((s0, t0), (s1, t1))| {
            (t1 > t0).then(|| s1.saturating_sub(s0) as f64 / (t1 - t0) as f64)
        });
        let mut written = self.save().map_err(anyhow::Error::from);
        if let Some(path) = history {
            let appended = append(path, &self.result).with_context(|| format!("history {}", path.display()));
            written = written.and(appended);
        }
        (self.result, written)
    }
}

impl Observer for Recorder {
    fn row(&mut self, row: Cell, doing: &str) {
        self.progress.set_message(format!("{} {} {}: {doing}", row.mesh.name, row.workload, row.backend));
        let urgent = row.complete;
        match self.result.cells.iter_mut().find(|cell| cell.same_as(&row)) {
            Some(cell) => *cell = row,
            None => self.result.cells.push(row),
        }
        if !urgent && self.saved.elapsed() < INTERVAL {
            return;
        }
        if let Err(error) = self.save() {
            if self.failed.is_none() {
                self.progress.suspend(|| eprintln!("error: {error}; measuring goes on"));
            }
            self.failed = Some(error);
        }
    }
}

/// A row without its samples and the course of its iterations.
fn without_series(cell: &Cell) -> Cell {
    Cell { samples_ns: Vec::new(), convergence: Convergence::default(), ..cell.clone() }
}

/// One line per cell, without samples, with time and commit.
fn append(path: &Path, result: &ResultFile) -> anyhow::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    for cell in &result.cells {
        let line = ResultFile { cells: vec![without_series(cell)], ..result.clone() };
        writeln!(file, "{}", serde_json::to_string(&line)?)?;
    }
    Ok(())
}

/// An argument as a shell would need it.
fn shell_word(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_can_be_pasted() {
        assert_eq!(shell_word("--mesh=a.ply"), "--mesh=a.ply");
        assert_eq!(shell_word("it's $HOME"), "'it'\\''s $HOME'");
        assert_eq!(shell_word(""), "''");
    }
}
