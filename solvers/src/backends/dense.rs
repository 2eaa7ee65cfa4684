//! `dense`: the readable oracle. Plain Cholesky on the full matrix, checkable by hand.

use crate::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::registry::OpenOptions;
use crate::sparse::SymmetricCsr;
use crate::system::System;

/// Largest system taken: n^2 doubles are 128 MB there and n^3 / 3 flops take some ten seconds.
pub const MAX_UNKNOWNS: usize = 4_000;

/// Opens the oracle; there is nothing to choose.
pub fn open(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Dense))
}

struct Dense;

impl Backend for Dense {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        _: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let n = system.n();
        if n > MAX_UNKNOWNS {
            let what = format!("dense factorisation of {n} unknowns (the limit is {MAX_UNKNOWNS})");
            return Err(PrepareError::Unsupported { what });
        }
        on(Phase::Symbolic);
        let mut factor = DenseFactor { pattern: system.matrix().clone(), l: vec![0.0; n * n] };
        factor.factorise(on)?;
        Ok(Box::new(factor))
    }
}

/// L with A = L L^T, the lower triangle by rows in an n x n array.
struct DenseFactor {
    pattern: SymmetricCsr,
    l: Vec<f64>,
}

impl DenseFactor {
    /// Row-wise Cholesky: l_ij = (a_ij - sum_k l_ik l_jk) / l_jj, l_ii = sqrt(a_ii - sum_k l_ik^2). n^3 / 3 flops.
    fn factorise(&mut self, on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        let n = self.pattern.n();
        self.l.fill(0.0);
        for j in 0..n {
            let (rows, values) = self.pattern.row(j);
            for (&i, &a) in rows.iter().zip(values) {
                self.l[i as usize * n + j] = a;
            }
        }
        for i in 0..n {
            let (above, row) = self.l.split_at_mut(i * n);
            for j in 0..i {
                let other = &above[j * n..j * n + j + 1];
                row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
            }
            let pivot = row[i] - dot(&row[..i], &row[..i]);
            if pivot.is_nan() || pivot.is_infinite() {
                return Err(PrepareError::NonFinite { row: i });
            }
            if pivot <= 0.0 {
                return Err(PrepareError::NotPositiveDefinite { row: i });
            }
            row[i] = pivot.sqrt();
        }
        Ok(())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

impl Factor for DenseFactor {
    /// L y = b forwards, L^T x = y backwards; 2 n^2 flops per column.
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.pattern.n(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        x.data_mut().copy_from_slice(rhs.slice());
        let x = x.data_mut();
        for c in 0..k {
            for i in 0..n {
                let row = &self.l[i * n..i * n + i + 1];
                let known: f64 = (0..i).map(|j| row[j] * x[j * k + c]).sum();
                x[i * k + c] = (x[i * k + c] - known) / row[i];
            }
            for i in (0..n).rev() {
                let known: f64 = (i + 1..n).map(|j| self.l[j * n + i] * x[j * k + c]).sum();
                x[i * k + c] = (x[i * k + c] - known) / self.l[i * n + i];
            }
        }
        match x.iter().position(|v| !v.is_finite()) {
            Some(at) => Err(SolveError::NonFinite { row: at / k }),
            None => Ok(Solved::default()),
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.pattern.values_mut().copy_from_slice(values);
        self.factorise(on)
    }

    fn footprint(&self) -> Footprint {
        let n = self.pattern.n() as u64;
        let bytes = n * n * 8;
        Footprint {
            host_bytes: Some(bytes + self.pattern.stored() as u64 * 12 + (n + 1) * 4),
            factor_nonzeros: Some(n * (n + 1) / 2),
            factor_bytes: Some(bytes),
            bytes_per_solve: Some(n * (n + 1) / 2 * 8 * 2),
            factor_flops: Some(n * n * n / 3),
            ordering: Some("natural"),
            ..Footprint::default()
        }
    }
}
