//! The V-cycle: the hierarchy of the CPU, with a smoother that devices like.
//!
//! Two Jacobi steps before the coarse correction and two after it, in reverse order, with the weights of a Chebyshev
//! polynomial for the upper three quarters of the spectrum, where the coarse level cannot see. The diagonal is the l1 one,
//! sum_j |a_ij|, so that the spectrum of D^-1 A ends at 1 for every matrix (Baker, Falgout, Kolev and Yang 2011). The bottom is
//! multiplied by its inverse.

use super::super::{Buffer, Device, DeviceError, Plan};
use super::kernels::{Kernels, Number, Product};
use super::precondition::vector;
use super::sparse::{Sparse, weights};
use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::Workers;
use crate::backends::multigrid::bottom::Bottom;
use crate::backends::multigrid::hierarchy::{self, Interpolation};
use crate::backends::multigrid::rows::Rows;
use crate::error::PrepareError;
use crate::vector::Vector;
use std::sync::Arc;

/// Roots of the polynomial on [1/4, 1]: (1 + 1/4) / 2 +- (1 - 1/4) / 2 cos(pi / 4).
const ROOTS: [f64; 2] =
    [0.625 + 0.375 * std::f64::consts::FRAC_1_SQRT_2, 0.625 - 0.375 * std::f64::consts::FRAC_1_SQRT_2];

/// Levels and bottom.
pub(super) struct Cycle {
    levels: Vec<Level>,
    /// The inverse of the coarsest matrix.
    inverse: Sparse,
}

struct Level {
    a: Sparse,
    p: Sparse,
    r: Sparse,
    /// 1 / (root l1-diagonal), for both roots.
    weights: [Arc<Buffer>; 2],
    /// Iterate and residual of this level.
    work: [Arc<Buffer>; 2],
    /// Right-hand side and solution of the next one.
    coarse: [Arc<Buffer>; 2],
}

impl Cycle {
    /// Builds the hierarchy of `a` and uploads it.
    pub(super) fn new<T: Number>(
        device: &Arc<Device>,
        workers: &mut Workers,
        a: Csr<'_>,
        points: Option<&[Vector]>,
    ) -> Result<Self, PrepareError> {
        let interpolation = points.map_or(Interpolation::Smoothed, Interpolation::Barycentric);
        let (mut levels, mut all_cells) = (Vec::new(), Vec::new());
        let bottom = hierarchy::levels(workers, a, interpolation, |matrix, kept, cells| {
            levels.push(Level::new::<T>(device, &matrix, &kept.p, &kept.r));
            all_cells.push(cells);
        });
        let levels = levels.into_iter().collect::<Result<Vec<_>, _>>()?;
        let inverse = inverse(bottom.csr()).map_err(|row| PrepareError::NotPositiveDefinite {
            row: hierarchy::sampled_row(row, &all_cells),
        })?;
        Ok(Self { levels, inverse: Sparse::of_rows::<T, f64>(device, &inverse)? })
    }

    /// x = V-cycle(b), from zero.
    pub(super) fn apply(&self, plan: &mut Plan, kernels: &Kernels, b: &Arc<Buffer>, x: &Arc<Buffer>) {
        descend(&self.levels, &self.inverse, plan, kernels, b, x);
    }

    /// Entries of all levels.
    pub(super) fn entries(&self) -> usize {
        let levels = self.levels.iter().map(|l| l.a.entries + l.p.entries + l.r.entries);
        levels.sum::<usize>() + self.inverse.entries
    }
}

impl Level {
    fn new<T: Number>(
        device: &Arc<Device>,
        a: &Rows<f64>,
        p: &Rows<f32>,
        r: &Rows<f32>,
    ) -> Result<Self, DeviceError> {
        let sums: Vec<f64> = (0..a.n()).map(|i| a.row(i).1.iter().map(|v| v.abs()).sum()).collect();
        let weight = |root: f64| weights::<T>(device, sums.iter().map(|sum| 1.0 / (root * sum)));
        let (n, coarse) = (a.n() as u32, r.n() as u32);
        Ok(Self {
            a: Sparse::of_rows::<T, f64>(device, a)?,
            p: Sparse::of_rows::<T, f32>(device, p)?,
            r: Sparse::of_rows::<T, f32>(device, r)?,
            weights: [weight(ROOTS[0])?, weight(ROOTS[1])?],
            work: [vector::<T>(device, n)?, vector::<T>(device, n)?],
            coarse: [vector::<T>(device, coarse)?, vector::<T>(device, coarse)?],
        })
    }
}

fn descend(
    levels: &[Level],
    bottom: &Sparse,
    plan: &mut Plan,
    kernels: &Kernels,
    b: &Arc<Buffer>,
    x: &Arc<Buffer>,
) {
    let Some((level, coarser)) = levels.split_first() else {
        return kernels.sparse(plan, Product::Plain, bottom, b, x);
    };
    let Level { a, p, r, weights: [first, second], work: [iterate, residual], coarse: [coarse_b, coarse_x] } =
        level;
    kernels.scale(plan, a.rows, first, b, x);
    kernels.sparse(plan, Product::Smooth(b, second), a, x, iterate);
    kernels.sparse(plan, Product::Residual(b), a, iterate, residual);
    kernels.sparse(plan, Product::Plain, r, residual, coarse_b);
    descend(coarser, bottom, plan, kernels, coarse_b, coarse_x);
    kernels.sparse(plan, Product::Plus(iterate), p, coarse_x, residual);
    kernels.sparse(plan, Product::Smooth(b, second), a, residual, iterate);
    kernels.sparse(plan, Product::Smooth(b, first), a, iterate, x);
}

/// The inverse of a small matrix, all entries. `Err` holds the row whose pivot is not positive.
fn inverse(a: Csr<'_>) -> Result<Rows<f64>, usize> {
    const LANES: usize = 8;
    let n = a.n();
    let mut bottom = Bottom::new(a, LANES)?;
    let mut inverse = Rows::with_capacity(n, n * n);
    inverse.columns = (0..n * n).map(|at| (at % n) as u32).collect();
    inverse.values = vec![0.0; n * n];
    inverse.starts = (0..=n).map(|i| (i * n) as u32).collect();
    let mut solution = vec![[0.0; LANES]; n];
    for first in (0..n).step_by(LANES) {
        let mut unit = vec![[0.0; LANES]; n];
        (0..LANES.min(n - first)).for_each(|c| unit[first + c][c] = 1.0);
        bottom.solve(&unit, &mut solution);
        for i in 0..n {
            for c in 0..LANES.min(n - first) {
                inverse.values[i * n + first + c] = solution[i][c];
            }
        }
    }
    Ok(inverse)
}
