//! Loop subdivision: four triangles from one, positions as fixed weighted sums, so that animations can follow.
//!
//! C. Loop, "Smooth subdivision surfaces based on triangles", 1987, with the vertex weights of J. Warren (1995), which
//! are rational: the same bits on every machine.

use lapsolve::mesh::{MeshError, TriangleMesh};
use rayon::prelude::*;
use thiserror::Error;

/// A subdivided mesh and how its vertices follow those of the mesh it was made from.
///
/// One step keeps the vertices with their indices and appends one for each edge, in ascending order of the edge's
/// vertices. The children of triangle t = (a, b, c) are 4t..4t+3: those at a, b and c, then the middle one.
///
/// An edge with two triangles is smooth. Any other edge (boundary, or with more triangles) is a crease: its new vertex
/// is its midpoint. A vertex with two creases moves along them, one with any other number of creases stays, and so does
/// one on no triangle. Orientation does not matter. A triangle that names a vertex twice has itself as its children.
#[derive(Clone, Debug)]
pub struct Subdivision {
    mesh: TriangleMesh,
    steps: Vec<Stencils>,
}

/// Most triangles of a result: it and its stencils then take about 10 GiB.
const LARGEST: usize = 1 << 26;

/// Why a mesh cannot be subdivided.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SubdivisionError {
    /// There would be too many triangles; found before any are made.
    #[error("{triangles} triangles subdivided {steps} times are more than 2^26; take fewer steps")]
    TooLarge {
        /// Triangles of the mesh.
        triangles: usize,
        /// Steps asked for.
        steps: u32,
    },
    /// A new position is not finite; possible only at the end of the range of f64.
    #[error("after subdivision, {0}")]
    Mesh(#[from] MeshError),
}

/// New positions as weighted sums of old ones, by rows: the entries of vertex v are `starts[v]..starts[v + 1]`.
#[derive(Clone, Debug)]
struct Stencils {
    starts: Vec<u32>,
    sources: Vec<u32>,
    weights: Vec<f64>,
}

impl Subdivision {
    /// Subdivides `steps` times; none gives the mesh back. Each step takes one sort of the edges.
    ///
    /// # Errors
    /// See [`SubdivisionError`].
    pub fn new(mesh: &TriangleMesh, steps: u32) -> Result<Self, SubdivisionError> {
        let triangles =
            4usize.checked_pow(steps).and_then(|factor| factor.checked_mul(mesh.triangles().len()));
        if triangles.is_none_or(|triangles| triangles > LARGEST) {
            return Err(SubdivisionError::TooLarge { triangles: mesh.triangles().len(), steps });
        }
        let mut result = Self { mesh: mesh.clone(), steps: Vec::new() };
        for _ in 0..steps {
            let mesh = &result.mesh;
            let edges = Edges::of(mesh);
            let stencils = Stencils::of(mesh.positions().len(), &edges);
            let positions = stencils.apply(mesh.positions());
            result.mesh = TriangleMesh::new(positions, edges.children(mesh))?;
            result.steps.push(stencils);
        }
        Ok(result)
    }

    /// The subdivided mesh.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// Other positions of the original mesh's vertices, subdivided alike: 84 bytes and about 40 flops per new vertex
    /// and step, in parallel.
    ///
    /// # Panics
    /// Unless there is one position per vertex of the original mesh.
    pub fn apply(&self, positions: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.steps.iter().fold(positions.to_vec(), |positions, step| step.apply(&positions))
    }
}

impl Stencils {
    fn of(vertices: usize, edges: &Edges) -> Self {
        let mut stencils = Self { starts: vec![0], sources: Vec::new(), weights: Vec::new() };
        let (starts, neighbours) = edges.neighbours(vertices);
        for v in 0..vertices {
            stencils.vertex_rule(v as u32, &neighbours[starts[v] as usize..starts[v + 1] as usize]);
        }
        for edge in &edges.list {
            stencils.edge_rule(edge);
        }
        stencils
    }

