//! Preconditioners on the device: what each adds to a plan.

use super::super::{Buffer, Device, Plan};
use super::cycle::Cycle;
use super::kernels::{Kernels, Number, Product};
use super::sparse::{Sparse, weights};
use crate::backends::cg::fsai::{Fsai, Pattern};
use crate::backends::cg::operator::Csr;
use crate::backends::cg::preconditioner::Budget;
use crate::backends::cg::workers::Workers;
use crate::error::PrepareError;
use crate::vector::Vector;
use std::sync::Arc;

/// Which preconditioner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Method {
    /// The diagonal.
    Jacobi,
    /// G^T G, eight entries per row.
    Fsai,
    /// A V-cycle on the hierarchy of `cg-multigrid` (without positions: of `cg-amg`).
    Multigrid,
}

impl Method {
    /// When to give up.
    pub(super) fn budget(self) -> Budget {
        match self {
            Self::Jacobi | Self::Fsai => Budget::SIMPLE,
            Self::Multigrid => Budget::MULTILEVEL,
        }
    }

    /// Iterations of a command buffer: some milliseconds of work, so that the host hardly matters, and not much more than
    /// a solve needs.
    pub(super) fn batch(self) -> u32 {
        match self {
            Self::Jacobi => 32,
            Self::Fsai => 16,
            Self::Multigrid => 4,
        }
    }
}

/// A preconditioner on the device.
pub(super) enum Preconditioner {
    Jacobi { inverse: Arc<Buffer>, rows: u32 },
    Fsai { g: Sparse, transposed: Sparse, middle: Arc<Buffer> },
    Multigrid(Cycle),
}

impl Preconditioner {
    /// Builds it on the host and uploads it.
    pub(super) fn new<T: Number>(
        device: &Arc<Device>,
        workers: &mut Workers,
        a: Csr<'_>,
        points: Option<&[Vector]>,
        method: Method,
    ) -> Result<Self, PrepareError> {
        let rows = a.n() as u32;
        Ok(match method {
            Method::Jacobi => {
                let inverse = weights::<T>(device, a.diagonal().into_iter().map(|d| 1.0 / d))?;
                Self::Jacobi { inverse, rows }
            }
            Method::Fsai => {
                let (g, transposed) = Fsai::new(workers, a, Pattern::Width(8), 1)?.into_factors();
                Self::Fsai {
                    g: Sparse::of_rows::<T, f64>(device, &g)?,
                    transposed: Sparse::of_rows::<T, f64>(device, &transposed)?,
                    middle: vector::<T>(device, rows)?,
                }
            }
            Method::Multigrid => Self::Multigrid(Cycle::new::<T>(device, workers, a, points)?),
        })
    }

    /// z = M^-1 r.
    pub(super) fn apply(&self, plan: &mut Plan, kernels: &Kernels, r: &Arc<Buffer>, z: &Arc<Buffer>) {
        match self {
            Self::Jacobi { inverse, rows } => kernels.scale(plan, *rows, inverse, r, z),
            Self::Fsai { g, transposed, middle } => {
                kernels.sparse(plan, Product::Plain, g, r, middle);
                kernels.sparse(plan, Product::Plain, transposed, middle, z);
            }
            Self::Multigrid(cycle) => cycle.apply(plan, kernels, r, z),
        }
    }

    /// Entries stored.
    pub(super) fn entries(&self) -> usize {
        match self {
            Self::Jacobi { rows, .. } => *rows as usize,
            Self::Fsai { g, transposed, .. } => g.entries + transposed.entries,
            Self::Multigrid(cycle) => cycle.entries(),
        }
    }
}

/// A vector of `rows` rows of four columns.
pub(super) fn vector<T: Number>(
    device: &Arc<Device>,
    rows: u32,
) -> Result<Arc<Buffer>, super::super::DeviceError> {
    Buffer::new(device, super::super::Place::Device, u64::from(rows) * 4 * size_of::<T>() as u64)
}
