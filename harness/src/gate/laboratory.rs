//! Couples on this machine: fresh processes of both programs, the control kernel between them.

use super::bench::{Bench, Fault};
use super::cell::Case;
use super::control::ControlKernel;
use super::couple::{Couple, Side, Slot, order};
use super::neighbours::Ticks;
use super::side::Program;
use crate::engine::cell::Running;
use crate::engine::inputs::Inputs;
use crate::engine::settings::Settings;
use crate::engine::solver::Solver;
use crate::engine::source::Source;
use crate::engine::task::Task;
use crate::engine::workspace::Workspace;
use crate::record::names::Status;
use crate::record::result::Cell;
use anyhow::Context;
use lapsolve::registry::Entry;
use std::time::{Duration, Instant};

/// Everything that is made once: meshes, equations with their reference solutions, programs.
pub struct Laboratory {
    sources: Vec<Source>,
    tasks: Vec<Task>,
    cases: Vec<Prepared>,
    settings: Settings,
    threads: usize,
    processors: usize,
    control: ControlKernel,
    begin: Instant,
    /// The files of the tasks and the copy of the base program.
    workspace: Workspace,
}

/// A case with what it needs.
struct Prepared {
    case: Case,
    source: usize,
    task: usize,
    /// Of base, head, copy.
    solvers: [Solver; 3],
}

/// Time of steady repetitions in one process: with start, set-up and checks a process stays below 0.25 s.
const SLICE: Duration = Duration::from_millis(80);

impl Laboratory {
    /// Makes meshes, equations and references of `cases`. `begin` is when the gate's time began.
    ///
    /// # Errors
    /// A mesh that cannot be read, a system that is not acceptable, or a full disk.
    pub fn new(
        cases: &[Case],
        [base, head]: [&Program; 2],
        backends: &[Entry],
        threads: usize,
        begin: Instant,
    ) -> anyhow::Result<Self> {
        let workspace = Workspace::new()?;
        let copy = base.copy(&workspace.folder("copy")?).context("cannot copy the base program")?;
        let mut laboratory = Self {
            sources: Vec::new(),
            tasks: Vec::new(),
            cases: Vec::new(),
            settings: Settings { cell_time: SLICE, rounds: 1, ..Settings::default() },
            threads,
            processors: std::thread::available_parallelism().map_or(1, Into::into),
            control: ControlKernel::default(),
            begin,
            workspace,
        };
        for case in cases {
            let source = laboratory.source(case)?;
            let task = laboratory.task(case, source, backends).with_context(|| case.to_string())?;
            let solvers =
                [base.solver(case, None), head.solver(case, None), base.solver(case, copy.as_deref())];
            laboratory.cases.push(Prepared { case: case.clone(), source, task, solvers });
        }
        Ok(laboratory)
    }

    fn source(&mut self, case: &Case) -> anyhow::Result<usize> {
        let name = case.mesh.recorded(0);
        if let Some(known) = self.sources.iter().position(|source| source.record.name == name) {
            return Ok(known);
        }
        self.sources.push(case.mesh.load(0)?);
        Ok(self.sources.len() - 1)
    }

    fn task(&mut self, case: &Case, source: usize, backends: &[Entry]) -> anyhow::Result<usize> {
        let known = self.cases.iter().find(|c| c.source == source && c.case.workload == case.workload);
        if let Some(known) = known {
            return Ok(known.task);
        }
        let folder = self.workspace.folder(&format!("task-{}", self.tasks.len()))?;
        let inputs = Inputs { tau: lapsolve::workload::screened::DEFAULT_TAU, ..Inputs::default() };
        self.tasks.push(Task::new(case.workload, &self.sources[source], &inputs, backends, folder)?);
        Ok(self.tasks.len() - 1)
    }

    /// One process of `side`: set-up, first repetition, a slice of steady ones, each checked. Its row.
    ///
    /// # Errors
    /// How it failed.
    pub fn process(&self, case: usize, side: Side) -> Result<Cell, Fault> {
        let prepared = &self.cases[case];
        let solver = &prepared.solvers[side as usize];
        let (task, source) = (&self.tasks[prepared.task], &self.sources[prepared.source]);
        let mut running = Running::new(task, source, solver, self.threads, &self.settings, case);
        running.begin();
        if running.is_live() {
            running.round();
        }
        let row = running.row();
        running.into_solution();
        match row.status {
            Status::Ok => Ok(row),
            status => Err(Fault { side, status, reason: row.reason.unwrap_or_default() }),
        }
    }

    fn times(&self, case: usize, side: Side, row: &Cell) -> Result<Vec<f64>, Fault> {
        let case = &self.cases[case].case;
        let time = |&measure: &super::cell::Measure| measure.of_row(row).map(|ns| ns as f64);
        case.measures.iter().map(time).collect::<Option<_>>().ok_or_else(|| Fault {
            side,
            status: Status::Error,
            reason: "it told no time of what is judged".into(),
        })
    }
}

impl Bench for Laboratory {
    fn elapsed(&self) -> Duration {
        self.begin.elapsed()
    }

    fn couple(&mut self, case: usize, round: usize, with_copy: bool) -> Result<Couple, Fault> {
        let begin = Ticks::read();
        let mut before = self.control.time_ns();
        let mut slots = Vec::new();
        for side in order(round, with_copy) {
            let row = self.process(case, side)?;
            let after = self.control.time_ns();
            let control_ns = (0.5 * (before + after)).round();
            slots.push(Slot { side, times_ns: self.times(case, side, &row)?, control_ns });
            before = after;
        }
        let disturbed = begin
            .zip(Ticks::read())
            .is_some_and(|(begin, end)| begin.disturbed_until(&end, self.processors, self.threads));
        Ok(Couple { slots, contended: disturbed })
    }
}
