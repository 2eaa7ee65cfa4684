//! `transfer`: a moving template drives a target mesh (VA section 4).

use crate::mesh::TriangleMesh;

/// Everything a `transfer` preparation needs.
#[derive(Clone, Debug)]
pub struct TransferProblem {
    /// The mesh that is to move.
    pub target: TriangleMesh,
    /// The template in its reference pose.
    pub template: TriangleMesh,
    /// Corresponding triangles: (template triangle, target triangle), 0-based.
    pub marks: Vec<(u32, u32)>,
}
