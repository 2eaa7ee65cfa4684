//! One checked solve outside of a run, by the same process and protocol.

use super::cell::Running;
use super::settings::Settings;
use super::solver::Solver;
use super::source::Source;
use super::task::Task;
use crate::record::result::Cell;

/// Prepares and solves once. The row, and the solution (rows x k) where it passed every check.
pub fn solve(
    task: &Task,
    source: &Source,
    solver: &Solver,
    threads: usize,
    settings: &Settings,
) -> (Cell, Option<Vec<f64>>) {
    let mut running = Running::new(task, source, solver, threads, settings, 0);
    running.begin();
    (running.row(), running.into_solution())
}
