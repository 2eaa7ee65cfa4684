//! Lumped mass matrices: the share of the surface that belongs to each vertex.

use crate::laplacian::{range_exponent, within_range};
use crate::mesh::TriangleMesh;
use crate::triangle::shape;
use crate::vector::{dot, sub};

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
/// Serial, one pass: about 60 flops per triangle. May overflow to infinity or underflow to 0 for coordinates beyond
/// 1e+-150, as the area itself does.
pub fn lumped(mesh: &TriangleMesh, kind: Mass) -> Vec<f64> {
    let positions = within_range(mesh.positions());
    let mut mass = vec![0.0; positions.len()];
    for &triangle in mesh.triangles() {
        let shares = shares(triangle.map(|v| positions[v as usize]), kind);
        for (&v, share) in triangle.iter().zip(shares) {
            mass[v as usize] += share;
        }
    }
    let exponent = range_exponent(mesh.positions());
    if exponent != 0 {
        let back = 2f64.powi(-exponent / 2); // in four factors: 2^(-2 exponent) may overflow by itself
        let rest = 2f64.powi(-exponent - -exponent / 2);
        mass.iter_mut().for_each(|m| *m = *m * back * back * rest * rest);
    }
    mass
}

/// Area belonging to each corner.
fn shares(p: [[f64; 3]; 3], kind: Mass) -> [f64; 3] {
    let shape = shape(p);
    let area = 0.5 * shape.double_area;
    match kind {
        Mass::Barycentric => [area / 3.0; 3],
        Mass::Voronoi => {
            let half = shape.half_cotangents;
            if let Some(obtuse) = (0..3).find(|&c| half[c] < 0.0) {
                let mut shares = [0.25 * area; 3];
                shares[obtuse] = 0.5 * area;
                return shares;
            }
            // (|e_b|^2 cot b + |e_c|^2 cot c) / 8, e_c opposite to corner c.
            let part: [f64; 3] = std::array::from_fn(|c| {
                let edge = sub(p[(c + 1) % 3], p[(c + 2) % 3]);
                0.25 * dot(edge, edge) * half[c]
            });
            [part[1] + part[2], part[2] + part[0], part[0] + part[1]]
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
        let acute = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 3f64.sqrt(), 0.0]];
        let third = 3f64.sqrt() / 3.0;
        assert!(shares(acute, Mass::Voronoi).iter().all(|s| (s - third).abs() < 1e-15));
        let right = shares([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], Mass::Voronoi);
        assert_eq!(right, [1.0, 0.5, 0.5]);
        let obtuse = shares([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.0, 1.0, 0.0]], Mass::Voronoi);
        assert_eq!(obtuse, [0.5, 0.25, 0.25]);
    }
}
