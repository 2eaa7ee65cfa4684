//! The extremities of a standing figure: head, hands and feet, found by distances along the surface.
//!
//! The highest vertex is the head; the four that are then farthest from each other along the surface are hands and feet, in
//! any standing pose in which the limbs are apart from the body. Heights tell hands from feet; toes show where it faces.

use super::body_frame::BodyFrame;
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{Vector, add, distance_squared, dot, norm, scale, sub};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use thiserror::Error;

/// Why a mesh shows no figure.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum NoFigure {
    /// The largest component has no five tips, or none that can be told apart.
    #[error("no head, two hands and two feet stand off the largest component")]
    NoTips,
    /// The surface is torn: the largest component is only a part of it.
    #[error("the largest component has only {share:.0} % of the vertices")]
    Torn {
        /// Per cent.
        share: f64,
    },
}

/// Head, left and right hand, left and right foot.
pub const TIPS: usize = 5;

/// Index of each tip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Tip {
    Head,
    LeftHand,
    RightHand,
    LeftFoot,
    RightFoot,
}

/// A figure: its tips, and how far every vertex is from each of them along the edges.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Up, left and forwards.
    pub frame: BodyFrame,
    /// From the lowest to the highest vertex.
    pub height: f64,
    /// Tip vertices, in the order of [`Tip`].
    pub tips: [u32; TIPS],
    /// Lengths of shortest paths along edges from every tip; infinite on other components.
    distances: [Vec<f64>; TIPS],
    positions: Vec<Vector>,
}

/// Share of the height over which toes must point forwards to tell front from back.
const TOES: f64 = 0.02;
/// Share of the height from the toes at which the shin begins.
const ANKLE: f64 = 0.16;
/// Share of the height by which the head may lie beside both hands.
const ASIDE: f64 = 0.1;
/// Least share of all vertices that one component must have.
const WHOLE: f64 = 0.6;

impl Figure {
    /// Finds the figure in `mesh`, whose up direction is `up` (1: y, 2: z). Where the toes do not tell, it faces +z (y up)
    /// or -y (z up).
    ///
    /// Cost: five shortest-path searches over all edges.
    ///
    /// # Errors
    /// [`NoFigure`].
    pub fn of(mesh: &TriangleMesh, up: usize) -> Result<Self, NoFigure> {
        let graph = Graph::of(mesh);
        let used = graph.used().count();
        let start = graph.used().next().ok_or(NoFigure::NoTips)?;
        let whole = graph.largest_component(start);
        if whole.len() < 4 * TIPS {
            return Err(NoFigure::NoTips);
        }
        if (whole.len() as f64) < WHOLE * used as f64 {
            return Err(NoFigure::Torn { share: 100.0 * whole.len() as f64 / used as f64 });
        }
        let height_of = |v: u32| mesh.positions()[v as usize][up];
        let higher = |a: u32, b: u32| if height_of(b) > height_of(a) { b } else { a };
        let crown = whole.iter().copied().reduce(higher).ok_or(NoFigure::NoTips)?;
        let low = whole.iter().map(|&v| height_of(v)).fold(f64::INFINITY, f64::min);
        let height = height_of(crown) - low;
        let (tips, distances) = graph.farthest(&whole, crown).ok_or(NoFigure::NoTips)?;
        let positions = mesh.positions().to_vec();
        let mut figure = Self { frame: BodyFrame::standing(up), height, tips, distances, positions };
        figure.name_tips(up)?;
        Ok(figure)
    }