    /// `around`: the neighbours of `v`, each with whether the edge to it is a crease.
    fn vertex_rule(&mut self, v: u32, around: &[(u32, bool)]) {
        let creases = around.iter().filter(|(_, crease)| *crease).count();
        match (around.len(), creases) {
            (0, _) => self.row(&[(v, 1.0)]),
            (n, 0) => {
                // Warren: 3/16 at three neighbours, else 3/(8n).
                let weight = if n == 3 { 3.0 / 16.0 } else { 3.0 / (8.0 * n as f64) };
                self.entry(v, 1.0 - n as f64 * weight);
                around.iter().for_each(|&(neighbour, _)| self.entry(neighbour, weight));
                self.end_row();
            }
            (_, 2) => {
                self.entry(v, 0.75);
                around
                    .iter()
                    .filter(|(_, crease)| *crease)
                    .for_each(|&(neighbour, _)| self.entry(neighbour, 0.125));
                self.end_row();
            }
            _ => self.row(&[(v, 1.0)]),
        }
    }

    fn edge_rule(&mut self, edge: &Edge) {
        match edge.opposite {
            Some([c, d]) => {
                self.row(&[(edge.ends[0], 0.375), (edge.ends[1], 0.375), (c, 0.125), (d, 0.125)]);
            }
            None => self.row(&[(edge.ends[0], 0.5), (edge.ends[1], 0.5)]),
        }
    }

    fn row(&mut self, entries: &[(u32, f64)]) {
        entries.iter().for_each(|&(source, weight)| self.entry(source, weight));
        self.end_row();
    }

    fn entry(&mut self, source: u32, weight: f64) {
        self.sources.push(source);
        self.weights.push(weight);
    }

    fn end_row(&mut self) {
        self.starts.push(self.sources.len() as u32);
    }

    fn apply(&self, positions: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let row = |ends: &[u32]| {
            let range = ends[0] as usize..ends[1] as usize;
            let mut sum = [0.0; 3];
            for (&source, weight) in self.sources[range.clone()].iter().zip(&self.weights[range]) {
                for i in 0..3 {
                    sum[i] += weight * positions[source as usize][i];
                }
            }
            sum
        };
        self.starts.par_windows(2).map(row).collect()
    }
}

/// The edges of a mesh, ascending.
struct Edges {
    list: Vec<Edge>,
    /// For side i of triangle t (from corner i to the next), at 3t + i: its edge; [`NO_EDGE`] where a vertex repeats.
    of_side: Vec<u32>,
}

const NO_EDGE: u32 = u32::MAX;

struct Edge {
    /// Lower and higher vertex.
    ends: [u32; 2],
    /// The third vertices of its two triangles, ascending; `None` on a crease.
    opposite: Option<[u32; 2]>,
}

impl Edges {
    fn of(mesh: &TriangleMesh) -> Self {
        let mut sides = Vec::with_capacity(3 * mesh.triangles().len());
        for (t, &[a, b, c]) in (0u32..).zip(mesh.triangles()) {
            if a != b && b != c && c != a {
                let side = |i: u32, from: u32, to: u32| (from.min(to), from.max(to), 3 * t + i);
                sides.extend([side(0, a, b), side(1, b, c), side(2, c, a)]);
            }
        }
        sides.sort_unstable();
        let mut edges = Self { list: Vec::new(), of_side: vec![NO_EDGE; 3 * mesh.triangles().len()] };
        for edge in sides.chunk_by(|p, q| (p.0, p.1) == (q.0, q.1)) {
            // Side i lies across from corner i + 2.
            let third = |side: u32| mesh.triangles()[side as usize / 3][(side as usize % 3 + 2) % 3];
            let opposite = match edge {
                [p, q] => Some([third(p.2).min(third(q.2)), third(p.2).max(third(q.2))]),
                _ => None,
            };
            edge.iter().for_each(|&(_, _, side)| edges.of_side[side as usize] = edges.list.len() as u32);
            edges.list.push(Edge { ends: [edge[0].0, edge[0].1], opposite });
        }
        edges
    }

