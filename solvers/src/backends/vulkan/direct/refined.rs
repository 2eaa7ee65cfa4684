//! `mixed` on a GPU with f64: sweeps in f32, residuals and solutions in f64, all in one submission
//! (J. H. Wilkinson, "Rounding Errors in Algebraic Processes", 1963, section 3.4). The host looks at a few norms and asks for
//! more pairs where two do not suffice.
use super::core::Core;
use super::mixed::{ENOUGH, MOST_PAIRS, SMALL};
use super::number::GROUP;
use super::tables::{PLANE, Places, Tables};
use crate::backends::vulkan::buffer::{Buffer, Output, Place, Upload, constant};
use crate::backends::vulkan::device::Device;
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::plan::Plan;
use crate::backends::vulkan::shaders::{Binding, Shader};
use crate::error::PrepareError;
use crate::sparse::SymmetricCsr;
use std::ops::Range;
use std::sync::Arc;

use Binding::Storage;

const NARROW: Shader = storage_shader!("narrow", "f64", &[Storage; 3], 2);
const ADVANCE: Shader = storage_shader!("advance", "f64", &[Storage; 3], 3);
const RESIDUAL: Shader = storage_shader!("residual", "f64", &[Storage; 7], 2);

/// Elements per invocation of these: few, for a GPU has many; and a workgroup then ends with one atomic per norm.
const ROWS: u32 = 4;

/// Entries of a chunk of a row: what kernels read with one word of columns.
const CHUNK: usize = 4;
/// No stored entry: padding.
const NOTHING: u32 = u32::MAX;

/// Norms that a pair leaves: step, solution, residual; the fourth of pair 0 is that of the right-hand side.
const NORMS: usize = 4;

/// The factor in f32 and the matrix in f64.
pub struct Refined {
    tables: Tables<f32>,
    device: Arc<Device>,
    narrow: Arc<Kernel>,
    advance: Arc<Kernel>,
    /// By planes.
    residual: [Arc<Kernel>; 2],
    /// Rows of the matrix in chunks, by place.
    starts: Arc<Buffer>,
    columns: Arc<Buffer>,
    values: Arc<Buffer>,
    /// Stored entry of every number in the chunks.
    sources: Vec<u32>,
    /// Residual and step in f32.
    r: Arc<Buffer>,
    step: Arc<Buffer>,
    pub(super) norms: Output<u32>,
    /// The largest diagonal entry of what is factored: a lower bound of its norm.
    norm: f64,
}

impl Refined {
    /// From a factor that is in place, and its matrix.
    ///
    /// # Errors
    /// Where memory does not suffice or the driver refuses.
    pub fn new(
        tables: Tables<f32>,
        matrix: &SymmetricCsr,
        places: &Places<'_>,
        planes: usize,
    ) -> Result<Self, DeviceError> {
        let device = Arc::clone(tables.device());
        let (starts, columns, sources) = chunks(matrix, places);
        let vector = || Buffer::new(&device, Place::Device, ((places.n + 1) * planes * PLANE * 4) as u64);
        let residual = |planes| Kernel::new(&device, &RESIDUAL, &[GROUP, ROWS, planes]);
        let mut refined = Self {
            narrow: Kernel::new(&device, &NARROW, &[GROUP, ROWS])?,
            advance: Kernel::new(&device, &ADVANCE, &[GROUP, ROWS])?,
            residual: [residual(1)?, residual(2)?],
            starts: constant(&device, &starts)?,
            columns: constant(&device, &columns)?,
            values: Buffer::new(&device, Place::Device, 8 * sources.len() as u64)?,
            sources,
            r: vector()?,
            step: vector()?,
            norms: Output::new(&device, NORMS * MOST_PAIRS as usize)?,
            norm: 0.0,
            device,
            tables,
        };
        refined.renew(matrix.values())?;
        Ok(refined)
    }

    /// Takes the matrix' values, scaled as the factor is.
    fn renew(&mut self, values: &[f64]) -> Result<(), DeviceError> {
        let scale = self.tables.scale;
        // Diagonal entries are among them, and in a positive definite matrix one is the largest entry.
        self.norm = values.iter().fold(0.0_f64, |most, v| v.max(most)) * scale;
        // SAFETY: frames are waited for, the buffer is known to self alone, and self is borrowed exclusively.
        let mut upload = unsafe { Upload::<f64>::new(&self.device, &self.values) }?;
        for (value, &entry) in upload.host().iter_mut().zip(&self.sources) {
            *value = if entry == NOTHING { 0.0 } else { values[entry as usize] * scale };
        }
        upload.finish()
    }

