//! Frames of `transfer`, made stiffer on request: iterations of ARAP spread the stretch at joints over their surroundings.
//!
//! ARAP starts from the transferred pose, holds the marked vertices where
//! they are and lets all others move until every neighbourhood is as close to a rotated piece of the rest pose as it can be.

use crate::vector::Vector;
use anyhow::Context;
use lapsolve::backend::{Backend, PrepareOptions, TransferFrame};
use lapsolve::laplacian::Weights;
use lapsolve::workload::arap::{Arap, ArapProblem};
use lapsolve::workload::transfer::{self, TransferProblem};

/// Prepared frames.
pub struct Frames {
    transfer: Box<dyn TransferFrame>,
    stiffening: Option<Stiffening>,
}

struct Stiffening {
    arap: Arap,
    iterations: u32,
    handles: Vec<Vector>,
}

impl Frames {
    /// Prepares `problem` on `backend`, with `iterations` of ARAP on top of every frame.
    ///
    /// # Errors
    /// What the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &TransferProblem,
        iterations: u32,
    ) -> anyhow::Result<Self> {
        let transfer = transfer::prepare(backend, problem, &PrepareOptions::columns(3), &mut |_| {})?;
        let stiffening = match iterations {
            0 => None,
            _ => Some(Stiffening::prepare(backend, problem, iterations).context("--arap")?),
        };
        Ok(Self { transfer, stiffening })
    }

    /// From positions of the template to positions of the target.
    ///
    /// # Errors
    /// What the backend says.
    pub fn frame(&mut self, template: &[Vector], target: &mut [Vector]) -> anyhow::Result<()> {
        self.transfer.frame(template, target)?;
        match &mut self.stiffening {
            Some(stiffening) => stiffening.apply(target),
            None => Ok(()),
        }
    }

    /// Rotations that were replaced in the last frame.
    pub fn replaced(&mut self) -> usize {
        self.transfer.trace().map_or(0, |trace| trace.replaced)
    }
}

impl Stiffening {
    fn prepare(backend: &dyn Backend, problem: &TransferProblem, iterations: u32) -> anyhow::Result<Self> {
        // Parts without a mark have moved rigidly already: all their vertices stay.
        let loose = problem.pieces().detached().iter().flat_map(|piece| piece.vertices.iter().copied());
        let handles: Vec<u32> = problem.marks().vertices().iter().copied().chain(loose).collect();
        // Where a weight is negative an iteration may raise the energy.
        let arap = ArapProblem::new(problem.target(), &handles, Weights::ClampedPerEdge)?;
        let handles = vec![[0.0; 3]; arap.handles().len()];
        Ok(Self { arap: Arap::prepare(backend, &arap, &mut |_| {})?, iterations, handles })
    }

    fn apply(&mut self, target: &mut [Vector]) -> anyhow::Result<()> {
        let Self { arap, iterations, handles } = self;
        let held = arap.problem().handles();
        handles.iter_mut().zip(held).for_each(|(handle, &v)| *handle = target[v as usize]);
        arap.resume(handles, target)?;
        arap.iterate(*iterations)?;
        arap.write(target);
        Ok(())
    }
}
