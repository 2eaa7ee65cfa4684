//! The handles of a mesh that comes alone.

use crate::laplacian::{Laplacian, Weights};
use crate::mesh::TriangleMesh;
use crate::workload::harmonic::{Constraints, DEFAULT_CONSTRAINTS};
use crate::workload::twist::{EXTREME_FRAME, Twist};

/// The default constraints of `harmonic` (ascending), and where the extreme frame of the default twist takes them: some fifty
/// handles, turned by up to 60 degrees about the longest axis, at least one in every component.
pub fn handles(mesh: &TriangleMesh) -> (Vec<u32>, Vec<[f64; 3]>) {
    let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
    let vertices = Constraints::sample(mesh, &laplacian, DEFAULT_CONSTRAINTS).default_set();
    let mut pose = mesh.positions().to_vec();
    Twist::of(mesh).frame(EXTREME_FRAME, &mut pose);
    let targets = vertices.iter().map(|&v| pose[v as usize]).collect();
    (vertices, targets)
}
