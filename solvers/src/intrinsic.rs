//! Intrinsic Delaunay triangulation of a triangle mesh, after mollification of its edge lengths.
//!
//! A surface with edge lengths instead of positions can be re-triangulated without changing it: an edge is replaced by the
//! other diagonal of its two triangles, unfolded into the plane, until no pair of opposite angles exceeds 180 degrees
//! (Bobenko and Springborn 2007). The cotangent Laplacian of the result has no negative weight. Mollification first adds
//! the smallest constant to all lengths that makes every triangle clearly non-degenerate (Sharp and Crane 2020).
//!
//! What it costs in accuracy: the added length is at most [`MOLLIFICATION`] x the mean edge for a mesh of zero-area
//! triangles, and zero for a mesh without needles; flips change no length.

use crate::mesh::TriangleMesh;
use crate::range::within_range;
use crate::triangle::shape_from_lengths;
use crate::vector::{norm, sub};
use rayon::prelude::*;

/// Every triangle must satisfy its inequality with this much of the mean edge length to spare: far above rounding
/// (1e-16), far below what a discretisation can resolve.
pub const MOLLIFICATION: f64 = 1e-6;

/// An edge is flipped when its cotangent sum is below -1e-12 of its parts: smaller sums are rounding, and flipping the
/// diagonal of four points on a circle back and forth would never end.
const ROUNDING: f64 = 1e-12;

/// Flips allowed per edge before the search gives up; surfaces need one or two, needles some tens.
const FLIPS_PER_EDGE: usize = 64;

/// An intrinsic triangulation on the vertices of a mesh.
#[derive(Clone, Debug)]
pub struct Intrinsic {
    /// Triangles; after flips two corners may be the same vertex (an edge that runs round).
    pub triangles: Vec<[u32; 3]>,
    /// (cot a) / 2 at every corner.
    pub half_cotangents: Vec<[f64; 3]>,
    /// Length added to every edge, in file units.
    pub added_length: f64,
    /// Number of flips done.
    pub flips: usize,
}

/// No triangle on the other side: a boundary, an edge of three or more triangles, or a seam of clashing orientation.
const NONE: u32 = u32::MAX;

/// Triangles with the length of each side (opposite to corner c) and the corner across it.
struct Surface {
    triangles: Vec<[u32; 3]>,
    lengths: Vec<[f64; 3]>,
    across: Vec<u32>,
}

impl Intrinsic {
    /// Triangulates `mesh`. Triangles that name a vertex twice are left out; all others take part, also those of zero
    /// area. Edges with three or more triangles stay as they are.
    ///
    /// Cost: one parallel sort of the 3 m sides, about 100 ns per side and flip.
    pub fn delaunay(mesh: &TriangleMesh) -> Self {
        let mut triangles: Vec<[u32; 3]> = mesh
            .triangles()
            .iter()
            .copied()
            .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
            .collect();
        orient(&mut triangles);
        let (lengths, added_length) = mollified_lengths(&within_range(mesh.positions()), &triangles);
        let across = glue(&triangles, |a, b| side(&triangles, a).0 == side(&triangles, b).1);
        let mut surface = Surface { triangles, lengths, across };
        let flips = surface.flip_all();
        let half_cotangents =
            surface.lengths.par_iter().map(|&lengths| shape_from_lengths(lengths).half_cotangents).collect();
        Self { triangles: surface.triangles, half_cotangents, added_length, flips }
    }
}

/// First and last vertex of the side opposite to `corner`, in the direction of its triangle.
fn side(triangles: &[[u32; 3]], corner: u32) -> (u32, u32) {
    let (t, c) = (corner as usize / 3, corner as usize % 3);
    (triangles[t][(c + 1) % 3], triangles[t][(c + 2) % 3])
}

/// For every corner the corner across the side opposite to it, where exactly two triangles share that side and
/// `accept` takes the pair.
fn glue(triangles: &[[u32; 3]], accept: impl Fn(u32, u32) -> bool) -> Vec<u32> {
    let mut sides: Vec<(u64, u32)> = (0..3 * triangles.len() as u32)
        .map(|corner| {
            let (a, b) = side(triangles, corner);
            (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), corner)
        })
        .collect();
    sides.par_sort_unstable();
    let mut across = vec![NONE; sides.len()];
    for group in sides.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, a), (_, b)] = *group
            && accept(a, b)
        {
            (across[a as usize], across[b as usize]) = (b, a);
        }
    }
    across
}

