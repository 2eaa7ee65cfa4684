//! The contract between a solver and everything that uses one.
//!
//! A **backend** is an algorithm with its options, opened on a device. It *prepares* a system once and hands out a
//! **factor**, which solves it for a few right-hand sides in every frame. Data flows one way:
//!
//! ```text
//! TriangleMesh -> Laplacian -> Dirichlet / System -> Backend::prepare -> Factor::solve, frame after frame
//! ```
//!
//! # What an implementer promises
//! - **Layout**: right-hand sides and unknowns are [`Columns`], n x k, vertex-major, f64. All columns of a solve are
//!   done together. Inside, a backend may compute in f32; its registry row then says so.
//! - **Ownership**: handles borrow nothing and own all workspace, sized at prepare for `max_columns`; a solve with fewer
//!   columns costs nothing extra. `&mut self` is the lock on that workspace.
//! - **A frame is cheap**: our own backends allocate nothing, take no lock and start no thread in a solve.
//! - **Inputs are checked already**: a [`System`] has a finite matrix with positive diagonal; shapes of `Columns` are the
//!   caller's duty and a mismatch panics naming the argument.
//! - **Deterministic** for a given number of threads.
//! - **Claims are not trusted**: whatever [`Solved`] says, the harness recomputes the residual itself.
//!
//! Static facts (name, family, precision, licence) stand in the registry row ([`crate::registry::Entry`]) and nowhere
//! else. [`crate::conformance::check`] tests all of this for any backend, ours or a third party's.

use crate::columns::Columns;
use crate::dirichlet::{Dirichlet, ReducedHarmonic};
use crate::error::{EditError, PrepareError, SolveError};
use crate::system::System;
use crate::workload::transfer::TransferProblem;

/// An algorithm with its options, opened on a device. Cheap to make and to keep; no system-sized work.
pub trait Backend: Send + Sync {
    /// Where and how it runs, as found at run time.
    fn describe(&self) -> Description;

    /// Does all work that depends on the matrix only: ordering, symbolic and numeric factorisation, hierarchy, upload.
    ///
    /// `on` is told each phase when it *begins*; the caller reads the clock there (this crate never does).
    ///
    /// # Errors
    /// [`PrepareError`]; in particular `NotPositiveDefinite` with the offending row of `system`.
    ///
    /// # Panics
    /// If `options.order` is given and is not a permutation of the rows, or `options.max_columns` is 0.
    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError>;

    /// Prepares L_FF u_F = -L_FC g, u_C = g (VA section 4) for a fixed set of constrained vertices.
    ///
    /// Provided: reduce, [`prepare`](Self::prepare), wrap. Override it to exploit that the right-hand side is sparse
    /// (only rows next to a constraint) or to edit constraints in place.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    fn prepare_harmonic(
        &self,
        problem: &Dirichlet,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Harmonic>, PrepareError> {
        let factor = match problem.system() {
            Some(system) => Some(self.prepare(system, options, on)?),
            None => None,
        };
        Ok(Box::new(ReducedHarmonic::new(problem.clone(), factor, options.max_columns)))
    }

    /// Prepares whole frames of the `transfer` workload on the device. `None` (provided): the frame is put together on
    /// the CPU from [`prepare`](Self::prepare) and [`prepare_harmonic`](Self::prepare_harmonic).
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    fn prepare_transfer(
        &self,
        problem: &TransferProblem,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Option<Box<dyn TransferFrame>>, PrepareError> {
        let _ = (problem, options, on);
        Ok(None)
    }
}

/// A prepared system: solves A X = B for as many right-hand sides as it was prepared for.
pub trait Factor: Send {
    /// Solves for all columns of `rhs` (n x k, read) into `x` (n x k). Where warm start is declared in the registry row,
    /// `x` comes in as initial guess; otherwise its content is ignored. k must not exceed `max_columns`.
    ///
    /// # Errors
    /// [`SolveError::NotConverged`] leaves the best iterate in `x`; `NonFinite` names the first row.
    fn solve(&mut self, rhs: Columns<&[f64]>, x: Columns<&mut [f64]>) -> Result<Solved, SolveError>;

