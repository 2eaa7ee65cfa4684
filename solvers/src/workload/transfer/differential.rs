//! Steps 1 to 4: from a pose of the template to the differential coordinates U of the fragmented target.

use super::fragments::{Fragments, Turn};
use super::marks::MarkPose;
use super::posing::Posing;
use super::prediction::Prediction;
use super::{TransferError, TransferProblem};
use crate::backend::{Backend, Footprint, FrameStep, FrameTrace, Harmonic, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};
use crate::rotation::Quaternion;
use crate::team::Team;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Columns of the harmonic field: the components of a quaternion.
const FIELD: usize = 4;

/// Frames of the past that a guess is made of: fields are smooth, so f32 will do for them, at half the memory.
const DEPTH: usize = 8;

/// The first half of a frame: a prepared harmonic system and all buffers up to U.
pub struct DifferentialCoordinates {
    problem: TransferProblem,
    harmonic: Box<dyn Harmonic>,
    fragments: Fragments,
    team: Team,
    posing: Posing,
    /// Step 2 as solved, n x 4; the initial guess of the next frame.
    field: Vec<f64>,
    quaternions: Vec<Quaternion>,
    turns: Vec<Turn>,
    /// U, n x 3.
    rhs: Vec<f64>,
    prediction: Option<Prediction<f32>>,
    /// Vertices in no system: their field is 0 for good.
    outside: usize,
    replaced: usize,
}

/// What a pose leaves for the placement of the solution.
pub(super) struct Posed<'a> {
    pub(super) problem: &'a TransferProblem,
    pub(super) poses: &'a [MarkPose],
    pub(super) quaternions: &'a [Quaternion],
}

impl DifferentialCoordinates {
    /// Prepares the harmonic system on `backend`; `order` is an elimination order in vertex numbering, if one is known. What
    /// is done here runs on as many threads as the backend's solves.
    ///
    /// # Errors
    /// [`TransferError::Prepare`] with what the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &TransferProblem,
        order: Option<&[u32]>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, TransferError> {
        let order = order.map(|order| problem.harmonic.restrict_order(order));
        let options = PrepareOptions { max_columns: FIELD, order: order.as_deref() };
        let harmonic = backend.prepare_harmonic(&problem.harmonic, &options, on)?;
        let team = Team::new(backend.describe().threads.max(1)).map_err(no_threads)?;
        let fragments = Fragments::new(&problem.laplacian, problem.target.positions());
        let n = problem.target.positions().len();
        Ok(Self {
            posing: Posing::new(&problem.marks),
            field: vec![0.0; FIELD * n],
            quaternions: vec![Quaternion::default(); n],
            turns: vec![Turn::default(); fragments.triangles()],
            rhs: vec![0.0; 3 * n],
            prediction: None,
            outside: problem.pieces.outside(),
            replaced: 0,
            problem: problem.clone(),
            harmonic,
            fragments,
            team,
        })
    }

    /// From now on every field starts from a combination of the last ones, which have relative residuals of `tolerance`.
    pub(super) fn predict(&mut self, tolerance: f64) {
        let (rows, n) = (self.posing.values.len() / FIELD, self.quaternions.len());
        self.prediction = Some(Prediction::new(rows, n, FIELD, DEPTH, tolerance));
    }

    /// Computes U for the template positions `template`; it is in [`trace`](Self::trace) then. No allocation.
    ///
    /// # Errors
    /// As [`Harmonic::solve`]; [`SolveError::NonFinite`] with the template vertex for a pose that is not finite.
    ///
    /// # Panics
    /// If the number of template vertices differs.
    pub fn compute(&mut self, template: &[[f64; 3]]) -> Result<Solved, SolveError> {
        self.observed(template, &mut |_| {})
    }

    /// As [`compute`](Self::compute), announcing its steps.
    pub(super) fn observed(
        &mut self,
        template: &[[f64; 3]],
        on: &mut dyn FnMut(FrameStep),
    ) -> Result<Solved, SolveError> {
        on(FrameStep::Marks);
        self.replaced = self.posing.pose(&self.problem.marks, &mut self.team, template)?;
        on(FrameStep::Field);
        let (n, rows) = (self.quaternions.len(), self.posing.values.len() / FIELD);
        if let Some(prediction) = &mut self.prediction {
            prediction.guess(&mut self.team, &self.posing.values, &mut self.field);
        }
        let values = Columns::new(&self.posing.values[..], rows, FIELD);
        let solved = self.harmonic.solve(values, Columns::new(&mut self.field, n, FIELD))?;
        if let Some(prediction) = &mut self.prediction {
            prediction.remember(&mut self.team, &self.field);
        }
        on(FrameStep::Fragments);
        self.break_apart();
        Ok(solved)
    }

