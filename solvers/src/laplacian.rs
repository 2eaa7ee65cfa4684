//! The cotangent Laplacian of a triangle mesh, assembled in parallel and re-assembled on its pattern.
//!
//! L_ij = -(cot a + cot b) / 2 with a and b the angles opposite to edge ij in its triangles, L_ii = -sum_j L_ij:
//! **positive** semi-definite (libigl's `cotmatrix` is -L). Its kernel is the constants on every component.
//!
//! A triangle of zero area ([`ZERO_AREA`](crate::triangle::ZERO_AREA)) contributes nothing, not even to the pattern; a
//! vertex on no other triangle has an empty row (a stored zero on the diagonal). Edges with one, two or more triangles are
//! all taken: every triangle adds the cotangent opposite to the edge.

use crate::incidence::Incidence;
use crate::intrinsic::Intrinsic;
use crate::mesh::TriangleMesh;
use crate::sparse::SymmetricCsr;
use crate::triangle::shape;
use rayon::prelude::*;
use thiserror::Error;

/// How angles become weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Weights {
    /// Cotangents as they are; an edge opposite to large angles has a negative weight.
    #[default]
    Plain,
    /// Negative cotangents count as zero. Components stay connected: a triangle has at most one obtuse angle, so two of its
    /// edges keep a positive share.
    ClampedPerCorner,
    /// Negative edge weights (cot a + cot b) / 2 count as zero. Components stay connected: the plain weights over any cut
    /// sum to x'Lx > 0 for the indicator x of one side, so one of them is positive.
    ClampedPerEdge,
    /// Cotangents of the intrinsic Delaunay triangulation of mollified edge lengths ([`crate::intrinsic`]), without negative
    /// weights: at edges with at most two triangles by construction (but for rounding), at non-manifold ones by
    /// clamping per edge. Takes zero-area triangles too. The pattern is not the mesh's.
    IntrinsicDelaunay,
}

/// L with everything needed to compute its values again for other positions.
#[derive(Clone, Debug)]
pub struct Laplacian {
    matrix: SymmetricCsr,
    weights: Weights,
    zero_area: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    half_cotangents: Vec<[f64; 3]>,
    incidence: Incidence,
    opposite: Opposite,
}

/// For every off-diagonal entry, in the order of storage, the corners opposite to its edge, ascending.
#[derive(Clone, Debug, Default)]
struct Opposite {
    /// Start of each entry's corners; one more than off-diagonal entries.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

/// Why new positions do not fit the pattern.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum UpdateError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NonFinite {
        /// 0-based vertex.
        vertex: usize,
    },
    /// A triangle that had zero area at assembly, and so is not in the pattern, has one now.
    #[error("triangle {triangle} had zero area when the Laplacian was assembled; assemble it anew")]
    Opened {
        /// 0-based triangle.
        triangle: u32,
    },
    /// The triangulation itself follows the positions.
    #[error("the pattern of an intrinsic Delaunay Laplacian follows the positions; assemble it anew")]
    Intrinsic,
}

impl Laplacian {
    /// Assembles L of `mesh`.
    ///
    /// Cost: about 60 flops per triangle, one counting sort of the corners, one sort of about three neighbours per vertex; no hashing.
    /// Runs on the current rayon pool; the result has the same bits for any number of threads.
    pub fn assemble(mesh: &TriangleMesh, weights: Weights) -> Self {
        if weights == Weights::IntrinsicDelaunay {
            let intrinsic = Intrinsic::delaunay(mesh);
            let incidence = Incidence::new(mesh.positions().len(), &intrinsic.triangles);
            return Self::from_parts(
                weights,
                intrinsic.triangles,
                intrinsic.half_cotangents,
                Vec::new(),
                incidence,
            );
        }
        let triangles = mesh.triangles();
        let positions = mesh.positions();
        let mut half_cotangents = vec![[0.0; 3]; triangles.len()];
        let (mut incidence, zero_area) = rayon::join(
            || Incidence::new(positions.len(), triangles),
            || measure(positions, triangles, weights, &mut half_cotangents),
        );
        if !zero_area.is_empty() {
            incidence.retain(|t| zero_area.binary_search(&(t as u32)).is_err());
        }
        Self::from_parts(weights, triangles.to_vec(), half_cotangents, zero_area, incidence)
    }

