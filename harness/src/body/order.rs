//! Vertex order of a scan: neighbours in space lie near each other in memory.

use crate::vector::Vector;
use rayon::prelude::*;

/// Renumbers vertices along a Morton curve through their bounding cube and sorts triangles by their smallest vertex,
/// which becomes their first corner.
pub(super) fn along_morton_curve(
    positions: &[Vector],
    triangles: &[[u32; 3]],
) -> (Vec<Vector>, Vec<[u32; 3]>) {
    let low: Vector = std::array::from_fn(|i| positions.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min));
    let mut order: Vec<(u64, u32)> =
        positions.iter().zip(0..).map(|(&p, v)| (code(std::array::from_fn(|i| p[i] - low[i])), v)).collect();
    order.par_sort_unstable();
    let mut number = vec![0; positions.len()];
    for (&(_, v), k) in order.iter().zip(0..) {
        number[v as usize] = k;
    }
    let mut triangles: Vec<[u32; 3]> =
        triangles.iter().map(|t| smallest_first(t.map(|v| number[v as usize]))).collect();
    triangles.par_sort_unstable();
    (order.iter().map(|&(_, v)| positions[v as usize]).collect(), triangles)
}

/// Interleaved bits of the coordinates (metres from the lowest corner) in steps of 1/8192 m; a body is below 4 m.
fn code(p: Vector) -> u64 {
    let [x, y, z] = p.map(|x| (x * 8192.0) as u64);
    (0..16).fold(0, |code, bit| {
        let at = |v: u64, place: u32| (v >> bit & 1) << (3 * bit + place);
        code | at(x, 0) | at(y, 1) | at(z, 2)
    })
}

fn smallest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
