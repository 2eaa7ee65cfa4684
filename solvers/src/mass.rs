//! Lumped mass matrices: the share of the surface that belongs to each vertex.

use crate::mesh::TriangleMesh;
use crate::triangle::{Shape, shape};

/// How a triangle's area is shared among its corners. libigl's `massmatrix` takes Voronoi for triangles by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mass {
    /// A third each.
    Barycentric,
    /// The part nearer to the corner than to the others; in an obtuse triangle half for the obtuse corner and a quarter
    /// for the others (Meyer, Desbrun, Schröder and Barr 2003).
    Voronoi,
}

/// Diagonal of the lumped mass matrix M, in squared file units; sums to the area of the mesh. Zero-area triangles give nothing,
/// so a vertex outside of all others has mass 0.
///
/// Serial, one pass: about 60 flops per triangle. Overflows to infinity where the area itself does (edges beyond 1e154).
pub fn lumped(mesh: &TriangleMesh, kind: Mass) -> Vec<f64> {
    let positions = mesh.positions();
    let mut mass = vec![0.0; positions.len()];
    for &triangle in mesh.triangles() {
        let Some(shape) = shape(triangle.map(|v| positions[v as usize])) else { continue };
        for (&v, share) in triangle.iter().zip(shares(&shape, kind)) {
            mass[v as usize] += share;
        }
    }
    mass
}

/// Area belonging to each corner.
fn shares(shape: &Shape, kind: Mass) -> [f64; 3] {
    let area = 0.5 * shape.double_area;
    match kind {
        Mass::Barycentric => [area / 3.0; 3],
        Mass::Voronoi => {
            let cot = shape.half_cotangents.map(|half| 2.0 * half);
            if let Some(obtuse) = (0..3).find(|&c| cot[c] < 0.0) {
                let mut shares = [0.25 * area; 3];
                shares[obtuse] = 0.5 * area;
                return shares;
            }
            // |e_c|^2 cot c / 8 lies along the edge opposite to corner c; with |e_c|^2 = 2 area (cot a + cot b) of the
            // other two corners it needs no lengths.
            let along: [f64; 3] =
                std::array::from_fn(|c| 0.25 * area * (cot[(c + 1) % 3] + cot[(c + 2) % 3]) * cot[c]);
            [along[1] + along[2], along[2] + along[0], along[0] + along[1]]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(scale: f64) {
        let positions = vec![
            [0.0, 0.0, 0.0],
            [3.0 * scale, 0.0, 0.0],
            [scale, scale, 0.0],
            [0.0, -2.0 * scale, scale],
            [9.0 * scale, 9.0 * scale, 9.0 * scale],
        ];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [0, 3, 1], [0, 1, 1]]).expect("valid");
        let area = 0.5 * (3.0 + 3.0 * 5f64.sqrt());
        for kind in [Mass::Barycentric, Mass::Voronoi] {
            let mass = lumped(&mesh, kind);
            let total: f64 = mass.iter().map(|m| m / scale / scale).sum();
            assert!((total / area - 1.0).abs() < 1e-14, "{kind:?}: {total} {area}");
            assert_eq!(mass[4], 0.0);
        }
    }

    #[test]
    fn sums_to_the_area_at_any_scale() {
        for scale in [1.0, 1e8, 1e-8, 1e100, 1e-100, 1e150, 1e-150] {
            sums(scale);
        }
    }

    #[test]
    fn voronoi_shares() {
        let shares = |p, kind| shares(&shape(p).expect("has an area"), kind);
        let acute = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 3f64.sqrt(), 0.0]];
        let third = 3f64.sqrt() / 3.0;
        assert!(shares(acute, Mass::Voronoi).iter().all(|s| (s - third).abs() < 1e-15));
        let right = shares([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], Mass::Voronoi);
        assert_eq!(right, [1.0, 0.5, 0.5]);
        let obtuse = shares([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.0, 1.0, 0.0]], Mass::Voronoi);
        assert_eq!(obtuse, [0.5, 0.25, 0.25]);
    }
}