    /// For each vertex its neighbours, ascending, and whether the edge to them is a crease: those of v stand at
    /// `starts[v]..starts[v + 1]`.
    fn neighbours(&self, vertices: usize) -> (Vec<u32>, Vec<(u32, bool)>) {
        let mut starts = vec![0u32; vertices + 1];
        self.list.iter().flat_map(|edge| edge.ends).for_each(|v| starts[v as usize + 1] += 1);
        for v in 0..vertices {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut neighbours = vec![(0, false); 2 * self.list.len()];
        let mut put = |v: u32, neighbour: u32, crease: bool| {
            neighbours[next[v as usize] as usize] = (neighbour, crease);
            next[v as usize] += 1;
        };
        // First the lower neighbours of every vertex, then the higher ones, both in the order of the list.
        self.list.iter().for_each(|edge| put(edge.ends[1], edge.ends[0], edge.opposite.is_none()));
        self.list.iter().for_each(|edge| put(edge.ends[0], edge.ends[1], edge.opposite.is_none()));
        (starts, neighbours)
    }

    fn children(&self, mesh: &TriangleMesh) -> Vec<[u32; 3]> {
        let mut children = Vec::with_capacity(4 * mesh.triangles().len());
        for (&[a, b, c], sides) in mesh.triangles().iter().zip(self.of_side.as_chunks::<3>().0) {
            if sides[0] == NO_EDGE {
                children.extend([[a, b, c]; 4]);
                continue;
            }
            let [ab, bc, ca] = sides.map(|edge| mesh.positions().len() as u32 + edge);
            children.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        children
    }
}

#[cfg(test)]
mod tests {
    use lapsolve::topology::Topology;

    use super::*;

    fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriangleMesh {
        TriangleMesh::new(positions.to_vec(), triangles.to_vec()).unwrap()
    }

    fn octahedron() -> TriangleMesh {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let minus = |p: [f64; 3]| p.map(|x: f64| -x);
        let faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
        mesh(&[x, y, z, minus(x), minus(y), minus(z)], &faces)
    }

    #[test]
    fn an_octahedron_by_hand() {
        let fine = Subdivision::new(&octahedron(), 1).unwrap();
        let p = fine.mesh().positions();
        assert_eq!(p.len(), 18);
        // Four neighbours cancel: 1 - 4 * 3/32. Edge x-y: 3/8 (x + y), the opposite +z and -z cancel.
        assert_eq!(p[0], [0.625, 0.0, 0.0]);
        assert_eq!(p[6], [0.375, 0.375, 0.0]);
        assert_eq!(fine.mesh().triangles()[..4], [[0, 6, 7], [1, 10, 6], [2, 7, 10], [6, 10, 7]]);
        let topology = Topology::of(Subdivision::new(&octahedron(), 3).unwrap().mesh());
        assert!(topology.is_closed() && topology.is_manifold() && topology.clashing_edges.count == 0);
    }

    #[test]
    fn boundaries_are_curves_of_their_own_and_creases_meet_in_corners() {
        let strip =
            mesh(&[[0.0; 3], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 8.0]], &[[0, 1, 2], [0, 2, 3]]);
        let fine = Subdivision::new(&strip, 1).unwrap();
        // Vertex 1: 3/4 of itself and 1/8 of 0 and 2; edge 0-2 is the only smooth one.
        assert_eq!(fine.mesh().positions()[1], [1.75, 0.25, 0.0]);
        assert_eq!(fine.mesh().positions()[5], [0.75 + 0.25, 0.75 + 0.25, 1.0]);
        let book = mesh(
            &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [9.0; 3]],
            &[[0, 1, 2], [0, 1, 3], [0, 1, 4], [5, 5, 0]],
        );
        let fine = Subdivision::new(&book, 1).unwrap();
        assert_eq!(fine.mesh().positions()[..2], book.positions()[..2]); // four creases meet
        assert_eq!(fine.mesh().positions()[5], [9.0; 3]);
        assert_eq!(fine.mesh().positions()[6], [0.5, 0.0, 0.0]);
        assert_eq!(fine.mesh().triangles()[12..], [[5, 5, 0]; 4]);
    }

    #[test]
    fn constants_are_reproduced_and_frames_follow() {
        let coarse = octahedron();
        let fine = Subdivision::new(&coarse, 3).unwrap();
        for p in fine.apply(&[[1.0, -2.0, 0.1]; 6]) {
            assert!((p[0] - 1.0).abs() < 1e-15 && (p[1] + 2.0).abs() < 1e-15 && (p[2] - 0.1).abs() < 1e-15);
        }
        assert_eq!(fine.apply(coarse.positions()), fine.mesh().positions());
    }

    #[test]
    fn too_large_results_are_refused_at_once() {
        for steps in [12, 40] {
            let error = Subdivision::new(&octahedron(), steps).map(|_| ());
            assert_eq!(error, Err(SubdivisionError::TooLarge { triangles: 8, steps }));
        }
    }
}
