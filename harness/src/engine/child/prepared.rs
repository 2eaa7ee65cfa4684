//! A prepared problem in the child, and the timed repetitions on it.

use super::clock::{PhaseClock, StepClock, nanoseconds};
use super::{failed, inject, open_loop, read_rows};
use crate::engine::allocation;
use crate::engine::array_file::{ArrayFile, Number};
use crate::engine::protocol::{MatrixFiles, MeshFiles, Problem, Refusal, Timed, Trace};
use lapsolve::backend::{Backend, Factor, Footprint, Harmonic, PrepareOptions, Solved, TransferFrame};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::error::PrepareError;
use lapsolve::laplacian::Weights;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::poisson::PoissonError;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::workload::arap::{Arap, ArapError, ArapProblem};
use lapsolve::workload::geodesic::{Geodesic, GeodesicError, GeodesicProblem};
use lapsolve::workload::transfer::{self, TransferError, TransferProblem};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// A handle and the shape of its blocks.
pub struct Prepared {
    pub(super) handle: Handle,
    /// Rows of a right-hand side.
    pub(super) inputs: usize,
    /// Rows of a solution.
    pub(super) outputs: usize,
    /// Stored entries of the matrix, as many as an update has values.
    entries: usize,
    max_columns: usize,
}

/// What a backend prepared.
pub(super) enum Handle {
    System(Box<dyn Factor>),
    Harmonic(Box<dyn Harmonic>),
    Transfer(Box<dyn TransferFrame>),
    Arap(Box<Arap>, u32),
    Geodesic(Box<Geodesic>),
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
                let entries = matrix.values.rows;
                let system = System::new(read_matrix(matrix)?, read_points(positions.as_ref())?)
                    .map_err(|e| failed(e.to_string()))?;
                clock.restart();
                let start = Instant::now();
                let factor = backend.prepare(&system, &options, &mut |phase| clock.begin(phase))?;
                inject::delay("setup", start);
                clock.stop();
                let n = system.n();
                Ok(Self { handle: Handle::System(factor), inputs: n, outputs: n, entries, max_columns })
            }
            Problem::Harmonic { laplacian, positions, fixed, .. } => {
                let positions = read_points(positions.as_ref())?;
                let problem =
                    Dirichlet::new(read_matrix(laplacian)?, positions.as_deref(), &fixed.read::<u32>()?)
                        .map_err(|e| failed(e.to_string()))?;
                clock.restart();
                let start = Instant::now();
                let harmonic =
                    backend.prepare_harmonic(&problem, &options, &mut |phase| clock.begin(phase))?;
                inject::delay("setup", start);
                clock.stop();
                let (inputs, outputs) = (problem.fixed().len(), laplacian.n);
                let entries = laplacian.values.rows;
                Ok(Self { handle: Handle::Harmonic(harmonic), inputs, outputs, entries, max_columns })
            }
            Problem::Transfer { target, template, marks } => {
                let (target, template) = (read_mesh(target)?, read_mesh(template)?);
                let (inputs, outputs) = (template.positions().len(), target.positions().len());
                let marks: Vec<u32> = marks.read()?;
                let pairs: Vec<(u32, u32)> = marks.as_chunks().0.iter().map(|&[p, t]| (p, t)).collect();
                let problem = TransferProblem::new(&template, target, &pairs, Weights::Plain)
                    .map_err(|e| failed(e.to_string()))?;
                clock.restart();
                let start = Instant::now();
                let frames = transfer::prepare(backend, &problem, &options, &mut |phase| clock.begin(phase))
                    .map_err(|error| match error {
                        TransferError::Prepare(error) => error.into(),
                        other => failed(other.to_string()),
                    })?;
                inject::delay("setup", start);
                clock.stop();
                Ok(Self { handle: Handle::Transfer(frames), inputs, outputs, entries: 0, max_columns })
            }
            Problem::Arap { mesh, handles, iterations } => {
                exactly(max_columns, 3)?;
                let (mesh, handles) = (read_mesh(mesh)?, handles.read::<u32>()?);
                let problem = ArapProblem::new(&mesh, &handles, Weights::ClampedPerEdge)?;
                clock.restart();
                let arap = Arap::prepare(backend, &problem, &mut |phase| clock.begin(phase))?;
                clock.stop();
                let handle = Handle::Arap(Box::new(arap), *iterations);
                Ok(Self {
                    handle,
                    inputs: handles.len(),
                    outputs: mesh.positions().len(),
                    entries: 0,
                    max_columns,
                })
            }
            Problem::Geodesic { mesh } => {
                exactly(max_columns, 1)?;
                let mesh = read_mesh(mesh)?;
                let problem = GeodesicProblem::new(&mesh, Mass::Barycentric)?;
                clock.restart();
                let geodesic = Geodesic::prepare(backend, &problem, &mut |phase| clock.begin(phase))?;
                clock.stop();
                let n = mesh.positions().len();
                Ok(Self {
                    handle: Handle::Geodesic(Box::new(geodesic)),
                    inputs: n,
                    outputs: n,
                    entries: 0,
                    max_columns,
                })
            }
        }
    }

    /// One solve from x = 0; only the solve itself is timed.
    fn solve_once(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Step, Refusal> {
        x.data_mut().fill(0.0);
        let sources = self.sources(rhs)?;
        let before = allocation::count();
        let start = Instant::now();
        let solved = match &mut self.handle {
            Handle::Arap(arap, iterations) => {
                arap.solve(rhs.slice().as_chunks().0, *iterations, x.data_mut().as_chunks_mut().0)
            }
            Handle::Geodesic(geodesic) => geodesic.solve(&sources, x.data_mut()),
            Handle::System(factor) => factor.solve(rhs, x),
            Handle::Harmonic(harmonic) => harmonic.solve(rhs, x),
            Handle::Transfer(_) => return Err(failed("a transfer problem has frames, not solves")),
        };
        inject::delay("solve", start);
        let elapsed = start.elapsed();
        Ok(Step { elapsed, solved: solved?, allocations: allocation::count() - before })
    }

    /// The vertices that a right-hand side of distances names; none for other problems.
    fn sources(&self, rhs: Columns<&[f64]>) -> Result<Vec<u32>, Refusal> {
        let Handle::Geodesic(geodesic) = &self.handle else { return Ok(Vec::new()) };
        let sources: Vec<u32> =
            (0..).zip(rhs.slice()).filter(|&(_, &heat)| heat != 0.0).map(|(v, _)| v).collect();
        geodesic.problem().check_sources(&sources)?;
        Ok(sources)
    }

    pub(super) fn rhs(&self, file: &ArrayFile) -> Result<Vec<f64>, Refusal> {
        let whole = matches!(self.handle, Handle::Arap(..) | Handle::Geodesic(_));
        if file.columns > self.max_columns || (whole && file.columns != self.max_columns) {
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
        let mut timed =
            repeat(warmup, times, counts, |_| self.solve_once(b, Columns::new(&mut x[..], n, k)))?;
        timed.steps_ns = self.device_steps(&timed)?;
        ArrayFile::write(solution, &x, k)?;
        Ok(timed)
    }

    /// Where the timed solves ran on a device: their time there, the rest, and the phases of one more.
    fn device_steps(&mut self, timed: &Timed) -> Result<BTreeMap<String, Vec<u64>>, Refusal> {
        if timed.device_ns.len() != timed.samples_ns.len() {
            return Ok(BTreeMap::new());
        }
        let phases = match &mut self.handle {
            Handle::System(factor) => factor.device_phases()?,
            Handle::Harmonic(harmonic) => harmonic.device_phases()?,
            Handle::Transfer(frames) => frames.device_phases()?,
            Handle::Arap(..) | Handle::Geodesic(_) => Vec::new(),
        };
        let host =
            timed.samples_ns.iter().zip(&timed.device_ns).map(|(all, device)| all.saturating_sub(*device));
        let mut steps: BTreeMap<_, _> = phases.into_iter().map(|(name, ns)| (name, vec![ns])).collect();
        steps.insert("device".into(), timed.device_ns.clone());
        steps.insert("host".into(), host.collect());
        Ok(steps)
    }

    /// `update`: see [`crate::engine::protocol::Request::Update`].
    pub fn update(&mut self, values: &ArrayFile, times: u32) -> Result<Timed, Refusal> {
        if values.columns != 1 {
            return Err(failed(format!(
                "values: one number per stored entry expected, not {}",
                values.columns
            )));
        }
        let values = read_rows(values, self.entries, "values")?;
        repeat(0, times, false, |_| {
            let start = Instant::now();
            match &mut self.handle {
                Handle::System(factor) => factor.update_values(&values, &mut |_| {}),
                Handle::Harmonic(harmonic) => harmonic.update_values(&values, &mut |_| {}),
                Handle::Transfer(_) | Handle::Arap(..) | Handle::Geodesic(_) => {
                    Err(PrepareError::Unsupported { what: "new values of a whole pipeline".into() })
                }
            }?;
            Ok(Step { elapsed: start.elapsed(), solved: Solved::default(), allocations: 0 })
        })
    }

    /// `edit`: see [`crate::engine::protocol::Request::Edit`].
    pub fn edit(&mut self, add: &ArrayFile, remove: &ArrayFile) -> Result<Timed, Refusal> {
        let (add, remove): (Vec<u32>, Vec<u32>) = (add.read()?, remove.read()?);
        let Handle::Harmonic(harmonic) = &mut self.handle else {
            return Err(failed("only a harmonic problem has constraints to edit"));
        };
        let start = Instant::now();
        harmonic.edit_constraints(&add, &remove)?;
        let elapsed = start.elapsed();
        self.inputs = self.inputs + add.len() - remove.len();
        Ok(Timed { samples_ns: vec![nanoseconds(elapsed)], ..Timed::default() })
    }

    /// `frame`: see [`crate::engine::protocol::Request::Frame`]. A frame is read before its clock starts.
    pub fn frame(
        &mut self,
        template: &ArrayFile,
        warmup: u32,
        solution: &Path,
        trace: Option<&Trace>,
        counts: bool,
    ) -> Result<Timed, Refusal> {
        let times =
            template.rows.checked_sub(warmup as usize).ok_or_else(|| failed("more warm-up than frames"))?;
        let mut frames = Frames::new(template, self.inputs)?;
        let mut target = vec![[0.0; 3]; self.outputs];
        let handle = self.transfer()?;
        let mut clock = StepClock::new(times);
        let step = |k: usize| {
            let pose = frames.read(k)?;
            let before = allocation::count();
            let start = Instant::now();
            clock.start(start);
            let solved = handle.observed_frame(pose, &mut target, &mut |step| clock.begin(step));
            inject::delay("frame", start);
            let end = Instant::now();
            let (elapsed, allocations) = (end - start, allocation::count() - before);
            clock.stop(end, k >= warmup as usize);
            Ok(Step { elapsed, solved: solved?, allocations })
        };
        let mut timed = repeat(warmup, times as u32, counts, step)?;
        timed.steps_ns = clock.into_samples();
        ArrayFile::write(solution, target.as_flattened(), 3)?;
        if let (Some(files), Some(inner)) = (trace, handle.trace()) {
            ArrayFile::write(&files.field, inner.field, 4)?;
            ArrayFile::write(&files.rhs, inner.rhs, 3)?;
        }
        timed.steps_ns.extend(self.device_steps(&timed)?);
        Ok(timed)
    }

    fn transfer(&mut self) -> Result<&mut dyn TransferFrame, Refusal> {
        match &mut self.handle {
            Handle::Transfer(frames) => Ok(&mut **frames),
            _ => Err(failed("frames need a prepared transfer problem")),
        }
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
        let limit = Duration::from_nanos(limit_ns);
        let samples_ns = if let Handle::Transfer(handle) = &mut self.handle {
            let poses = Frames::new(input, self.inputs)?.read_all()?;
            let mut target = vec![[0.0; 3]; self.outputs];
            let mut k = 0;
            open_loop::latencies(hz, frames, limit, || {
                let pose = &poses[there_and_back(k, input.rows)];
                k += 1;
                handle.frame(pose, &mut target).map(|_| ()).map_err(Refusal::from)
            })?
        } else {
            let (b, k) = (self.rhs(input)?, input.columns);
            let b = Columns::new(&b[..], self.inputs, k);
            let (n, mut x) = (self.outputs, vec![0.0; self.outputs * k]);
            open_loop::latencies(hz, frames, limit, || {
                self.solve_once(b, Columns::new(&mut x[..], n, k)).map(|_| ())
            })?
        };
        Ok(Timed { samples_ns, ..Timed::default() })
    }

    /// What the handle holds.
    pub fn footprint(&self) -> Footprint {
        match &self.handle {
            Handle::System(factor) => factor.footprint(),
            Handle::Harmonic(harmonic) => harmonic.footprint(),
            Handle::Transfer(frames) => frames.footprint(),
            Handle::Arap(arap, iterations) => {
                let one = arap.footprint();
                let solves = u64::from(*iterations) + 1;
                Footprint { bytes_per_solve: one.bytes_per_solve.map(|bytes| solves * bytes), ..one }
            }
            Handle::Geodesic(geodesic) => geodesic.footprint(),
        }
    }
}

/// Pipelines have inputs of one shape.
fn exactly(columns: usize, expected: usize) -> Result<(), Refusal> {
    if columns == expected {
        return Ok(());
    }
    Err(failed(format!("{columns} columns, inputs of this problem have {expected}")))
}

impl From<ArapError> for Refusal {
    fn from(error: ArapError) -> Self {
        match error {
            ArapError::Prepare(error) => error.into(),
            other => failed(other.to_string()),
        }
    }
}

impl From<GeodesicError> for Refusal {
    fn from(error: GeodesicError) -> Self {
        match error {
            GeodesicError::Prepare(error) | GeodesicError::Poisson(PoissonError::Prepare(error)) => {
                error.into()
            }
            other => failed(other.to_string()),
        }
    }
}

/// One repetition.
struct Step {
    elapsed: Duration,
    solved: Solved,
    /// Of the whole process, during the timed part.
    allocations: u64,
}

/// Repeats `step`, which times itself; the first `warmup` times do not count. It is told which repetition it is.
fn repeat(
    warmup: u32,
    times: u32,
    counts: bool,
    mut step: impl FnMut(usize) -> Result<Step, Refusal>,
) -> Result<Timed, Refusal> {
    for k in 0..warmup as usize {
        step(k)?;
    }
    const ROOM: usize = 1 << 16; // what is measured in one request; a request for more grows the list between two clocks
    let mut timed = Timed { samples_ns: Vec::with_capacity(ROOM.min(times as usize)), ..Timed::default() };
    let mut allocations = 0;
    for k in 0..times as usize {
        let Step { elapsed, solved, allocations: new } = step(warmup as usize + k)?;
        timed.samples_ns.push(nanoseconds(elapsed));
        timed.device_ns.extend(solved.device_ns);
        timed.iterations = solved.iterations;
        allocations += new;
    }
    timed.allocations = counts.then_some(allocations);
    Ok(timed)
}

/// Template positions in a file, one frame per row, read into one buffer.
struct Frames<'a> {
    file: &'a ArrayFile,
    numbers: Vec<f64>,
    pose: Vec<[f64; 3]>,
}

