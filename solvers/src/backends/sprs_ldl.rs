//! `sprs-ldl`: the up-looking scalar L D L^T of the sprs family (LGPL, hence a feature of its own).
//!
//! It gets our minimum degree ordering instead of its default reverse Cuthill-McKee, which fills far more on meshes. One
//! column at a time, serial; its triangular solves are called directly, so that a solve allocates nothing.

use super::permuted::Permuted;
use crate::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use sprs::{CsMatViewI, PermOwnedI, SymmetryCheck};
use sprs_ldl::{LdlNumeric, LdlSymbolic, ldl_lsolve, ldl_ltsolve};

/// Opens the backend; there is nothing to choose.
pub fn open(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(SprsLdl))
}

struct SprsLdl;

impl Backend for SprsLdl {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        if system.n() == 1 {
            let what = "sprs-ldl takes no system of a single unknown".into();
            return Err(PrepareError::Unsupported { what });
        }
        on(Phase::Order);
        let matrix = Permuted::new(system.matrix(), options);
        on(Phase::Symbolic);
        // The matrix comes permuted, and is symmetric by construction.
        let identity = PermOwnedI::identity(matrix.n());
        let symbolic = LdlSymbolic::new_perm(view(&matrix), identity, SymmetryCheck::DontCheckSymmetry);
        on(Phase::Numeric);
        let ldl = symbolic.factor(view(&matrix)).map_err(|_| PrepareError::NotPositiveDefinite { row: 0 })?;
        let factor = SprsLdlFactor { column: vec![0.0; matrix.n()], matrix, ldl };
        factor.check_pivots()?;
        Ok(Box::new(factor))
    }
}

fn view(matrix: &Permuted) -> CsMatViewI<'_, f64, u32> {
    let n = matrix.n();
    let pattern = &matrix.pattern;
    CsMatViewI::new_csc((n, n), &pattern.starts, &pattern.columns, &matrix.values)
}

struct SprsLdlFactor {
    matrix: Permuted,
    ldl: LdlNumeric<f64, u32>,
    column: Vec<f64>,
}

impl SprsLdlFactor {
    /// L D L^T goes through with negative pivots too; a positive definite matrix has none.
    fn check_pivots(&self) -> Result<(), PrepareError> {
        let row = |k: usize| self.matrix.order[k] as usize;
        match self.ldl.d().iter().position(|d| !d.is_finite() || *d <= 0.0) {
            Some(k) if !self.ldl.d()[k].is_finite() => Err(PrepareError::NonFinite { row: row(k) }),
            Some(k) => Err(PrepareError::NotPositiveDefinite { row: row(k) }),
            None => Ok(()),
        }
    }
}

impl Factor for SprsLdlFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.matrix.n(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let l = self.ldl.l();
        for c in 0..k {
            self.matrix.gather(rhs, c, &mut self.column);
            ldl_lsolve(&l, &mut self.column[..]);
            for (value, d) in self.column.iter_mut().zip(self.ldl.d()) {
                *value /= d;
            }
            ldl_ltsolve(&l, &mut self.column[..]);
            if let Some(at) = self.column.iter().position(|v| !v.is_finite()) {
                return Err(SolveError::NonFinite { row: self.matrix.order[at] as usize });
            }
            self.matrix.scatter(&self.column, c, &mut x);
        }
        Ok(Solved::default())
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.matrix.update(values);
        self.ldl.update(view(&self.matrix)).map_err(|_| PrepareError::NotPositiveDefinite { row: 0 })?;
        self.check_pivots()
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.matrix.order)
    }

    fn footprint(&self) -> Footprint {
        let (n, entries) = (self.matrix.n() as u64, self.ldl.nnz() as u64);
        let factor = entries * 12 + n * 12;
        Footprint {
            host_bytes: Some(factor + self.matrix.bytes() + n * 40),
            factor_nonzeros: Some(entries + n),
            factor_bytes: Some(factor),
            bytes_per_solve: Some(2 * factor),
            ordering: Some(self.matrix.ordering),
            ..Footprint::default()
        }
    }
}
