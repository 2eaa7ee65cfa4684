//! The hierarchy of levels, and its V-cycle as a preconditioner.

use super::bottom::Bottom;
use super::cells::Cells;
use super::filter::Filtered;
use super::galerkin;
use super::interpolate;
use super::level::{self, Level};
use super::rows::Rows;
use super::stiff::{self, Stiff};
use crate::backends::cg::operator::Csr;
use crate::backends::cg::preconditioner::{AnyPreconditioner, Budget, Preconditioner, Size};
use crate::backends::cg::workers::Workers;
use crate::error::PrepareError;
use crate::vector::Vector;

/// Rows that dense Cholesky takes over from: its two sweeps then cost less than a hundredth of a cycle on a large mesh.
const BOTTOM_ROWS: usize = 400;
/// A level that keeps more than this share of its rows is not worth having: smoothing alone has to do.
const WORTHWHILE: f64 = 0.8;

/// How coarse functions are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Interpolation<'a> {
    /// Smoothed aggregation, from the matrix alone.
    Smoothed,
    /// Barycentric on the surface, from one point per row; these weights stay when values change.
    Barycentric(&'a [Vector]),
}

/// Stiff rows, levels, and the direct solve at the bottom.
pub(crate) struct Hierarchy {
    stiff: Stiff,
    levels: Vec<Level>,
    bottom: Bottom,
    /// The cells of each level: they stay when values change.
    cells: Vec<Cells>,
    keeps_weights: bool,
    width: usize,
}

impl Hierarchy {
    /// Builds the hierarchy of `a`, for solves of up to `width` lanes.
    ///
    /// # Errors
    /// `NotPositiveDefinite` with the row where elimination breaks down, or the sample of the coarse row where it does.
    pub(crate) fn new(
        workers: &mut Workers,
        a: Csr<'_>,
        interpolation: Interpolation<'_>,
        width: usize,
    ) -> Result<Self, PrepareError> {
        let order = stiff::choose(workers, a);
        let keeps_weights = interpolation != Interpolation::Smoothed;
        Self::build(workers, a, order, keeps_weights, width, coarsening(interpolation))
    }