    fn from_parts(
        weights: Weights,
        triangles: Vec<[u32; 3]>,
        half_cotangents: Vec<[f64; 3]>,
        zero_area: Vec<u32>,
        incidence: Incidence,
    ) -> Self {
        let (row_starts, columns, opposite) = pattern(&triangles, &incidence);
        let values = vec![0.0; columns.len()];
        let matrix = SymmetricCsr::from_sorted(row_starts, columns, values);
        let mut laplacian =
            Self { matrix, weights, zero_area, triangles, half_cotangents, incidence, opposite };
        laplacian.fill();
        laplacian
    }

    /// The values for other positions of the same vertices, on the same pattern, in place. Triangles that lose their area
    /// contribute nothing from now on. No allocation of its own unless some do.
    ///
    /// # Errors
    /// [`UpdateError`]; the old values are then still in place.
    ///
    /// # Panics
    /// If the number of positions differs.
    pub fn update(&mut self, positions: &[[f64; 3]]) -> Result<(), UpdateError> {
        assert_eq!(positions.len(), self.matrix.n(), "positions: one per vertex");
        if self.weights == Weights::IntrinsicDelaunay {
            return Err(UpdateError::Intrinsic);
        }
        if let Some(vertex) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(UpdateError::NonFinite { vertex });
        }
        let opened = |t: &&u32| shape(corners(positions, self.triangles[**t as usize])).is_some();
        if let Some(&triangle) = self.zero_area.iter().find(opened) {
            return Err(UpdateError::Opened { triangle });
        }
        measure(positions, &self.triangles, self.weights, &mut self.half_cotangents);
        self.fill();
        Ok(())
    }

    /// The matrix L, n x n over all vertices.
    pub fn matrix(&self) -> &SymmetricCsr {
        &self.matrix
    }

    /// The matrix alone; the pattern's bookkeeping is dropped.
    pub fn into_matrix(self) -> SymmetricCsr {
        self.matrix
    }

    /// How angles became weights.
    pub fn weights(&self) -> Weights {
        self.weights
    }

    /// Triangles that had zero area at assembly, ascending: they are in no pattern.
    pub fn zero_area(&self) -> &[u32] {
        &self.zero_area
    }

    /// The share of every triangle in the weights of its edges: `[t][c]` belongs to the edge opposite to corner c, with the
    /// clamping per corner done. Zero where the triangle has zero area. (Triangles of the intrinsic triangulation with
    /// [`Weights::IntrinsicDelaunay`].)
    pub fn corner_weights(&self) -> &[[f64; 3]] {
        &self.half_cotangents
    }

    /// The triangles that were assembled: the mesh's, or those of the intrinsic triangulation.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The corners of the contributing triangles at every vertex.
    pub fn incidence(&self) -> &Incidence {
        &self.incidence
    }

    /// Values from half cotangents: off-diagonals gather their opposite corners, diagonals the corners around them.
    fn fill(&mut self) {
        let (starts, columns, values) = self.matrix.parts_mut();
        let half = self.half_cotangents.as_flattened();
        let rows = Rows { starts, half, opposite: &self.opposite, incidence: &self.incidence };
        rows.fill(0, rows.starts.len() - 1, values);
        if matches!(self.weights, Weights::ClampedPerEdge | Weights::IntrinsicDelaunay) {
            clamp_edges(starts, columns, values);
        }
    }
}

#[inline(always)]
fn corners(positions: &[[f64; 3]], triangle: [u32; 3]) -> [[f64; 3]; 3] {
    triangle.map(|v| positions[v as usize])
}

