//! `vulkan-direct-*`: a block Cholesky factor made on the CPU and solved on the device.
//!
//! ```text
//! order -> supernodes (wide ones: a device wants few levels) -> blocks, tiles -> numeric (CPU, f64) -> tiles in T
//! frame: (g -> couple ->) b -> [assemble, forward tiles] per level -> [backward tiles] per level -> x, one submission
//! transfer: harmonic frame -> rotations of triangles -> differential coordinates -> frame, one submission
//! ```
//! Ordering, analysis and numeric factorisation are `framechol`'s; layout and sweeps are described in `tiles` and
//! `blocks`, figures in the README of this folder.
mod blocks;
mod coupling;
mod fragments;
mod frames;
mod harmonic;
mod mixed;
mod number;
mod tables;
#[cfg(test)]
mod tests;
mod tiles;
mod transfer;

use crate::backend::{
    Backend, Description, Factor, Footprint, Harmonic, Phase, PrepareOptions, Solved, TransferFrame,
};
use crate::backends::framechol::constraints::extend_order;
use crate::backends::framechol::engine::groups;
use crate::backends::framechol::gather::Group;
use crate::backends::framechol::supernodes::Supernodes;
use crate::backends::framechol::symbolic::Symbolic;
use crate::backends::framechol::{first_bad_row, thread_pool};
use crate::backends::vulkan::device::{Device, Settings};
use crate::columns::Columns;
use crate::dirichlet::{Dirichlet, ReducedHarmonic};
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::ordering::{self, Graph};
use crate::registry::OpenOptions;
use crate::sparse::{SymmetricCsr, inverse_permutation};
use crate::system::System;
use crate::team::Team;
use crate::workload::transfer::TransferProblem;
use coupling::Coupling;
use fragments::Fragmentation;
use frames::Frames;
use harmonic::Field;
use mixed::Mixed;
use number::{Kernels, Number};
use std::marker::PhantomData;
use std::sync::{Arc, Mutex};
use tables::{PLANE, Places, Tables};
use transfer::{DeviceFrames, Parts};

/// Opens `vulkan-direct-f64`: stored and swept in f64.
pub fn open_f64(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Direct::<f64, Single<f64>>::open(options, &Settings::default())?))
}

/// Opens `vulkan-direct-f32`: factored in f64, stored and swept in f32.
pub fn open_f32(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Direct::<f32, Single<f32>>::open(options, &Settings::default())?))
}

/// Opens `vulkan-direct-mixed`: stored and swept in f32 on the device, refined with residuals in f64 on the CPU.
pub fn open_mixed(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Direct::<f32, Mixed>::open(options, &Settings::default())?))
}

/// A way to solve with a factor in T on the device.
trait Method<T: Number>: Send + Sized + 'static {
    /// From the frames of a factor that is in place, and the matrix with its values.
    fn new(frames: Frames<T>, matrix: &SymmetricCsr, values: &[f64], max_columns: usize) -> Self;

    /// The frames.
    fn frames(&mut self) -> &mut Frames<T>;

    /// The frames, to look at.
    fn frames_ref(&self) -> &Frames<T>;

    /// The factor was made anew from these values.
    fn renew(&mut self, values: &[f64]);

    /// Solves for a group of columns; (whether the solution is finite, what to report).
    fn solve(
        &mut self,
        rhs: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), SolveError>;

    /// Bytes that this holds on the host beside the frames, and bytes of matrix read per solve.
    fn extra_bytes(&self) -> (u64, u64);

    /// Whether one sweep pair in the factor's own numbers is all of a solve, so that more than it can be put on the device.
    const PLAIN: bool;
    /// Sweep pairs that a usual solve takes.
    const PAIRS: u64;
}

/// The backend.
struct Direct<T, M> {
    device: Arc<Device>,
    kernels: Mutex<Option<Arc<Kernels>>>,
    threads: usize,
    method: PhantomData<fn() -> (T, M)>,
}

impl<T: Number, M: Method<T>> Direct<T, M> {
    fn open(options: &OpenOptions<'_>, settings: &Settings) -> Result<Self, Unavailable> {
        let device = Device::open(options.device, settings)?;
        if size_of::<T>() == 8 {
            device.require_f64("vulkan-direct-mixed or vulkan-direct-f32")?;
        }
        Ok(Self { device, kernels: Mutex::new(None), threads: options.threads, method: PhantomData })
    }

