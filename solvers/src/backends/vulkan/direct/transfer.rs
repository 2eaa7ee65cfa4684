//! Whole `transfer` frames in one submission: rotations at the constrained vertices go up, positions come down.
//!
//! Step 1 stays on the host: it looks at the marked triangles alone, some hundred vertices of the template, and the device
//! would need all of them. The end of step 5, a translation per component, is worked out on the host from the marked
//! triangles again, and added while the positions are copied to the caller.
//!
//! ```text
//! g, rotations -> couple -> field factor -> normalise -> turn -> divergence -> space factor -> positions
//! ```
use super::core::Core;
use super::coupling::Coupling;
use super::fragments::Fragmentation;
use super::number::{GROUP, Number};
use super::tables::{PLANE, Tables};
use crate::backend::{Footprint, FrameTrace, Solved, TransferFrame};
use crate::backends::vulkan::buffer::{Buffer, Input, Output, Place, Plain, constant, read};
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::plan::Plan;
use crate::backends::vulkan::recorded::Recorded;
use crate::error::SolveError;
use crate::isa::Real;
use crate::team::Team;
use crate::vector::Vector;
use crate::workload::transfer::TransferProblem;
use crate::workload::transfer::placement::Placement;
use crate::workload::transfer::posing::Posing;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Columns of a position.
const SPACE: usize = 3;

/// Both factors and what lies between them.
pub struct Parts<C: Core> {
    /// L_FF of step 2, and L of step 5 grounded; a row per vertex in both.
    pub field: C,
    pub space: C,
    /// L_FC of step 2.
    pub coupling: Coupling<C::Outer>,
    /// Steps 2 to 4.
    pub fragments: Fragmentation<C::Outer>,
}

/// Prepared frames.
pub struct DeviceFrames<C: Core> {
    problem: TransferProblem,
    steps: Steps<C>,
    /// A usual frame, and frames with more and more sweep pairs for both factors.
    recorded: Vec<Recorded>,
    clear: Recorded,
    team: Team,
    posing: Posing,
    placement: Placement,
    replaced: usize,
    dispatches: u64,
    /// The last trace: field and U.
    traced: (Vec<f64>, Vec<f64>),
    ordering: &'static str,
}

/// All that lies on the device.
struct Steps<C: Core> {
    parts: Parts<C>,
    /// Values at the constraints, then the rotations of the marks.
    input: Input<[C::Outer; PLANE]>,
    constraints: u32,
    /// Vertices of the constraints, and anchors of detached pieces.
    fixed: Arc<Buffer>,
    anchors: Arc<Buffer>,
    pieces: u32,
    /// Right-hand side and solution of both systems.
    field: [Arc<Buffer>; 2],
    space: [Arc<Buffer>; 2],
    /// Quaternions at the anchors.
    turned: Output<[C::Outer; PLANE]>,
    /// Positions packed, where the host does not see the device's.
    packed: Option<(Arc<Buffer>, Arc<Kernel>)>,
    place: Arc<Kernel>,
    pick: Arc<Kernel>,
}

impl<C: Core> Steps<C> {
    fn new(problem: &TransferProblem, parts: Parts<C>) -> Result<Self, DeviceError> {
        let device = Arc::clone(parts.field.tables().device());
        let n = problem.target().positions().len();
        let buffer =
            |place, numbers: usize| Buffer::new(&device, place, (numbers * size_of::<C::Outer>()) as u64);
        let vector = || buffer(Place::Device, (n + 1) * PLANE);
        let (fixed, marks) = (problem.harmonic().fixed(), problem.marks().all().len());
        let anchors: Vec<u32> = problem.pieces().detached().iter().map(|piece| piece.anchor).collect();
        let packed = if device.is_unified() {
            None
        } else {
            let packed = buffer(Place::Readback, n * SPACE)?;
            Some((packed, Kernel::new(&device, &C::Outer::PACKING, &[GROUP, 1])?))
        };
        Ok(Self {
            input: Input::new(&device, fixed.len() + marks)?,
            constraints: fixed.len() as u32,
            fixed: constant(&device, fixed)?,
            pieces: anchors.len() as u32,
            turned: Output::new(&device, anchors.len())?,
            anchors: constant(&device, &anchors)?,
            field: [vector()?, vector()?],
            space: [vector()?, vector()?],
            packed,
            place: Kernel::new(&device, &C::Outer::SCATTER, &[GROUP, 0])?,
            pick: Kernel::new(&device, &C::Outer::SCATTER, &[GROUP, 1])?,
            parts,
        })
    }