    /// Sorts the tips, of which the first is the head, into the order of [`Tip`] and finds out where the figure faces.
    fn name_tips(&mut self, up: usize) -> Result<(), NoFigure> {
        let at = |figure: &Self, k: usize| figure.positions[figure.tips[k] as usize];
        let mut limbs: [usize; TIPS - 1] = [1, 2, 3, 4];
        limbs.sort_by(|&a, &b| at(self, a)[up].total_cmp(&at(self, b)[up]));
        let [a, b, c, d] = limbs;
        let toes = [a, b].map(|k| {
            let ankle = self.centre_of_ring(k, ANKLE * self.height).unwrap_or(at(self, k));
            sub(at(self, k), ankle)
        });
        let mut forwards = add(toes[0], toes[1]);
        forwards[up] = 0.0;
        if norm(forwards) > TOES * self.height {
            self.frame = BodyFrame::facing(up, forwards);
        }
        let left_first = |[a, b]: [usize; 2]| {
            let side = |k: usize| dot(at(self, k), self.frame.left);
            if side(a) >= side(b) { [a, b] } else { [b, a] }
        };
        let [hands, feet] = [left_first([c, d]), left_first([a, b])];
        let order = [0, hands[0], hands[1], feet[0], feet[1]];
        let side = |k: usize| dot(at(self, order[k]), self.frame.left);
        let aside = (side(0) - side(1)).max(side(2) - side(0));
        let above = |k: usize| at(self, order[k])[up] - at(self, feet[0])[up].max(at(self, feet[1])[up]);
        // Hands at the feet, a head that is no higher than the hands reach down or not between them: no standing figure.
        let low = above(0) < 0.5 * self.height || above(1).min(above(2)) < 0.15 * self.height;
        if low || aside > ASIDE * self.height {
            return Err(NoFigure::NoTips);
        }
        self.tips = order.map(|k| self.tips[k]);
        self.distances = order.map(|k| std::mem::take(&mut self.distances[k]));
        Ok(())
    }

    /// Where the tip is.
    pub fn tip(&self, tip: Tip) -> Vector {
        self.positions[self.tips[tip as usize] as usize]
    }

    /// The middle of the limb at `distance` from its tip along the surface; none where no vertex is there.
    pub fn centre(&self, tip: Tip, distance: f64) -> Option<Vector> {
        self.centre_of_ring(tip as usize, distance)
    }

    /// Middle of the vertices of tip `k`'s limb in a ring about `distance`; the ring grows until it holds enough of them.
    fn centre_of_ring(&self, k: usize, distance: f64) -> Option<Vector> {
        const FEW: usize = 12;
        // The head does not count: a shoulder is nearer to it than to its hand.
        let nearest = |v: usize| (1..TIPS).all(|other| self.distances[other][v] >= self.distances[k][v]);
        for width in [0.008, 0.015, 0.03, 0.06] {
            let half = width * self.height;
            let ring: Vec<Vector> = (0..self.positions.len())
                .filter(|&v| (self.distances[k][v] - distance).abs() <= half && nearest(v))
                .map(|v| self.positions[v])
                .collect();
            if ring.len() >= FEW {
                return Some(middle_of(&ring));
            }
        }
        None
    }
}

/// Half mean, half middle of the box: densely sampled sides pull the one, outlying vertices the other.
fn middle_of(ring: &[Vector]) -> Vector {
    let mean = scale(1.0 / ring.len() as f64, ring.iter().fold([0.0; 3], |sum, &p| add(sum, p)));
    let extreme =
        |axis: usize, pick: fn(f64, f64) -> f64, first: f64| ring.iter().map(|p| p[axis]).fold(first, pick);
    let middle: Vector = std::array::from_fn(|axis| {
        0.5 * (extreme(axis, f64::min, f64::INFINITY) + extreme(axis, f64::max, f64::NEG_INFINITY))
    });
    scale(0.5, add(mean, middle))
}

/// Vertices and the lengths of their edges.
struct Graph {
    starts: Vec<u32>,
    /// Neighbour and length.
    edges: Vec<(u32, f64)>,
}

