//! The fragments of the target mesh: a rotation for every triangle (step 3) and their differential coordinates (step 4).
//!
//! U_i = sum over triangles t at i of R_t c, with c = sum over the two edges (i, j) of t of w_ij^t (x_i - x_j) known before
//! the first frame. U is gathered vertex by vertex: every number is written once, by one thread, in a fixed order, so
//! the result has the same bits for any number of threads.
//!
//! Bytes per frame and vertex of a closed surface (2 triangles, 6 corners each): 32 read and 32 written for the
//! normalised quaternion, 24 + 64 for the triangles, 28 x 6 + 24 for the gather, 6 x 32 of them again from cache: 340,
//! 50 MB at 150K vertices, of which 25 MB (edges and indices of corners) do not fit in the second-level cache.
//! Flops: about 20 per vertex, 25 per triangle, 30 per corner.

use super::marks::LEAST_NORM;
use crate::incidence::Incidence;
use crate::isa::{Features, Isa, Kernel};
use crate::laplacian::Laplacian;
use crate::rotation::{Quaternion, dot4};
use crate::vector::{Vector, scale, sub};
use std::ops::Range;

/// Triangles, and for every vertex the edges of its corners.
#[derive(Clone, Debug)]
pub struct Fragments {
    isa: Isa,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Start of every vertex' corners; n + 1.
    pub(crate) starts: Vec<u32>,
    /// Triangle of every corner, vertex after vertex.
    pub(crate) corner_triangles: Vec<u32>,
    /// c of every corner, in the same order.
    pub(crate) corner_edges: Vec<Vector>,
}

impl Fragments {
    /// Prepares the fragments of the triangles that `laplacian` was assembled from, with its corner weights, so that
    /// rotations of nothing give U = L x. `positions` is the reference pose.
    pub fn new(laplacian: &Laplacian, positions: &[[f64; 3]]) -> Self {
        let incidence: &Incidence = laplacian.incidence();
        let edges = |&corner: &u32| {
            let (t, c) = (corner as usize / 3, corner as usize % 3);
            let (triangle, weights) = (laplacian.triangles()[t], laplacian.corner_weights()[t]);
            let [at, next, last] = [c, (c + 1) % 3, (c + 2) % 3].map(|c| positions[triangle[c] as usize]);
            // The weight of the edge to the next corner is that of the angle at the last one, and the reverse.
            let to_next = scale(weights[(c + 2) % 3], sub(at, next));
            let to_last = scale(weights[(c + 1) % 3], sub(at, last));
            crate::vector::add(to_next, to_last)
        };
        Self {
            isa: Isa::best(),
            triangles: laplacian.triangles().to_vec(),
            starts: incidence.starts().to_vec(),
            corner_triangles: incidence.corners().iter().map(|corner| corner / 3).collect(),
            corner_edges: incidence.corners().iter().map(edges).collect(),
        }
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        12 * self.triangles.len() + 4 * self.starts.len() + 28 * self.corner_edges.len()
    }

    /// Normalises the field (rows w, x, y, z) at vertices `range` into `quaternions` (theirs alone); where the norm is below
    /// [`LEAST_NORM`] the quaternion becomes zero for the caller to replace. Returns how many are.
    pub fn normalise(&self, field: &[f64], range: Range<usize>, quaternions: &mut [Quaternion]) -> usize {
        self.isa.run(Normalise { field: field[4 * range.start..4 * range.end].as_chunks().0, quaternions })
    }

    /// Step 3 for triangles `range`: `turns` (theirs alone) from the unit quaternions at all vertices.
    pub fn turn(&self, quaternions: &[Quaternion], range: Range<usize>, turns: &mut [Turn]) {
        self.isa.run(TurnTriangles { triangles: &self.triangles[range], quaternions, turns });
    }

    /// Step 4 for vertices `range`: their rows of U (theirs alone, 3 numbers each) from all turns.
    pub fn gather(&self, turns: &[Turn], range: Range<usize>, rhs: &mut [f64]) {
        let first = self.starts[range.start] as usize;
        let last = self.starts[range.end] as usize;
        self.isa.run(Gather {
            starts: &self.starts[range.start..=range.end],
            triangles: &self.corner_triangles[first..last],
            edges: &self.corner_edges[first..last],
            turns,
            rhs: rhs.as_chunks_mut().0,
        });
    }
}

