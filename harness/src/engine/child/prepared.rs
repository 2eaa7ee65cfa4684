//! A prepared problem in the child, and the timed repetitions on it.

use super::clock::{PhaseClock, nanoseconds};
use super::{failed, open_loop, read_rows};
use crate::engine::allocation;
use crate::engine::array_file::{ArrayFile, Number};
use crate::engine::protocol::{MatrixFiles, Problem, Refusal, Timed, Trace};
use lapsolve::backend::{Backend, Factor, Footprint, Harmonic, PrepareOptions, Solved};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use std::path::Path;
use std::time::{Duration, Instant};

/// A handle and the shape of its blocks.
pub struct Prepared {
    handle: Handle,
    /// Rows of a right-hand side.
    inputs: usize,
    /// Rows of a solution.
    outputs: usize,
    max_columns: usize,
}

enum Handle {
    System(Box<dyn Factor>),
    Harmonic(Box<dyn Harmonic>),
}

impl Prepared {
    /// Reads the problem and prepares it; `clock` runs during the backend's own work only.
    pub fn new(
        backend: &dyn Backend,
        problem: &Problem,
        max_columns: usize,
        clock: &mut PhaseClock,
    ) -> Result<Self, Refusal> {
        let options = PrepareOptions::columns(max_columns);
        match problem {
            Problem::System { matrix, positions } => {
                let system = System::new(read_matrix(matrix)?, read_points(positions.as_ref())?)
                    .map_err(|e| failed(e.to_string()))?;
                clock.restart();
                let factor = backend.prepare(&system, &options, &mut |phase| clock.begin(phase))?;
                clock.stop();
                let n = system.n();
                Ok(Self { handle: Handle::System(factor), inputs: n, outputs: n, max_columns })
            }
            Problem::Harmonic { laplacian, positions, fixed } => {
                let positions = read_points(positions.as_ref())?;
                let problem =
                    Dirichlet::new(read_matrix(laplacian)?, positions.as_deref(), &fixed.read::<u32>()?)
                        .map_err(|e| failed(e.to_string()))?;
                clock.restart();
                let harmonic =
                    backend.prepare_harmonic(&problem, &options, &mut |phase| clock.begin(phase))?;
                clock.stop();
                let (inputs, outputs) = (problem.fixed().len(), laplacian.n);
                Ok(Self { handle: Handle::Harmonic(harmonic), inputs, outputs, max_columns })
            }
            Problem::Transfer { .. } => Err(failed("whole transfer frames are not served")),
        }
    }

    /// One solve from x = 0; only the solve itself is timed.
    fn solve_once(
        &mut self,
        rhs: Columns<&[f64]>,
        mut x: Columns<&mut [f64]>,
    ) -> Result<(Duration, Solved), Refusal> {
        x.data_mut().fill(0.0);
        let start = Instant::now();
        let solved = match &mut self.handle {
            Handle::System(factor) => factor.solve(rhs, x),
            Handle::Harmonic(harmonic) => harmonic.solve(rhs, x),
        };
        Ok((start.elapsed(), solved?))
    }

    fn rhs(&self, file: &ArrayFile) -> Result<Vec<f64>, Refusal> {
        if file.columns > self.max_columns {
            return Err(failed(format!("{} columns, prepared for {}", file.columns, self.max_columns)));
        }
        read_rows(file, self.inputs, "rhs")
    }

    /// `solve`: see [`crate::engine::protocol::Request::Solve`].
    pub fn solve(
        &mut self,
        rhs: &ArrayFile,
        warmup: u32,
        times: u32,
        solution: &Path,
        counts: bool,
    ) -> Result<Timed, Refusal> {
        let (b, k) = (self.rhs(rhs)?, rhs.columns);
        let b = Columns::new(&b[..], self.inputs, k);
        let (n, mut x) = (self.outputs, vec![0.0; self.outputs * k]);
        let timed = repeat(warmup, times, counts, || self.solve_once(b, Columns::new(&mut x[..], n, k)))?;
        ArrayFile::write(solution, &x, k)?;
        Ok(timed)
    }