/// Turns triangles round until neighbours agree, as far as the surface allows.
fn orient(triangles: &mut [[u32; 3]]) {
    let across = glue(triangles, |_, _| true);
    let mut turned = vec![None; triangles.len()];
    let mut stack = Vec::new();
    for seed in 0..triangles.len() {
        if turned[seed].is_none() {
            turned[seed] = Some(false);
            stack.push(seed);
        }
        while let Some(t) = stack.pop() {
            for corner in 3 * t as u32..3 * t as u32 + 3 {
                let other = across[corner as usize];
                if other == NONE || turned[other as usize / 3].is_some() {
                    continue;
                }
                let same_direction = side(triangles, corner).0 == side(triangles, other).0;
                turned[other as usize / 3] = turned[t].map(|flag| flag ^ same_direction);
                stack.push(other as usize / 3);
            }
        }
    }
    for (triangle, turned) in triangles.iter_mut().zip(turned) {
        if turned == Some(true) {
            triangle.swap(1, 2);
        }
    }
}

/// Side lengths with the smallest constant added that leaves [`MOLLIFICATION`] x the mean length in every triangle
/// inequality; and that constant.
fn mollified_lengths(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> (Vec<[f64; 3]>, f64) {
    let length = |a: u32, b: u32| norm(sub(positions[a as usize], positions[b as usize]));
    let mut lengths: Vec<[f64; 3]> =
        triangles.iter().map(|&[a, b, c]| [length(b, c), length(c, a), length(a, b)]).collect();
    let mean = lengths.as_flattened().iter().sum::<f64>() / (3 * lengths.len()).max(1) as f64;
    // Where all vertices coincide any positive length will do.
    let spare = MOLLIFICATION * if mean > 0.0 { mean } else { 1.0 };
    let missing = |l: &[f64; 3]| {
        let (longest, sum) = (l[0].max(l[1]).max(l[2]), l[0] + l[1] + l[2]);
        spare - (sum - 2.0 * longest)
    };
    let added = lengths.iter().map(missing).fold(0.0, f64::max);
    for length in lengths.as_flattened_mut() {
        *length += added;
    }
    (lengths, added)
}

impl Surface {
    /// Flips until every glued side is Delaunay; returns the number of flips.
    fn flip_all(&mut self) -> usize {
        let mut stack: Vec<u32> = (0..self.across.len() as u32).rev().collect();
        let mut waiting = vec![true; stack.len()];
        let mut flips = 0;
        while let Some(corner) = stack.pop() {
            waiting[corner as usize] = false;
            let other = self.across[corner as usize];
            if other == NONE || other / 3 == corner / 3 || self.is_delaunay(corner, other) {
                continue;
            }
            if flips == FLIPS_PER_EDGE * self.across.len() {
                return flips;
            }
            self.flip(corner, other);
            flips += 1;
            for t in [corner / 3, other / 3] {
                for outer in [3 * t + 1, 3 * t + 2] {
                    if !std::mem::replace(&mut waiting[outer as usize], true) {
                        stack.push(outer);
                    }
                }
            }
        }
        flips
    }

    fn is_delaunay(&self, a: u32, b: u32) -> bool {
        let cotangent = |corner: u32| {
            let (t, c) = (corner as usize / 3, corner as usize % 3);
            shape_from_lengths(self.lengths[t]).half_cotangents[c]
        };
        let (x, y) = (cotangent(a), cotangent(b));
        x + y >= -ROUNDING * (x.abs() + y.abs())
    }

    /// Replaces the side between corners `a` (vertex k, triangle k i j) and `b` (vertex l, triangle l j i) by k l: the new
    /// triangles are i l k and j k l, with the new side opposite to their first corners.
    fn flip(&mut self, a: u32, b: u32) {
        let at = |corner: u32, step: u32| (corner / 3, (corner + step) % 3); // (3 t + c + step) % 3 = (c + step) % 3
        let corner_of = |(t, c): (u32, u32)| 3 * t + c;
        let length = |(t, c): (u32, u32)| self.lengths[t as usize][c as usize];
        let vertex = |(t, c): (u32, u32)| self.triangles[t as usize][c as usize];
        let (k, i, j) = (vertex(at(a, 0)), vertex(at(a, 1)), vertex(at(a, 2)));
        let l = vertex(at(b, 0));
        // The four outer sides by their opposite corner before, and after.
        let (jk, ki, il, lj) = (at(a, 1), at(a, 2), at(b, 1), at(b, 2));
        let (first, second) = (a / 3, b / 3);
        let moves = [
            (corner_of(ki), 3 * first + 1),
            (corner_of(il), 3 * first + 2),
            (corner_of(lj), 3 * second + 1),
            (corner_of(jk), 3 * second + 2),
        ];
        let diagonal = other_diagonal(length(at(a, 0)), [length(jk), length(ki)], [length(il), length(lj)]);
        let (l_ki, l_il, l_lj, l_jk) = (length(ki), length(il), length(lj), length(jk));
        let renamed = |corner: u32| moves.iter().find(|m| m.0 == corner).map_or(corner, |m| m.1);
        let partners = moves.map(|(old, _)| self.across[old as usize]);
        self.triangles[first as usize] = [i, l, k];
        self.triangles[second as usize] = [j, k, l];
        self.lengths[first as usize] = [diagonal, l_ki, l_il];
        self.lengths[second as usize] = [diagonal, l_lj, l_jk];
        (self.across[3 * first as usize], self.across[3 * second as usize]) = (3 * second, 3 * first);
        for ((_, new), partner) in moves.into_iter().zip(partners) {
            let partner = if partner == NONE { NONE } else { renamed(partner) };
            self.across[new as usize] = partner;
            if partner != NONE {
                self.across[partner as usize] = new;
            }
        }
    }
}

/// Length of k l for the triangles k i j and l j i unfolded on both sides of i j: `above` = [jk, ki], `below` = [il, lj].
fn other_diagonal(ij: f64, above: [f64; 2], below: [f64; 2]) -> f64 {
    // Apex over the base i = 0, j = ij: distance to i and j known.
    let apex = |to_i: f64, to_j: f64| {
        let x = 0.5 * (ij + (to_i - to_j) * ((to_i + to_j) / ij));
        let height = shape_from_lengths([ij, to_j, to_i]).double_area / ij;
        (x, height)
    };
    let ((xk, hk), (xl, hl)) = (apex(above[1], above[0]), apex(below[0], below[1]));
    (xk - xl).hypot(hk + hl)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laplacian::{Laplacian, Weights};

    #[test]
    fn flips_the_wrong_diagonal_of_a_flat_kite() {
        // The long diagonal 0-1 is opposite to two angles of about 157 degrees.
        let positions = vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, -0.2, 0.0]];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [1, 0, 3]]).expect("valid");
        let intrinsic = Intrinsic::delaunay(&mesh);
        assert_eq!((intrinsic.flips, intrinsic.added_length), (1, 0.0));
        let corners: Vec<_> = intrinsic.triangles.iter().map(|t| t.iter().sum::<u32>()).collect();
        assert_eq!(corners, [5, 6], "triangles 0 2 3 and 1 2 3: {:?}", intrinsic.triangles);
    }

    #[test]
    fn zero_area_and_clashing_orientation_still_give_a_definite_laplacian() {
        // A tetrahedron-like strip with a triangle on a line, and neighbours that disagree about the outside.
        let positions =
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, -1.0, 0.1]];
        let mesh =
            TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3], [1, 2, 3], [0, 1, 4]]).expect("valid");
        let l = Laplacian::assemble(&mesh, Weights::IntrinsicDelaunay);
        assert!(l.matrix().values().iter().all(|v| v.is_finite()));
        for row in 0..5 {
            assert!(l.matrix().diagonal(row) > 0.0);
            assert!(l.matrix().row(row).1[1..].iter().all(|&v| v <= 0.0));
        }
    }
}
