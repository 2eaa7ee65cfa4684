//! Frames on the CPU, around any backend's handles.

use super::differential::DifferentialCoordinates;
use super::placement::Placement;
use super::prediction::Prediction;
use super::{TransferError, TransferProblem};
use crate::backend::{
    Backend, Footprint, FrameStep, FrameTrace, Phase, PrepareOptions, Solved, TransferFrame,
};
use crate::columns::Columns;
use crate::error::SolveError;
use crate::laplacian::Weights;
use crate::mesh::TriangleMesh;
use crate::poisson::Poisson;

/// Columns of step 5: coordinates.
const SPACE: usize = 3;

/// Frames of the past that a guess is made of.
const DEPTH: usize = 6;

/// Whole frames: owns both prepared systems and all buffers; a frame allocates nothing.
pub struct Transfer {
    differential: DifferentialCoordinates,
    poisson: Poisson,
    /// Step 5 before the translation, n x 3; the initial guess of the next frame.
    solution: Vec<f64>,
    prediction: Option<Prediction<f64>>,
    placement: Placement,
}

impl Transfer {
    /// Everything in one: [`TransferProblem::new`] with plain weights for correspondences (template triangle, target
    /// triangle), and [`prepare`](Self::prepare). Then call [`TransferFrame::frame`] for every pose of the template.
    ///
    /// # Errors
    /// [`TransferError`] naming the pair, or with what the backend says.
    pub fn new(
        backend: &dyn Backend,
        template: &TriangleMesh,
        target: TriangleMesh,
        pairs: &[(u32, u32)],
    ) -> Result<Self, TransferError> {
        let problem = TransferProblem::new(template, target, pairs, Weights::Plain)?;
        Self::prepare(backend, &problem, &mut |_| {})
    }

    /// Prepares both systems on `backend`. The elimination order of the Poisson system is used for the harmonic one, too,
    /// which lacks a few more rows; so it is computed once.
    ///
    /// # Errors
    /// [`TransferError::Prepare`] with what the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &TransferProblem,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, TransferError> {
        let (matrix, positions) = (problem.laplacian.matrix().clone(), problem.target.positions());
        let poisson =
            Poisson::prepare(backend, matrix, Some(positions), &PrepareOptions::columns(SPACE), on)?;
        let order = poisson.vertex_order();
        let differential = DifferentialCoordinates::prepare(backend, problem, order.as_deref(), on)?;
        let solution = vec![0.0; SPACE * positions.len()];
        let placement = Placement::new(problem);
        Ok(Self { differential, poisson, solution, prediction: None, placement })
    }

    /// For backends that iterate: both solves of a frame start from the combination of past frames whose right-hand sides
    /// come nearest (eight fields, six poses), not from the last frame alone. `tolerance` is the relative residual that
    /// the backend stops at.
    #[must_use]
    pub fn predicting(mut self, tolerance: f64) -> Self {
        let n = self.solution.len() / SPACE;
        self.differential.predict(tolerance);
        self.prediction = Some(Prediction::new(n, n, SPACE, DEPTH, tolerance));
        self
    }

    /// The problem that was prepared.
    pub fn problem(&self) -> &TransferProblem {
        self.differential.problem()
    }

    /// The end of step 5: one translation per marked component, then what follows or stays.
    fn place(&mut self, target: &mut [[f64; 3]]) {
        let solved = self.solution.as_chunks::<SPACE>().0;
        let (differential, team) = self.differential.with_team();
        let problem = differential.problem;
        self.placement.update(problem, differential.poses, |v| solved[v]);
        let placement = &self.placement;
        team.for_each_run(target, 1, |vertices, target| {
            placement.apply(problem, vertices.start, solved[vertices].iter().copied(), target);
        });
        let anchor = |piece: usize| problem.pieces.detached()[piece].anchor as usize;
        Placement::follow(problem, |piece| differential.quaternions[anchor(piece)], target);
    }
}

impl TransferFrame for Transfer {
    fn frame(&mut self, template: &[[f64; 3]], target: &mut [[f64; 3]]) -> Result<Solved, SolveError> {
        self.observed_frame(template, target, &mut |_| {})
    }

    fn observed_frame(
        &mut self,
        template: &[[f64; 3]],
        target: &mut [[f64; 3]],
        on: &mut dyn FnMut(FrameStep),
    ) -> Result<Solved, SolveError> {
        let n = self.solution.len() / SPACE;
        assert_eq!(target.len(), n, "target: one position per vertex");
        let field = self.differential.observed(template, on)?;
        on(FrameStep::Positions);
        if let Some(prediction) = &mut self.prediction {
            let (rhs, team) = self.differential.rhs_with_team();
            prediction.guess(team, rhs, &mut self.solution);
        }
        let rhs = Columns::new(self.differential.trace().rhs, n, SPACE);
        let space = self.poisson.solve(rhs, Columns::new(&mut self.solution, n, SPACE))?;
        if let Some(prediction) = &mut self.prediction {
            prediction.remember(self.differential.rhs_with_team().1, &self.solution);
        }
        on(FrameStep::Placement);
        self.place(target);
        Ok(worse(field, space))
    }

    fn trace(&mut self) -> Option<FrameTrace<'_>> {
        Some(self.differential.trace())
    }

    fn replaced(&self) -> usize {
        self.differential.replaced()
    }

    fn footprint(&self) -> Footprint {
        let (a, b) = (self.differential.footprint(), self.poisson.footprint());
        let sum = |x: Option<u64>, y: Option<u64>| Some(x? + y?);
        let past = self.prediction.as_ref().map_or(0, Prediction::bytes);
        let own = (8 * self.solution.len() + past) as u64;
        Footprint {
            host_bytes: sum(a.host_bytes, b.host_bytes).map(|bytes| bytes + own),
            device_bytes: sum(a.device_bytes, b.device_bytes),
            factor_nonzeros: sum(a.factor_nonzeros, b.factor_nonzeros),
            factor_bytes: sum(a.factor_bytes, b.factor_bytes),
            bytes_per_solve: sum(a.bytes_per_solve, b.bytes_per_solve),
            factor_flops: sum(a.factor_flops, b.factor_flops),
            dispatches: sum(a.dispatches, b.dispatches),
            ordering: b.ordering,
        }
    }
}

/// The larger claims of two solves, and the device time of both.
fn worse(a: Solved, b: Solved) -> Solved {
    let residual = match (a.residual, b.residual) {
        (Some(x), Some(y)) => Some(x.max(y)),
        (x, y) => x.or(y),
    };
    let device_ns = match (a.device_ns, b.device_ns) {
        (Some(x), Some(y)) => Some(x + y),
        _ => None,
    };
    Solved { iterations: a.iterations.max(b.iterations), residual, device_ns }
}
