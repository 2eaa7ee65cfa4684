//! Frames of `animate transfer`: the transfer, and on request stiffening and the volume on top of it.

use super::keep_volume::{KeepVolume, Kept, Wanted};
use super::stiff::Stiffening;
use crate::vector::Vector;
use anyhow::Context;
use lapsolve::backend::{Backend, PrepareOptions, TransferFrame};
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::transfer::{self, TransferProblem};

/// What comes on top of every transferred frame.
#[derive(Clone, Copy, Debug)]
pub struct Extras {
    /// Iterations of ARAP.
    pub arap: u32,
    /// Whose volume the frames keep, if any.
    pub volume: Option<Wanted>,
    /// Threads of what the backend does not do.
    pub threads: usize,
}

/// Prepared frames.
pub struct Frames {
    transfer: Box<dyn TransferFrame>,
    stiffening: Option<Stiffening>,
    volume: Option<KeepVolume>,
}

impl Frames {
    /// Prepares `problem` on `backend`, for poses of `template`.
    ///
    /// # Errors
    /// What the backend says; an open surface whose volume is to be kept.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &TransferProblem,
        template: &TriangleMesh,
        extras: Extras,
    ) -> anyhow::Result<Self> {
        let keep = |wanted| KeepVolume::prepare(backend, wanted, template, problem, extras.threads);
        let volume = extras.volume.map(keep).transpose().context("--keep-volume")?; // before the costly part
        let transfer = transfer::prepare(backend, problem, &PrepareOptions::columns(3), &mut |_| {})?;
        let stiffening = match extras.arap {
            0 => None,
            iterations => Some(Stiffening::prepare(backend, problem, iterations).context("--arap")?),
        };
        Ok(Self { transfer, stiffening, volume })
    }

    /// From positions of the template to positions of the target.
    ///
    /// # Errors
    /// What the backend says; a volume that cannot be kept.
    pub fn frame(&mut self, template: &[Vector], target: &mut [Vector]) -> anyhow::Result<()> {
        self.transfer.frame(template, target)?;
        if let Some(stiffening) = &mut self.stiffening {
            stiffening.apply(target)?;
        }
        if let Some(volume) = &mut self.volume {
            let trace =
                self.transfer.trace().context("--keep-volume: the backend keeps its rotations to itself")?;
            volume.apply(template, trace.field, target).context("--keep-volume")?;
        }
        Ok(())
    }

    /// Rotations that were replaced in the last frame.
    pub fn replaced(&self) -> usize {
        self.transfer.replaced()
    }

    /// What keeping the volume took in the last frame.
    pub fn kept(&self) -> Option<Kept> {
        self.volume.as_ref().map(KeepVolume::last)
    }
}
