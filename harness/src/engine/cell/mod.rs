//! One cell while it is measured: its process, its samples, its row.
//!
//! ```text
//! begin: open, prepare, first solve or frame, checked   process, solves, frames
//! round: a slice of steady repetitions, the last checked
//! finish: updates, memory, open-loop frames, goodbye
//! ```

mod edits;
mod figures;
mod frames;
mod process;
mod solves;

use super::bandwidth;
use super::session::{Failure, Session};
use super::settings::Settings;
use super::solver::Solver;
use super::source::Source;
use super::task::{Goal, Task};
use crate::record::names::Status;
use crate::record::result::{Cell, Phases};
use crate::statistics::percentiles;
use crate::verify::solution::Checked;
use lapsolve::limits::Limits;
use lapsolve::registry::{Accuracy, Precision};
use std::path::PathBuf;

/// A cell in the making. Whatever happens to its process becomes its status; no method fails.
pub struct Running<'a> {
    task: &'a Task,
    settings: &'a Settings,
    solver: &'a Solver,
    cell: Cell,
    session: Option<Session>,
    limits: Limits,
    iterative: bool,
    /// Where the child puts its solution; other files of this cell are named after it.
    solution: PathBuf,
    /// The last solution that passed every check: the same bits need no second one.
    verified: Vec<f64>,
    samples: Vec<u64>,
    /// The frame (`transfer`) or edit (`harmonic-edit`) that comes next.
    next_frame: usize,
    allocations: Option<u64>,
    repetitions: u64,
    /// Bytes a solve (direct) or an iteration reads, as the solver says.
    bytes: Option<u64>,
    read_rates: Vec<f64>,
}

/// Most solves in one request: with more, a stalled child would be noticed late.
const MOST_SOLVES: u64 = 10_000;

impl<'a> Running<'a> {
    /// A cell that has not begun; `index` tells its files from those of other cells of the task.
    pub fn new(
        task: &'a Task,
        source: &Source,
        solver: &'a Solver,
        threads: usize,
        settings: &'a Settings,
        index: usize,
    ) -> Self {
        let cell = Cell {
            mesh: source.record.clone(),
            workload: task.workload.name().to_owned(),
            backend: solver.name().to_owned(),
            threads,
            columns: Some(task.columns()),
            phases_ns: Phases {
                load: Some(source.load_ns),
                assemble: Some(task.assemble_ns),
                ..Phases::default()
            },
            ..Cell::default()
        };
        Self {
            task,
            settings,
            solver,
            cell,
            session: None,
            // Replaced by those of the class that the solver declares, before anything is checked.
            limits: Limits::of(Precision::F64, Accuracy::Direct, settings.tolerance),
            iterative: false,
            solution: task.solution_path(index),
            verified: Vec::new(),
            samples: Vec::new(),
            next_frame: 0,
            allocations: None,
            repetitions: 0,
            bytes: None,
            read_rates: Vec::new(),
        }
    }

    /// Starts the process, prepares, solves once and checks the answer.
    pub fn begin(&mut self) {
        self.cell.status = Status::Ok;
        let outcome = self.open().and_then(|()| self.prepare()).and_then(|()| self.first());
        self.settle(outcome);
    }

    fn first(&mut self) -> Result<(), Failure> {
        let task = self.task;
        let first = match &task.goal {
            Goal::Solve(solve) => self.first_solve(solve)?,
            Goal::Frames(frames) => self.known_frame(frames)?,
        };
        // Not a steady one: pages are touched for the first time. It counts by itself only.
        (self.allocations, self.repetitions) = (None, 0);
        self.cell.phases_ns.first_solve = Some(first);
        let Phases { order, symbolic, numeric, upload, .. } = self.cell.phases_ns;
        let set_up: u64 = [order, symbolic, numeric, upload].into_iter().flatten().sum();
        self.cell.first_frame_ns = Some(set_up + first);
        self.memory()
    }

    /// A slice of steady repetitions, the last answer checked.
    pub fn round(&mut self) {
        let task = self.task;
        let slice = self.settings.slice().as_nanos() as u64;
        let expected = self.expected().max(1);
        let times = (slice / expected).clamp(1, MOST_SOLVES) as u32;
        // Other processes had the caches in the meantime; where there is time, a repetition warms them up again.
        let warmup = u32::from(2 * expected <= slice);
        let outcome = match &task.goal {
            Goal::Solve(solve) => match &solve.edits {
                Some(edits) => self.steady_edits(solve, edits, slice),
                None => self.steady_solves(solve, warmup, times),
            },
            Goal::Frames(frames) => self.steady_frames(frames, warmup, times),
        };
        self.settle(outcome);
    }

    /// Measures the read bandwidth at the factor's size, in this process, for comparison.
    pub fn measure_bandwidth(&mut self) {
        let Some(bytes) = self.cell.factor.bytes else { return };
        self.read_rates.extend(bandwidth::read_bandwidth(bytes, self.cell.threads));
    }

    /// What comes after the rounds: updates, peak memory, open-loop frames. Ends the process.
    pub fn finish(&mut self) {
        if self.is_live() {
            let task = self.task;
            let outcome = match &task.goal {
                Goal::Solve(solve) => match &solve.edits {
                    Some(edits) => self.last_edits(solve, edits).and_then(|()| self.memory()),
                    None => self
                        .updates(solve)
                        .and_then(|()| self.memory())
                        .and_then(|()| self.open_loops(&solve.input)),
                },
                Goal::Frames(frames) => self.last_frames(frames),
            };
            self.settle(outcome);
        }
        self.end();
        self.cell.complete = true;
    }

    /// Whether the process still runs and has only given right answers.
    pub fn is_live(&self) -> bool {
        self.session.is_some()
    }

    /// Ends the process; the last solution that passed every check.
    pub fn into_solution(mut self) -> Option<Vec<f64>> {
        self.end();
        (self.cell.status == Status::Ok).then_some(self.verified)
    }

    fn end(&mut self) {
        if let Some(session) = self.session.take() {
            session.quit();
        }
    }

    /// Peak resident memory so far, bytes.
    pub fn peak_bytes(&self) -> Option<u64> {
        self.cell.peak_rss_bytes
    }

    /// Takes over a failure and ends the process.
    fn settle(&mut self, outcome: Result<(), Failure>) {
        if let Err(failure) = outcome {
            self.cell.status = failure.status;
            self.cell.reason = Some(failure.reason);
            self.session = None;
        }
    }

    /// Time of one repetition as far as known, nanoseconds.
    fn expected(&self) -> u64 {
        let mut sorted = self.samples.clone();
        sorted.sort_unstable();
        percentiles::median(&sorted).or(self.cell.phases_ns.first_solve).unwrap_or(1)
    }

    fn judge(&mut self, checked: Checked) -> Result<(), Failure> {
        self.cell.accuracy.worsen(&checked.accuracy);
        match checked.faults.as_slice() {
            [] => Ok(()),
            faults => Err(Failure::new(Status::Invalid, faults.join("; "))),
        }
    }
}
