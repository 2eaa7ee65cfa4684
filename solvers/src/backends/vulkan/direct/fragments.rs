//! Steps 2 to 4 of a `transfer` frame after the field is solved: unit quaternions, rotations of triangles, differential
//! coordinates. The mathematics is that of [`crate::workload::transfer::fragments`].
use super::number::{GROUP, Number};
use super::tables::PLANE;
use crate::backends::framechol::engine::power_of_two;
use crate::backends::vulkan::buffer::{Buffer, Input, Output, Place, constant};
use crate::backends::vulkan::device::Device;
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::plan::Plan;
use crate::vector::{Vector, scale, sub};
use crate::workload::transfer::TransferProblem;
use crate::workload::transfer::fragments::Fragments;
use crate::workload::transfer::marks::LEAST_NORM;
use std::sync::Arc;

/// Tables and vectors of the fragments.
pub struct Fragmentation<T> {
    normalise: Arc<Kernel>,
    turn: Arc<Kernel>,
    divergence: Arc<Kernel>,
    /// Reference positions of vertices and of the marks' target centroids, about the first of these, in units of the diagonal.
    positions: Arc<Buffer>,
    centroids: Arc<Buffer>,
    /// Vertices of triangles, with a zero.
    triangles: Arc<Buffer>,
    /// Start of every vertex' corners; triangle and weighted edges of every corner.
    starts: Arc<Buffer>,
    corner_triangles: Arc<Buffer>,
    edges: Arc<Buffer>,
    /// Unit quaternion of every vertex.
    pub quaternions: Arc<Buffer>,
    turns: Arc<Buffer>,
    /// Vertices whose rotation was replaced in the last frame.
    pub replaced: Output<u32>,
    /// U comes times this power of two: the largest edge is about 1.
    pub scale: f64,
    vertices: u32,
    count: u32,
    marks: u32,
    number: std::marker::PhantomData<fn() -> T>,
}

impl<T: Number> Fragmentation<T> {
    /// For the target of `problem`.
    ///
    /// # Errors
    /// Where memory does not suffice or the driver refuses.
    pub fn new(device: &Arc<Device>, problem: &TransferProblem) -> Result<Self, DeviceError> {
        let target = problem.target();
        let host = Fragments::new(problem.laplacian(), target.positions());
        let largest = host.corner_edges.as_flattened().iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let unit = 1.0 / power_of_two(largest);
        let edges: Vec<[T; PLANE]> = host.corner_edges.iter().map(|&c| row(scale(unit, c))).collect();
        let origin = problem.marks().all()[0].target_centroid;
        let size = 1.0 / power_of_two(target.diagonal());
        let near = |x: Vector| row::<T>(scale(size, sub(x, origin)));
        let positions: Vec<[T; PLANE]> = target.positions().iter().map(|&x| near(x)).collect();
        let centroids: Vec<[T; PLANE]> =
            problem.marks().all().iter().map(|mark| near(mark.target_centroid)).collect();
        let triangles: Vec<[u32; 4]> = host.triangles.iter().map(|&[a, b, c]| [a, b, c, 0]).collect();
        let vector = |rows: usize| Buffer::new(device, Place::Device, (rows * PLANE * size_of::<T>()) as u64);
        let rotations = [GROUP, (LEAST_NORM as f32).to_bits()];
        Ok(Self {
            normalise: Kernel::new(device, &T::NORMALISE, &rotations)?,
            turn: Kernel::new(device, &T::TURN, &rotations)?,
            divergence: Kernel::new(device, &T::DIVERGENCE, &[GROUP])?,
            positions: constant(device, &positions)?,
            centroids: constant(device, &centroids)?,
            triangles: constant(device, &triangles)?,
            starts: constant(device, &host.starts)?,
            corner_triangles: constant(device, &host.corner_triangles)?,
            edges: constant(device, &edges)?,
            quaternions: vector(positions.len())?,
            turns: vector(triangles.len())?,
            replaced: Output::new(device, 1)?,
            scale: unit,
            vertices: positions.len() as u32,
            count: triangles.len() as u32,
            marks: centroids.len() as u32,
            number: std::marker::PhantomData,
        })
    }

    /// Bytes of the largest table for `problem`: kernels must see all of it.
    pub fn largest(problem: &TransferProblem) -> u64 {
        let laplacian = problem.laplacian();
        let rows = laplacian.incidence().corners().len().max(problem.target().positions().len() + 1);
        (rows * PLANE * size_of::<T>()) as u64
    }

    /// Lists the steps from the `field` at all vertices to U in `u`. `input` has the marks' rotations from row `first` on.
    pub fn list(
        &self,
        plan: &mut Plan,
        field: &Arc<Buffer>,
        (input, first): (&Input<[T; PLANE]>, u32),
        u: &Arc<Buffer>,
    ) {
        plan.clear(self.replaced.buffer());
        plan.barrier();
        let [centroids, rotations] = [&self.centroids, input.buffer()];
        let slots = [
            field,
            &self.starts,
            &self.positions,
            centroids,
            rotations,
            &self.quaternions,
            self.replaced.buffer(),
        ];
        let push = [self.vertices, self.marks, first];
        plan.dispatch(&self.normalise, &slots.map(Buffer::all), &push, self.vertices.div_ceil(GROUP));
        plan.barrier();
        plan.phase(|| "normalise".into());
        let slots = [&self.triangles, &self.quaternions, &self.turns];
        plan.dispatch(&self.turn, &slots.map(Buffer::all), &[self.count], self.count.div_ceil(GROUP));
        plan.barrier();
        plan.phase(|| "turn".into());
        let slots = [&self.starts, &self.corner_triangles, &self.edges, &self.turns, u];
        let groups = self.vertices.div_ceil(GROUP);
        plan.dispatch(&self.divergence, &slots.map(Buffer::all), &[self.vertices], groups);
        plan.barrier();
        plan.phase(|| "divergence".into());
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let Self { positions, centroids, triangles, starts, corner_triangles, edges, .. } = self;
        let tables = [positions, centroids, triangles, starts, corner_triangles, edges];
        let vectors = [&self.quaternions, &self.turns, self.replaced.buffer()];
        tables.into_iter().chain(vectors).map(|buffer| buffer.bytes()).sum()
    }
}

/// A point as a row of four columns.
fn row<T: Number>(x: Vector) -> [T; PLANE] {
    [x[0], x[1], x[2], 0.0].map(T::from_f64)
}