    /// The problem that was prepared.
    pub fn problem(&self) -> &TransferProblem {
        &self.problem
    }

    /// What the marks do in the last pose.
    pub fn poses(&self) -> &[MarkPose] {
        &self.posing.poses
    }

    /// Unit quaternions at the vertices in the last pose; zero outside of the marked components.
    pub fn quaternions(&self) -> &[Quaternion] {
        &self.quaternions
    }

    /// What the last pose left, with the team free for work of the caller.
    pub(super) fn with_team(&mut self) -> (Posed<'_>, &mut Team) {
        let Self { problem, posing, quaternions, team, .. } = self;
        (Posed { problem, poses: &posing.poses, quaternions }, team)
    }

    /// U of the last pose, with the team free for work of the caller.
    pub(super) fn rhs_with_team(&mut self) -> (&[f64], &mut Team) {
        (&self.rhs, &mut self.team)
    }

    /// Constraint values, field and U of the last pose.
    pub fn trace(&self) -> FrameTrace<'_> {
        FrameTrace { constraints: &self.posing.values, field: &self.field, rhs: &self.rhs }
    }

    /// As [`TransferFrame::replaced`](crate::backend::TransferFrame::replaced).
    pub fn replaced(&self) -> usize {
        self.replaced
    }

    /// What the harmonic handle holds, buffers included.
    pub fn footprint(&self) -> Footprint {
        let numbers = self.posing.values.len()
            + self.field.len()
            + self.rhs.len()
            + 4 * (self.quaternions.len() + self.turns.len());
        let past = self.prediction.as_ref().map_or(0, Prediction::bytes);
        let buffers = (8 * numbers + self.fragments.bytes() + past) as u64;
        let harmonic = self.harmonic.footprint();
        Footprint { host_bytes: harmonic.host_bytes.map(|bytes| bytes + buffers), ..harmonic }
    }

    /// The end of step 2, and steps 3 and 4: from the field to U.
    fn break_apart(&mut self) {
        let (fragments, field, vanished) = (&self.fragments, &self.field, AtomicUsize::new(0));
        self.team.for_each_run(&mut self.quaternions, 1, |vertices, quaternions| {
            vanished.fetch_add(fragments.normalise(field, vertices, quaternions), Ordering::Relaxed);
        });
        if vanished.into_inner() > self.outside {
            self.replace_vanished();
        }
        let (fragments, quaternions) = (&self.fragments, &self.quaternions);
        self.team.for_each_run(&mut self.turns, 1, |triangles, turns| {
            fragments.turn(quaternions, triangles, turns);
        });
        let turns = &self.turns;
        self.team.for_each_run(&mut self.rhs, 3, |vertices, rhs| fragments.gather(turns, vertices, rhs));
    }

    /// Gives vertices whose quaternion vanished that of the nearest mark. Vertices in no system have no field and keep a zero.
    fn replace_vanished(&mut self) {
        for v in 0..self.quaternions.len() {
            if self.quaternions[v] == [0.0; 4] && !self.problem.laplacian.incidence().at(v).is_empty() {
                let nearest = self.problem.marks.nearest(self.problem.target.positions()[v]);
                self.quaternions[v] = self.posing.poses[nearest].rotation;
                self.replaced += 1;
            }
        }
    }
}

/// The system refuses a thread.
fn no_threads(error: std::io::Error) -> PrepareError {
    PrepareError::Unsupported { what: format!("threads that the system refuses ({error})") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::registry::{OpenOptions, find};
    use crate::workload::transfer::defaults::default_problem;

    #[test]
    fn vanished_quaternions_become_those_of_the_nearest_mark_and_are_counted() {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [9.0; 3]];
        let mesh =
            TriangleMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("valid");
        let backend = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
        let problem = default_problem(&mesh).expect("usable");
        let mut half = DifferentialCoordinates::prepare(&*backend, &problem, None, &mut |_| {})
            .expect("positive definite");
        half.posing.pose(&problem.marks, &mut half.team, mesh.positions()).expect("finite");
        for (m, pose) in half.posing.poses.iter_mut().enumerate() {
            pose.rotation = [0.0, 0.0, m as f64, 1.0]; // recognisable, no rotation
        }
        half.field = vec![1e-4; 20];
        half.field[16..].fill(0.0); // the unused vertex
        half.break_apart();
        assert_eq!(half.replaced, 4);
        for v in 0..4 {
            let nearest = problem.marks().nearest(mesh.positions()[v]) as f64;
            assert_eq!(half.quaternions[v], [0.0, 0.0, nearest, 1.0]);
        }
        assert_eq!(half.quaternions[4], [0.0; 4]);
    }
}
