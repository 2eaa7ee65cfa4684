//! Frames of a direct solve: right-hand sides in, both sweeps in one submission, solutions out.
use super::core::Core;
use super::coupling::Coupling;
use super::number::{GROUP, Number};
use super::tables::PLANE;
use crate::backend::{Footprint, Solved};
use crate::backends::framechol::engine::power_of_two;
use crate::backends::framechol::gather::Group;
use crate::backends::vulkan::buffer::{Buffer, Place};
use crate::backends::vulkan::device::Device;
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::plan::Plan;
use crate::backends::vulkan::recorded::Recorded;
use crate::columns::Columns;
use crate::team::Team;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A factor with the host's side of its frames.
///
/// The device has its vectors in planes of four columns. Where the host sees them it writes and reads them there. Elsewhere
/// only the columns there are go to host memory of the device's, which `pack.comp` reads and writes across the bus.
pub struct Frames<C: Core> {
    /// The factor and what is done with it.
    pub core: C,
    /// Threads that copy on the host.
    pub team: Team,
    vectors: Vectors<C::Outer>,
    /// By columns less one: a usual solve, and the pairs after it one by one.
    plans: Vec<(Recorded, Vec<Recorded>)>,
    /// Dispatches of one submission.
    dispatches: usize,
    clear: Recorded,
    /// Columns of the last frame.
    last: usize,
}

/// Right-hand side and solution.
struct Vectors<T> {
    /// Where the host's numbers arrive, and how many rows they have: the right-hand side, or values at constraints, from
    /// which `coupling` makes it.
    input: Arc<Buffer>,
    inputs: usize,
    coupling: Option<Coupling<T>>,
    rhs: Arc<Buffer>,
    /// Rows of right-hand side and solution.
    n: usize,
    x: Arc<Buffer>,
    packing: Option<Packing>,
}

/// The host's copies, packed.
struct Packing {
    input: Arc<Buffer>,
    x: Arc<Buffer>,
    /// There and back.
    kernels: [Arc<Kernel>; 2],
}

/// Planes for solves of up to `columns` columns.
pub fn planes(columns: usize) -> usize {
    if columns > PLANE { 2 } else { 1 }
}

impl<T: Number> Vectors<T> {
    /// For solutions of `n` rows from as many, or from values at `constraints.1` constraints.
    fn new(
        device: &Arc<Device>,
        n: usize,
        columns: usize,
        constraints: Option<(Coupling<T>, usize)>,
    ) -> Result<Self, DeviceError> {
        let buffer = |place, numbers: usize| Buffer::new(device, place, (numbers * size_of::<T>()) as u64);
        let wide = PLANE * planes(columns);
        let (rhs, x) = (buffer(Place::Device, (n + 1) * wide)?, buffer(Place::Device, (n + 1) * wide)?);
        let (coupling, inputs) = constraints.map_or((None, n), |(coupling, count)| (Some(coupling), count));
        let input = if coupling.is_some() { buffer(Place::Device, inputs * wide)? } else { Arc::clone(&rhs) };
        let packing = if device.is_unified() {
            None
        } else {
            let kernel = |back| Kernel::new(device, &T::PACKING, &[GROUP, back]);
            Some(Packing {
                input: buffer(Place::Upload, inputs * columns)?,
                x: buffer(Place::Readback, n * columns)?,
                kernels: [kernel(0)?, kernel(1)?],
            })
        };
        Ok(Self { input, inputs, coupling, rhs, n, x, packing })
    }

    /// Numbers per row that the host has for `columns` columns.
    fn width(&self, columns: usize) -> usize {
        if self.packing.is_some() { columns } else { PLANE * planes(columns) }
    }

    /// Lists sweep pairs `pairs` of a frame, with the way in before the first of all.
    fn list(
        &self,
        plan: &mut Plan,
        core: &impl Core<Outer = T>,
        columns: usize,
        pairs: std::ops::Range<u32>,
    ) {
        let pack = |plan: &mut Plan, kernel, from: &Arc<Buffer>, to: &Arc<Buffer>, rows: usize| {
            let push = [rows * columns, columns, PLANE * planes(columns)].map(|word| word as u32);
            plan.dispatch(kernel, &[from, to].map(Buffer::all), &push, push[0].div_ceil(GROUP));
        };
        let begins = pairs.start == 0;
        if let Some(Packing { input, kernels, .. }) = self.packing.as_ref().filter(|_| begins) {
            pack(plan, &kernels[0], input, &self.input, self.inputs);
            plan.barrier();
            plan.phase(|| "upload".into());
        }
        if let Some(coupling) = self.coupling.as_ref().filter(|_| begins) {
            coupling.list(plan, &self.input, &self.rhs, planes(columns));
        }
        core.list(plan, &self.rhs, &self.x, planes(columns), pairs);
        if let Some(Packing { x, kernels, .. }) = &self.packing {
            pack(plan, &kernels[1], &self.x, x, self.n);
            plan.phase(|| "download".into());
        }
    }
}