impl<'a> Frames<'a> {
    fn new(file: &'a ArrayFile, vertices: usize) -> Result<Self, Refusal> {
        if file.columns != 3 * vertices || file.rows == 0 {
            let shape = format!("{} x {}", file.rows, file.columns);
            return Err(failed(format!("template: {shape} numbers, frames of {vertices} vertices expected")));
        }
        Ok(Self { file, numbers: Vec::new(), pose: Vec::new() })
    }

    fn read(&mut self, k: usize) -> Result<&[[f64; 3]], Refusal> {
        self.file.read_rows_into(k, 1, &mut self.numbers)?;
        self.pose.clear();
        self.pose.extend_from_slice(self.numbers.as_chunks().0);
        Ok(&self.pose)
    }

    fn read_all(&mut self) -> Result<Vec<Vec<[f64; 3]>>, Refusal> {
        (0..self.file.rows).map(|k| self.read(k).map(<[_]>::to_vec)).collect()
    }
}

/// 0, 1, .., n - 1, n - 2, .., 1, 0, 1, ..: a motion without a jump from its last frame to its first.
fn there_and_back(k: usize, n: usize) -> usize {
    let period = (2 * n).saturating_sub(2).max(1);
    let k = k % period;
    if k < n { k } else { period - k }
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

fn read_mesh(files: &MeshFiles) -> Result<TriangleMesh, Refusal> {
    TriangleMesh::new(read_triples(&files.positions)?, read_triples(&files.triangles)?)
        .map_err(|e| failed(format!("mesh: {e}")))
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

#[cfg(test)]
mod tests {
    use super::there_and_back;

    #[test]
    fn motions_return_without_a_jump() {
        let order = |n: usize| (0..7).map(|k| there_and_back(k, n)).collect::<Vec<_>>();
        assert_eq!(order(4), [0, 1, 2, 3, 2, 1, 0]);
        assert_eq!(order(2), [0, 1, 0, 1, 0, 1, 0]);
        assert_eq!(order(1), [0; 7]);
    }
}
