//! The handle: iterations on the device, refinement and the last word on the host.

use super::super::Device;
use super::iteration::{Iteration, LANES};
use super::kernels::{Kernels, Number};
use super::precondition::{Method, Preconditioner};
use super::sparse::Sparse;
use crate::backend::{Factor, Footprint, Phase, Solved};
use crate::backends::cg::in_system;
use crate::backends::cg::kernels::{Residual, Sums};
use crate::backends::cg::lanes::Window;
use crate::backends::cg::norms::{Norms, inverse_diagonal};
use crate::backends::cg::operator::{FullCsr, Operator};
use crate::backends::cg::workers::{Each, Strips, Workers};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};
use crate::vector::Vector;
use std::sync::Arc;

/// The true residual may exceed the tolerance by this factor, as on the CPU.
const ACCEPTED: f64 = 1.05;
/// A refinement must at least halve the residual, or rounding is all that is left.
const GAIN: f64 = 0.5;
/// So a refinement is asked for half of that at least, even where less is missing.
const LEAST: f64 = 0.5 * GAIN;
/// A residual is progress where it is below nine tenths of the smallest before.
const PROGRESS: f64 = 0.9;

/// A prepared system.
pub(super) struct CgOnDevice<T> {
    device: Arc<Device>,
    workers: Workers,
    strips: Strips,
    sums: Vec<Sums>,
    matrix: FullCsr,
    /// Inverse diagonal.
    inverse: Vec<f64>,
    points: Option<Vec<Vector>>,
    method: Method,
    tolerance: f64,
    kernels: Kernels,
    iteration: Iteration<T>,
    entries: usize,
    /// Iterate and residual on the host.
    x: Vec<[f64; LANES]>,
    r: Vec<[f64; LANES]>,
    observer: Option<Box<dyn FnMut(u32, f64) + Send>>,
}

/// A window of columns while it is solved.
struct Course {
    b: Norms<LANES>,
    r: Norms<LANES>,
    iterations: u32,
    device_ns: Option<u64>,
}