impl<C: Core> Frames<C> {
    /// Records the frames of a factor for up to `max_columns` columns at once (at most eight), and runs them once: drivers
    /// compile kernels when they first run. Right-hand sides come whole, or from `constraints`: a coupling and how many.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn new(
        core: C,
        team: Team,
        constraints: Option<(Coupling<C::Outer>, usize)>,
        max_columns: usize,
    ) -> Result<Self, DeviceError> {
        let device = Arc::clone(core.tables().device());
        let most = max_columns.min(2 * PLANE);
        let vectors = Vectors::new(&device, core.tables().rows(), most, constraints)?;
        let mut plan = Plan::new(&device);
        core.clear(&mut plan);
        plan.clear(&vectors.rhs);
        plan.clear(&vectors.x);
        if vectors.coupling.is_some() {
            plan.clear(&vectors.input);
        }
        let mut clear = plan.record()?;
        clear.run()?;
        let (mut plans, mut dispatches) = (Vec::new(), 0);
        for columns in 1..=most {
            let mut plan = Plan::new(&device);
            plan.mark();
            vectors.list(&mut plan, &core, columns, 0..C::PAIRS);
            plan.mark();
            dispatches = plan.dispatches();
            let mut more = Vec::new();
            for pair in C::PAIRS..C::MOST {
                let mut plan = Plan::new(&device);
                plan.mark();
                vectors.list(&mut plan, &core, columns, pair..pair + 1);
                plan.mark();
                more.push(plan.record()?);
            }
            plans.push((plan.record()?, more));
        }
        for columns in [PLANE.min(most), most] {
            plans[columns - 1].0.run()?;
        }
        Ok(Self { core, team, vectors, plans, dispatches, clear, last: most })
    }

    /// The last frame once more, phase by phase.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn device_phases(&self) -> Result<Vec<(String, u64)>, DeviceError> {
        let mut plan = Plan::timed(self.core.tables().device());
        self.vectors.list(&mut plan, &self.core, self.last, 0..C::PAIRS);
        let mut recorded = plan.record()?;
        recorded.run()?;
        Ok(recorded.phases())
    }

    /// Dispatches of one submission.
    pub fn dispatches(&self) -> u64 {
        self.dispatches as u64
    }

    /// Most columns of a frame.
    pub fn widest(&self) -> usize {
        self.plans.len()
    }

    /// Where right-hand sides come from constraints: takes their weights from the stored values of L, for the factor at hand.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn couple(&mut self, values: &[f64]) -> Result<(), DeviceError> {
        let scale = self.core.tables().scale;
        self.vectors.coupling.as_mut().map_or(Ok(()), |coupling| coupling.update(values, scale))
    }

    /// Solves for a group of columns of `b`; returns whether the solution is finite, and what to report.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn solve(
        &mut self,
        b: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), DeviceError> {
        if self.vectors.coupling.is_some() && planes(self.last) != planes(group.count) {
            self.clear.run()?; // rows that no frame writes lie elsewhere in two planes than in one
        }
        let largest = self.load(b, group, 1.0);
        // Only a right-hand side far from 1 is scaled: the same bits come out either way, but not the same speed.
        let scale = if C::COMFORTABLE.contains(&largest) { 1.0 } else { 1.0 / power_of_two(largest) };
        if scale != 1.0 {
            self.load(b, group, scale);
        }
        let (mut device_ns, mut pairs) = (self.run(group)?, C::PAIRS);
        while pairs < C::MOST && !self.core.enough(pairs) {
            let more = &mut self.plans[group.count - 1].1[(pairs - C::PAIRS) as usize];
            more.run()?;
            device_ns = device_ns.zip(more.device_ns()).map(|(a, b)| a + b);
            pairs += 1;
        }
        let of_factor = if self.vectors.coupling.is_some() { 1.0 } else { self.core.tables().scale };
        let finite = self.store(x, group, of_factor / scale)?;
        let iterations = (C::MOST > 1).then_some(pairs);
        Ok((finite, Solved { iterations, device_ns, ..Solved::default() }))
    }

    /// A group of columns of `b`, times `scale`, becomes the right-hand side. Returns the largest absolute value of the group
    /// before that; NaN where there is one.
    pub fn load(&mut self, b: Columns<&[f64]>, group: Group, scale: f64) -> f64 {
        let (n, width) = (self.vectors.inputs, self.vectors.width(group.count));
        let seen = self.vectors.packing.as_ref().map_or(&self.vectors.input, |packing| &packing.input);
        // SAFETY: frames are waited for, self is borrowed exclusively, and nobody else knows the buffer.
        let host: &mut [C::Outer] = unsafe { seen.host() }.expect("the host sees it");
        // The bits of numbers that are not negative are ordered as they are; NaN comes last.
        let largest = AtomicU64::new(0);
        self.team.for_each_run(&mut host[..n * width], width, |rows, to| {
            let from = &b.slice()[rows.start * b.k()..rows.end * b.k()];
            let most = load_rows(from, b.k(), group, scale, to, width);
            largest.fetch_max(most.to_bits(), Ordering::Relaxed);
        });
        f64::from_bits(largest.into_inner())
    }

    /// Both sweeps; returns the time on the device.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn run(&mut self, group: Group) -> Result<Option<u64>, DeviceError> {
        self.last = group.count;
        let recorded = &mut self.plans[group.count - 1].0;
        recorded.run()?;
        Ok(recorded.device_ns())
    }

    /// Stores the solution times `scale` to a group of columns of `x`; returns whether all of it is finite.
    ///
    /// # Errors
    /// Where clearing the device's vectors fails, which is done where it is not.
    pub fn store(
        &mut self,
        x: &mut Columns<&mut [f64]>,
        group: Group,
        scale: f64,
    ) -> Result<bool, DeviceError> {
        let (k, width) = (x.k(), self.vectors.width(group.count));
        let seen = self.vectors.packing.as_ref().map_or(&self.vectors.x, |packing| &packing.x);
        // SAFETY: as in `load`.
        let host: &[C::Outer] = unsafe { seen.host() }.expect("the host sees it");
        let finite = AtomicBool::new(true);
        self.team.for_each_run(x.data_mut(), k, |rows, to| {
            if !store_rows(&host[rows.start * width..rows.end * width], width, to, k, group, scale) {
                finite.store(false, Ordering::Relaxed);
            }
        });
        let finite = finite.into_inner();
        if !finite {
            self.clear.run()?;
        }
        Ok(finite)
    }

    /// Bytes on the device: all that this handle allocated there.
    pub fn device_bytes(&self) -> u64 {
        let (tables, (extra, _)) = (self.core.tables(), self.core.extra_bytes());
        let (numbers, indices) = tables.factor_bytes();
        let Vectors { input, coupling, rhs, x, .. } = &self.vectors;
        let own = coupling.as_ref().map_or(0, |coupling| input.bytes() + coupling.device_bytes());
        numbers + indices + tables.vector_bytes() + rhs.bytes() + x.bytes() + own + extra
    }

    /// What a handle holds and moves.
    pub fn footprint(&self, ordering: &'static str) -> Footprint {
        let (tables, (_, read)) = (self.core.tables(), self.core.extra_bytes());
        let (numbers, indices) = tables.factor_bytes();
        let symbolic = tables.symbolic();
        Footprint {
            host_bytes: Some(tables.host_bytes()),
            device_bytes: Some(self.device_bytes()),
            factor_nonzeros: Some(symbolic.nonzeros),
            factor_bytes: Some(numbers + indices),
            bytes_per_solve: Some(u64::from(C::PAIRS) * (numbers + indices + read)),
            factor_flops: Some(symbolic.flops),
            dispatches: Some(self.dispatches()),
            ordering: Some(ordering),
        }
    }
}