impl Graph {
    fn of(mesh: &TriangleMesh) -> Self {
        let mut pairs: Vec<(u32, u32)> = mesh
            .triangles()
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)])
            .filter(|(a, b)| a != b)
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let (mut starts, mut edges) = (vec![0], Vec::with_capacity(pairs.len()));
        let mut pairs = pairs.into_iter().peekable();
        for v in 0..mesh.positions().len() as u32 {
            while let Some((_, to)) = pairs.next_if(|&(from, _)| from == v) {
                let length = distance_squared(mesh.positions()[v as usize], mesh.positions()[to as usize]);
                edges.push((to, length.sqrt()));
            }
            starts.push(edges.len() as u32);
        }
        Self { starts, edges }
    }

    fn around(&self, v: u32) -> &[(u32, f64)] {
        &self.edges[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }

    /// Vertices with an edge.
    fn used(&self) -> impl Iterator<Item = u32> {
        (0..self.starts.len() as u32 - 1).filter(|&v| !self.around(v).is_empty())
    }

    /// The vertices of the component with the most vertices.
    fn largest_component(&self, start: u32) -> Vec<u32> {
        let mut seen = vec![false; self.starts.len() - 1];
        let mut best = Vec::new();
        for root in std::iter::once(start).chain(self.used()) {
            if seen[root as usize] {
                continue;
            }
            seen[root as usize] = true;
            let mut own = vec![root];
            let mut next = 0;
            while next < own.len() {
                for &(to, _) in self.around(own[next]) {
                    if !std::mem::replace(&mut seen[to as usize], true) {
                        own.push(to);
                    }
                }
                next += 1;
            }
            if own.len() > best.len() {
                best = own;
            }
        }
        best
    }

    /// `first` and four vertices of the component, each as far as possible from those before, with their distances.
    fn farthest(&self, component: &[u32], first: u32) -> Option<([u32; TIPS], [Vec<f64>; TIPS])> {
        let most = |distance: &[f64]| {
            let better =
                |best: u32, v: u32| if distance[v as usize] > distance[best as usize] { v } else { best };
            component.iter().copied().reduce(better)
        };
        let mut tips = [first; TIPS];
        let mut least = self.distances(first);
        let mut all: [Vec<f64>; TIPS] = Default::default();
        all[0] = least.clone();
        for k in 1..TIPS {
            tips[k] = most(&least)?;
            all[k] = self.distances(tips[k]);
            least.iter_mut().zip(&all[k]).for_each(|(least, &d)| *least = least.min(d));
        }
        Some((tips, all))
    }

    /// Lengths of shortest paths from `source` (Dijkstra 1959).
    fn distances(&self, source: u32) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; self.starts.len() - 1];
        distances[source as usize] = 0.0;
        // Lengths are not negative, so their bits sort as they do.
        let mut queue = BinaryHeap::from([Reverse((0u64, source))]);
        while let Some(Reverse((bits, v))) = queue.pop() {
            let distance = f64::from_bits(bits);
            if distance > distances[v as usize] {
                continue;
            }
            for &(to, length) in self.around(v) {
                let through = distance + length;
                if through < distances[to as usize] {
                    distances[to as usize] = through;
                    queue.push(Reverse((through.to_bits(), to)));
                }
            }
        }
        distances
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Body, Build};

    #[test]
    fn a_body_has_its_tips_at_head_hands_and_feet() {
        let body = Body::new(Build::Template, 8_000);
        let turned: Vec<Vector> = body.mesh.positions().iter().map(|&[x, y, z]| [-x, y, -z]).collect();
        for (positions, sign) in [(body.mesh.positions().to_vec(), 1.0), (turned, -1.0)] {
            let mesh = body.mesh.with_positions(positions).unwrap();
            let figure = Figure::of(&mesh, 1).unwrap();
            assert!((figure.height - 1.73).abs() < 0.03, "{}", figure.height);
            assert!(dot(figure.frame.forwards, [0.0, 0.0, sign]) > 0.9, "{:?}", figure.frame);
            for (tip, name, end) in [
                (Tip::Head, "head", 0.15),
                (Tip::LeftHand, "left_hand", 0.1),
                (Tip::RightHand, "right_hand", 0.1),
                (Tip::LeftFoot, "left_foot", 0.1),
                (Tip::RightFoot, "right_foot", 0.1),
            ] {
                let [x, y, z] = body.skeleton.bones[body.skeleton.find(name).unwrap()].tail;
                let away = distance_squared(figure.tip(tip), [sign * x, y, sign * z]).sqrt();
                assert!(away < end, "{name}: {away}");
            }
            // The knee of the generated body is known.
            let [x, y, z] = body.skeleton.bones[body.skeleton.find("left_shin").unwrap()].head;
            let knee = figure.centre(Tip::LeftFoot, (0.12 + 0.246) * figure.height).unwrap();
            assert!(distance_squared(knee, [sign * x, y, sign * z]).sqrt() < 0.1, "{knee:?}");
        }
    }

    #[test]
    fn other_shapes_have_no_figure() {
        let mesh = |name: &str| crate::mesh_source::load(name).unwrap().mesh;
        for name in ["grid:8", "sphere:0"] {
            assert!(Figure::of(&mesh(name), 1).is_err(), "{name}");
        }
    }
}