    /// New values on the same pattern, in the order of the prepared [`System`]'s stored entries; keeps everything
    /// symbolic. After an error the handle must be given valid values before it may solve again.
    ///
    /// # Errors
    /// As [`Backend::prepare`].
    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError>;

    /// The elimination order in use (row eliminated k-th, in the system's numbering), where there is one: it can be
    /// handed to another `prepare` on the same vertices.
    fn permutation(&self) -> Option<&[u32]> {
        None
    }

    /// Has every iteration of later solves reported to `observer`: its number and the largest relative residual over the
    /// columns, as the recurrence has it. That is how a history over time is recorded, with the caller's clock (this crate
    /// reads none); blocks of more than eight columns are reported eight at a time. `None` ends it. Returns false
    /// (provided) where there are no iterations to report.
    fn observe(&mut self, observer: Option<Box<dyn FnMut(u32, f64) + Send>>) -> bool {
        let _ = observer;
        false
    }

    /// Repeats the last solve with a timestamp between its phases on the device: (name, nanoseconds) in their order. Not for
    /// frames: it allocates. Empty (provided) where there is no device, or none that tells.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(Vec::new())
    }

    /// What the handle holds and moves.
    fn footprint(&self) -> Footprint;
}

/// A prepared harmonic field: constraint values in, the whole field out.
pub trait Harmonic: Send {
    /// Extends `constraints` (|C| x k, rows in ascending vertex order) to `field` (n x k, all vertices). Rows of absent
    /// vertices become 0. With warm start the free rows of `field` are the initial guess.
    ///
    /// # Errors
    /// As [`Factor::solve`].
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError>;

    /// New values of the **full** L, in the order of its stored entries.
    ///
    /// # Errors
    /// As [`Backend::prepare`].
    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError>;

    /// Adds and removes constrained vertices without a full factorisation; afterwards constraint values go in ascending
    /// order of the new set.
    ///
    /// # Errors
    /// [`EditError::Unsupported`] (provided) where the backend cannot; otherwise the offending vertex. On an error the
    /// old set stays in force.
    fn edit_constraints(&mut self, add: &[u32], remove: &[u32]) -> Result<(), EditError> {
        let _ = (add, remove);
        Err(EditError::Unsupported)
    }

    /// As [`Factor::observe`].
    fn observe(&mut self, observer: Option<Box<dyn FnMut(u32, f64) + Send>>) -> bool {
        let _ = observer;
        false
    }

    /// As [`Factor::device_phases`].
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(Vec::new())
    }

    /// What the handle holds and moves.
    fn footprint(&self) -> Footprint;
}

/// Whole `transfer` frames prepared on a device: template positions in, target positions out.
pub trait TransferFrame: Send {
    /// Steps 1 to 5 of a frame. `template`: one position per template vertex; `target`: one per target vertex, written.
    ///
    /// # Errors
    /// As [`Factor::solve`].
    fn frame(&mut self, template: &[[f64; 3]], target: &mut [[f64; 3]]) -> Result<Solved, SolveError>;

    /// As [`frame`](Self::frame); `on` is told each step when it *begins*; the caller reads the clock there (this crate
    /// never does). Provided: a frame without steps, for handles that cannot tell them apart.
    ///
    /// # Errors
    /// As [`frame`](Self::frame).
    fn observed_frame(
        &mut self,
        template: &[[f64; 3]],
        target: &mut [[f64; 3]],
        on: &mut dyn FnMut(FrameStep),
    ) -> Result<Solved, SolveError> {
        let _ = on;
        self.frame(template, target)
    }

    /// Inner results of the last frame, where the handle keeps them: what the checks need to judge both solves. Not for
    /// frames: those of a device are read back only here.
    fn trace(&mut self) -> Option<FrameTrace<'_>> {
        None
    }

    /// Marks and vertices whose rotation was replaced in the last frame, because a triangle collapsed or an average vanished.
    fn replaced(&self) -> usize;

    /// As [`Factor::device_phases`].
    ///
    /// # Errors
    /// As [`frame`](Self::frame).
    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(Vec::new())
    }

    /// What the handle holds and moves.
    fn footprint(&self) -> Footprint;
}

