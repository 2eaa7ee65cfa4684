//! The right-hand side of a harmonic field on the device: b = -L_FC g, of which only the rows next to a constraint are not
//! zero. Only g goes up.
use super::number::{GROUP, Number};
use crate::backends::vulkan::buffer::{Buffer, Place, Upload, constant};
use crate::backends::vulkan::device::Device;
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::plan::Plan;
use crate::dirichlet::Dirichlet;
use std::marker::PhantomData;
use std::sync::Arc;

/// L_FC on the device, row by row.
pub struct Coupling<T> {
    device: Arc<Device>,
    /// By planes of four columns.
    kernels: [Arc<Kernel>; 2],
    /// Vertex of every row, start of its entries, constraint of every entry.
    rows: Arc<Buffer>,
    starts: Arc<Buffer>,
    constraints: Arc<Buffer>,
    /// The weight of every entry.
    weights: Arc<Buffer>,
    /// The stored entry of L that it comes from.
    sources: Vec<u32>,
    /// Rows.
    count: u32,
    number: PhantomData<fn() -> T>,
}

impl<T: Number> Coupling<T> {
    /// For the constraints of `problem`; weights follow with [`update`](Self::update).
    ///
    /// # Errors
    /// Where memory does not suffice or the driver refuses.
    pub fn new(device: &Arc<Device>, problem: &Dirichlet) -> Result<Self, DeviceError> {
        let (mut rows, mut starts) = (Vec::new(), vec![0_u32]);
        for group in problem.coupling().chunk_by(|a, b| a.0 == b.0) {
            rows.push(problem.free()[group[0].0 as usize]);
            starts.push(starts.last().expect("not empty") + group.len() as u32);
        }
        let constraints: Vec<u32> = problem.coupling().iter().map(|entry| entry.1).collect();
        let kernel = |planes| Kernel::new(device, &T::COUPLE, &[GROUP, planes]);
        Ok(Self {
            kernels: [kernel(1)?, kernel(2)?],
            count: rows.len() as u32,
            rows: constant(device, &rows)?,
            starts: constant(device, &starts)?,
            weights: Buffer::new(device, Place::Device, (constraints.len() * size_of::<T>()) as u64)?,
            constraints: constant(device, &constraints)?,
            sources: problem.coupling().iter().map(|entry| entry.2).collect(),
            device: Arc::clone(device),
            number: PhantomData,
        })
    }

    /// Takes the weights from the stored values of L, times `scale`: that of the factor, so that solutions need none.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn update(&mut self, values: &[f64], scale: f64) -> Result<(), DeviceError> {
        // SAFETY: frames are waited for, the buffer is known to self alone, and self is borrowed exclusively.
        let mut upload = unsafe { Upload::<T>::new(&self.device, &self.weights) }?;
        for (weight, &entry) in upload.host().iter_mut().zip(&self.sources) {
            *weight = T::from_f64(values[entry as usize] * scale);
        }
        upload.finish()
    }

    /// Lists the step from `g` (one element per constraint and plane) to the rows of `rhs` next to them.
    pub fn list(&self, plan: &mut Plan, g: &Arc<Buffer>, rhs: &Arc<Buffer>, planes: usize) {
        let slots = [&self.rows, &self.starts, &self.constraints, &self.weights, g, rhs];
        let groups = self.count.div_ceil(GROUP);
        plan.dispatch(&self.kernels[planes - 1], &slots.map(Buffer::all), &[self.count], groups);
        plan.barrier();
        plan.phase(|| "couple".into());
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        [&self.rows, &self.starts, &self.constraints, &self.weights].iter().map(|b| b.bytes()).sum()
    }
}