/// Half cotangents of all triangles; returns those of zero area, ascending.
fn measure(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    weights: Weights,
    out: &mut [[f64; 3]],
) -> Vec<u32> {
    const CHUNK: usize = 4096; // triangles: 100 KB of results, some 60 us of work
    let clamp = weights == Weights::ClampedPerCorner;
    let any_zero = out
        .par_chunks_mut(CHUNK)
        .zip(triangles.par_chunks(CHUNK))
        .map(|(out, triangles)| {
            let mut any_zero = false;
            for (half, &triangle) in out.iter_mut().zip(triangles) {
                let shape = shape(corners(positions, triangle));
                any_zero |= shape.is_none();
                *half = shape.map_or([0.0; 3], |s| s.half_cotangents);
                if clamp {
                    *half = half.map(|h| h.max(0.0));
                }
            }
            any_zero
        })
        .reduce(|| false, |a, b| a | b);
    if !any_zero {
        return Vec::new();
    }
    let is_zero = |t: &u32| shape(corners(positions, triangles[*t as usize])).is_none();
    (0..triangles.len() as u32).filter(is_zero).collect()
}

/// Row starts, columns and opposite corners of L: for every vertex the neighbours of higher index, sorted.
fn pattern(triangles: &[[u32; 3]], incidence: &Incidence) -> (Vec<u32>, Vec<u32>, Opposite) {
    const CHUNK: usize = 4096; // vertices: some 200 us of work
    let n = incidence.vertices();
    let chunks: Vec<PatternChunk> = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| PatternChunk::new(c * CHUNK..n.min((c + 1) * CHUNK), triangles, incidence))
        .collect();
    let total = |length: fn(&PatternChunk) -> usize| chunks.iter().map(length).sum::<usize>();
    let mut row_starts = Vec::with_capacity(n + 1);
    let mut columns = Vec::with_capacity(total(|c| c.columns.len()));
    let mut opposite = Opposite {
        starts: Vec::with_capacity(total(|c| c.opposite_ends.len()) + 1),
        corners: Vec::with_capacity(total(|c| c.opposite_corners.len())),
    };
    row_starts.push(0);
    opposite.starts.push(0);
    for chunk in &chunks {
        let (entries, corners) = (columns.len() as u32, opposite.corners.len() as u32);
        row_starts.extend(chunk.row_ends.iter().map(|end| entries + end));
        opposite.starts.extend(chunk.opposite_ends.iter().map(|end| corners + end));
        columns.extend_from_slice(&chunk.columns);
        opposite.corners.extend_from_slice(&chunk.opposite_corners);
    }
    (row_starts, columns, opposite)
}

/// The pattern of a range of rows, counted from its own beginning.
#[derive(Default)]
struct PatternChunk {
    row_ends: Vec<u32>,
    columns: Vec<u32>,
    opposite_ends: Vec<u32>,
    opposite_corners: Vec<u32>,
}

impl PatternChunk {
    fn new(rows: std::ops::Range<usize>, triangles: &[[u32; 3]], incidence: &Incidence) -> Self {
        let mut chunk = Self::default();
        chunk.row_ends.reserve(rows.len());
        chunk.columns.reserve(4 * rows.len()); // a closed surface has three upper neighbours per vertex
        chunk.opposite_ends.reserve(3 * rows.len());
        chunk.opposite_corners.reserve(6 * rows.len());
        let mut neighbours: Vec<u64> = Vec::new();
        for row in rows {
            chunk.columns.push(row as u32);
            neighbours.clear();
            for &corner in incidence.at(row) {
                let (t, c) = (corner / 3, corner % 3);
                let triangle = triangles[t as usize];
                let (next, last) = ((c + 1) % 3, (c + 2) % 3);
                for (to, across) in [(next, last), (last, next)] {
                    let neighbour = triangle[to as usize];
                    if neighbour as usize > row {
                        neighbours.push(u64::from(neighbour) << 32 | u64::from(3 * t + across));
                    }
                }
            }
            neighbours.sort_unstable(); // by neighbour, then by corner
            chunk.push_row(&neighbours);
        }
        chunk
    }

