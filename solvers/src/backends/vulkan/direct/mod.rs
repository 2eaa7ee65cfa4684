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
mod core;
mod coupling;
mod fragments;
mod frames;
mod handle;
mod harmonic;
mod mixed;
mod number;
mod refined;
mod tables;
#[cfg(test)]
mod tests;
mod tiles;
mod transfer;

use crate::backend::{Backend, Description, Factor, Harmonic, Phase, PrepareOptions, TransferFrame};
use crate::backends::framechol::constraints::extend_order;
use crate::backends::framechol::supernodes::Supernodes;
use crate::backends::framechol::symbolic::Symbolic;
use crate::backends::framechol::thread_pool;
use crate::backends::vulkan::device::{Device, Settings};
use crate::backends::vulkan::error::DeviceError;
use crate::dirichlet::{Dirichlet, ReducedHarmonic};
use crate::error::{PrepareError, Unavailable};
use crate::ordering::{self, Graph};
use crate::registry::OpenOptions;
use crate::sparse::{SymmetricCsr, inverse_permutation};
use crate::system::System;
use crate::team::Team;
use crate::workload::transfer::TransferProblem;
use core::Core;
use coupling::Coupling;
use fragments::Fragmentation;
use frames::Frames;
use handle::Handle;
use harmonic::Field;
use mixed::HostRefined;
use number::{Kernels, Number};
use refined::Refined;
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

/// Opens `vulkan-direct-mixed`: stored and swept in f32, refined with residuals in f64; those are the CPU's where the device has
/// no f64 or is the CPU.
pub fn open_mixed(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Direct::<f32, Mixed>::open(options, &Settings::default())?))
}

/// A way to solve with a factor in T on the device.
trait Method<T: Number>: Send + Sync + 'static {
    /// All of a solve on the device.
    type Core: Core<Inner = T>;

    /// Whether `device` can do all of a solve.
    fn fits(device: &Device) -> bool;

    /// From a factor that is in place, and its matrix.
    fn core(
        tables: Tables<T>,
        matrix: &SymmetricCsr,
        places: &Places<'_>,
        planes: usize,
    ) -> Result<Self::Core, DeviceError>;

    /// The handle where the host has to help.
    fn with_host(frames: Frames<Tables<T>>, matrix: &SymmetricCsr, ordering: &'static str)
    -> Box<dyn Factor>;
}

/// One sweep pair in the factor's own numbers.
struct Single<T>(PhantomData<fn() -> T>);

impl<T: Number> Method<T> for Single<T> {
    type Core = Tables<T>;

    fn fits(_: &Device) -> bool {
        true
    }

    fn core(tables: Tables<T>, _: &SymmetricCsr, _: &Places<'_>, _: usize) -> Result<Tables<T>, DeviceError> {
        Ok(tables)
    }

    fn with_host(frames: Frames<Tables<T>>, _: &SymmetricCsr, ordering: &'static str) -> Box<dyn Factor> {
        Box::new(Handle::new(frames, ordering))
    }
}

/// Sweeps in f32, refined with residuals in f64.
struct Mixed;

impl Method<f32> for Mixed {
    type Core = Refined;

    fn fits(device: &Device) -> bool {
        Refined::fits(device)
    }

    fn core(
        tables: Tables<f32>,
        matrix: &SymmetricCsr,
        places: &Places<'_>,
        planes: usize,
    ) -> Result<Refined, DeviceError> {
        Refined::new(tables, matrix, places, planes)
    }

    fn with_host(
        frames: Frames<Tables<f32>>,
        matrix: &SymmetricCsr,
        ordering: &'static str,
    ) -> Box<dyn Factor> {
        Box::new(HostRefined::new(frames, matrix, ordering))
    }
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
    ) -> Result<(M::Core, Coupling<<M::Core as Core>::Outer>, &'static str), PrepareError> {
        let (free, active) = (problem.free(), problem.active_rows());
        let of = |row: u32| free[row as usize];
        // The residual of a later pair is not zero anywhere.
        let active = (M::Core::MOST == 1).then_some(&active[..]);
        let places = Places { n: problem.laplacian().n(), of: &of, active };
        let (tables, ordering) = self.factorise(system.matrix(), options, &places, on)?;
        let mut coupling = Coupling::new(&self.device, problem)?;
        coupling.update(problem.laplacian().values(), tables.scale)?;
        let core = M::core(tables, system.matrix(), &places, frames::planes(options.max_columns))?;
        Ok((core, coupling, ordering))
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
        let (places, columns) = (Places::all(matrix.n()), options.max_columns);
        let (tables, ordering) = self.factorise(matrix, options, &places, on)?;
        on(Phase::Upload);
        if !M::fits(&self.device) {
            let frames = Frames::new(tables, self.team()?, None, columns)?;
            return Ok(M::with_host(frames, matrix, ordering));
        }
        let core = M::core(tables, matrix, &places, frames::planes(columns))?;
        Ok(Box::new(Handle::new(Frames::new(core, self.team()?, None, columns)?, ordering)))
    }

    fn prepare_harmonic(
        &self,
        problem: &Dirichlet,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Harmonic>, PrepareError> {
        match problem.system() {
            Some(system) if M::fits(&self.device) => {
                let (core, coupling, ordering) = self.field(problem, system, options, on)?;
                on(Phase::Upload);
                let constraints = (coupling, problem.fixed().len());
                let frames = Frames::new(core, self.team()?, Some(constraints), options.max_columns)?;
                Ok(Box::new(Field::new(problem, frames, ordering)))
            }
            system => {
                let factor = system.map(|system| self.prepare(system, options, on)).transpose()?;
                Ok(Box::new(ReducedHarmonic::new(problem.clone(), factor, options.max_columns)))
            }
        }
    }

    /// Frames of a software device, those whose tables the device's kernels cannot see whole, and those of a mesh without a
    /// free vertex are put together on the CPU.
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
        let largest = Fragmentation::<<M::Core as Core>::Outer>::largest(problem);
        if !self.device.is_apart() || !M::fits(&self.device) || largest > self.device.traits().range {
            return Ok(None);
        }
        let options = PrepareOptions { max_columns: PLANE, order: None };
        let of = |row: u32| grounded.free()[row as usize];
        let places = Places { n: laplacian.n(), of: &of, active: None };
        let (space, ordering) = self.factorise(whole.matrix(), &options, &places, on)?;
        // One order serves both: the field lacks a few rows, and has those that were grounded.
        let order = problem.harmonic().restrict_order(&extend_order(&grounded, &space.symbolic().order));
        let space = M::core(space, whole.matrix(), &places, 1)?;
        let options = PrepareOptions { order: Some(&order), ..options };
        let (field, coupling, _) = self.field(problem.harmonic(), system, &options, on)?;
        on(Phase::Upload);
        let fragments = Fragmentation::new(&self.device, problem)?;
        let parts = Parts { field, space, coupling, fragments };
        Ok(Some(Box::new(DeviceFrames::new(problem, parts, self.team()?, ordering)?)))
    }
}
