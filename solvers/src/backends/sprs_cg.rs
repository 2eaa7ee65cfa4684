//! `sprs-cg`: conjugate gradients with a Jacobi preconditioner on a `sprs` matrix.
//!
//! The Krylov core is that of the `cg-` family; the matrix is stored and multiplied as [`sprs::CsMatI`], one row view at
//! a time. What the row shows is the price of a general sparse-matrix crate in the inner loop.

use super::cg::handle::CgFactor;
use super::cg::jacobi::Jacobi;
use super::cg::operator::{Csr, FullCsr, Operator};
use crate::backend::{Backend, Description, Factor, Phase, PrepareOptions};
use crate::error::{PrepareError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use sprs::CsMatI;

/// Opens `sprs-cg`.
pub fn open(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(SprsCg { tolerance: options.tolerance }))
}

struct SprsCg {
    tolerance: f64,
}

impl Backend for SprsCg {
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
        let (starts, columns, values, source) = FullCsr::new(system.matrix()).into_parts();
        let n = system.n();
        let matrix = SprsMatrix { matrix: CsMatI::new((n, n), starts, columns, values), source };
        on(Phase::Numeric);
        let jacobi = Box::new(Jacobi::new(matrix.csr()));
        Ok(Box::new(CgFactor::new(matrix, jacobi, self.tolerance, options.max_columns)))
    }
}

/// A `sprs` matrix with both triangles, and the system's stored entry behind each of its own.
struct SprsMatrix {
    matrix: CsMatI<f64, u32, u32>,
    source: Vec<u32>,
}

impl Operator for SprsMatrix {
    fn csr(&self) -> Csr<'_> {
        Csr {
            starts: self.matrix.indptr().into_raw_storage(),
            columns: self.matrix.indices(),
            values: self.matrix.data(),
        }
    }

    fn multiply<const W: usize>(&self, x: &[[f64; W]], y: &mut [[f64; W]]) -> [f64; W] {
        let mut dot = [0.0; W];
        for ((row, y), own) in self.matrix.outer_iterator().zip(y).zip(x) {
            *y = [0.0; W];
            for (j, &a) in row.iter() {
                for c in 0..W {
                    y[c] += a * x[j as usize][c];
                }
            }
            for c in 0..W {
                dot[c] += own[c] * y[c];
            }
        }
        dot
    }

    fn update(&mut self, stored: &[f64]) {
        for (value, &entry) in self.matrix.data_mut().iter_mut().zip(&self.source) {
            *value = stored[entry as usize];
        }
    }

    fn bytes(&self) -> usize {
        self.matrix.indptr().len() * 4 + self.matrix.nnz() * 16
    }
}
