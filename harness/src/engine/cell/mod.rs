//! One cell while it is measured: its process, its samples, its row.
//!
//! ```text
//! begin: open, prepare, first solve or frame, checked   process, solves, frames
//! set_up_again: the same in another fresh process       set_ups
//! round: a slice of steady repetitions, the last checked
//! wind_up: updates, memory, open-loop frames
//! columns: steady solves with other numbers of columns  columns
//! finish: goodbye
//! ```

mod columns;
mod edits;
mod figures;
mod frames;
mod ledger;
mod process;
mod set_ups;
mod solves;

use super::bandwidth;
use super::contention::Watch;
use super::protocol::Timed;
use super::session::{Failure, Session};
use super::settings::Settings;
use super::solver::Solver;
use super::source::Source;
use super::task::edits::FirstEdit;
use super::task::{Goal, Task};
use crate::record::names::{DeviceType, Status};
use crate::record::result::{Cell, Phases, SetUp};
use crate::statistics::percentiles;
use crate::verify::solution::Checked;
use lapsolve::limits::Limits;
use lapsolve::registry::{Accuracy, Precision};
use ledger::Ledger;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

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
    /// Parts of each steady frame.
    steps: BTreeMap<String, Vec<u64>>,
    /// Times of changes: new values, or edits of the constraints.
    changes: Vec<u64>,
    /// The frame that comes next (`transfer`).
    next_frame: usize,
    allocations: Option<u64>,
    repetitions: u64,
    /// Bytes a solve (direct) or an iteration reads, as the solver says.
    bytes: Option<u64>,
    read_rates: Vec<f64>,
    ledger: Ledger,
    /// Wall-clock time that extra set-ups took.
    set_up_time: Duration,
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
            division: solver.division(),
            threads,
            columns: Some(task.columns()),
            phases_ns: Phases {
                load: Some(source.load_ns),
                assemble: source.assemble_ns,
                ..Phases::default()
            },
            ..Cell::default()
        };
        Self::fresh(task, settings, solver, cell, task.solution_path(index))
    }

    fn fresh(
        task: &'a Task,
        settings: &'a Settings,
        solver: &'a Solver,
        cell: Cell,
        solution: PathBuf,
    ) -> Self {
        Self {
            task,
            settings,
            solver,
            cell,
            session: None,
            // Replaced by those of the class that the solver declares, before anything is checked.
            limits: Limits::of(Precision::F64, Accuracy::Direct, settings.tolerance),
            iterative: false,
            solution,
            verified: Vec::new(),
            samples: Vec::new(),
            steps: BTreeMap::new(),
            changes: Vec::new(),
            next_frame: 0,
            allocations: None,
            repetitions: 0,
            bytes: None,
            read_rates: Vec::new(),
            ledger: Ledger::default(),
            set_up_time: Duration::ZERO,
        }
    }

    /// Starts the process, prepares, solves once and checks the answer.
    pub fn begin(&mut self) {
        self.cell.status = Status::Ok;
        let outcome = self.open().and_then(|()| self.prepare()).and_then(|()| self.first());
        let task = self.task;
        if let (Err(Failure { status: Status::NotConverged, .. }), Goal::Solve(solve)) =
            (&outcome, &task.goal)
        {
            let _ = self.convergence(solve); // shows how far it came; the solve's own failure is the row's
        }
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
        self.memory()?;
        let phases_ns = Phases { load: None, assemble: None, ..self.cell.phases_ns };
        self.cell.set_ups.push(SetUp { phases_ns, peak_rss_bytes: self.cell.peak_rss_bytes });
        self.summarise_set_ups();
        Ok(())
    }

    /// A slice of steady repetitions, the last answer checked.
    pub fn round(&mut self) {
        let task = self.task;
        let Some(child) = self.session.as_ref().map(Session::id) else { return };
        let watch = Watch::start(child);
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
        watch.end(&mut self.cell.contention);
        self.settle(outcome);
    }

    /// Adds steady repetitions and their parts to the samples.
    fn keep(&mut self, timed: Timed) {
        self.samples.extend(timed.samples_ns);
        for (step, samples) in timed.steps_ns {
            self.steps.entry(step).or_default().extend(samples);
        }
    }

    /// New values and back again for about `time`, at least once. Where the solver cannot, the row says so and nothing is
    /// measured.
    pub fn change_values(&mut self, time: Duration) {
        let task = self.task;
        if let (true, Goal::Solve(solve)) = (self.is_live(), &task.goal) {
            let outcome = self.updates_for(solve, time);
            self.settle(outcome);
        }
    }

    /// Other constraints and back again for about `time`, at least once; as [`change_values`](Self::change_values).
    pub fn change_constraints(&mut self, edit: &FirstEdit, time: Duration) {
        let task = self.task;
        if let (true, Goal::Solve(solve)) = (self.is_live(), &task.goal) {
            let outcome = self.edits(solve, edit, time);
            self.settle(outcome);
        }
    }

    /// Asks for peak memory and factor once more.
    pub fn look_at_memory(&mut self) {
        if self.is_live() {
            let outcome = self.memory();
            self.settle(outcome);
        }
    }

    /// The same preparation once more and again for about `time`, at least once: what a change costs a solver that can only
    /// prepare anew. Its process is warm by then, other than in [`begin`](Self::begin).
    pub fn prepare_again(&mut self, time: Duration) {
        if self.is_live() {
            let outcome = self.preparations(time);
            self.settle(outcome);
        }
    }

    /// Times of the changes so far, nanoseconds.
    pub fn changes(&self) -> &[u64] {
        &self.changes
    }

    /// Measures the read bandwidth at the factor's size, in this process, for comparison; not where the factor lies in a card's
    /// own memory, which has nothing to do with this process'.
    pub fn measure_bandwidth(&mut self) {
        if self.cell.device_type == Some(DeviceType::Discrete) {
            return;
        }
        let Some(bytes) = self.cell.factor.bytes else { return };
        self.read_rates.extend(bandwidth::read_bandwidth(bytes, self.cell.threads));
    }

    /// What comes after the rounds: updates, peak memory, open-loop frames.
    pub fn wind_up(&mut self) {
        if self.is_live() {
            let task = self.task;
            let outcome = match &task.goal {
                Goal::Solve(solve) => match &solve.edits {
                    Some(edits) => self.last_edits(solve, edits).and_then(|()| self.memory()),
                    None => self
                        .updates(solve)
                        .and_then(|()| self.memory())
                        .and_then(|()| self.convergence(solve))
                        .and_then(|()| self.open_loops(&solve.input)),
                },
                Goal::Frames(frames) => self.last_frames(frames),
            };
            self.settle(outcome.and_then(|()| self.ledger.judge()));
        }
    }

    /// Ends the process; the row is complete.
    pub fn finish(&mut self) {
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
