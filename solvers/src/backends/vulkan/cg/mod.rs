//! Conjugate gradients on a device: `vulkan-cg-jacobi`, `vulkan-cg-fsai` and `vulkan-cg-multigrid`.
//!
//! A whole batch of iterations is one command buffer. Its scalars stay on the device; a column that has reached its limit
//! is frozen there, so that the rest of the batch changes nothing. The host looks between batches only, and computes the
//! true residual in f64 at the end; where that is too large (f32 devices, rounding) it starts the device on the remainder.
//!
//! | file | what |
//! |---|---|
//! | `kernels.rs` | the compiled kernels and how each is dispatched |
//! | `sparse.rs` | a sparse matrix on the device |
//! | `precondition.rs`, `cycle.rs` | Jacobi and FSAI, the multigrid V-cycle |
//! | `iteration.rs` | the recorded command buffers and the vectors they work on |
//! | `factor.rs` | the handle: outer refinement on the host |
//!
//! Numbers on the device are f64 where its shaders have them, else f32. Four columns at a time, one vector register per row.

mod cycle;
mod factor;
mod iteration;
mod kernels;
mod precondition;
mod sparse;
#[cfg(test)]
mod tests;

use super::{Device, Settings};
use crate::backend::{Backend, Description, Factor, Phase, PrepareOptions};
use crate::backends::cg::operator::{FullCsr, Operator};
use crate::backends::cg::workers::Workers;
use crate::error::{PrepareError, Unavailable};
use crate::registry::OpenOptions;
use crate::system::System;
use factor::CgOnDevice;
use precondition::Method;
use std::sync::Arc;

/// Conjugate gradients with one of the preconditioners.
struct VulkanCg {
    device: Arc<Device>,
    method: Method,
    tolerance: f64,
    threads: usize,
}

/// Opens `vulkan-cg-jacobi`.
///
/// # Errors
/// What is missing: loader, driver, device.
pub fn open_jacobi(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Jacobi)
}

/// Opens `vulkan-cg-fsai`.
///
/// # Errors
/// What is missing: loader, driver, device.
pub fn open_fsai(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Fsai)
}

/// Opens `vulkan-cg-multigrid`.
///
/// # Errors
/// What is missing: loader, driver, device.
pub fn open_multigrid(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    open(options, Method::Multigrid)
}

fn open(options: &OpenOptions<'_>, method: Method) -> Result<Box<dyn Backend>, Unavailable> {
    let device = Device::open(options.device, &Settings::default())?;
    Ok(Box::new(VulkanCg { device, method, tolerance: options.tolerance, threads: options.threads }))
}

impl Backend for VulkanCg {
    fn describe(&self) -> Description {
        self.device.describe(self.threads)
    }

    fn prepare(
        &self,
        system: &System,
        _: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Order);
        let mut workers = Workers::new(self.threads)?;
        let matrix = FullCsr::new(&mut workers, system.matrix());
        let row = |&row: &u32| system.positions().map(|points| points[row as usize]);
        let points = matrix.rows().iter().map(row).collect();
        let Self { device, method, tolerance, .. } = self;
        if device.traits().f64 {
            Ok(Box::new(CgOnDevice::<f64>::new(device, workers, matrix, points, *method, *tolerance, on)?))
        } else {
            Ok(Box::new(CgOnDevice::<f32>::new(device, workers, matrix, points, *method, *tolerance, on)?))
        }
    }
}
