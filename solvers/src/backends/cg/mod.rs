//! The conjugate-gradient family: one Krylov core, many preconditioners.
//!
//! | row | preconditioner | module |
//! |---|---|---|
//! | `cg-jacobi` | the diagonal | `jacobi` |
//! | `cg-ic0` | incomplete Cholesky on the pattern of A | `ic0` |
//! | `cg-fsai` | sparse approximate inverse factor, 8 entries per row | `fsai` |
//! | `cg-chebyshev` | polynomial of degree 4 | `chebyshev` |
//! | `cg-approxchol` | Cholesky with randomly sampled fill | `approxchol` |
//! | `cg-amg`, `cg-multigrid` | multilevel cycles | [`super::multigrid`] |
//!
//! A solve stops, column by column, when the true relative residual ||b - A x|| / ||b|| is at most the tolerance, in the 2-norm
//! and as the largest entry after division by the diagonal (`norms`: rows with small entries count as others do). It
//! starts from the incoming x (warm start), unless x = 0 is the better guess. Where the tolerance is out of reach
//! (indefinite matrix, rounding, iteration limit) it ends with `NotConverged` and the best iterate in place.
//!
//! Layout: every vector is n rows of W lanes, W = 1, 4 or 8 columns at a time, so that one pass over the matrix serves all
//! of them and a row is one vector register. Parts, in the order data takes:
//! `lanes` (columns in and out) -> `krylov` (the iteration) -> `operator` (A p) and `preconditioner` (M^-1 r).

mod approxchol;
mod chebyshev;
pub(crate) mod fsai;
pub(crate) mod handle;
mod ic0;
pub(crate) mod jacobi;
pub(crate) mod kernels;
pub(crate) mod krylov;
pub(crate) mod lanes;
pub(crate) mod norms;
pub(crate) mod operator;
pub(crate) mod order;
pub(crate) mod preconditioner;
#[cfg(test)]
pub(crate) mod test_systems;
#[cfg(test)]
mod tests;
pub(crate) mod workers;

use crate::backend::{Backend, Description, Factor, Phase, PrepareOptions, TransferFrame};
use crate::error::{PrepareError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use crate::vector::Vector;
use crate::workload::transfer::{Transfer, TransferError, TransferProblem};
use handle::CgFactor;
use krylov::{Method, Stored};
use operator::{Csr, FullCsr, Operator};
use preconditioner::AnyPreconditioner;
use workers::Workers;

/// Builds a preconditioner from the matrix and, where the system has them, one point per row of it.
type Build<S> = fn(
    &mut Workers,
    Csr<'_>,
    Option<&[Vector]>,
    width: usize,
) -> Result<Box<dyn AnyPreconditioner<S>>, PrepareError>;

/// A method with a preconditioner in precision S.
struct Iterative<S> {
    method: Method,
    tolerance: f64,
    threads: usize,
    build: Build<S>,
}

/// Opens `cg-jacobi`.
pub fn open_jacobi(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Conjugate, |workers, a, _, _| Ok(Box::new(jacobi::Jacobi::new(workers, a))))
}

/// Opens `cg-ic0`.
pub fn open_ic0(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Conjugate, |_, a, _, _| Ok(Box::new(ic0::IncompleteCholesky::new(a))))
}

/// Opens `cg-fsai`.
pub fn open_fsai(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    const PATTERN: fsai::Pattern = fsai::Pattern::Width(8);
    open(options, Method::Conjugate, |workers, a, _, width| {
        Ok(Box::new(fsai::Fsai::new(workers, a, PATTERN, width)?))
    })
}

/// Opens `cg-chebyshev`.
pub fn open_chebyshev(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Conjugate, |workers, a, _, width| {
        Ok(Box::new(chebyshev::Chebyshev::new(workers, a, width)))
    })
}

/// Opens `cg-approxchol`.
pub fn open_approxchol(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Conjugate, |_, a, _, _| Ok(Box::new(approxchol::ApproximateCholesky::new(a))))
}

/// Opens a backend of the family.
pub(crate) fn open<S: Stored>(
    options: &OpenOptions<'_>,
    method: Method,
    build: Build<S>,
) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Iterative { method, tolerance: options.tolerance, threads: options.threads, build }))
}

impl<S: Stored> Backend for Iterative<S> {
    fn describe(&self) -> Description {
        Description::cpu(self.threads)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Order);
        let mut workers = Workers::new(self.threads)?;
        let matrix = FullCsr::new(&mut workers, system.matrix());
        let row = |&row: &u32| system.positions().map(|points| points[row as usize]);
        let points: Option<Vec<Vector>> = matrix.rows().iter().map(row).collect();
        on(Phase::Numeric);
        let preconditioner =
            (self.build)(&mut workers, matrix.csr(), points.as_deref(), lanes::width(options.max_columns))
                .map_err(|error| in_system(error, matrix.rows()))?;
        let (method, tolerance) = (self.method, self.tolerance);
        Ok(Box::new(CgFactor::new(matrix, preconditioner, workers, method, tolerance, options.max_columns)))
    }

    /// The provided frames, with guesses from more than the last one.
    fn prepare_transfer(
        &self,
        problem: &TransferProblem,
        _: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Option<Box<dyn TransferFrame>>, PrepareError> {
        let frames = Transfer::prepare(self, problem, on).map_err(|error| match error {
            TransferError::Prepare(error) => error,
            other => PrepareError::Unsupported { what: other.to_string() },
        })?;
        Ok(Some(Box::new(frames.predicting(self.tolerance))))
    }
}

/// The error with its row in the numbering of the system.
pub(crate) fn in_system(error: PrepareError, rows: &[u32]) -> PrepareError {
    match error {
        PrepareError::NotPositiveDefinite { row } => {
            PrepareError::NotPositiveDefinite { row: rows[row] as usize }
        }
        PrepareError::NonFinite { row } => PrepareError::NonFinite { row: rows[row] as usize },
        other => other,
    }
}
