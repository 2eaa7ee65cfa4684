//! A run: sources x workloads x solvers x threads, measured task by task.

use super::cell::Running;
use super::inputs::Inputs;
use super::rounds::{Observer, measure};
use super::settings::Settings;
use super::solver::Solver;
use super::source::{Name, Source};
use super::task::Task;
use super::workload::Workload;
use super::workspace::Workspace;
use crate::record::names::Status;
use crate::record::result::{Cell, Mesh};
use lapsolve::registry::Entry;

/// What a run measures.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Meshes and matrices.
    pub sources: Vec<Name>,
    /// Workloads for the meshes; a matrix has its own.
    pub workloads: Vec<Workload>,
    /// Backends and peers.
    pub solvers: Vec<Solver>,
    /// Thread counts.
    pub threads: Vec<usize>,
    /// Overrides of the default inputs.
    pub inputs: Inputs,
    /// Times and limits.
    pub settings: Settings,
    /// This run's share, by a numbering that all shards agree on: every `count`-th task (mesh and workload), so that solvers
    /// that are compared take turns on one machine; every `count`-th cell where there are fewer tasks than shards.
    pub shard: Option<Shard>,
}

/// Part `index` of `count`, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which part.
    pub index: usize,
    /// Of how many.
    pub count: usize,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = || {
            let (index, count) = text.split_once('/')?;
            let shard = Self { index: index.parse().ok()?, count: count.parse().ok()? };
            (shard.index < shard.count).then_some(shard)
        };
        parse().ok_or_else(|| "expected i/N with 0 <= i < N, for example 0/4".to_owned())
    }
}

impl Plan {
    /// Measures every cell for which `skip` does not hold. What goes wrong with a source or a task becomes error rows of its
    /// cells; the others still run.
    ///
    /// # Errors
    /// Only where there is no place for temporary files.
    pub fn execute(
        &self,
        backends: &[Entry],
        skip: &dyn Fn(&Cell) -> bool,
        observer: &mut dyn Observer,
    ) -> anyhow::Result<()> {
        let workspace = Workspace::new()?;
        let (mut task, mut number) = (0, 0);
        for name in &self.sources {
            let mut todo = Vec::new();
            for workload in self.workloads_of(name) {
                let mut cells = Vec::new();
                for (solver, threads) in self.columns() {
                    let mine = self.is_mine(task, number);
                    number += 1;
                    let cell = empty_row(self.record(name), workload, solver, threads);
                    if mine && !skip(&cell) {
                        cells.push((solver, threads));
                    }
                }
                task += 1;
                if !cells.is_empty() {
                    todo.push((workload, cells));
                }
            }
            if todo.is_empty() {
                continue;
            }
            match name.load(self.inputs.subdivide) {
                Ok(source) => self.measure_source(&source, todo, backends, &workspace, observer)?,
                Err(error) => {
                    eprintln!("error: {error:#}");
                    for (workload, cells) in &todo {
                        refuse(&self.record(name), *workload, cells, &format!("{error:#}"), observer);
                    }
                }
            }
        }
        Ok(())
    }

    fn measure_source(
        &self,
        source: &Source,
        todo: Vec<(Workload, Vec<(&Solver, usize)>)>,
        backends: &[Entry],
        workspace: &Workspace,
        observer: &mut dyn Observer,
    ) -> anyhow::Result<()> {
        for (workload, cells) in todo {
            let folder = workspace.folder("task")?;
            let first = empty_row(source.record.clone(), workload, cells[0].0, cells[0].1);
            observer.row(first, "assembling, solving for reference");
            match Task::new(workload, source, &self.inputs, backends, folder.clone()) {
                Ok(task) => {
                    let running = cells.iter().enumerate().map(|(index, &(solver, threads))| {
                        Running::new(&task, source, solver, threads, &self.settings, index)
                    });
                    measure(running.collect(), &self.settings, observer);
                }
                Err(error) => {
                    eprintln!("error: {}: {workload}: {error:#}", source.record.name);
                    refuse(&source.record, workload, &cells, &format!("{error:#}"), observer);
                }
            }
            std::fs::remove_dir_all(&folder)?;
        }
        Ok(())
    }

    /// Whether a cell belongs to this run's shard, by the number of its task and its own.
    fn is_mine(&self, task: usize, cell: usize) -> bool {
        let Some(shard) = self.shard else { return true };
        let tasks: usize = self.sources.iter().map(|name| self.workloads_of(name).len()).sum();
        let number = if tasks >= shard.count { task } else { cell };
        number % shard.count == shard.index
    }

    fn workloads_of(&self, name: &Name) -> Vec<Workload> {
        match name {
            Name::Mesh(_) => self.workloads.iter().copied().filter(|w| w.needs_mesh()).collect(),
            Name::Matrix(_) => vec![Workload::Matrix],
            Name::Sequence(_) => vec![Workload::Smoothing],
        }
    }

    fn columns(&self) -> impl Iterator<Item = (&Solver, usize)> {
        self.solvers.iter().flat_map(|solver| self.threads.iter().map(move |&threads| (solver, threads)))
    }

    fn record(&self, name: &Name) -> Mesh {
        Mesh { name: name.recorded(self.inputs.subdivide), ..Mesh::default() }
    }
}

/// The row of a cell of which nothing is known yet.
fn empty_row(mesh: Mesh, workload: Workload, solver: &Solver, threads: usize) -> Cell {
    Cell {
        mesh,
        workload: workload.name().to_owned(),
        backend: solver.name().to_owned(),
        division: solver.division(),
        threads,
        status: Status::Ok,
        ..Cell::default()
    }
}

/// Error rows for cells that cannot be set up.
fn refuse(
    mesh: &Mesh,
    workload: Workload,
    cells: &[(&Solver, usize)],
    reason: &str,
    observer: &mut dyn Observer,
) {
    for &(solver, threads) in cells {
        let row = empty_row(mesh.clone(), workload, solver, threads);
        let row = Cell { status: Status::Error, reason: Some(reason.to_owned()), complete: true, ..row };
        observer.row(row, "done");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_checked() {
        assert_eq!("1/3".parse(), Ok(Shard { index: 1, count: 3 }));
        for wrong in ["3/3", "0/0", "1", "-1/2", "a/b"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }
}