    /// Lists the steps of a frame with so many sweep pairs for each factor.
    fn list(&self, plan: &mut Plan, pairs: u32) {
        let Parts { field, space, coupling, fragments } = &self.parts;
        self.input.upload(plan);
        plan.barrier();
        plan.part("field ");
        coupling.list(plan, self.input.buffer(), &self.field[0], 1);
        field.list(plan, &self.field[0], &self.field[1], 1, 0..pairs);
        let slots = [&self.fixed, self.input.buffer(), &self.field[1]];
        let groups = self.constraints.div_ceil(GROUP);
        plan.dispatch(&self.place, &slots.map(Buffer::all), &[self.constraints], groups);
        plan.part("");
        fragments.list(plan, &self.field[1], (&self.input, self.constraints), &self.space[0]);
        let slots = [&self.anchors, &fragments.quaternions, self.turned.buffer()];
        plan.dispatch(&self.pick, &slots.map(Buffer::all), &[self.pieces], self.pieces.div_ceil(GROUP));
        plan.part("space ");
        space.list(plan, &self.space[0], &self.space[1], 1, 0..pairs);
        self.turned.download(plan);
        fragments.replaced.download(plan);
        if let Some((packed, kernel)) = &self.packed {
            let push = [(space.tables().rows() * SPACE) as u32, SPACE as u32, PLANE as u32];
            let slots = [&self.space[1], packed];
            plan.dispatch(kernel, &slots.map(Buffer::all), &push, push[0].div_ceil(GROUP));
            plan.part("");
            plan.phase(|| "download".into());
        }
    }

    /// Lists zeros in all vectors.
    fn clear(&self, plan: &mut Plan) {
        Core::clear(&self.parts.field, plan);
        Core::clear(&self.parts.space, plan);
        self.field.iter().chain(&self.space).for_each(|buffer| plan.clear(buffer));
    }

    /// The solution of step 5 as the host has it, and its numbers per row.
    fn solved(&self) -> (&[C::Outer], usize) {
        let (seen, width) =
            self.packed.as_ref().map_or((&self.space[1], PLANE), |(packed, _)| (packed, SPACE));
        // SAFETY: frames are waited for, nobody else knows the buffer, and the host only reads it.
        (unsafe { seen.host() }.expect("the host sees it"), width)
    }

    /// What turns that into positions.
    fn unit(&self) -> f64 {
        self.parts.space.tables().scale / self.parts.fragments.scale
    }
}

impl<C: Core> DeviceFrames<C> {
    /// Records frames and runs one: drivers compile kernels when they first run.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn new(
        problem: &TransferProblem,
        parts: Parts<C>,
        team: Team,
        ordering: &'static str,
    ) -> Result<Self, DeviceError> {
        let steps = Steps::new(problem, parts)?;
        let device = Arc::clone(steps.parts.field.tables().device());
        let mut plan = Plan::new(&device);
        steps.clear(&mut plan);
        let mut clear = plan.record()?;
        clear.run()?;
        let (mut recorded, mut dispatches) = (Vec::new(), 0);
        for pairs in (C::PAIRS..=C::MOST).rev() {
            let mut plan = Plan::new(&device);
            plan.mark();
            steps.list(&mut plan, pairs);
            plan.mark();
            dispatches = plan.dispatches() as u64;
            recorded.push(plan.record()?);
        }
        recorded.reverse();
        recorded[0].run()?;
        Ok(Self {
            problem: problem.clone(),
            steps,
            recorded,
            clear,
            team,
            posing: Posing::new(problem.marks()),
            placement: Placement::new(problem),
            replaced: 0,
            dispatches,
            traced: (Vec::new(), Vec::new()),
            ordering,
        })
    }

    /// Writes what the device reads.
    fn load(&mut self) {
        let rotations = self.posing.poses.iter().map(|pose| pose.rotation);
        let rows = self.posing.values.as_chunks::<PLANE>().0.iter().copied().chain(rotations);
        for (to, row) in self.steps.input.host().iter_mut().zip(rows) {
            *to = row.map(C::Outer::from_f64);
        }
    }

    /// The end of step 5; false where a position is not finite.
    fn place(&mut self, target: &mut [Vector]) -> bool {
        let Self { problem, steps, placement, posing, team, .. } = self;
        let ((solved, width), unit) = (steps.solved(), steps.unit());
        let row = |row: &[C::Outer]| -> Vector { [0, 1, 2].map(|c| row[c].to_f64() * unit) };
        placement.update(problem, &posing.poses, |v| row(&solved[v * width..(v + 1) * width]));
        let (placement, finite) = (&*placement, AtomicBool::new(true));
        team.for_each_run(target, 1, |vertices, target| {
            let rows = solved[vertices.start * width..vertices.end * width].chunks_exact(width);
            placement.apply(problem, vertices.start, rows.map(row), target);
            // 0 times an infinity or a NaN is NaN, and stays in the sum.
            if target.as_flattened().iter().map(|x| 0.0 * x).sum::<f64>() != 0.0 {
                finite.store(false, Ordering::Relaxed);
            }
        });
        let turned = steps.turned.host();
        Placement::follow(problem, |piece| turned[piece].map(C::Outer::to_f64), target);
        finite.into_inner()
    }
}

