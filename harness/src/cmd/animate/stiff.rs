//! Frames made stiffer: iterations of ARAP spread the stretch at joints over their surroundings.
//!
//! ARAP starts from the transferred pose, holds the marked vertices where
//! they are and lets all others move until every neighbourhood is as close to a rotated piece of the rest pose as it can be.

use crate::vector::Vector;
use lapsolve::backend::Backend;
use lapsolve::laplacian::Weights;
use lapsolve::workload::arap::{Arap, ArapProblem};
use lapsolve::workload::transfer::TransferProblem;

/// ARAP, prepared, with the marked vertices as handles.
pub struct Stiffening {
    arap: Arap,
    iterations: u32,
    handles: Vec<Vector>,
}

impl Stiffening {
    /// Prepares `iterations` for the target of `problem`.
    ///
    /// # Errors
    /// What the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &TransferProblem,
        iterations: u32,
    ) -> anyhow::Result<Self> {
        // Parts without a mark have moved rigidly already: all their vertices stay.
        let loose = problem.pieces().detached().iter().flat_map(|piece| piece.vertices.iter().copied());
        let handles: Vec<u32> = problem.marks().vertices().iter().copied().chain(loose).collect();
        // Where a weight is negative an iteration may raise the energy.
        let arap = ArapProblem::new(problem.target(), &handles, Weights::ClampedPerEdge)?;
        let handles = vec![[0.0; 3]; arap.handles().len()];
        Ok(Self { arap: Arap::prepare(backend, &arap, &mut |_| {})?, iterations, handles })
    }

    /// Iterates from the transferred pose in `target`.
    ///
    /// # Errors
    /// What the backend says.
    pub fn apply(&mut self, target: &mut [Vector]) -> anyhow::Result<()> {
        let Self { arap, iterations, handles } = self;
        let held = arap.problem().handles();
        handles.iter_mut().zip(held).for_each(|(handle, &v)| *handle = target[v as usize]);
        arap.resume(handles, target)?;
        arap.iterate(*iterations)?;
        arap.write(target);
        Ok(())
    }
}
