//! Step 1 of a frame with its buffers: what the marks do in a pose, and the values at the constrained vertices.

use super::marks::{MarkPose, Marks};
use crate::error::SolveError;
use crate::team::Team;

/// Marks that are worth waking the other threads for: some 50 us of work for one.
const MANY: usize = 256;

/// What the last pose gave.
#[derive(Clone, Debug)]
pub(crate) struct Posing {
    /// One per mark.
    pub(crate) poses: Vec<MarkPose>,
    /// Quaternions at the constrained vertices, |C| x 4: the input of step 2.
    pub(crate) values: Vec<f64>,
}

impl Posing {
    /// Room for `marks`.
    pub(crate) fn new(marks: &Marks) -> Self {
        Self {
            poses: vec![MarkPose::default(); marks.all().len()],
            values: vec![0.0; 4 * marks.vertices().len()],
        }
    }

    /// Takes the pose of the template; returns how many rotations were replaced, of marks and of constrained vertices.
    ///
    /// # Errors
    /// [`SolveError::NonFinite`] with the template vertex.
    ///
    /// # Panics
    /// If the number of template vertices differs.
    pub(crate) fn pose(
        &mut self,
        marks: &Marks,
        team: &mut Team,
        template: &[[f64; 3]],
    ) -> Result<usize, SolveError> {
        let collapsed = if self.poses.len() < MANY {
            marks.pose(template, &mut self.poses)?
        } else {
            assert_eq!(template.len(), marks.template_vertices(), "template: one position per vertex");
            team.for_each_run(&mut self.poses, 1, |range, poses| marks.turn(template, range, poses));
            marks.agree(template, &mut self.poses)?
        };
        Ok(collapsed + marks.constraint_values(&self.poses, &mut self.values))
    }
}
