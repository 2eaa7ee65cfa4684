//! Grounded solves of a singular Laplacian: L x = b, x known up to a constant per component.

use crate::backend::{Backend, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::dirichlet::{Dirichlet, DirichletError};
use crate::error::{PrepareError, SolveError};
use crate::sparse::SymmetricCsr;
use thiserror::Error;

/// Why a grounded Laplacian could not be prepared.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PoissonError {
    /// The Laplacian is not acceptable.
    #[error(transparent)]
    Dirichlet(#[from] DirichletError),
    /// The backend failed.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
}

/// L x = b on all vertices of a mesh, one vertex per component grounded at 0 (algebra only, no epsilon).
///
/// b should sum to zero over every component; then the solution is exact and unique up to a constant per component,
/// which the caller fixes (a translation, a mean). Otherwise the equation of the grounded vertex is the one that fails.
pub struct Poisson {
    problem: Dirichlet,
    factor: Option<Box<dyn Factor>>,
    /// Where the free rows are not the first rows of the mesh they are copied; empty otherwise.
    rhs: Vec<f64>,
    x: Vec<f64>,
    in_place: bool,
}

impl Poisson {
    /// Grounds `laplacian` (n x n) and prepares it on `backend`. `options.order`, if given, is in vertex numbering.
    ///
    /// # Errors
    /// [`PoissonError`].
    pub fn prepare(
        backend: &dyn Backend,
        laplacian: SymmetricCsr,
        positions: Option<&[[f64; 3]]>,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, PoissonError> {
        let problem = Dirichlet::grounded(laplacian, positions)?;
        let order = options.order.map(|order| problem.restrict_order(order));
        let reduced = PrepareOptions { order: order.as_deref(), ..*options };
        let factor = match problem.system() {
            Some(system) => Some(backend.prepare(system, &reduced, on)?),
            None => None,
        };
        Ok(Self::new(problem, factor, options.max_columns))
    }

    /// Wraps a factor that was prepared for `problem.system()`.
    pub fn new(problem: Dirichlet, factor: Option<Box<dyn Factor>>, max_columns: usize) -> Self {
        let in_place = problem.free().iter().enumerate().all(|(row, &v)| row == v as usize);
        let length = if in_place { 0 } else { problem.free().len() * max_columns };
        Self { problem, factor, rhs: vec![0.0; length], x: vec![0.0; length], in_place }
    }

    /// Solves for all columns: `rhs` (n x k, read), `x` (n x k, written; initial guess where warm start is declared).
    /// Grounded and absent rows of `x` become 0. No allocation of its own.
    ///
    /// # Errors
    /// As [`Factor::solve`].
    pub fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (rows, k) = (self.problem.free().len(), rhs.k());
        let Some(factor) = &mut self.factor else {
            x.data_mut().fill(0.0);
            return Ok(Solved::default());
        };
        if self.in_place {
            let (free, rest) = x.data_mut().split_at_mut(rows * k);
            rest.fill(0.0);
            return factor
                .solve(Columns::new(&rhs.slice()[..rows * k], rows, k), Columns::new(free, rows, k));
        }
        let mut b = Columns::new(&mut self.rhs[..rows * k], rows, k);
        let mut y = Columns::new(&mut self.x[..rows * k], rows, k);
        self.problem.gather(rhs, b.reborrow());
        self.problem.gather(x.view(), y.reborrow());
        let outcome = factor.solve(b.view(), y.reborrow());
        x.data_mut().fill(0.0);
        for (row, &v) in self.problem.free().iter().enumerate() {
            x.row_mut(v as usize).copy_from_slice(y.row(row));
        }
        outcome
    }

    /// New values of the full L, in the order of its stored entries.
    ///
    /// # Errors
    /// As [`Factor::update_values`].
    pub fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.problem.update_values(values)?;
        match (&mut self.factor, self.problem.system()) {
            (Some(factor), Some(system)) => factor.update_values(system.matrix().values(), on),
            _ => Ok(()),
        }
    }

    /// The split into grounded, free and absent vertices.
    pub fn problem(&self) -> &Dirichlet {
        &self.problem
    }

    /// The elimination order in use, in vertex numbering (grounded and absent vertices last), where there is one: it suits
    /// every other system on the same mesh. Allocates n indices.
    pub fn vertex_order(&self) -> Option<Vec<u32>> {
        let rows = self.factor.as_ref()?.permutation()?;
        let mut order: Vec<u32> = rows.iter().map(|&row| self.problem.free()[row as usize]).collect();
        let mut rest = vec![true; self.problem.laplacian().n()];
        order.iter().for_each(|&v| rest[v as usize] = false);
        order.extend((0..rest.len() as u32).filter(|&v| rest[v as usize]));
        Some(order)
    }

    /// What the factor holds and moves.
    pub fn footprint(&self) -> Footprint {
        self.factor.as_ref().map(|f| f.footprint()).unwrap_or_default()
    }
}