/// A rotation, stored so that applying it costs the least: sqrt(2) x a unit quaternion (w, u), for which
/// R c = c + w (u x c) + u x (u x c).
pub type Turn = [f64; 4];

struct Normalise<'a> {
    field: &'a [[f64; 4]],
    quaternions: &'a mut [Quaternion],
}

impl Kernel for Normalise<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<F: Features>(self) -> usize {
        let mut vanished = 0;
        for (out, &q) in self.quaternions.iter_mut().zip(self.field) {
            let squared = dot4(q, q);
            // Written as "not >=" so that a NaN counts as vanished, too.
            let usable = squared >= LEAST_NORM * LEAST_NORM;
            let inverse = if usable { 1.0 / squared.sqrt() } else { 0.0 };
            *out = if usable { q.map(|x| x * inverse) } else { [0.0; 4] };
            vanished += usize::from(!usable);
        }
        vanished
    }
}

struct TurnTriangles<'a> {
    triangles: &'a [[u32; 3]],
    quaternions: &'a [Quaternion],
    turns: &'a mut [Turn],
}

impl Kernel for TurnTriangles<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (turn, triangle) in self.turns.iter_mut().zip(self.triangles) {
            let [a, b, c] = triangle.map(|v| self.quaternions[v as usize]);
            let sum: [f64; 4] = std::array::from_fn(|i| (a[i] + b[i]) + c[i]);
            let squared = dot4(sum, sum);
            // Opposite rotations in one triangle: their mean says nothing, the first counts.
            let (mean, squared) = if squared >= LEAST_NORM * LEAST_NORM { (sum, squared) } else { (a, 1.0) };
            let factor = (2.0 / squared).sqrt();
            *turn = mean.map(|x| x * factor);
        }
    }
}

struct Gather<'a> {
    /// Of the vertices at hand and one more.
    starts: &'a [u32],
    triangles: &'a [u32],
    edges: &'a [Vector],
    turns: &'a [Turn],
    rhs: &'a mut [[f64; 3]],
}

impl Kernel for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let base = self.starts[0];
        for (row, bounds) in self.rhs.iter_mut().zip(self.starts.windows(2)) {
            let range = (bounds[0] - base) as usize..(bounds[1] - base) as usize;
            let mut sum = [0.0; 3];
            for (&t, &c) in self.triangles[range.clone()].iter().zip(&self.edges[range]) {
                let [w, x, y, z] = self.turns[t as usize];
                let s = cross_lanes([x, y, z], c);
                let r = cross_lanes([x, y, z], s);
                for i in 0..3 {
                    sum[i] += c[i] + (w * s[i] + r[i]);
                }
            }
            *row = sum;
        }
    }
}