    /// Whether `device` can, and would do better than the host.
    pub fn fits(device: &Device) -> bool {
        device.traits().f64 && device.is_apart()
    }
}

/// Workgroups for so many elements.
fn groups(elements: u32) -> u32 {
    elements.div_ceil(GROUP * ROWS)
}

/// Starts of rows, columns and stored entries of the chunks of a matrix, its rows and columns in their places. Padding is of
/// the row after the last, which stays zero.
fn chunks(matrix: &SymmetricCsr, places: &Places<'_>) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let pattern = matrix.full_pattern();
    let mut row_at = vec![NOTHING; places.n];
    (0..matrix.n() as u32).for_each(|row| row_at[(places.of)(row) as usize] = row);
    let (mut starts, mut columns, mut sources) = (vec![0], Vec::new(), Vec::new());
    for row in row_at {
        if row != NOTHING {
            let entries = pattern.starts[row as usize] as usize..pattern.starts[row as usize + 1] as usize;
            columns.extend(pattern.columns[entries.clone()].iter().map(|&column| (places.of)(column)));
            sources.extend_from_slice(&pattern.source[entries]);
            columns.resize(columns.len().next_multiple_of(CHUNK), places.n as u32);
            sources.resize(columns.len(), NOTHING);
        }
        starts.push((columns.len() / CHUNK) as u32);
    }
    (starts, columns, sources)
}

impl Core for Refined {
    type Outer = f64;
    type Inner = f32;
    const PAIRS: u32 = 2;
    const MOST: u32 = MOST_PAIRS;
    /// Residuals of later pairs must stay in the range of f32.
    const COMFORTABLE: Range<f64> = 1.0 / 65_536.0..65_536.0;

    fn tables(&self) -> &Tables<f32> {
        &self.tables
    }

    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        self.tables.factorise(values)?;
        Ok(self.renew(values)?)
    }

    fn list(&self, plan: &mut Plan, b: &Arc<Buffer>, x: &Arc<Buffer>, planes: usize, pairs: Range<u32>) {
        let rows = self.tables.rows() as u32;
        let (elements, norms) = (rows * planes as u32, self.norms.buffer());
        for pair in pairs {
            let slot = NORMS as u32 * pair;
            if pair == 0 {
                plan.clear(norms);
                plan.barrier();
                let slots = [b, &self.r, norms].map(Buffer::all);
                plan.dispatch(&self.narrow, &slots, &[elements, slot + 3], groups(elements));
                plan.barrier();
                plan.phase(|| "narrow".into());
            }
            self.tables.sweep(plan, &self.r, &self.step, planes);
            let slots = [&self.step, x, norms].map(Buffer::all);
            let push = [elements, slot, u32::from(pair == 0)];
            plan.dispatch(&self.advance, &slots, &push, groups(elements));
            plan.barrier();
            plan.phase(|| "advance".into());
            let slots = [&self.starts, &self.columns, &self.values, x, b, &self.r, norms].map(Buffer::all);
            plan.dispatch(&self.residual[planes - 1], &slots, &[rows, slot + 2], groups(rows));
            plan.barrier();
            plan.phase(|| "residual".into());
        }
        self.norms.download(plan);
    }

    fn clear(&self, plan: &mut Plan) {
        self.tables.clear(plan);
        plan.clear(&self.r);
        plan.clear(&self.step);
    }

    fn enough(&mut self, pairs: u32) -> bool {
        let norm = self.norm;
        let norms = self.norms.host();
        let of = |pair: u32, kind: usize| f64::from(f32::from_bits(norms[NORMS * pair as usize + kind]));
        let [step, solution, residual] = [0, 1, 2].map(|kind| of(pairs - 1, kind));
        let before = of(pairs - 2, 0);
        // Written so that zeros and what is not a number end it, too: nothing is to be gained there.
        !(residual > ENOUGH * (norm * solution + of(0, 3)) || step * step > SMALL * solution * before)
    }

    fn extra_bytes(&self) -> (u64, u64) {
        let matrix = [&self.starts, &self.columns, &self.values].iter().map(|b| b.bytes()).sum::<u64>();
        (matrix + self.r.bytes() + self.step.bytes(), matrix)
    }
}