    /// Builds levels for as long as `coarsen` (given the matrix of a level) makes cells.
    fn build(
        workers: &mut Workers,
        a: Csr<'_>,
        stiff: Vec<u32>,
        keeps_weights: bool,
        width: usize,
        coarsen: impl FnMut(&mut Workers, Csr<'_>) -> Option<(level::Interpolation, Cells)>,
    ) -> Result<Self, PrepareError> {
        let not_definite = |row| PrepareError::NotPositiveDefinite { row };
        let (stiff, matrix) = Stiff::factor(a, stiff, width).map_err(not_definite)?;
        let (mut levels, mut all_cells) = (Vec::new(), Vec::new());
        let bottom = refine(workers, matrix, coarsen, |workers, matrix, interpolation, cells| {
            levels.push(Level::new(workers, matrix.csr(), interpolation, width));
            all_cells.push(cells);
        });
        let bottom =
            Bottom::new(bottom.csr(), width).map_err(|row| not_definite(sampled_row(row, &all_cells)))?;
        Ok(Self { stiff, levels, bottom, cells: all_cells, keeps_weights, width })
    }
}

/// Row of the finest level that row `row` of the coarsest one is a sample of.
pub(crate) fn sampled_row(row: usize, cells: &[Cells]) -> usize {
    cells.iter().rev().fold(row, |row, cells| cells.samples[row] as usize)
}

/// How cells and interpolation are made, level after level.
fn coarsening(
    interpolation: Interpolation<'_>,
) -> impl FnMut(&mut Workers, Csr<'_>) -> Option<(level::Interpolation, Cells)> {
    let mut points = match interpolation {
        Interpolation::Smoothed => None,
        Interpolation::Barycentric(points) => Some(points.to_vec()),
    };
    move |workers, a| {
        let f = Filtered::new(a);
        let cells = Cells::new(&f);
        // No cells at all: every row is its own (a mass matrix, nearly).
        if cells.count() == 0 || cells.count() as f64 > WORTHWHILE * a.n() as f64 {
            return None;
        }
        let p = match &points {
            Some(points) => interpolate::barycentric(workers, a, &cells, points),
            None => interpolate::smoothed(workers, &f, &cells),
        };
        points = points.take().map(|own| cells.samples.iter().map(|&s| own[s as usize]).collect());
        Some((level::Interpolation::new(p, cells.count()), cells))
    }
}

/// Makes coarser matrices until one is small enough for the bottom, which is returned; `level` takes the others, with the way
/// from each to the next.
fn refine(
    workers: &mut Workers,
    mut matrix: Rows<f64>,
    mut coarsen: impl FnMut(&mut Workers, Csr<'_>) -> Option<(level::Interpolation, Cells)>,
    mut level: impl FnMut(&mut Workers, Rows<f64>, level::Interpolation, Cells),
) -> Rows<f64> {
    while matrix.n() > BOTTOM_ROWS {
        let (interpolation, cells) =
            coarsen(workers, matrix.csr()).unwrap_or_else(|| smoothing_only(matrix.n()));
        let level::Interpolation { p, r } = &interpolation;
        let coarse = galerkin::product(workers, matrix.csr(), p, r);
        level(workers, std::mem::replace(&mut matrix, coarse), interpolation, cells);
    }
    matrix
}

/// The levels of `a` without elimination, for cycles elsewhere: `level` takes each, the coarsest matrix is returned.
#[cfg(feature = "vulkan")]
pub(crate) fn levels(
    workers: &mut Workers,
    a: Csr<'_>,
    interpolation: Interpolation<'_>,
    mut level: impl FnMut(Rows<f64>, level::Interpolation, Cells),
) -> Rows<f64> {
    let matrix = Rows { starts: a.starts.to_vec(), columns: a.columns.to_vec(), values: a.values.to_vec() };
    refine(workers, matrix, coarsening(interpolation), |_, matrix, kept, cells| level(matrix, kept, cells))
}

/// The last level of a matrix without couplings worth following: its cycle is one symmetric Gauss-Seidel step.
fn smoothing_only(n: usize) -> (level::Interpolation, Cells) {
    let nothing = Rows { starts: vec![0; n + 1], columns: Vec::new(), values: Vec::new() };
    (level::Interpolation::new(nothing, 0), Cells { owner: Vec::new(), samples: Vec::new() })
}

/// x = V-cycle(b), from zero.
fn cycle<const W: usize>(
    workers: &mut Workers,
    levels: &mut [Level],
    bottom: &mut Bottom,
    b: &[[f32; W]],
    x: &mut [[f32; W]],
) {
    let Some((level, coarser)) = levels.split_first_mut() else {
        return bottom.solve(b, x);
    };
    level.down(workers, b, x);
    let mut work = std::mem::take(&mut level.coarse);
    let rows = level.coarse_rows();
    let (coarse_b, coarse_x) = work.split::<W>(rows);
    cycle(workers, coarser, bottom, coarse_b, coarse_x);
    level.coarse = work;
    level.up(workers, b, x);
}

impl<const W: usize> Preconditioner<f32, W> for Hierarchy {
    fn apply(&mut self, workers: &mut Workers, r: &mut [[f32; W]], z: &mut [[f32; W]]) {
        self.stiff.forward(r);
        cycle(workers, &mut self.levels, &mut self.bottom, r, z);
        self.stiff.backward(z, r);
    }
}

impl AnyPreconditioner<f32> for Hierarchy {
    /// Keeps the eliminated rows, the cells and, where they come from positions, the weights of the interpolation.
    fn update(&mut self, workers: &mut Workers, a: Csr<'_>) -> Result<(), PrepareError> {
        let order = self.stiff.order().to_vec();
        let mut old = std::mem::take(&mut self.levels).into_iter();
        let mut cells = std::mem::take(&mut self.cells).into_iter();
        let keeps_weights = self.keeps_weights;
        let again = |workers: &mut Workers, a: Csr<'_>| {
            let (level, cells) = (old.next()?, cells.next()?);
            let kept = level.into_interpolation();
            let interpolation = if keeps_weights || cells.count() == 0 {
                kept
            } else {
                let p = interpolate::smoothed(workers, &Filtered::new(a), &cells);
                level::Interpolation::new(p, cells.count())
            };
            Some((interpolation, cells))
        };
        *self = Self::build(workers, a, order, keeps_weights, self.width, again)?;
        Ok(())
    }

    fn budget(&self) -> Budget {
        Budget::MULTILEVEL
    }

    fn size(&self) -> Size {
        let parts = self.levels.iter().map(Level::size).chain([self.stiff.size()]);
        let (entries, bytes) = parts.fold((0, 0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        let bottom = self.bottom.entries();
        Size { entries: (entries + bottom) as u64, bytes: (bytes + 8 * bottom) as u64 }
    }
}