impl<T: Number> CgOnDevice<T> {
    /// Uploads `matrix` and its preconditioner, records the iteration and lets the driver compile it.
    pub(super) fn new(
        device: &Arc<Device>,
        mut workers: Workers,
        matrix: FullCsr,
        points: Option<Vec<Vector>>,
        method: Method,
        tolerance: f64,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, PrepareError> {
        on(Phase::Upload);
        let kernels = Kernels::new::<T>(device)?;
        let (iteration, entries) =
            prepare(device, &mut workers, &kernels, &matrix, points.as_deref(), method, on)?;
        let n = matrix.csr().n();
        let strips = workers.strips(n);
        Ok(Self {
            device: Arc::clone(device),
            sums: vec![Sums::default(); strips.count()],
            strips,
            workers,
            inverse: inverse_diagonal(matrix.csr()),
            matrix,
            points,
            method,
            tolerance,
            kernels,
            iteration,
            entries,
            x: vec![[0.0; LANES]; n],
            r: vec![[0.0; LANES]; n],
            observer: None,
        })
    }

    fn solve_window(
        &mut self,
        b: Columns<&[f64]>,
        mut out: Columns<&mut [f64]>,
        first: usize,
    ) -> Result<Solved, SolveError> {
        let window = Window::<LANES>::new(b, first).map_err(|row| SolveError::NonFinite { row })?;
        let mut course = self.guess(&window, b, out.view());
        loop {
            let missing = self.missing(&course, &window);
            if !missing.contains(&true) {
                break;
            }
            let before = course.sizes();
            let broken = self.correct(&missing, &mut course)?;
            course.r = self.residual(&window, b);
            let sizes = course.sizes();
            let stuck = |c: usize| !(sizes[c] <= GAIN * GAIN * before[c]);
            let still = self.missing(&course, &window);
            let exhausted = course.iterations >= self.method.budget().iterations;
            if (0..LANES).any(|c| still[c] && (broken[c] || stuck(c) || exhausted)) {
                self.write(&window, &mut out);
                let residual = course.worst(&window);
                return Err(SolveError::NotConverged { iterations: course.iterations, residual });
            }
        }
        self.write(&window, &mut out);
        let residual = Some(course.worst(&window));
        Ok(Solved { iterations: Some(course.iterations), residual, device_ns: course.device_ns })
    }

    /// Loads the guess, unless x = 0 is better.
    fn guess(&mut self, window: &Window<LANES>, b: Columns<&[f64]>, guess: Columns<&[f64]>) -> Course {
        let mut norms = Norms::ZERO;
        for (i, &row) in self.matrix.rows().iter().enumerate() {
            self.x[i] = window.read(guess, row as usize);
            norms.add(&window.read(b, row as usize), self.inverse[i]);
        }
        let r = self.residual(window, b);
        let mut course = Course { b: norms, r, iterations: 0, device_ns: None };
        let keep = course.sizes().map(|size| size <= 1.0); // false for NaN as well
        if keep.contains(&false) {
            for x in &mut self.x {
                (0..LANES).filter(|&c| !keep[c]).for_each(|c| x[c] = 0.0);
            }
            course.r = self.residual(window, b);
        }
        course
    }

    /// r = b - A x in f64; returns its norms.
    fn residual(&mut self, window: &Window<LANES>, b: Columns<&[f64]>) -> Norms<LANES> {
        let (isa, a, x, inverse) = (self.workers.isa, &self.matrix, &self.x[..], &self.inverse[..]);
        self.workers.run(&self.strips, (&mut self.r[..], Each(&mut self.sums)), |_, rows, (r, sum)| {
            sum.set(isa.run(Residual { a, rows, inverse, window, b, x, r }));
        });
        Sums::norms(&self.sums)
    }

    fn missing(&self, course: &Course, window: &Window<LANES>) -> [bool; LANES] {
        let (limit, sizes) = (ACCEPTED * self.tolerance, course.sizes());
        std::array::from_fn(|c| window.is_used(c) && !(sizes[c] <= limit * limit))
    }

    /// x += what the device makes of r for the columns `missing`. Returns the columns that broke down or stood still.
    fn correct(&mut self, missing: &[bool; LANES], course: &mut Course) -> Result<[bool; LANES], SolveError> {
        // r goes over at unit norm, a power of two apart, so that f32 holds it.
        let rr = course.r.plain;
        let scale: [f64; LANES] =
            std::array::from_fn(|c| if missing[c] { rr[c].sqrt().log2().floor().exp2() } else { 1.0 });
        // The device watches the 2-norm alone: it goes as far below as the other norm, if that is larger, has to.
        let (goal, sizes) = (self.tolerance * self.tolerance, course.sizes());
        let limit = std::array::from_fn(|c| {
            let enough = f64::max((goal / sizes[c]).min(LEAST * LEAST), T::TRUST * T::TRUST) * rr[c];
            if missing[c] { enough / (scale[c] * scale[c]) } else { f64::INFINITY }
        });
        let r = &self.r;
        let zero_rest = |i: usize| std::array::from_fn(|c| if missing[c] { r[i][c] / scale[c] } else { 0.0 });
        self.iteration.begin(zero_rest, limit)?;
        let broken = self.iterate(&scale, course)?;
        for (x, d) in self.x.iter_mut().zip(self.iteration.solution()) {
            for c in (0..LANES).filter(|&c| missing[c]) {
                let d = d[c].to_f64() * scale[c];
                x[c] += if d.is_finite() { d } else { 0.0 };
            }
        }
        Ok(broken)
    }

    /// Batches until no column iterates, or the budget or the patience is at its end.
    fn iterate(&mut self, scale: &[f64; LANES], course: &mut Course) -> Result<[bool; LANES], SolveError> {
        let budget = self.method.budget();
        let before = course.iterations;
        let (mut best, mut progress) = ([f64::INFINITY; LANES], before);
        loop {
            let standing = self.iteration.advance()?;
            let told = course.iterations;
            course.iterations = before + standing.iterations.into_iter().max().unwrap_or(0);
            course.device_ns =
                course.device_ns.unwrap_or(0).checked_add(self.iteration.batch_ns().unwrap_or(0));
            let rows = self.iteration.history().take((course.iterations - told) as usize);
            for (k, rr) in rows.enumerate() {
                let number = told + k as u32 + 1;
                let relative = |c: usize| (rr[c] * scale[c] * scale[c] / course.b.plain[c]).sqrt();
                if let Some(observer) = &mut self.observer {
                    let used = (0..LANES).filter(|&c| course.b.plain[c] > 0.0).map(relative);
                    observer(number, used.fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a }));
                }
                for c in 0..LANES {
                    if rr[c] < PROGRESS * PROGRESS * best[c] {
                        (best[c], progress) = (rr[c], number);
                    }
                }
            }
            if !standing.active.contains(&true) {
                return Ok(standing.broken);
            }
            if course.iterations - progress > budget.patience || course.iterations >= budget.iterations {
                return Ok(std::array::from_fn(|c| standing.active[c] || standing.broken[c]));
            }
        }
    }

    /// Writes the solution to the caller's x.
    fn write(&self, window: &Window<LANES>, out: &mut Columns<&mut [f64]>) {
        for (x, &row) in self.x.iter().zip(self.matrix.rows()) {
            window.write(out, row as usize, &[true; LANES], x);
        }
    }
}

