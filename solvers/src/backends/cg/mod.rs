//! The conjugate-gradient family: one Krylov core, many preconditioners.
//!
//! | row | preconditioner | module |
//! |---|---|---|
//! | `cg-jacobi` | the diagonal | `jacobi` |
//!
//! A solve stops, column by column, when the true relative residual ||b - A x||_2 / ||b||_2 is at most the tolerance. It
//! starts from the incoming x (warm start), unless x = 0 is the better guess. Where the tolerance is out of reach
//! (indefinite matrix, rounding, iteration limit) it ends with `NotConverged` and the best iterate in place.
//!
//! Layout: every vector is n rows of W lanes, W = 1, 4 or 8 columns at a time, so that one pass over the matrix serves all
//! of them and a row is one vector register. Parts, in the order data takes:
//! `lanes` (columns in and out) -> `krylov` (the iteration) -> `operator` (A p) and `preconditioner` (M^-1 r).

pub(crate) mod handle;
pub(crate) mod jacobi;
pub(crate) mod krylov;
pub(crate) mod lanes;
pub(crate) mod operator;
pub(crate) mod preconditioner;
#[cfg(test)]
mod tests;

use crate::backend::{Backend, Description, Factor, Phase, PrepareOptions};
use crate::error::{PrepareError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use handle::CgFactor;
use operator::{FullCsr, Operator};
use preconditioner::AnyPreconditioner;

/// Builds a preconditioner for a system whose matrix is also given by full rows.
type Build = fn(&System, &FullCsr) -> Result<Box<dyn AnyPreconditioner>, PrepareError>;

/// CG with one of the preconditioners.
struct Cg {
    tolerance: f64,
    build: Build,
}

/// Opens `cg-jacobi`.
pub fn open_jacobi(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Cg {
        tolerance: options.tolerance,
        build: |_, a| Ok(Box::new(jacobi::Jacobi::new(a.csr()))),
    }))
}

impl Backend for Cg {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Symbolic);
        let matrix = FullCsr::new(system.matrix());
        on(Phase::Numeric);
        let preconditioner = (self.build)(system, &matrix)?;
        Ok(Box::new(CgFactor::new(matrix, preconditioner, self.tolerance, options.max_columns)))
    }
}