    fn push_row(&mut self, neighbours: &[u64]) {
        let mut previous = None;
        for &key in neighbours {
            let neighbour = (key >> 32) as u32;
            self.opposite_corners.push(key as u32);
            if previous == Some(neighbour) {
                *self.opposite_ends.last_mut().expect("an entry is open") += 1;
            } else {
                self.columns.push(neighbour);
                self.opposite_ends.push(self.opposite_corners.len() as u32);
                previous = Some(neighbour);
            }
        }
        self.row_ends.push(self.columns.len() as u32);
    }
}

/// What the values of a range of rows are computed from.
struct Rows<'a> {
    starts: &'a [u32],
    half: &'a [f64],
    opposite: &'a Opposite,
    incidence: &'a Incidence,
}

impl Rows<'_> {
    /// Computes the values of rows `from..to` into `values` (theirs alone), splitting the range over the pool. Reads 8 bytes
    /// per corner three times (once as part of an edge, twice around a vertex), writes 8 per entry.
    fn fill(&self, from: usize, to: usize, values: &mut [f64]) {
        const SERIAL: usize = 4096; // rows: some 100 us of work
        if to - from > SERIAL {
            let middle = usize::midpoint(from, to);
            let (low, high) = values.split_at_mut((self.starts[middle] - self.starts[from]) as usize);
            rayon::join(|| self.fill(from, middle, low), || self.fill(middle, to, high));
            return;
        }
        let mut slot = values.iter_mut();
        // Every row stores one diagonal entry, so the off-diagonal entries before row i are i fewer.
        let mut edge = self.starts[from] as usize - from;
        for row in from..to {
            *slot.next().expect("a diagonal entry") = self.diagonal(row);
            for _ in self.starts[row] + 1..self.starts[row + 1] {
                *slot.next().expect("an entry per column") = 0.0 - self.edge_weight(edge); // never -0
                edge += 1;
            }
        }
    }

    #[inline]
    fn edge_weight(&self, edge: usize) -> f64 {
        let range = self.opposite.starts[edge] as usize..self.opposite.starts[edge + 1] as usize;
        self.opposite.corners[range].iter().map(|&corner| self.half[corner as usize]).sum()
    }

    /// Sum of the weights of all edges at `row`, with the rounding errors carried along (Knuth's TwoSum): row sums stay
    /// within a few eps at vertices with thousands of triangles too.
    #[inline]
    fn diagonal(&self, row: usize) -> f64 {
        let (mut sum, mut lost) = (0.0, 0.0);
        for &corner in self.incidence.at(row) {
            let first = corner - corner % 3;
            for other in [(corner + 1 - first) % 3, (corner + 2 - first) % 3] {
                let term = self.half[(first + other) as usize];
                let next = sum + term;
                let back = next - sum;
                lost += (sum - (next - back)) + (term - back);
                sum = next;
            }
        }
        sum + lost
    }
}