/// The device's side of `matrix`, and the entries of its preconditioner.
fn prepare<T: Number>(
    device: &Arc<Device>,
    workers: &mut Workers,
    kernels: &Kernels,
    matrix: &FullCsr,
    points: Option<&[Vector]>,
    method: Method,
    on: &mut dyn FnMut(Phase),
) -> Result<(Iteration<T>, usize), PrepareError> {
    on(Phase::Numeric);
    let preconditioner = Preconditioner::new::<T>(device, workers, matrix.csr(), points, method)
        .map_err(|error| in_system(error, matrix.rows()))?;
    on(Phase::Upload);
    let a = Sparse::of_csr::<T>(device, matrix.csr())?;
    let mut iteration = Iteration::new(device, kernels, &a, &preconditioner, method.batch())?;
    // Drivers compile kernels when they first run.
    iteration.begin(|_| [0.0; LANES], [f64::INFINITY; LANES])?;
    iteration.advance()?;
    Ok((iteration, preconditioner.entries() + a.entries))
}

impl Course {
    /// Largest relative residual.
    fn worst(&self, window: &Window<LANES>) -> f64 {
        let sizes = self.sizes();
        let used = (0..LANES).filter(|&c| window.is_used(c)).map(|c| sizes[c].sqrt());
        used.fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Squares of the relative residuals, the larger of both norms.
    fn sizes(&self) -> [f64; LANES] {
        std::array::from_fn(|c| self.r.relative(&self.b, c))
    }
}

impl<T: Number> Factor for CgOnDevice<T> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.x.len(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let mut whole = Solved { iterations: Some(0), residual: Some(0.0), device_ns: None };
        let mut missed = false;
        for first in (0..k).step_by(LANES) {
            let solved = match self.solve_window(rhs, x.reborrow(), first) {
                Err(SolveError::NotConverged { iterations, residual }) => {
                    missed = true;
                    Solved { iterations: Some(iterations), residual: Some(residual), device_ns: None }
                }
                other => other?,
            };
            whole.iterations = whole.iterations.max(solved.iterations);
            whole.residual =
                whole.residual.zip(solved.residual).map(|(a, b)| if b.is_nan() { b } else { a.max(b) });
            whole.device_ns = Some(whole.device_ns.unwrap_or(0) + solved.device_ns.unwrap_or(0));
        }
        if missed {
            let (iterations, residual) = (whole.iterations.unwrap_or(0), whole.residual.unwrap_or(f64::NAN));
            return Err(SolveError::NotConverged { iterations, residual });
        }
        Ok(whole)
    }

    /// Everything on the device is made again.
    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.matrix.update(values);
        self.inverse = inverse_diagonal(self.matrix.csr());
        let Self { device, workers, kernels, matrix, points, method, .. } = self;
        let (iteration, entries) = prepare(device, workers, kernels, matrix, points.as_deref(), *method, on)?;
        (self.iteration, self.entries) = (iteration, entries);
        Ok(())
    }

    fn observe(&mut self, observer: Option<Box<dyn FnMut(u32, f64) + Send>>) -> bool {
        self.observer = observer;
        true
    }

    fn footprint(&self) -> Footprint {
        let bytes = (self.entries * (4 + size_of::<T>())) as u64;
        Footprint {
            host_bytes: Some(
                (self.matrix.bytes() + self.inverse.len() * 8 + 2 * self.x.len() * LANES * 8) as u64,
            ),
            device_bytes: Some(self.device.used()),
            factor_nonzeros: Some(self.entries as u64),
            factor_bytes: Some(bytes),
            bytes_per_solve: Some(bytes),
            ..Footprint::default()
        }
    }
}