/// A part of a `transfer` frame, announced when it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameStep {
    /// Step 1: rotations of the marked triangles, constraint values.
    Marks,
    /// Step 2: the harmonic field of quaternions.
    Field,
    /// Normalisation and steps 3 and 4: rotations of all triangles and their differential coordinates.
    Fragments,
    /// Step 5: the Poisson system.
    Positions,
    /// The end of step 5: translations, and what follows rigidly.
    Placement,
}

impl FrameStep {
    /// All steps in their order.
    pub const ALL: [Self; 5] = [Self::Marks, Self::Field, Self::Fragments, Self::Positions, Self::Placement];

    /// Its name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Marks => "marks",
            Self::Field => "field",
            Self::Fragments => "fragments",
            Self::Positions => "positions",
            Self::Placement => "placement",
        }
    }
}

/// Inner results of a `transfer` frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameTrace<'a> {
    /// Quaternions at the constrained vertices, |C| x 4 (w, x, y, z): the input of step 2.
    pub constraints: &'a [f64],
    /// Quaternions at all vertices before they are normalised, n x 4: the solution of step 2.
    pub field: &'a [f64],
    /// U, n x 3: the right-hand side of step 5.
    pub rhs: &'a [f64],
}

/// Where and how an opened backend runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// "cpu", or the Vulkan device name verbatim.
    pub device: String,
    /// What kind of device that is.
    pub device_type: DeviceType,
    /// Threads a solve uses.
    pub threads: usize,
    /// Library versions, instruction set, tuning: pairs of name and value for the record.
    pub details: Vec<(&'static str, String)>,
}

impl Description {
    /// A backend on the CPU.
    pub fn cpu(threads: usize) -> Self {
        Self { device: "cpu".into(), device_type: DeviceType::Cpu, threads, details: Vec::new() }
    }
}

/// Kind of device; software Vulkan is never ranked with real GPUs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceType {
    /// This process' own cores.
    Cpu,
    /// A Vulkan driver that computes on the CPU (lavapipe).
    SoftwareVulkan,
    /// A GPU that shares the CPU's memory.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
}

/// What a preparation needs to know besides the system.
#[derive(Clone, Copy, Debug)]
pub struct PrepareOptions<'a> {
    /// The most columns a solve will have (>= 1); sizes the workspace.
    pub max_columns: usize,
    /// An elimination order to use: `order[k]` is the row eliminated k-th, in the numbering of the system at hand.
    /// Iterative backends ignore it; direct ones compute their own where it is `None`.
    pub order: Option<&'a [u32]>,
}

impl PrepareOptions<'static> {
    /// Room for `max_columns` columns, the backend's own ordering.
    pub fn columns(max_columns: usize) -> Self {
        Self { max_columns, order: None }
    }
}

/// A part of a preparation, announced when it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Computing the elimination order or the hierarchy's structure.
    Order,
    /// Symbolic factorisation: pattern of the factor, allocation.
    Symbolic,
    /// Numeric factorisation, or the numbers of a preconditioner.
    Numeric,
    /// Transfer to a device, compilation of its programs.
    Upload,
}

/// What a solve claims about itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solved {
    /// Iterations (or sweep pairs of a refinement), the largest over the columns; `None` for a plain direct solve.
    pub iterations: Option<u32>,
    /// Relative residual of the worst column as the backend computed it, if it did.
    pub residual: Option<f64>,
    /// Time on the device between its own timestamps, in nanoseconds, where it has any.
    pub device_ns: Option<u64>,
}

/// What a handle holds and moves. `None` means unknown, never zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// Bytes on the host: factor, matrix copy, workspace.
    pub host_bytes: Option<u64>,
    /// Bytes on the device.
    pub device_bytes: Option<u64>,
    /// Entries of the factor, or of all levels of a preconditioner.
    pub factor_nonzeros: Option<u64>,
    /// Bytes of those entries as stored (values and indices).
    pub factor_bytes: Option<u64>,
    /// Bytes of matrix and factor that one solve reads, for any number of columns up to four (direct) or per
    /// iteration (iterative).
    pub bytes_per_solve: Option<u64>,
    /// Floating-point operations of the numeric factorisation.
    pub factor_flops: Option<u64>,
    /// Programs started on a device in one solve or frame.
    pub dispatches: Option<u64>,
    /// Name of the ordering that ran.
    pub ordering: Option<&'static str>,
}