/// Runs `$body` with the constants `$c` equal to `$count` and `$l` equal to `$width`: that, or whole planes.
macro_rules! with_count {
    ($count:expr, $width:expr, $c:ident, $l:ident, $body:block) => {
        with_count!(@ $count, $width, $c, $l, $body, 1 4, 2 4, 3 4, 4 4, 5 8, 6 8, 7 8, 8 8)
    };
    (@ $count:expr, $width:expr, $c:ident, $l:ident, $body:block, $($n:literal $planes:literal),*) => {
        match $count {
            $($n if $width == $n => { const $c: usize = $n; const $l: usize = $n; $body })*
            $($n => { const $c: usize = $n; const $l: usize = $planes; $body })*
            other => unreachable!("a group of {other} columns"),
        }
    };
}

/// Rows of `k` numbers to rows of `width` numbers; returns the largest absolute value.
fn load_rows<T: Number>(from: &[f64], k: usize, group: Group, scale: f64, to: &mut [T], width: usize) -> f64 {
    with_count!(group.count, width, C, L, {
        let mut most = [0.0_f64; C];
        for (to, from) in to.as_chunks_mut::<L>().0.iter_mut().zip(from.chunks_exact(k)) {
            let from = from[group.from..].first_chunk::<C>().expect("C columns");
            let mut row = [T::default(); L];
            for c in 0..C {
                most[c] = if from[c].abs() <= most[c] { most[c] } else { from[c].abs() };
                row[c] = T::from_f64(from[c] * scale);
            }
            *to = row;
        }
        most.into_iter().fold(0.0, |all, v| if v <= all { all } else { v })
    })
}

/// Rows of `width` numbers to rows of `k` numbers; returns whether all are finite.
fn store_rows<T: Number>(
    from: &[T],
    width: usize,
    to: &mut [f64],
    k: usize,
    group: Group,
    scale: f64,
) -> bool {
    with_count!(group.count, width, C, L, {
        let mut check = [0.0; C];
        for (from, to) in from.as_chunks::<L>().0.iter().zip(to.chunks_exact_mut(k)) {
            let to = to[group.from..].first_chunk_mut::<C>().expect("C columns");
            for c in 0..C {
                to[c] = from[c].to_f64() * scale;
                check[c] += 0.0 * to[c]; // NaN for an infinity or a NaN, and stays in the sum
            }
        }
        check.iter().all(|&sum| sum == 0.0)
    })
}
