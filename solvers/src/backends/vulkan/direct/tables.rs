//! A factor on the device and the steps of its sweeps.
use super::blocks::{Blocks, LANES};
use super::number::{GROUP, Kernels, Number, Source};
use super::tiles::{TileStore, Tiles, scratch};
use crate::backends::framechol::engine::power_of_two;
use crate::backends::framechol::numeric::{Breakdown, FactorPart, Workspace};
use crate::backends::framechol::symbolic::Symbolic;
use crate::backends::vulkan::buffer::{Buffer, Place, Slot, Upload, constant};
use crate::backends::vulkan::device::{ALIGNMENT, Device};
use crate::backends::vulkan::plan::Plan;
use crate::error::PrepareError;
use crate::isa::Isa;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

/// Columns of a plane.
pub const PLANE: usize = 4;

/// The factor, its index tables and the vectors between the sweeps.
pub struct Tables<T> {
    device: Arc<Device>,
    kernels: Arc<Kernels>,
    isa: Isa,
    symbolic: Symbolic,
    work: Workspace,
    blocks: Blocks,
    tiles: Tiles,
    /// The factor is that of this power of two times the matrix.
    pub scale: f64,
    forward: Arc<Buffer>,
    backward: Arc<Buffer>,
    forward_heads: Arc<Buffer>,
    backward_heads: Arc<Buffer>,
    rows: Arc<Buffer>,
    below: Arc<Buffer>,
    starts: Arc<Buffer>,
    sources: Arc<Buffer>,
    y: Arc<Buffer>,
    fronts: Arc<Buffer>,
    /// Rows of right-hand side and solution.
    n: usize,
    number: PhantomData<fn() -> T>,
}

/// Where matrix rows lie in right-hand sides and solutions.
pub struct Places<'a> {
    /// Rows of those vectors.
    pub n: usize,
    /// The place of a matrix row.
    pub of: &'a dyn Fn(u32) -> u32,
    /// The only matrix rows where a right-hand side is not zero, if not all.
    pub active: Option<&'a [u32]>,
}

impl Places<'static> {
    /// `n` rows where they are.
    pub fn all(n: usize) -> Self {
        Self { n, of: &|row| row, active: None }
    }
}

/// Elements that a tile may read past the end of a vector: their factors are zero.
const OVERREAD: usize = LANES;

impl<T: Number> Tables<T> {
    /// Room for the factor on the device, for vectors of `planes` planes.
    ///
    /// # Errors
    /// Where device or host memory does not suffice.
    pub fn new(
        device: &Arc<Device>,
        kernels: Arc<Kernels>,
        symbolic: Symbolic,
        planes: usize,
        places: &Places<'_>,
    ) -> Result<Self, PrepareError> {
        let part = &symbolic.parts[0];
        let bytes = Workspace::bytes_for(part);
        Vec::<u8>::new()
            .try_reserve_exact(usize::try_from(bytes).unwrap_or(usize::MAX))
            .map_err(|_| PrepareError::OutOfMemory { bytes })?;
        let work = Workspace::new(part);
        let mut blocks = Blocks::new(&symbolic, places.active);
        let tiles = Tiles::new(part, &blocks, T::PACK, device.access());
        blocks.rows.iter_mut().chain(&mut blocks.below).for_each(|at| *at = (places.of)(*at));
        let slots = blocks.slots();
        let table = |numbers: usize| Buffer::new(device, Place::Device, (numbers * size_of::<T>()) as u64);
        let vectors = |elements: usize| table((elements + OVERREAD) * planes * PLANE);
        let padded_rows: Vec<u32> = blocks.rows.iter().copied().chain([places.n as u32; OVERREAD]).collect();
        Ok(Self {
            forward: table(tiles.forward_len)?,
            backward: table(tiles.backward_len)?,
            forward_heads: constant(device, &tiles.forward)?,
            backward_heads: constant(device, &tiles.backward)?,
            rows: constant(device, &padded_rows)?,
            below: constant(device, &blocks.below)?,
            starts: constant(device, &blocks.source_starts)?,
            sources: constant(device, &blocks.sources)?,
            y: vectors(slots)?,
            fronts: vectors(blocks.fronts as usize)?,
            device: Arc::clone(device),
            kernels,
            isa: Isa::best(),
            symbolic,
            work,
            blocks,
            tiles,
            scale: 1.0,
            n: places.n,
            number: PhantomData,
        })
    }

