//! A closed triangle mesh under local change: split, flip and collapse an edge.

use crate::vector::{Vector, add, area_normal, dot, lerp, norm};

/// Index of a half-edge: corner c of triangle t is half-edge 3 t + c, running from that corner to the next.
pub(super) type HalfEdge = u32;

const DEAD: u32 = u32::MAX;

/// A closed, oriented manifold mesh. Every half-edge has a twin running the other way.
#[derive(Clone, Debug)]
pub(super) struct HalfEdges {
    pub(super) positions: Vec<Vector>,
    /// Wanted edge length at each vertex, relative.
    pub(super) detail: Vec<f64>,
    /// Vertex from which each half-edge starts; DEAD in a removed triangle.
    from: Vec<u32>,
    twin: Vec<HalfEdge>,
    /// One half-edge starting at each vertex; DEAD for a removed vertex.
    leaving: Vec<HalfEdge>,
    removed_triangles: usize,
}

/// The half-edge after h in its triangle.
pub(super) fn next(h: HalfEdge) -> HalfEdge {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The half-edge before h in its triangle.
pub(super) fn previous(h: HalfEdge) -> HalfEdge {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

impl HalfEdges {
    /// None if some edge is not shared by exactly two triangles of opposite direction.
    pub(super) fn new(positions: Vec<Vector>, detail: Vec<f64>, triangles: &[[u32; 3]]) -> Option<Self> {
        let from = triangles.as_flattened().to_vec();
        let ends = |h: HalfEdge| (from[h as usize], from[next(h) as usize]);
        let sorted_ends = |h: &HalfEdge| {
            let (a, b) = ends(*h);
            (a.min(b), a.max(b))
        };
        let mut by_edge: Vec<HalfEdge> = (0..from.len() as u32).collect();
        by_edge.sort_by_cached_key(sorted_ends);
        let mut leaving = vec![DEAD; positions.len()];
        let mut twin = vec![DEAD; from.len()];
        for edge in by_edge.chunk_by(|g, h| sorted_ends(g) == sorted_ends(h)) {
            let &[g, h] = edge else { return None };
            if ends(g).0 != ends(h).1 {
                return None;
            }
            for (x, y) in [(g, h), (h, g)] {
                twin[x as usize] = y;
                leaving[from[x as usize] as usize] = x;
            }
        }
        Some(Self { positions, detail, from, twin, leaving, removed_triangles: 0 })
    }

    /// Number of triangles alive.
    pub(super) fn triangle_count(&self) -> usize {
        self.from.len() / 3 - self.removed_triangles
    }

    /// Length of the arrays that a half-edge or vertex indexes, dead ones included.
    pub(super) fn half_edge_slots(&self) -> usize {
        self.from.len()
    }

    /// One half-edge per edge: the one with the smaller index.
    pub(super) fn edges(&self) -> impl Iterator<Item = HalfEdge> + '_ {
        (0..self.from.len() as u32).filter(|&h| self.is_alive(h) && h < self.twin(h))
    }

    pub(super) fn is_alive(&self, h: HalfEdge) -> bool {
        self.from[h as usize] != DEAD
    }

    pub(super) fn twin(&self, h: HalfEdge) -> HalfEdge {
        self.twin[h as usize]
    }

    /// Start and end vertex.
    pub(super) fn ends(&self, h: HalfEdge) -> [u32; 2] {
        [self.from[h as usize], self.from[next(h) as usize]]
    }

    /// The vertex opposite to h in its triangle.
    pub(super) fn opposite(&self, h: HalfEdge) -> u32 {
        self.from[previous(h) as usize]
    }

    pub(super) fn position(&self, v: u32) -> Vector {
        self.positions[v as usize]
    }

    /// Normal of the triangle of h, twice its area long.
    pub(super) fn normal(&self, h: HalfEdge) -> Vector {
        let [a, b] = self.ends(h);
        area_normal(self.position(a), self.position(b), self.position(self.opposite(h)))
    }

    /// Half-edges that start at v, in clockwise order.
    pub(super) fn around(&self, v: u32) -> impl Iterator<Item = HalfEdge> + '_ {
        let first = self.leaving[v as usize];
        let mut at = (first != DEAD).then_some(first);
        std::iter::from_fn(move || {
            let h = at?;
            let following = next(self.twin(h));
            at = (following != first).then_some(following);
            Some(h)
        })
    }

    /// Vertices that share an edge with v.
    pub(super) fn neighbours(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        self.around(v).map(|h| self.from[next(h) as usize])
    }

    fn link(&mut self, g: HalfEdge, h: HalfEdge) {
        self.twin[g as usize] = h;
        self.twin[h as usize] = g;
    }

    /// Puts a new vertex at p on the edge of h; both its triangles are halved.
    pub(super) fn split(&mut self, h: HalfEdge, p: Vector) {
        let g = self.twin(h);
        let ([a, b], c, d) = (self.ends(h), self.opposite(h), self.opposite(g));
        let middle = self.positions.len() as u32;
        let (b_to_c, d_to_b) = (self.twin(next(h)), self.twin(previous(g)));
        let fresh = self.from.len() as u32; // the triangles (m b c) and (b m d)
        self.from.extend([middle, b, c, b, middle, d]);
        self.twin.extend([DEAD; 6]);
        self.from[next(h) as usize] = middle;
        self.from[g as usize] = middle;
        self.link(fresh, fresh + 3);
        self.link(fresh + 1, b_to_c);
        self.link(fresh + 2, next(h));
        self.link(fresh + 4, previous(g));
        self.link(fresh + 5, d_to_b);
        self.positions.push(p);
        self.detail.push(0.5 * (self.detail[a as usize] + self.detail[b as usize]));
        self.leaving.push(fresh);
        self.leaving[b as usize] = fresh + 1;
    }

    /// Turns the edge of h so that it joins the two opposite vertices. The caller has checked that they are not
    /// neighbours yet.
    pub(super) fn flip(&mut self, h: HalfEdge) {
        let g = self.twin(h);
        let (n, p, gn, gp) = (next(h), previous(h), next(g), previous(g));
        let ([a, b], c, d) = (self.ends(h), self.opposite(h), self.opposite(g));
        let [tn, tp, tgn, tgp] = [n, p, gn, gp].map(|x| self.twin(x));
        for (half_edge, start, twin) in [(n, d, tgp), (p, b, tn), (gn, c, tp), (gp, a, tgn)] {
            self.from[half_edge as usize] = start;
            self.link(half_edge, twin);
        }
        self.from[h as usize] = c;
        self.from[g as usize] = d;
        for (v, half_edge) in [(a, gp), (b, p), (c, h), (d, g)] {
            self.leaving[v as usize] = half_edge;
        }
    }

    /// True if the ends of h can become one vertex without changing the topology (link condition).
    pub(super) fn can_collapse(&self, h: HalfEdge) -> bool {
        let [a, b] = self.ends(h);
        let common = self.neighbours(a).filter(|&v| self.neighbours(b).any(|w| w == v)).count();
        let opposite = [self.opposite(h), self.opposite(self.twin(h))];
        common == 2 && opposite.iter().all(|&v| self.around(v).count() > 3)
    }

    /// Smallest cosine between the mean normal around the edge h and the normals of the triangles there after both
    /// ends move to p; the two triangles of the edge, which vanish, do not count.
    pub(super) fn turn_of_collapse(&self, h: HalfEdge, p: Vector) -> f64 {
        let vanishing = [h / 3, self.twin(h) / 3];
        let spokes = || self.ends(h).into_iter().flat_map(|v| self.around(v));
        let mean = spokes().fold([0.0; 3], |sum, k| add(sum, self.normal(k)));
        let cosine = |k: HalfEdge| {
            let after = area_normal(p, self.position(self.ends(k)[1]), self.position(self.opposite(k)));
            dot(mean, after) / (norm(mean) * norm(after)).max(f64::MIN_POSITIVE)
        };
        spokes().filter(|k| !vanishing.contains(&(k / 3))).map(cosine).fold(1.0, f64::min)
    }

    /// Merges the end of h into its start, which moves to p; two triangles and one vertex die.
    pub(super) fn collapse(&mut self, h: HalfEdge, p: Vector) {
        let g = self.twin(h);
        let [a, b] = self.ends(h);
        let (c, d) = (self.opposite(h), self.opposite(g));
        let spokes: Vec<HalfEdge> = self.around(b).collect();
        for k in spokes {
            self.from[k as usize] = a;
        }
        let sides =
            [(next(h), previous(h)), (next(g), previous(g))].map(|(x, y)| (self.twin(x), self.twin(y)));
        for (x, y) in sides {
            self.link(x, y);
        }
        let [(b_side, a_side), (a_side_of_d, _)] = sides;
        self.leaving[c as usize] = b_side;
        self.leaving[a as usize] = a_side;
        self.leaving[d as usize] = a_side_of_d;
        self.leaving[b as usize] = DEAD;
        for triangle in [h / 3, g / 3] {
            self.from[3 * triangle as usize..][..3].fill(DEAD);
        }
        self.removed_triangles += 2;
        self.positions[a as usize] = p;
    }

    /// Midpoint of an edge.
    pub(super) fn midpoint(&self, h: HalfEdge) -> Vector {
        let [a, b] = self.ends(h);
        lerp(self.position(a), self.position(b), 0.5)
    }

    /// Positions and triangles that are alive, renumbered in their present order.
    pub(super) fn into_arrays(self) -> (Vec<Vector>, Vec<[u32; 3]>) {
        let mut number = vec![DEAD; self.positions.len()];
        let mut positions = Vec::with_capacity(self.positions.len());
        for (v, &p) in self.positions.iter().enumerate().filter(|&(v, _)| self.leaving[v] != DEAD) {
            number[v] = positions.len() as u32;
            positions.push(p);
        }
        let alive = self.from.as_chunks::<3>().0.iter().filter(|t| t[0] != DEAD);
        let triangles = alive.map(|t| t.map(|v| number[v as usize])).collect();
        (positions, triangles)
    }
}
