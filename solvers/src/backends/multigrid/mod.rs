//! The multilevel backends: `multigrid`, `cg-multigrid` and `cg-amg`.
//!
//! One hierarchy, built from the matrix and, for the first two, from the vertex positions:
//!
//! 1. `stiff`: the few vertices in the middle of needles and caps are eliminated exactly;
//! 2. `filter`: positive and weak couplings are lumped, for the decisions of the next two steps only;
//! 3. `cells`: samples, and the graph Voronoi cell of each;
//! 4. `interpolate`: every vertex from at most three samples, barycentric on the surface (`multigrid`, in the spirit of
//!    Wiersma, Nasikun, Eisemann and Hildebrandt 2023), or constants on cells smoothed by one Jacobi step (`cg-amg`;
//!    Vanek, Mandel and Brezina 1996; also taken where a system has no positions);
//! 5. `galerkin`: the coarse matrix P^T A P, of the true A with all its entries; from there again, until `bottom` takes over.
//!
//! `level` holds the kernels of a cycle: one Gauss-Seidel sweep down, one up, all in f32 (the outer iteration is in f64).
//! `multigrid` repeats the cycle by itself; as preconditioner it needs half the iterations or fewer.
//!
//! When to choose it: one or a few solves per matrix, values that change in every frame, or not enough memory for a
//! factor. For many solves with one matrix a direct factor wins.

pub(crate) mod bottom;
pub(crate) mod cells;
mod filter;
mod galerkin;
pub(crate) mod hierarchy;
mod interpolate;
pub(crate) mod level;
pub(crate) mod rows;
mod stiff;
#[cfg(test)]
mod tests;

use super::cg;
use super::cg::krylov::Method;
use super::cg::operator::Csr;
use super::cg::preconditioner::AnyPreconditioner;
use super::cg::workers::Workers;
use crate::backend::Backend;
use crate::error::{PrepareError, Unavailable};
use crate::registry::OpenOptions;
use crate::vector::Vector;
use hierarchy::{Hierarchy, Interpolation};

/// Opens `multigrid`: the cycle by itself.
pub fn open(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    cg::open(options, Method::Stationary, surface)
}

/// Opens `cg-multigrid`.
pub fn open_cg(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    cg::open(options, Method::Conjugate, surface)
}

/// Opens `cg-amg`.
pub fn open_amg(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    cg::open(options, Method::Conjugate, |workers, a, _, width| surface(workers, a, None, width))
}

fn surface(
    workers: &mut Workers,
    a: Csr<'_>,
    positions: Option<&[Vector]>,
    width: usize,
) -> Result<Box<dyn AnyPreconditioner<f32>>, PrepareError> {
    let interpolation = positions.map_or(Interpolation::Smoothed, Interpolation::Barycentric);
    Ok(Box::new(Hierarchy::new(workers, a, interpolation, width)?))
}
