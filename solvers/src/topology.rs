//! How the triangles of a mesh hang together, and what is irregular about it.
//!
//! Nothing here is an error: the report says what there is, and the modules that assemble and solve say what they do
//! with it. Edges, fans and boundary are judged by connectivity alone, over the triangles that name three different
//! vertices. Components and unreferenced vertices are judged over the triangles that have an area
//! ([`TriangleMesh::is_zero_area`]), because only those enter a Laplacian.

use crate::mesh::TriangleMesh;

/// How often something occurs and the lowest index where it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Number of occurrences.
    pub count: usize,
    /// Lowest 0-based index among them, of a vertex or a triangle as the field says; `None` without occurrence.
    pub first: Option<u32>,
}

impl Found {
    fn add(&mut self, index: u32) {
        self.count += 1;
        self.first = Some(self.first.map_or(index, |first| first.min(index)));
    }
}

/// The report of [`Topology::of`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Topology {
    /// Connected components (joined through shared vertices) of the triangles that have an area.
    pub components: usize,
    /// Vertices on no triangle that has an area.
    pub unreferenced_vertices: Found,
    /// Triangles that name a vertex twice.
    pub repeated_corners: Found,
    /// Triangles with three different vertices but no area.
    pub zero_area: Found,
    /// Triangles with the same three vertices as an earlier one, in whatever order.
    pub duplicates: Found,
    /// Edges of one triangle; the index is a triangle.
    pub boundary_edges: Found,
    /// Connected pieces that the boundary edges form: closed curves, unless they touch at a vertex.
    pub boundary_loops: usize,
    /// Edges of more than two triangles; the index is a triangle.
    pub non_manifold_edges: Found,
    /// Vertices whose triangles form more than one fan (a fan: joined through edges at the vertex).
    pub non_manifold_vertices: Found,
    /// Edges of two triangles that pass them in the same direction, so that their normals disagree; the index is a
    /// triangle. A closed curve of a Moebius strip always crosses one.
    pub clashing_edges: Found,
}