    /// The kernels, compiled by the first preparation.
    fn kernels(&self) -> Result<Arc<Kernels>, PrepareError> {
        let mut kernels = self.kernels.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if kernels.is_none() {
            *kernels = Some(Arc::new(Kernels::new::<T>(&self.device)?));
        }
        Ok(Arc::clone(kernels.as_ref().expect("just made")))
    }

    /// Threads for the host's part of a frame.
    fn team(&self) -> Result<Team, PrepareError> {
        Team::new(self.threads).map_err(|error| PrepareError::Unsupported {
            what: format!("{} threads: the system refuses to start them ({error})", self.threads),
        })
    }

    /// Orders and analyses; returns the structure and the name of the ordering.
    fn analyse(
        &self,
        matrix: &SymmetricCsr,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<(Symbolic, &'static str), PrepareError> {
        assert!(options.max_columns > 0, "max_columns: at least 1");
        let pool = thread_pool(self.threads)?;
        on(Phase::Order);
        let graph = Graph::from_triangle_of_matrix(matrix.row_starts(), matrix.columns());
        let (order, name) = match options.order {
            Some(order) => {
                assert_eq!(order.len(), matrix.n(), "order: one entry per row");
                inverse_permutation(order); // panics where a row is missing
                (order.to_vec(), "given")
            }
            None => {
                let ordering = pool.install(|| ordering::nested_dissection(&graph));
                (ordering.order, ordering.name)
            }
        };
        on(Phase::Symbolic);
        let groups = pool.install(|| Supernodes::with_cost(&graph, &order, blocks::sweep_cost));
        Ok((Symbolic::new(matrix, &graph, &groups, &order, 1), name))
    }

    /// The factor of a harmonic field with a row per vertex, the way of its constraints to it, and the name of the ordering.
    fn field(
        &self,
        problem: &Dirichlet,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<(Tables<T>, Coupling<T>, &'static str), PrepareError> {
        let (free, active) = (problem.free(), problem.active_rows());
        let of = |row: u32| free[row as usize];
        let places = Places { n: problem.laplacian().n(), of: &of, active: Some(&active) };
        let (tables, ordering) = self.factorise(system.matrix(), options, &places, on)?;
        let mut coupling = Coupling::new(&self.device, problem)?;
        coupling.update(problem.laplacian().values(), tables.scale)?;
        Ok((tables, coupling, ordering))
    }

    /// The factor of a matrix on the device, and the name of the ordering.
    fn factorise(
        &self,
        matrix: &SymmetricCsr,
        options: &PrepareOptions<'_>,
        places: &Places<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<(Tables<T>, &'static str), PrepareError> {
        let (symbolic, ordering) = self.analyse(matrix, options, on)?;
        let planes = frames::planes(options.max_columns);
        let mut tables = Tables::new(&self.device, self.kernels()?, symbolic, planes, places)?;
        on(Phase::Numeric);
        tables.factorise(matrix.values())?;
        Ok((tables, ordering))
    }
}

impl<T: Number, M: Method<T>> Backend for Direct<T, M> {
    fn describe(&self) -> Description {
        self.device.describe(self.threads)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let matrix = system.matrix();
        let (tables, ordering) = self.factorise(matrix, options, &Places::all(matrix.n()), on)?;
        on(Phase::Upload);
        let frames = Frames::new(tables, self.team()?, None, options.max_columns)?;
        let method = M::new(frames, matrix, matrix.values(), options.max_columns);
        Ok(Box::new(Handle { method, ordering, number: PhantomData::<fn() -> T> }))
    }

    fn prepare_harmonic(
        &self,
        problem: &Dirichlet,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Harmonic>, PrepareError> {
        match problem.system() {
            Some(system) if M::PLAIN => {
                let (tables, coupling, ordering) = self.field(problem, system, options, on)?;
                on(Phase::Upload);
                let constraints = (coupling, problem.fixed().len());
                let frames = Frames::new(tables, self.team()?, Some(constraints), options.max_columns)?;
                Ok(Box::new(Field::new(problem, frames, ordering)))
            }
            system => {
                let factor = system.map(|system| self.prepare(system, options, on)).transpose()?;
                Ok(Box::new(ReducedHarmonic::new(problem.clone(), factor, options.max_columns)))
            }
        }
    }

    /// Frames whose tables the device's kernels cannot see whole, and those of a mesh without a free vertex, are put
    /// together on the CPU.
    fn prepare_transfer(
        &self,
        problem: &TransferProblem,
        _: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Option<Box<dyn TransferFrame>>, PrepareError> {
        let laplacian = problem.laplacian().matrix();
        let grounded = Dirichlet::grounded(laplacian.clone(), None)
            .map_err(|error| PrepareError::Unsupported { what: error.to_string() })?;
        let (Some(whole), Some(system)) = (grounded.system(), problem.harmonic().system()) else {
            return Ok(None);
        };
        if !M::PLAIN || Fragmentation::<T>::largest(problem) > self.device.traits().range {
            return Ok(None);
        }
        let options = PrepareOptions { max_columns: PLANE, order: None };
        let of = |row: u32| grounded.free()[row as usize];
        let places = Places { n: laplacian.n(), of: &of, active: None };
        let (space, ordering) = self.factorise(whole.matrix(), &options, &places, on)?;
        // One order serves both: the field lacks a few rows, and has those that were grounded.
        let order = problem.harmonic().restrict_order(&extend_order(&grounded, &space.symbolic().order));
        let options = PrepareOptions { order: Some(&order), ..options };
        let (field, coupling, _) = self.field(problem.harmonic(), system, &options, on)?;
        on(Phase::Upload);
        let fragments = Fragmentation::new(&self.device, problem)?;
        let parts = Parts { field, space, coupling, fragments };
        Ok(Some(Box::new(DeviceFrames::new(problem, parts, self.team()?, ordering)?)))
    }
}

/// A factored system.
struct Handle<T, M> {
    method: M,
    ordering: &'static str,
    number: PhantomData<fn() -> T>,
}

impl<T: Number, M: Method<T>> Factor for Handle<T, M> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let frames = self.method.frames();
        let (n, k) = (frames.tables.symbolic().order.len(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let mut all = Solved { device_ns: Some(0), ..Solved::default() };
        for group in groups(k, frames.widest()) {
            let (finite, solved) = self.method.solve(rhs, &mut x, group)?;
            if !finite {
                return Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) });
            }
            all.iterations = all.iterations.max(solved.iterations);
            all.device_ns = all.device_ns.zip(solved.device_ns).map(|(a, b)| a + b);
        }
        Ok(all)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.method.frames().tables.factorise(values)?;
        self.method.renew(values);
        Ok(())
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(self.method.frames_ref().device_phases()?)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.method.frames_ref().tables.symbolic().order)
    }

    fn footprint(&self) -> Footprint {
        let of_one = self.method.frames_ref().footprint(self.ordering);
        let (host, matrix) = self.method.extra_bytes();
        Footprint {
            host_bytes: of_one.host_bytes.map(|bytes| bytes + host),
            bytes_per_solve: of_one.bytes_per_solve.map(|bytes| M::PAIRS * (bytes + matrix)),
            dispatches: of_one.dispatches.map(|count| M::PAIRS * count),
            ..of_one
        }
    }
}

/// One sweep pair in the factor's own numbers.
struct Single<T: Number> {
    frames: Frames<T>,
}

impl<T: Number> Method<T> for Single<T> {
    const PLAIN: bool = true;
    const PAIRS: u64 = 1;

    fn new(frames: Frames<T>, _: &SymmetricCsr, _: &[f64], _: usize) -> Self {
        Self { frames }
    }

    fn frames(&mut self) -> &mut Frames<T> {
        &mut self.frames
    }

    fn frames_ref(&self) -> &Frames<T> {
        &self.frames
    }

    fn renew(&mut self, _: &[f64]) {}

    fn solve(
        &mut self,
        rhs: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), SolveError> {
        let (finite, device_ns) = self.frames.solve(rhs, x, group)?;
        Ok((finite, Solved { device_ns, ..Solved::default() }))
    }

    fn extra_bytes(&self) -> (u64, u64) {
        (0, 0)
    }
}