impl<C: Core> TransferFrame for DeviceFrames<C> {
    fn frame(&mut self, template: &[Vector], target: &mut [Vector]) -> Result<Solved, SolveError> {
        assert_eq!(target.len(), self.problem.target().positions().len(), "target: one position per vertex");
        let replaced = self.posing.pose(self.problem.marks(), &mut self.team, template)?;
        self.load();
        let (mut device_ns, mut pairs) = (Some(0), C::PAIRS);
        for recorded in &mut self.recorded {
            recorded.run()?;
            device_ns = device_ns.zip(recorded.device_ns()).map(|(a, b)| a + b);
            let Parts { field, space, .. } = &mut self.steps.parts;
            if field.enough(pairs) & space.enough(pairs) || pairs == C::MOST {
                break;
            }
            pairs += 1;
        }
        self.replaced = replaced + self.steps.parts.fragments.replaced.host()[0] as usize;
        if !self.place(target) {
            self.clear.run()?;
            let row = target.iter().position(|x| x.iter().any(|x| !x.is_finite())).unwrap_or(0);
            return Err(SolveError::NonFinite { row });
        }
        Ok(Solved { iterations: (C::MOST > 1).then_some(pairs), device_ns, ..Solved::default() })
    }

    fn trace(&mut self) -> Option<FrameTrace<'_>> {
        let device = self.steps.parts.field.tables().device();
        let n = self.problem.target().positions().len();
        let field = numbers::<C::Outer>(read(device, &self.steps.field[1], n).ok()?);
        let scale = 1.0 / self.steps.parts.fragments.scale;
        let u = numbers::<C::Outer>(read(device, &self.steps.space[0], n).ok()?);
        let u = u.chunks_exact(PLANE).flat_map(|row| row[..SPACE].iter().map(|x| x * scale)).collect();
        self.traced = (field, u);
        let (field, rhs) = (&self.traced.0[..], &self.traced.1[..]);
        Some(FrameTrace { constraints: &self.posing.values, field, rhs })
    }

    fn replaced(&self) -> usize {
        self.replaced
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        let mut plan = Plan::timed(self.steps.parts.field.tables().device());
        self.steps.list(&mut plan, C::PAIRS);
        let mut recorded = plan.record()?;
        recorded.run()?;
        Ok(recorded.phases())
    }

    fn footprint(&self) -> Footprint {
        let Parts { field, space, coupling, fragments } = &self.steps.parts;
        let sum = |of: &dyn Fn(&Tables<C::Inner>) -> u64| of(field.tables()) + of(space.tables());
        let factors = sum(&|tables| tables.factor_bytes().0 + tables.factor_bytes().1);
        let vectors = self.steps.field.iter().chain(&self.steps.space).map(|buffer| buffer.bytes());
        let own = vectors.sum::<u64>() + coupling.device_bytes() + fragments.device_bytes();
        let ((a, read_a), (b, read_b)) = (field.extra_bytes(), space.extra_bytes());
        Footprint {
            host_bytes: Some(sum(&|tables| tables.host_bytes())),
            device_bytes: Some(factors + own + a + b + sum(&|tables| tables.vector_bytes())),
            factor_nonzeros: Some(sum(&|tables| tables.symbolic().nonzeros)),
            factor_bytes: Some(factors),
            bytes_per_solve: Some(u64::from(C::PAIRS) * (factors + read_a + read_b)),
            factor_flops: Some(sum(&|tables| tables.symbolic().flops)),
            dispatches: Some(self.dispatches),
            ordering: Some(self.ordering),
        }
    }
}

/// Rows of the device as numbers of the host.
fn numbers<T: Number + Plain>(rows: Vec<[T; PLANE]>) -> Vec<f64> {
    rows.as_flattened().iter().map(|x| x.to_f64()).collect()
}