impl Topology {
    /// Examines a mesh of n vertices and m triangles.
    ///
    /// Half-edges are sorted by their lower vertex (by counting) and then within each vertex: O(n + m) for bounded
    /// valence, O(m log m) always, without hashing. Memory: 36 bytes per triangle and 8 per vertex, freed at the end.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let mut report = Self::default();
        report.judge_triangles(mesh);
        report.judge_edges(mesh);
        report
    }

    /// Whether every edge has one or two triangles and every vertex one fan.
    pub fn is_manifold(&self) -> bool {
        self.non_manifold_edges.count == 0 && self.non_manifold_vertices.count == 0
    }

    /// Whether no edge has just one triangle.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges.count == 0
    }

    /// Areas, references and components.
    fn judge_triangles(&mut self, mesh: &TriangleMesh) {
        let mut sets = DisjointSets::new(mesh.positions().len());
        let mut referenced = vec![false; mesh.positions().len()];
        for (t, &corners) in mesh.triangles().iter().enumerate() {
            if !has_three_vertices(corners) {
                self.repeated_corners.add(t as u32);
            } else if mesh.is_zero_area(t) {
                self.zero_area.add(t as u32);
            } else {
                sets.join(corners[0], corners[1]);
                sets.join(corners[0], corners[2]);
                corners.iter().for_each(|&v| referenced[v as usize] = true);
            }
        }
        for (v, &referenced) in (0..).zip(&referenced) {
            if !referenced {
                self.unreferenced_vertices.add(v);
            } else if sets.root(v) == v {
                self.components += 1;
            }
        }
    }

    /// Edges, fans and boundary.
    fn judge_edges(&mut self, mesh: &TriangleMesh) {
        let triangles = mesh.triangles();
        let (starts, mut half_edges) = half_edges_by_lower_vertex(mesh);
        // Corners 3 t + i; joined when their triangles share an edge at the corner's vertex.
        let mut fans = DisjointSets::new(3 * triangles.len());
        let mut boundary = Vec::new();
        for low in 0..mesh.positions().len() {
            let around = &mut half_edges[starts[low] as usize..starts[low + 1] as usize];
            around.sort_unstable();
            for edge in around.chunk_by(|a, b| a.high == b.high) {
                self.judge_edge(low as u32, edge, triangles);
                for half in &edge[1..] {
                    for vertex in [low as u32, half.high] {
                        fans.join(edge[0].corner(vertex, triangles), half.corner(vertex, triangles));
                    }
                }
                if let [half] = edge {
                    boundary.push([low as u32, half.high]);
                }
            }
        }
        self.count_fans(mesh, &mut fans);
        self.boundary_loops = count_pieces(&boundary, mesh.positions().len());
    }

    /// One edge: the half-edges between `low` and a higher vertex.
    fn judge_edge(&mut self, low: u32, edge: &[HalfEdge], triangles: &[[u32; 3]]) {
        match edge {
            [half] => self.boundary_edges.add(half.triangle()),
            [a, b] if a.is_forward() == b.is_forward() => self.clashing_edges.add(a.triangle()),
            [_, _] => {}
            _ => self.non_manifold_edges.add(edge[0].triangle()),
        }
        if edge.len() == 1 {
            return;
        }
        // A triangle is compared at the edge between its two lower vertices, hence once.
        let third = |half: &HalfEdge| {
            let third = triangles[half.triangle() as usize].into_iter().find(|&v| v != low && v != half.high);
            third.filter(|&v| v > half.high)
        };
        if let [a, b] = edge {
            if third(a).is_some() && third(a) == third(b) {
                self.duplicates.add(b.triangle());
            }
            return;
        }
        let mut thirds: Vec<_> =
            edge.iter().filter_map(|half| Some((third(half)?, half.triangle()))).collect();
        thirds.sort_unstable();
        for pair in thirds.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            self.duplicates.add(pair[1].1);
        }
    }

    /// A vertex with more than one fan is not manifold.
    fn count_fans(&mut self, mesh: &TriangleMesh, fans: &mut DisjointSets) {
        let mut at_vertex = vec![0u32; mesh.positions().len()];
        for (corner, &v) in (0..).zip(mesh.triangles().as_flattened()) {
            let counts =
                has_three_vertices(mesh.triangles()[corner as usize / 3]) && fans.root(corner) == corner;
            at_vertex[v as usize] += u32::from(counts);
        }
        for (v, _) in (0..).zip(&at_vertex).filter(|&(_, &fans)| fans > 1) {
            self.non_manifold_vertices.add(v);
        }
    }
}

