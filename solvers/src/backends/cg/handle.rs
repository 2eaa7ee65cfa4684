//! The prepared handle of every backend of the family.

use super::kernels::Sums;
use super::krylov::{self, Force, Goal, Method, Stored, Vectors};
use super::lanes::{Window, width};
use super::norms;
use super::operator::Operator;
use super::preconditioner::{AnyPreconditioner, Preconditioner};
use super::workers::{Strips, Workers};
use crate::backend::{Factor, Footprint, Phase, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};

/// Matrix, preconditioner and workspace.
pub(crate) struct CgFactor<A, S> {
    matrix: A,
    /// Inverse diagonal.
    inverse: Vec<f64>,
    preconditioner: Box<dyn AnyPreconditioner<S>>,
    workers: Workers,
    strips: Strips,
    sums: Vec<Sums>,
    method: Method,
    tolerance: f64,
    x: Vec<f64>,
    workspace: [Vec<S>; 4],
    observer: Option<Box<dyn FnMut(u32, f64) + Send>>,
}

impl<A: Operator, S: Stored> CgFactor<A, S> {
    /// Room for solves of `max_columns` columns (wider blocks go eight at a time).
    pub(crate) fn new(
        matrix: A,
        preconditioner: Box<dyn AnyPreconditioner<S>>,
        workers: Workers,
        method: Method,
        tolerance: f64,
        max_columns: usize,
    ) -> Self {
        let strips = workers.strips(matrix.csr().n());
        let sums = vec![Sums::default(); strips.count()];
        let length = matrix.csr().n() * width(max_columns);
        let workspace = std::array::from_fn(|_| vec![S::default(); length]);
        let x = vec![0.0; length];
        let inverse = norms::inverse_diagonal(matrix.csr());
        Self {
            matrix,
            inverse,
            preconditioner,
            workers,
            strips,
            sums,
            method,
            tolerance,
            x,
            workspace,
            observer: None,
        }
    }

    /// Columns `first ..` as far as W lanes go.
    fn solve_window<const W: usize>(
        &mut self,
        rhs: Columns<&[f64]>,
        x: Columns<&mut [f64]>,
        first: usize,
        preconditioner: fn(&mut dyn AnyPreconditioner<S>) -> &mut dyn Preconditioner<S, W>,
    ) -> Result<Solved, SolveError> {
        let n = rhs.n();
        let window = Window::<W>::new(rhs, first).map_err(|row| SolveError::NonFinite { row })?;
        let [r, z, p, q] = self.workspace.each_mut().map(|v| v[..n * W].as_chunks_mut::<W>().0);
        let goal =
            Goal { method: self.method, tolerance: self.tolerance, budget: self.preconditioner.budget() };
        let vectors = Vectors { x: self.x[..n * W].as_chunks_mut::<W>().0, r, z, p, q };
        let m = preconditioner(&mut *self.preconditioner);
        let observer = &mut self.observer;
        let observe = &mut |iteration, residual| {
            if let Some(observer) = observer {
                observer(iteration, residual);
            }
        };
        let Self { workers, strips, sums, inverse, .. } = self;
        let force = Force { workers, strips, sums, inverse };
        krylov::solve(force, &self.matrix, m, goal, window, rhs, x, vectors, observe)
    }
}

impl<A: Operator, S: Stored> Factor for CgFactor<A, S> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.matrix.csr().n(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        assert!(n * width(k) <= self.x.len(), "rhs: more columns than the handle was prepared for");
        let mut whole = Whole::default();
        let mut first = 0;
        while first < k {
            let w = width(k - first);
            let x = x.reborrow();
            whole.add(match w {
                1 => self.solve_window::<1>(rhs, x, first, |m| m),
                4 => self.solve_window::<4>(rhs, x, first, |m| m),
                _ => self.solve_window::<8>(rhs, x, first, |m| m),
            })?;
            first += w;
        }
        whole.outcome()
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.matrix.update(values);
        self.inverse = norms::inverse_diagonal(self.matrix.csr());
        self.preconditioner
            .update(&mut self.workers, self.matrix.csr())
            .map_err(|error| super::in_system(error, self.matrix.rows()))
    }

    fn observe(&mut self, observer: Option<Box<dyn FnMut(u32, f64) + Send>>) -> bool {
        self.observer = observer;
        true
    }

    fn footprint(&self) -> Footprint {
        let (matrix, m) = (self.matrix.bytes() as u64, self.preconditioner.size());
        let vectors = self.inverse.len() * 8 + self.x.len() * (8 + self.workspace.len() * size_of::<S>());
        Footprint {
            host_bytes: Some(matrix + m.bytes + vectors as u64),
            factor_nonzeros: Some(m.entries),
            factor_bytes: Some(m.bytes),
            bytes_per_solve: Some(12 * self.matrix.csr().columns.len() as u64 + m.bytes),
            ..Footprint::default()
        }
    }
}

/// The outcome of a solve that took several windows of columns: the worst of each figure.
#[derive(Default)]
struct Whole {
    iterations: u32,
    residual: f64,
    missed: bool,
}

impl Whole {
    /// Takes in one window; other errors than a missed tolerance end the solve.
    fn add(&mut self, outcome: Result<Solved, SolveError>) -> Result<(), SolveError> {
        let (iterations, residual) = match outcome {
            Ok(solved) => (solved.iterations.unwrap_or(0), solved.residual.unwrap_or(0.0)),
            Err(SolveError::NotConverged { iterations, residual }) => {
                self.missed = true;
                (iterations, residual)
            }
            Err(other) => return Err(other),
        };
        self.iterations = self.iterations.max(iterations);
        self.residual = if residual.is_nan() { residual } else { self.residual.max(residual) };
        Ok(())
    }

    fn outcome(self) -> Result<Solved, SolveError> {
        let Self { iterations, residual, missed } = self;
        if missed {
            return Err(SolveError::NotConverged { iterations, residual });
        }
        Ok(Solved { iterations: Some(iterations), residual: Some(residual), device_ns: None })
    }
}
