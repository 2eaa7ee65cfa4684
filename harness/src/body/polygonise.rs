//! A first mesh of an implicit surface: marching tetrahedra (Doi and Koide 1991) on a
//! jittered lattice.

use super::random::Random;
use super::surface::Surface;
use crate::vector::{Vector, lerp};
use rayon::prelude::*;

/// Values of the implicit function on a lattice whose points are displaced at random, so that no regular pattern of
/// the lattice survives in the mesh.
struct Lattice {
    size: [usize; 3],
    points: Vec<Vector>,
    values: Vec<f64>,
}

/// Displacement of a lattice point along each axis, in spacings. Below 0.5 no cell turns inside out.
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

    /// The vertex where the surface crosses the lattice edge from the lower to the higher of two points that a
    /// tetrahedron shares; each edge has one vertex.
    fn crossing(&self, from: usize, to: usize) -> Vector {
        let (a, b) = (self.values[from], self.values[to]);
        lerp(self.points[from], self.points[to], a / (a - b))
    }
}

/// The six ways from a corner of a cube to the opposite one along its edges, as axes; each is a tetrahedron. The
/// first three are even permutations.
const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]];

/// Corners of a tetrahedron reordered by an even permutation: (the corners inside, which come first).
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
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    // Every edge of a tetrahedron runs from a point by one of seven sums of axes.
    let mut vertex_on = vec![u32::MAX; 8 * lattice.values.len()];
    for cell in lattice.cells() {
        for (path, axes) in PATHS.iter().enumerate() {
            let mut corners = [(cell, 0); 4]; // lattice point, and the axes walked so far as bits
            for (i, &axis) in axes.iter().enumerate() {
                corners[i + 1] = (corners[i].0 + lattice.step(axis), corners[i].1 | 1 << axis);
            }
            let mut vertex = |i: usize, j: usize| {
                let ((from, a), (to, b)) = (corners[i.min(j)], corners[i.max(j)]);
                let vertex = &mut vertex_on[8 * from + (a ^ b)];
                if *vertex == u32::MAX {
                    *vertex = vertices.len() as u32;
                    vertices.push(lattice.crossing(from, to));
                }
                *vertex
            };
            let inside = corners.map(|(point, _)| lattice.inside(point));
            let count = inside.iter().filter(|&&x| x).count();
            let first = |wanted: bool| {
                EVEN.iter().find(|(set, _)| (0..4).all(|i| set.contains(&i) == (inside[i] == wanted)))
            };
            let (faces, flip) = match count {
                1 | 3 => {
                    let [a, b, c, d] = first(count == 1).expect("one corner differs").1;
                    ([Some([vertex(a, b), vertex(a, c), vertex(a, d)]), None], count == 3)
                }
                2 => {
                    let [a, b, c, d] = first(true).expect("two corners are inside").1;
                    let [p, q, r, s] = [vertex(a, c), vertex(a, d), vertex(b, d), vertex(b, c)];
                    ([Some([p, q, r]), Some([p, r, s])], false)
                }
                _ => continue,
            };
            let odd = path >= 3;
            triangles.extend(
                faces.into_iter().flatten().map(|[a, b, c]| if flip != odd { [a, c, b] } else { [a, b, c] }),
            );
        }
    }
    (vertices, triangles)
}