    /// `update`: see [`crate::engine::protocol::Request::Update`].
    pub fn update(&mut self, values: &ArrayFile, times: u32) -> Result<Timed, Refusal> {
        let values: Vec<f64> = values.read()?;
        repeat(0, times, false, || {
            let start = Instant::now();
            match &mut self.handle {
                Handle::System(factor) => factor.update_values(&values, &mut |_| {}),
                Handle::Harmonic(harmonic) => harmonic.update_values(&values, &mut |_| {}),
            }?;
            Ok((start.elapsed(), Solved::default()))
        })
    }

    /// `frame`: see [`crate::engine::protocol::Request::Frame`].
    pub fn frame(
        &mut self,
        _template: &ArrayFile,
        _warmup: u32,
        _solution: &Path,
        _trace: Option<&Trace>,
        _counts: bool,
    ) -> Result<Timed, Refusal> {
        Err(failed("frames need a prepared transfer problem"))
    }

    /// `open_loop`: see [`crate::engine::protocol::Request::OpenLoop`].
    pub fn open_loop(
        &mut self,
        hz: f64,
        frames: u32,
        limit_ns: u64,
        input: &ArrayFile,
    ) -> Result<Timed, Refusal> {
        if !(0.1..=10_000.0).contains(&hz) {
            return Err(failed(format!("{hz} starts per second are not between 0.1 and 10,000")));
        }
        let (b, k) = (self.rhs(input)?, input.columns);
        let b = Columns::new(&b[..], self.inputs, k);
        let (n, mut x) = (self.outputs, vec![0.0; self.outputs * k]);
        let samples_ns = open_loop::latencies(hz, frames, Duration::from_nanos(limit_ns), || {
            self.solve_once(b, Columns::new(&mut x[..], n, k)).map(|_| ())
        })?;
        Ok(Timed { samples_ns, ..Timed::default() })
    }

    /// What the handle holds.
    pub fn footprint(&self) -> Footprint {
        match &self.handle {
            Handle::System(factor) => factor.footprint(),
            Handle::Harmonic(harmonic) => harmonic.footprint(),
        }
    }
}

/// Repeats `step`, which times itself; the first `warmup` times do not count.
fn repeat(
    warmup: u32,
    times: u32,
    counts: bool,
    mut step: impl FnMut() -> Result<(Duration, Solved), Refusal>,
) -> Result<Timed, Refusal> {
    for _ in 0..warmup {
        step()?;
    }
    let mut timed = Timed { samples_ns: Vec::with_capacity(times as usize), ..Timed::default() };
    timed.device_ns.reserve_exact(times as usize);
    let before = allocation::count();
    for _ in 0..times {
        let (elapsed, solved) = step()?;
        timed.samples_ns.push(nanoseconds(elapsed));
        timed.device_ns.extend(solved.device_ns);
        timed.iterations = solved.iterations;
    }
    timed.allocations = counts.then(|| allocation::count() - before);
    Ok(timed)
}

fn read_matrix(files: &MatrixFiles) -> Result<SymmetricCsr, Refusal> {
    let (row_starts, columns) = (files.row_starts.read()?, files.columns.read()?);
    let matrix = SymmetricCsr::new(row_starts, columns, files.values.read()?)
        .map_err(|e| failed(format!("matrix: {e}")))?;
    if matrix.n() != files.n {
        return Err(failed(format!("matrix: {} rows, {} announced", matrix.n(), files.n)));
    }
    Ok(matrix)
}

fn read_points(file: Option<&ArrayFile>) -> Result<Option<Vec<[f64; 3]>>, Refusal> {
    file.map(read_triples::<f64>).transpose()
}

fn read_triples<T: Number>(file: &ArrayFile) -> Result<Vec<[T; 3]>, Refusal> {
    if file.columns != 3 {
        return Err(failed(format!("{}: 3 columns expected", file.path.display())));
    }
    Ok(file.read::<T>()?.as_chunks().0.to_vec())
}
