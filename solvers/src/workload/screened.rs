//! `screened`: (M + t L) u = M f, smoothing by an implicit step of heat flow; t makes the ladder of conditioning.
//!
//! t = tau mean(M_ii) / mean(L_ii), so that tau means the same on every mesh: 1e-4 is nearly the mass matrix alone, 1e6
//! nearly the singular Laplacian. M is the lumped Voronoi mass.

use super::vertex_system::VertexSystem;
use crate::columns::Columns;
use crate::mesh::TriangleMesh;
use crate::sparse::SymmetricCsr;
use crate::system::SystemError;

/// tau where nothing else is asked.
pub const DEFAULT_TAU: f64 = 1.0;

/// M + t L over the vertices that have a mass, t as above. Cost: one pass over L.
///
/// # Errors
/// [`SystemError`] where the sum is not acceptable.
///
/// # Panics
/// If the shapes do not fit.
pub fn system(
    mesh: &TriangleMesh,
    laplacian: &SymmetricCsr,
    mass: &[f64],
    tau: f64,
) -> Result<VertexSystem, SystemError> {
    assert_eq!(
        (laplacian.n(), mass.len()),
        (mesh.positions().len(), mesh.positions().len()),
        "one row per vertex"
    );
    let stiffness: f64 = (0..laplacian.n()).map(|i| laplacian.diagonal(i)).sum();
    let t = tau * mass.iter().sum::<f64>() / stiffness; // the numbers of vertices cancel
    let mut matrix = laplacian.clone();
    matrix.values_mut().iter_mut().for_each(|v| *v *= t);
    matrix.add_diagonal(mass);
    VertexSystem::new(matrix, mesh.positions())
}

/// M f on the rows of `system`; `f` is n x k over all vertices.
pub fn right_hand_side(system: &VertexSystem, mass: &[f64], f: Columns<&[f64]>) -> Vec<f64> {
    let k = f.k();
    let mut b = system.gather(f);
    for (row, &v) in b.chunks_mut(k).zip(system.vertices()) {
        row.iter_mut().for_each(|x| *x *= mass[v as usize]);
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laplacian::{Laplacian, Weights};
    use crate::mass::{Mass, lumped};

    #[test]
    fn weights_mass_against_stiffness_and_leaves_unused_vertices_out() {
        let corners = vec![[0.0; 3], [9.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mesh =
            TriangleMesh::new(corners, vec![[0, 3, 2], [0, 2, 4], [2, 3, 4], [0, 4, 3]]).expect("valid");
        let (l, mass) =
            (Laplacian::assemble(&mesh, Weights::Plain).into_matrix(), lumped(&mesh, Mass::Voronoi));
        for tau in [1e-4, 1.0, 1e6] {
            let system = system(&mesh, &l, &mass, tau).expect("definite");
            assert_eq!(system.vertices(), [0, 2, 3, 4]);
            let a = system.system().matrix();
            let trace: f64 = (0..4).map(|i| a.diagonal(i)).sum();
            let area: f64 = mass.iter().sum();
            assert!(
                (trace / (area * (1.0 + tau)) - 1.0).abs() < 1e-14,
                "the trace of t L is tau times that of M"
            );
            // Constants solve it: (M + t L) 1 = M 1.
            let ones = vec![1.0; 5];
            let b = right_hand_side(&system, &mass, Columns::new(&ones, 5, 1));
            let mut product = vec![0.0; 4];
            a.multiply(Columns::new(&ones[..4], 4, 1), Columns::new(&mut product, 4, 1));
            assert!(
                product.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-15 * (1.0 + tau)),
                "{product:?} {b:?}"
            );
            assert_eq!(system.scatter(Columns::new(&ones[..4], 4, 1)), [1.0, 0.0, 1.0, 1.0, 1.0]);
        }
    }
}