/// a x b.
#[inline(always)]
fn cross_lanes(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Columns;
    use crate::laplacian::Weights;
    use crate::mesh::TriangleMesh;
    use crate::rotation::{IDENTITY, about_axis, normalised, product, rotate};

    fn sheet() -> TriangleMesh {
        let positions = (0..35u32)
            .map(|v| (f64::from(v % 7), f64::from(v / 7)))
            .map(|(x, y)| [x, y, (x * 0.9).sin() * (y * 1.7).cos()])
            .collect();
        let quad = |x: u32, y: u32| 7 * y + x;
        let triangles = (0..24)
            .map(|i| (i % 6, i / 6))
            .flat_map(|(x, y)| {
                [
                    [quad(x, y), quad(x + 1, y), quad(x, y + 1)],
                    [quad(x + 1, y), quad(x + 1, y + 1), quad(x, y + 1)],
                ]
            })
            .collect();
        TriangleMesh::new(positions, triangles).expect("valid")
    }

    fn right_hand_side(fragments: &Fragments, quaternions: &[Quaternion]) -> Vec<f64> {
        let mut turns = vec![[0.0; 4]; fragments.triangles()];
        fragments.turn(quaternions, 0..fragments.triangles(), &mut turns);
        let mut rhs = vec![0.0; 3 * quaternions.len()];
        fragments.gather(&turns, 0..quaternions.len(), &mut rhs);
        rhs
    }

    #[test]
    fn rotating_everything_alike_gives_l_times_the_rotated_positions() {
        let mesh = sheet();
        for weights in [Weights::Plain, Weights::ClampedPerCorner] {
            let l = Laplacian::assemble(&mesh, weights);
            let fragments = Fragments::new(&l, mesh.positions());
            for q in [IDENTITY, product(about_axis(0, 1.0), about_axis(2, -2.5))] {
                let rhs = right_hand_side(&fragments, &[q; 35]);
                let x: Vec<f64> = mesh.positions().iter().flat_map(|&p| rotate(q, p)).collect();
                let mut expected = vec![0.0; x.len()];
                l.matrix().multiply(Columns::new(&x, 35, 3), Columns::new(&mut expected, 35, 3));
                for (a, b) in rhs.iter().zip(&expected) {
                    assert!((a - b).abs() < 1e-13, "{weights:?}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn sums_to_zero_and_follows_the_definition() {
        let mesh = sheet();
        let l = Laplacian::assemble(&mesh, Weights::Plain);
        let fragments = Fragments::new(&l, mesh.positions());
        let quaternions: Vec<Quaternion> = (0..35)
            .map(|v| product(about_axis(0, 0.1 * f64::from(v)), about_axis(1, 0.05 * f64::from(v * v % 40))))
            .collect();
        let rhs = right_hand_side(&fragments, &quaternions);
        for column in 0..3 {
            assert!(rhs.iter().skip(column).step_by(3).sum::<f64>().abs() < 1e-13);
        }
        // w R (x_i - x_j), scattered triangle by triangle as the paper says it.
        let mut expected = vec![0.0; rhs.len()];
        for (t, triangle) in mesh.triangles().iter().enumerate() {
            let sum = triangle.map(|v| quaternions[v as usize]);
            let q = normalised(std::array::from_fn(|i| sum[0][i] + sum[1][i] + sum[2][i]), 0.0)
                .expect("not opposite");
            for c in 0..3 {
                for (to, opposite) in [((c + 1) % 3, (c + 2) % 3), ((c + 2) % 3, (c + 1) % 3)] {
                    let p = |c: usize| mesh.positions()[triangle[c] as usize];
                    let moved = rotate(q, sub(p(c), p(to)));
                    for i in 0..3 {
                        expected[3 * triangle[c] as usize + i] += l.corner_weights()[t][opposite] * moved[i];
                    }
                }
            }
        }
        assert!(rhs.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-13));
    }

    #[test]
    fn ranges_and_instruction_sets_agree_with_the_whole() {
        let mesh = sheet();
        let mut fragments = Fragments::new(&Laplacian::assemble(&mesh, Weights::Plain), mesh.positions());
        let field: Vec<f64> = (0..4 * 35).map(|i| (f64::from(i) * 0.37).sin()).collect();
        let run = |fragments: &Fragments, cut: usize| {
            let (mut q, mut turns, mut rhs) = (vec![[0.0; 4]; 35], vec![[0.0; 4]; 48], vec![0.0; 105]);
            for range in [0..cut, cut..35] {
                assert_eq!(fragments.normalise(&field, range.clone(), &mut q[range]), 0);
            }
            for range in [0..cut, cut..48] {
                fragments.turn(&q, range.clone(), &mut turns[range]);
            }
            for range in [0..cut, cut..35] {
                fragments.gather(&turns, range.clone(), &mut rhs[3 * range.start..3 * range.end]);
            }
            rhs
        };
        let whole = run(&fragments, 0);
        for isa in Isa::available() {
            fragments.isa = isa;
            assert_eq!(run(&fragments, 17), whole, "{}", isa.name());
        }
    }

    #[test]
    fn vanishing_quaternions_are_marked_and_counted() {
        let fragments = Fragments::new(&Laplacian::assemble(&sheet(), Weights::Plain), sheet().positions());
        let field = [1e-4, 0.0, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0, f64::NAN, 0.0, 0.0, 0.0];
        let mut q = [[9.0; 4]; 3];
        assert_eq!(fragments.normalise(&field, 0..3, &mut q), 2);
        assert_eq!(q, [[0.0; 4], [0.0, 0.0, -1.0, 0.0], [0.0; 4]]);
    }
}