/// Sets positive off-diagonal entries to zero and the diagonal to the sum of what is left. Serial.
fn clamp_edges(starts: &[u32], columns: &[u32], values: &mut [f64]) {
    let n = starts.len() - 1;
    for row in 0..n {
        values[starts[row] as usize] = 0.0;
    }
    for row in 0..n {
        for entry in starts[row] as usize + 1..starts[row + 1] as usize {
            let value = values[entry].min(0.0);
            values[entry] = value;
            values[starts[row] as usize] -= value;
            values[starts[columns[entry] as usize] as usize] -= value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Columns;

    /// A w x h grid of unit squares cut along one diagonal, bent by `z`.
    fn sheet(w: u32, h: u32, z: impl Fn(f64, f64) -> f64) -> TriangleMesh {
        let at = |x: u32, y: u32| y * w + x;
        let positions =
            (0..w * h).map(|v| (f64::from(v % w), f64::from(v / w))).map(|(x, y)| [x, y, z(x, y)]).collect();
        let triangles = (0..h - 1)
            .flat_map(|y| (0..w - 1).map(move |x| (x, y)))
            .flat_map(|(x, y)| {
                [[at(x, y), at(x + 1, y), at(x, y + 1)], [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]]
            })
            .collect();
        TriangleMesh::new(positions, triangles).expect("a valid sheet")
    }

    fn bent() -> TriangleMesh {
        sheet(23, 17, |x, y| (x * 0.7).sin() * 2.0 + (y * 1.3).cos())
    }

    /// L by the definition, entry by entry, from angles: atan2 and tan instead of the assembly's quotients.
    fn by_definition(mesh: &TriangleMesh) -> Vec<f64> {
        use crate::vector::{cross, dot, norm, sub};
        let n = mesh.positions().len();
        let mut l = vec![0.0; n * n];
        for &t in mesh.triangles() {
            for c in 0..3 {
                let [at, i, j] = [t[c], t[(c + 1) % 3], t[(c + 2) % 3]].map(|v| v as usize);
                let (u, v) = (
                    sub(mesh.positions()[i], mesh.positions()[at]),
                    sub(mesh.positions()[j], mesh.positions()[at]),
                );
                let half = 0.5 / norm(cross(u, v)).atan2(dot(u, v)).tan();
                for (row, column, sign) in [(i, j, -1.0), (j, i, -1.0), (i, i, 1.0), (j, j, 1.0)] {
                    l[row * n + column] += sign * half;
                }
            }
        }
        l
    }

    #[test]
    fn entries_follow_the_definition() {
        let mesh = bent();
        let (l, n) = (Laplacian::assemble(&mesh, Weights::Plain), mesh.positions().len());
        let expected = by_definition(&mesh);
        let mut seen = vec![0.0; n * n];
        for row in 0..n {
            let (columns, values) = l.matrix().row(row);
            for (&column, &value) in columns.iter().zip(values) {
                seen[row * n + column as usize] = value;
                seen[column as usize * n + row] = value;
            }
        }
        for (at, (a, b)) in seen.iter().zip(&expected).enumerate() {
            assert!((a - b).abs() < 1e-13 * 10.0, "entry {} {}: {a} instead of {b}", at / n, at % n);
        }
    }

    #[test]
    fn right_triangle_grid_is_the_five_point_stencil() {
        let l = Laplacian::assemble(&sheet(5, 5, |_, _| 0.0), Weights::Plain);
        // Vertex 12 is the middle: right and upper neighbour, and the diagonal edge to 16 as an explicit zero.
        assert_eq!(l.matrix().row(12), (&[12, 13, 16, 17][..], &[4.0, -1.0, 0.0, -1.0][..]));
        assert!(l.matrix().values().iter().all(|v| v.is_sign_positive() || *v < 0.0), "no negative zero");
    }

    #[test]
    fn constants_are_in_the_kernel_for_all_weights() {
        let mesh = bent();
        for weights in
            [Weights::Plain, Weights::ClampedPerCorner, Weights::ClampedPerEdge, Weights::IntrinsicDelaunay]
        {
            let l = Laplacian::assemble(&mesh, weights);
            let n = l.matrix().n();
            let mut y = vec![0.0; n];
            l.matrix().multiply(Columns::new(&vec![1.0; n], n, 1), Columns::new(&mut y[..], n, 1));
            for (sum, scale) in y.iter().zip(l.matrix().absolute_row_sums()) {
                assert!(sum.abs() <= 8.0 * f64::EPSILON * scale, "{weights:?}: {sum} of {scale}");
            }
            let negative = l.matrix().values().iter().filter(|v| **v < 0.0).count();
            assert!(negative > n, "{weights:?} has off-diagonal entries");
        }
    }

    #[test]
    fn clamped_weights_have_no_positive_off_diagonal() {
        let mesh = bent();
        let positive = |weights| {
            let l = Laplacian::assemble(&mesh, weights);
            (0..l.matrix().n()).flat_map(|i| l.matrix().row(i).1[1..].to_vec()).filter(|&v| v > 0.0).count()
        };
        assert!(
            positive(Weights::Plain) > 0,
            "the sheet must have obtuse angles for this test to mean anything"
        );
        assert_eq!(positive(Weights::ClampedPerCorner), 0);
        assert_eq!(positive(Weights::ClampedPerEdge), 0);
        assert_eq!(positive(Weights::IntrinsicDelaunay), 0);
    }

    #[test]
    fn update_gives_the_bits_of_a_new_assembly() {
        let mesh = bent();
        let moved = mesh.with_positions(
            mesh.positions().iter().map(|p| [p[0] * 1.1, p[1], p[2] - p[0] * p[1]]).collect(),
        );
        let moved = moved.expect("finite");
        for weights in [Weights::Plain, Weights::ClampedPerCorner, Weights::ClampedPerEdge] {
            let mut l = Laplacian::assemble(&mesh, weights);
            l.update(moved.positions()).expect("the pattern stays");
            assert_eq!(l.matrix(), Laplacian::assemble(&moved, weights).matrix());
        }
        let mut intrinsic = Laplacian::assemble(&mesh, Weights::IntrinsicDelaunay);
        assert_eq!(intrinsic.update(moved.positions()), Err(UpdateError::Intrinsic));
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let mesh = sheet(300, 150, |x, y| (x * 0.7).sin() + (y * 1.3).cos());
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| Laplacian::assemble(&mesh, Weights::Plain).into_matrix())
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    fn zero_area_triangles_and_their_vertices_are_left_out() {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [3.0, 0.0, 0.0], [5.0, 0.0, 0.0]];
        let mesh =
            TriangleMesh::new(positions, vec![[1, 3, 4], [0, 1, 2], [3, 3, 4], [0, 2, 2]]).expect("valid");
        let mut l = Laplacian::assemble(&mesh, Weights::Plain);
        assert_eq!(l.zero_area(), [0, 2, 3]);
        assert_eq!(l.matrix().row(3), (&[3][..], &[0.0][..]));
        assert_eq!(l.matrix().row(0).0, [0, 1, 2]);
        let mut lifted = mesh.positions().to_vec();
        lifted[3][2] = 1.0;
        let before = l.matrix().clone();
        assert_eq!(l.update(&lifted), Err(UpdateError::Opened { triangle: 0 }));
        lifted[3][2] = f64::NAN;
        assert_eq!(l.update(&lifted), Err(UpdateError::NonFinite { vertex: 3 }));
        assert_eq!(l.matrix(), &before);
    }

    #[test]
    fn scale_does_not_matter() {
        let mesh = bent();
        let reference = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        for exponent in [-490, -300, 300, 490, 1000] {
            let s = 2f64.powi(exponent);
            let scaled = mesh.with_positions(mesh.positions().iter().map(|p| p.map(|x| x * s)).collect());
            let l = Laplacian::assemble(&scaled.expect("finite"), Weights::Plain).into_matrix();
            assert_eq!(l, reference, "scale 2^{exponent}");
        }
    }

    #[test]
    fn an_edge_of_three_triangles_takes_all_three_cotangents() {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.0, 0.5]];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]).expect("valid");
        let l = Laplacian::assemble(&mesh, Weights::Plain);
        assert_eq!(
            l.matrix().row(0).1[0],
            1.5,
            "three right angles opposite to 0-1, two 45 degree angles per triangle"
        );
        assert_eq!(l.matrix().row(0).1[1], 0.0);
    }
}
