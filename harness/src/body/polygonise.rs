//! A first mesh of an implicit surface: marching tetrahedra (Doi and Koide 1991) on a jittered lattice.

use super::surface::Surface;
use crate::statistics::random::Random;
use crate::vector::{Vector, lerp};
use rayon::prelude::*;

/// Values of the implicit function on a lattice whose points are displaced at random, so that no regular pattern of
/// the lattice survives in the mesh.
struct Lattice {
    size: [usize; 3],
    points: Vec<Vector>,
    values: Vec<f64>,
}

/// Largest displacement of a lattice point along each axis, in spacings: breaks the pattern, keeps the shape of cells.
/// (The mesh would be a closed manifold with any displacement.)
const JITTER: f64 = 0.2;

impl Lattice {
    fn sample(surface: &Surface, spacing: f64, seed: u64) -> Self {
        let [low, high] = surface.bounding_box();
        let low = low.map(|x| x - 2.0 * spacing);
        let size: [usize; 3] = std::array::from_fn(|i| ((high[i] - low[i]) / spacing).ceil() as usize + 3);
        let point = |index: usize| {
            let place = [index % size[0], index / size[0] % size[1], index / (size[0] * size[1])];
            let mut random = Random::new(seed ^ (index as u64) << 20);
            std::array::from_fn(|i| low[i] + spacing * (place[i] as f64 + JITTER * random.signed_unit()))
        };
        let count = size[0] * size[1] * size[2];
        let (points, values) = (0..count)
            .into_par_iter()
            .map(|index| {
                let p: Vector = point(index);
                (p, surface.at(p).value)
            })
            .unzip();
        Self { size, points, values }
    }

    fn step(&self, axis: usize) -> usize {
        [1, self.size[0], self.size[0] * self.size[1]][axis]
    }

    /// Lattice points with a neighbour ahead along every axis.
    fn cells(&self) -> impl Iterator<Item = usize> {
        let [nx, ny, nz] = self.size;
        let (row, layer) = (self.step(1), self.step(2));
        (0..nz - 1).flat_map(move |z| {
            (0..ny - 1).flat_map(move |y| (0..nx - 1).map(move |x| x + y * row + z * layer))
        })
    }

    fn inside(&self, index: usize) -> bool {
        self.values[index] < 0.0
    }

    /// Where the surface crosses the line between two lattice points, by linear interpolation.
    fn crossing(&self, from: usize, to: usize) -> Vector {
        let (a, b) = (self.values[from], self.values[to]);
        lerp(self.points[from], self.points[to], a / (a - b))
    }
}

/// The six ways from a corner of a cube to the opposite one along its edges, as axes; each is a tetrahedron. The
/// first three are even permutations of the axes and give positively oriented tetrahedra.
const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]];

/// Even permutations of the corners of a tetrahedron that bring one or two chosen corners to the front.
const EVEN: [(&[usize], [usize; 4]); 10] = [
    (&[0], [0, 1, 2, 3]),
    (&[1], [1, 0, 3, 2]),
    (&[2], [2, 3, 0, 1]),
    (&[3], [3, 2, 1, 0]),
    (&[0, 1], [0, 1, 2, 3]),
    (&[0, 2], [0, 2, 3, 1]),
    (&[0, 3], [0, 3, 1, 2]),
    (&[1, 2], [1, 2, 0, 3]),
    (&[1, 3], [1, 3, 2, 0]),
    (&[2, 3], [2, 3, 0, 1]),
];

/// Vertices near the surface and triangles, counter-clockwise seen from outside: always a closed manifold, since every
/// tetrahedron is crossed by at most one sheet and neighbours agree on their common face. Slivers abound.
pub(super) fn polygonise(surface: &Surface, spacing: f64, seed: u64) -> (Vec<Vector>, Vec<[u32; 3]>) {
    let lattice = Lattice::sample(surface, spacing, seed);
    let mut mesh = Mesh {
        // Every edge of a tetrahedron runs from a lattice point by one of seven sums of axes.
        vertex_on: vec![u32::MAX; 8 * lattice.values.len()],
        lattice: &lattice,
        vertices: Vec::new(),
        triangles: Vec::new(),
    };
    for cell in lattice.cells() {
        for (path, axes) in PATHS.iter().enumerate() {
            let mut corners = [(cell, 0); 4];
            for (i, &axis) in axes.iter().enumerate() {
                corners[i + 1] = (corners[i].0 + lattice.step(axis), corners[i].1 | 1 << axis);
            }
            mesh.tetrahedron(corners, path < 3);
        }
    }
    (mesh.vertices, mesh.triangles)
}

/// A corner of a tetrahedron: lattice point, and the axes walked to it from the first corner as bits.
type Corner = (usize, usize);

/// The mesh made so far.
struct Mesh<'a> {
    lattice: &'a Lattice,
    vertex_on: Vec<u32>,
    vertices: Vec<Vector>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh<'_> {
    /// Adds the piece of surface in one tetrahedron: nothing, a triangle, or a quadrilateral.
    fn tetrahedron(&mut self, corners: [Corner; 4], positive: bool) {
        let inside = corners.map(|(point, _)| self.lattice.inside(point));
        let count = inside.iter().filter(|&&x| x).count();
        if count == 0 || count == 4 {
            return;
        }
        // A corner alone on its side comes first, or the two inside.
        let chosen = inside.map(|x| x == (count < 3));
        let brings = |set: &[usize]| (0..4).all(|i| set.contains(&i) == chosen[i]);
        let (_, order) = EVEN.iter().find(|(set, _)| brings(set)).expect("every choice is listed");
        let [a, b, c, d] = order.map(|i| corners[i]);
        if count == 2 {
            let [p, q, r, s] = [(a, c), (a, d), (b, d), (b, c)].map(|edge| self.vertex(edge));
            self.push([p, q, r], positive);
            self.push([p, r, s], positive);
        } else {
            let triangle = [(a, b), (a, c), (a, d)].map(|edge| self.vertex(edge));
            self.push(triangle, positive == (count == 1));
        }
    }

    /// The vertex on an edge of a tetrahedron, made when it is first asked for.
    fn vertex(&mut self, (one, other): (Corner, Corner)) -> u32 {
        let (from, to) = if one.1 < other.1 { (one, other) } else { (other, one) };
        let vertex = &mut self.vertex_on[8 * from.0 + (from.1 ^ to.1)];
        if *vertex == u32::MAX {
            *vertex = self.vertices.len() as u32;
            self.vertices.push(self.lattice.crossing(from.0, to.0));
        }
        *vertex
    }

    fn push(&mut self, [a, b, c]: [u32; 3], positive: bool) {
        self.triangles.push(if positive { [a, b, c] } else { [a, c, b] });
    }
}