    /// The device.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Rows of right-hand side and solution.
    pub fn rows(&self) -> usize {
        self.n
    }

    /// Structure of the factor.
    pub fn symbolic(&self) -> &Symbolic {
        &self.symbolic
    }

    /// Factors on the CPU, in f64, and writes the rounded tiles to the device. `values` by stored entry of the matrix.
    ///
    /// # Errors
    /// With the row of the matrix where elimination breaks down, or the device's.
    pub fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        let largest = self.symbolic.largest_pivot(values);
        self.scale = 1.0 / power_of_two(largest);
        let (inverse, dense) = scratch(&self.symbolic.parts[0]);
        let (mut inverse, mut dense) = (vec![0.0; inverse], vec![0.0; dense]);
        // SAFETY: frames are waited for, both buffers are known to self alone, and self is borrowed exclusively.
        let mut forward = unsafe { Upload::<T>::new(&self.device, &self.forward) }?;
        // SAFETY: as above.
        let mut backward = unsafe { Upload::<T>::new(&self.device, &self.backward) }?;
        let outcome = self.isa.run(FactorPart {
            part: &self.symbolic.parts[0],
            values,
            scale: self.scale,
            below: &|_| unreachable!("one part"),
            work: &mut self.work,
            out: &mut TileStore {
                tiles: &self.tiles,
                forward: forward.host(),
                backward: backward.host(),
                inverse: &mut inverse,
                dense: &mut dense,
            },
            crew: None,
        });
        outcome.map_err(|Breakdown { position, pivot }| {
            let row = self.symbolic.order[position as usize] as usize;
            if pivot.is_finite() {
                PrepareError::NotPositiveDefinite { row }
            } else {
                PrepareError::NonFinite { row }
            }
        })?;
        forward.finish()?;
        backward.finish()?;
        Ok(())
    }

    /// Zeros in all vectors: a frame with numbers that are not finite must leave nothing behind.
    pub fn clear(&self, plan: &mut Plan) {
        plan.clear(&self.y);
        plan.clear(&self.fronts);
    }

    /// Lists the steps of both sweeps: `rhs` and `x` hold `planes` times four numbers per row and one row more than the
    /// right-hand side. Begins without a barrier and ends with one; every level of either sweep is a phase.
    pub fn sweep(&self, plan: &mut Plan, rhs: &Arc<Buffer>, x: &Arc<Buffer>, planes: usize) {
        self.sweep_forward(plan, rhs, planes);
        self.sweep_backward(plan, x, planes);
    }

    fn sweep_forward(&self, plan: &mut Plan, rhs: &Arc<Buffer>, planes: usize) {
        let fronts = self.blocks.fronts;
        let mut slot = 0;
        for l in 0..self.blocks.levels() {
            let width = |&s: &u32| self.symbolic.parts[0].shape(s as usize).width as u32;
            let pivots: u32 = self.blocks.reached(l).iter().map(width).sum();
            let first = slot;
            slot += self.blocks.level(l).iter().map(width).sum::<u32>();
            if pivots == 0 {
                continue;
            }
            let y = if l == 0 || self.kernels.above_leaves() == Source::Gathered {
                rhs
            } else {
                let kernel = self.kernels.assemble(planes);
                let slots = [&self.rows, rhs, &self.starts, &self.sources, &self.fronts, &self.y];
                plan.dispatch(
                    kernel,
                    &slots.map(Buffer::all),
                    &[first, pivots, fronts],
                    pivots.div_ceil(GROUP),
                );
                plan.barrier();
                plan.phase(|| format!("assemble {l:02}"));
                &self.y
            };
            let shape = self.tiles.shapes[l];
            let kernel = self.kernels.forward(planes, l == 0, shape);
            let tiles = self.tiles.forward_levels[l]..self.tiles.forward_levels[l + 1];
            for (tiles, values, base) in self.pieces(tiles, &self.forward, |t| self.forward_place(t)) {
                let [heads, rows, starts, sources, updates, out] = [
                    &self.forward_heads,
                    &self.rows,
                    &self.starts,
                    &self.sources,
                    &self.fronts,
                    &self.fronts,
                ]
                .map(Buffer::all);
                let slots = [heads, values, y.all(), rows, starts, sources, updates, out];
                let count = tiles.end - tiles.start;
                plan.dispatch(kernel, &slots, &[tiles.start, count, base, fronts], shape.groups(count));
            }
            plan.barrier();
            plan.phase(|| format!("forward {l:02}"));
        }
    }

    fn sweep_backward(&self, plan: &mut Plan, x: &Arc<Buffer>, planes: usize) {
        for l in (0..self.blocks.levels()).rev() {
            let shape = self.tiles.shapes[l];
            let kernel = self.kernels.backward(planes, shape);
            let tiles = self.tiles.backward_levels[l]..self.tiles.backward_levels[l + 1];
            for (tiles, values, base) in self.pieces(tiles, &self.backward, |t| self.backward_place(t)) {
                let [heads, fronts, rows, below, above, out] =
                    [&self.backward_heads, &self.fronts, &self.rows, &self.below, x, x].map(Buffer::all);
                let slots = [heads, values, fronts, rows, below, above, out];
                let count = tiles.end - tiles.start;
                let push = [tiles.start, count, base, self.n as u32];
                plan.dispatch(kernel, &slots, &push, shape.groups(count));
            }
            plan.barrier();
            plan.phase(|| format!("backward {l:02}"));
        }
    }

    /// First unit of 16 bytes of a forward tile; one past the last tile's end for the tile after it.
    fn forward_place(&self, tile: u32) -> u64 {
        let end = || (self.tiles.forward_len / T::PACK) as u32;
        u64::from(self.tiles.forward.get(tile as usize).map_or_else(end, |head| head[2]))
    }

    /// As [`forward_place`](Self::forward_place) for the backward sweep.
    fn backward_place(&self, tile: u32) -> u64 {
        let end = || (self.tiles.backward_len / T::PACK) as u32;
        u64::from(self.tiles.backward.get(tile as usize).map_or_else(end, |head| head[2]))
    }

    /// Cuts tiles into pieces whose numbers a kernel may see at once: (tiles, what it sees, unit where that begins).
    fn pieces(
        &self,
        tiles: Range<u32>,
        table: &Arc<Buffer>,
        place: impl Fn(u32) -> u64,
    ) -> Vec<(Range<u32>, Slot, u32)> {
        const UNIT: u64 = 16;
        let range = self.device.traits().range;
        let mut pieces = Vec::new();
        let mut first = tiles.start;
        while first < tiles.end {
            let from = place(first) * UNIT / ALIGNMENT * ALIGNMENT;
            let mut last = first + 1; // a tile that alone is too large is refused when the plan is recorded
            while last < tiles.end && place(last + 1) * UNIT - from <= range {
                last += 1;
            }
            let bytes = place(last) * UNIT - from;
            pieces.push((first..last, table.part(from, bytes), (from / UNIT) as u32));
            first = last;
        }
        pieces
    }

    /// Bytes of the factor on the device: numbers, and the indices that go with them.
    pub fn factor_bytes(&self) -> (u64, u64) {
        let indices = [&self.rows, &self.below, &self.starts, &self.sources];
        let indices: u64 = indices.iter().map(|buffer| buffer.bytes()).sum();
        (self.forward.bytes() + self.backward.bytes(), indices + self.tiles.header_bytes())
    }

    /// Bytes of the vectors on the device.
    pub fn vector_bytes(&self) -> u64 {
        self.y.bytes() + self.fronts.bytes()
    }

    /// Bytes held on the host.
    pub fn host_bytes(&self) -> u64 {
        let words = self.blocks.below.len() + self.blocks.sources.len() + self.blocks.source_starts.len();
        self.symbolic.bytes() + self.work.bytes() + 4 * words as u64 + self.tiles.header_bytes()
    }
}