fn has_three_vertices([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// Connected pieces of a graph on `vertices` vertices, without those on no edge.
fn count_pieces(edges: &[[u32; 2]], vertices: usize) -> usize {
    let mut pieces = DisjointSets::new(vertices);
    edges.iter().for_each(|&[a, b]| pieces.join(a, b));
    let mut roots: Vec<u32> = edges.iter().map(|&[a, _]| pieces.root(a)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

/// One side of a triangle, filed under its lower vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    high: u32,
    /// 2 triangle + 1 if the triangle passes the edge from the lower vertex to the higher one.
    triangle_and_direction: u32,
}

impl HalfEdge {
    fn triangle(self) -> u32 {
        self.triangle_and_direction / 2
    }

    fn is_forward(self) -> bool {
        self.triangle_and_direction % 2 == 1
    }

    /// The corner 3 t + i of its triangle at one of its two vertices.
    fn corner(self, vertex: u32, triangles: &[[u32; 3]]) -> u32 {
        let [a, b, _] = triangles[self.triangle() as usize];
        3 * self.triangle()
            + if a == vertex {
                0
            } else if b == vertex {
                1
            } else {
                2
            }
    }
}

/// Half-edges of the triangles with three different vertices: those with lower vertex v stand at `starts[v]..starts[v + 1]`.
fn half_edges_by_lower_vertex(mesh: &TriangleMesh) -> (Vec<u32>, Vec<HalfEdge>) {
    let sides = || {
        let proper = (0u32..).zip(mesh.triangles()).filter(|&(_, &corners)| has_three_vertices(corners));
        proper.flat_map(|(t, &[a, b, c])| [(t, a, b), (t, b, c), (t, c, a)])
    };
    let mut starts = vec![0u32; mesh.positions().len() + 1];
    for (_, from, to) in sides() {
        starts[from.min(to) as usize + 1] += 1;
    }
    for v in 1..starts.len() {
        starts[v] += starts[v - 1];
    }
    let mut next = starts.clone();
    let mut sorted = vec![HalfEdge { high: 0, triangle_and_direction: 0 }; starts[starts.len() - 1] as usize];
    for (t, from, to) in sides() {
        let slot = &mut next[from.min(to) as usize];
        sorted[*slot as usize] =
            HalfEdge { high: from.max(to), triangle_and_direction: 2 * t + u32::from(from < to) };
        *slot += 1;
    }
    (starts, sorted)
}

/// Union-find over 0..n with path halving; the lower root wins, so that a set is named by its lowest member.
struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let above = self.parent[v as usize];
            self.parent[v as usize] = self.parent[above as usize];
            v = above;
        }
        v
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A report of points on a paraboloid, so that no triangle of different vertices lacks area.
    fn report(vertices: u32, triangles: &[[u32; 3]]) -> Topology {
        let positions =
            (0..vertices).map(|i| [f64::from(i), f64::from(i * i), f64::from(i * i * i)]).collect();
        Topology::of(&TriangleMesh::new(positions, triangles.to_vec()).unwrap())
    }

    fn found(count: usize, first: u32) -> Found {
        Found { count, first: Some(first) }
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn a_tetrahedron_is_regular() {
        assert_eq!(report(4, &TETRAHEDRON), Topology { components: 1, ..Topology::default() });
    }

    #[test]
    fn two_tetrahedra_at_a_vertex_are_two_fans_there() {
        let other = TETRAHEDRON.map(|t| t.map(|v| v + 3));
        let expected = Topology { components: 1, non_manifold_vertices: found(1, 3), ..Topology::default() };
        assert_eq!(report(7, &[TETRAHEDRON, other].concat()), expected);
    }

    #[test]
    fn a_moebius_strip_has_one_loop_and_a_clash() {
        let strip = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 1], [1, 5, 0]];
        let report = report(6, &strip);
        assert_eq!((report.components, report.boundary_loops, report.boundary_edges.count), (1, 1, 6));
        assert_eq!(report.clashing_edges.count, 1);
        assert!(report.is_manifold() && !report.is_closed());
    }

    #[test]
    fn a_third_triangle_at_an_edge_and_duplicates_of_any_order() {
        let book = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [4, 1, 0], [2, 1, 0], [0, 1, 2]];
        let report = report(5, &book);
        assert_eq!(report.non_manifold_edges, found(3, 0)); // 0-1 with six triangles, 0-2 and 1-2 with three
        assert_eq!(report.duplicates, found(3, 3));
        assert_eq!(report.non_manifold_vertices, Found::default());
        assert_eq!((report.boundary_edges, report.boundary_loops), (found(2, 1), 1));
    }

    #[test]
    fn repeated_corners_and_flat_triangles_hold_nothing_together() {
        let positions = vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [2.0, 0.0, 0.0],
            [3.0, 0.0, 0.0],
            [3.0, 1.0, 0.0],
        ];
        let triangles = vec![[3, 3, 1], [0, 1, 2], [1, 3, 0], [4, 5, 1], [2, 2, 2]];
        let report = Topology::of(&TriangleMesh::new(positions, triangles).unwrap());
        assert_eq!((report.repeated_corners, report.zero_area), (found(2, 0), found(1, 2)));
        assert_eq!(report.unreferenced_vertices, found(1, 3));
        assert_eq!(report.components, 1);
    }
}
