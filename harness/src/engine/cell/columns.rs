//! Steady solves with other numbers of columns, on a handle that is prepared for the most of them.

use super::{MOST_SOLVES, Running};
use crate::engine::array_file::ArrayFile;
use crate::engine::check::{Check, Judge};
use crate::engine::protocol::{Prepared, Request};
use crate::engine::session::Failure;
use crate::engine::task::{Goal, Task};
use crate::record::names::Status;
use crate::record::result::{ColumnsRun, Summary};

/// The equations whose columns can be more or fewer; none for frames and for pipelines, whose columns are given.
fn equations_of(task: &Task) -> Option<&Check> {
    match &task.goal {
        Goal::Solve(solve) => match &solve.check {
            Judge::Equations(check) => Some(check),
            Judge::Pipeline(_) => None,
        },
        _ => None,
    }
}

impl Running<'_> {
    /// Prepares once more, for the most columns; nothing where the workload's columns are given.
    pub fn prepare_columns(&mut self) {
        let (Some(_), Some(&most)) = (equations_of(self.task), self.settings.columns.iter().max()) else {
            return;
        };
        let problem = self.task.problem.clone();
        let outcome = self.ask::<Prepared>(Request::Prepare { problem, max_columns: most }).map(|_| ());
        self.note(outcome);
    }

    /// Times solves of `k` columns and checks the last one by its residual.
    pub fn columns(&mut self, k: usize) {
        if let Some(check) = equations_of(self.task)
            && self.is_live()
        {
            let outcome = self.time_columns(check, k);
            self.note(outcome);
        }
    }

    fn time_columns(&mut self, check: &Check, k: usize) -> Result<(), Failure> {
        let cannot_write = |error| Failure::new(Status::Error, format!("cannot write columns: {error}"));
        let equations = check.equations.with_columns(k);
        let (input, _) = equations.input();
        let rhs =
            ArrayFile::write(&self.solution.with_extension("columns"), input, k).map_err(cannot_write)?;
        let first = self.solves_of(&rhs, 0, 1)?;
        let slice = self.settings.columns_slice().as_nanos() as u64;
        let expected = first.first().copied().unwrap_or(1).max(1);
        let times = (slice / expected).clamp(1, MOST_SOLVES) as u32;
        let samples = self.solves_of(&rhs, u32::from(2 * expected <= slice), times)?;
        let x = super::process::read_block(&self.solution, equations.rows(), k)?;
        let checked = check.updated(&equations, &x, &self.limits);
        if let [fault, ..] = checked.faults.as_slice() {
            return Err(Failure::new(Status::Invalid, format!("with {k} columns: {fault}")));
        }
        self.cell.column_sweep.push(ColumnsRun { columns: k, solve_ns: Summary::of(&samples) });
        self.cell.column_sweep.sort_by_key(|run| run.columns);
        Ok(())
    }

    fn solves_of(&mut self, rhs: &ArrayFile, warmup: u32, times: u32) -> Result<Vec<u64>, Failure> {
        let _ = std::fs::remove_file(&self.solution); // an old answer must not pass for a new one
        let request = Request::Solve { rhs: rhs.clone(), warmup, times, solution: self.solution.clone() };
        Ok(self.timed(request, times)?.samples_ns)
    }

    /// A wrong answer spoils the cell; anything else that goes wrong here is noted, and what was measured before stays.
    fn note(&mut self, outcome: Result<(), Failure>) {
        match outcome {
            Ok(()) => {}
            Err(failure) if failure.status == Status::Invalid => self.settle(Err(failure)),
            Err(failure) => {
                self.cell.details.insert("columns".into(), failure.to_string());
                self.session = None;
            }
        }
    }
}
