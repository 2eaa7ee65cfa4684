//! The recorded command buffers: the start of an iteration, and a batch of it.

use super::super::{Buffer, Device, DeviceError, Input, Output, Plan, Recorded};
use super::kernels::{Kernels, Number, Product, Scalars};
use super::precondition::{Preconditioner, vector};
use super::sparse::Sparse;
use std::sync::Arc;

/// Columns of a vector on the device.
pub(super) const LANES: usize = 4;
/// Rows of the state; see `cg_scalars.comp`.
const STATE: usize = 8;
/// Row of the state with the limit of r . r.
const LIMIT: usize = 2;
/// Row with 1 for columns that iterate.
const ACTIVE: usize = 5;
/// Row with the iterations of each column.
const COUNT: usize = 6;
/// Row with 1 for columns whose curvature was not positive.
const BROKEN: usize = 7;

/// A system on the device, ready to iterate on right-hand sides of four columns from x = 0.
pub(super) struct Iteration<T> {
    r: Input<T>,
    state: Input<T>,
    x: Output<T>,
    reached: Output<T>,
    history: Output<T>,
    start: Recorded,
    batch: Recorded,
    /// Iterations of a batch.
    size: usize,
}

/// Where the columns stand after a batch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standing {
    /// Columns that still iterate.
    pub(super) active: [bool; LANES],
    /// Columns on which the method broke down.
    pub(super) broken: [bool; LANES],
    /// Iterations of each.
    pub(super) iterations: [u32; LANES],
}

/// The vectors and scalars that the kernels pass around.
struct Vectors {
    n: u32,
    r: Arc<Buffer>,
    z: Arc<Buffer>,
    p: Arc<Buffer>,
    q: Arc<Buffer>,
    x: Arc<Buffer>,
    state: Arc<Buffer>,
    partials: Arc<Buffer>,
    history: Arc<Buffer>,
}

impl<T: Number> Iteration<T> {
    /// Records everything for the matrix `a`.
    pub(super) fn new(
        device: &Arc<Device>,
        kernels: &Kernels,
        a: &Sparse,
        preconditioner: &Preconditioner,
        size: u32,
    ) -> Result<Self, DeviceError> {
        let n = a.rows;
        let length = LANES * n as usize;
        let (r, state) = (Input::new(device, length)?, Input::new(device, STATE * LANES)?);
        let (x, reached) = (Output::new(device, length)?, Output::new(device, STATE * LANES)?);
        let history: Output<T> = Output::new(device, LANES * size as usize)?;
        let vectors = Vectors {
            n,
            r: Arc::clone(r.buffer()),
            z: vector::<T>(device, n)?,
            p: vector::<T>(device, n)?,
            q: vector::<T>(device, n)?,
            x: Arc::clone(x.buffer()),
            state: Arc::clone(state.buffer()),
            partials: vector::<T>(device, kernels.partials(n))?,
            history: Arc::clone(history.buffer()),
        };
        let start = vectors.start(device, kernels, preconditioner, &r, &state)?;
        let mut plan = Plan::new(device);
        plan.mark();
        for slot in 0..size {
            vectors.iterate(&mut plan, kernels, a, preconditioner, slot);
        }
        plan.copy(state.buffer(), reached.buffer());
        plan.barrier();
        x.download(&mut plan);
        reached.download(&mut plan);
        history.download(&mut plan);
        plan.mark();
        let batch = plan.record()?;
        Ok(Self { r, state, x, reached, history, start, batch, size: size as usize })
    }

    /// Starts from x = 0: row i of the right-hand side is `row(i)`; columns iterate until r . r is at most their limit,
    /// those with an infinite one not at all.
    pub(super) fn begin(
        &mut self,
        row: impl Fn(usize) -> [f64; LANES],
        limit: [f64; LANES],
    ) -> Result<(), DeviceError> {
        for (i, out) in self.r.host().as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            *out = row(i).map(T::from_f64);
        }
        let state = self.state.host().as_chunks_mut::<LANES>().0;
        state.fill([T::default(); LANES]);
        state[LIMIT] = limit.map(|limit| T::from_f64(if limit.is_finite() { limit } else { 0.0 }));
        state[ACTIVE] = limit.map(|limit| T::from_f64(f64::from(u8::from(limit.is_finite()))));
        self.start.run()
    }

    /// Runs a batch.
    pub(super) fn advance(&mut self) -> Result<Standing, DeviceError> {
        self.batch.run()?;
        let state = self.reached.host().as_chunks::<LANES>().0;
        let is_set = |row: usize| state[row].map(|v| v.to_f64() != 0.0);
        Ok(Standing {
            active: is_set(ACTIVE),
            broken: is_set(BROKEN),
            iterations: state[COUNT].map(|v| v.to_f64() as u32),
        })
    }

    /// r . r after every iteration of the last batch.
    pub(super) fn history(&mut self) -> impl Iterator<Item = [f64; LANES]> + '_ {
        let size = self.size;
        self.history.host().as_chunks::<LANES>().0[..size].iter().map(|row| row.map(T::to_f64))
    }

    /// The iterate, row by row.
    pub(super) fn solution(&mut self) -> &[[T; LANES]] {
        self.x.host().as_chunks().0
    }

    /// Time on the device of the last batch.
    pub(super) fn batch_ns(&self) -> Option<u64> {
        self.batch.device_ns()
    }
}

impl Vectors {
    /// x = 0, p = z = M^-1 r, rz = r . z.
    fn start<T: Number>(
        &self,
        device: &Arc<Device>,
        kernels: &Kernels,
        preconditioner: &Preconditioner,
        r: &Input<T>,
        state: &Input<T>,
    ) -> Result<Recorded, DeviceError> {
        let mut plan = Plan::new(device);
        r.upload(&mut plan);
        state.upload(&mut plan);
        plan.clear(&self.x);
        plan.barrier();
        preconditioner.apply(&mut plan, kernels, &self.r, &self.z);
        kernels.dots(&mut plan, self.n, &self.r, &self.z, &self.partials);
        self.scalars(&mut plan, kernels, Scalars::Start, 0);
        plan.copy(&self.z, &self.p);
        plan.barrier();
        plan.record()
    }

    fn iterate(
        &self,
        plan: &mut Plan,
        kernels: &Kernels,
        a: &Sparse,
        preconditioner: &Preconditioner,
        slot: u32,
    ) {
        let Self { n, r, z, p, q, x, state, partials, .. } = self;
        kernels.sparse(plan, Product::Plain, a, p, q);
        kernels.dots(plan, *n, p, q, partials);
        self.scalars(plan, kernels, Scalars::Alpha, slot);
        kernels.update(plan, *n, [p, q, state, x, r, partials]);
        self.scalars(plan, kernels, Scalars::Norm, slot);
        preconditioner.apply(plan, kernels, r, z);
        kernels.dots(plan, *n, r, z, partials);
        self.scalars(plan, kernels, Scalars::Beta, slot);
        kernels.direction(plan, *n, z, state, p);
    }

    fn scalars(&self, plan: &mut Plan, kernels: &Kernels, step: Scalars, slot: u32) {
        kernels.scalars(plan, step, self.n, [&self.partials, &self.state, &self.history], slot);
    }
}
