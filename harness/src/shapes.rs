//! Generated meshes by name: `kind:number`, for example `body:50000` or `sphere:7`.
//!
//! All are bit-identical on every machine (no platform libm). Upper limits keep a mistyped number from filling the
//! memory.

use crate::body::{self, Body, Build};
use crate::file::Fault;
use crate::vector::{add, normalize};
use lapsolve::mesh::TriangleMesh;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// A kind of generated mesh.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The name before the colon.
    pub kind: &'static str,
    /// What it is and what the number after the colon means.
    pub meaning: &'static str,
    /// Numbers allowed.
    pub range: RangeInclusive<usize>,
    make: fn(usize) -> TriangleMesh,
}

/// All kinds.
pub const SHAPES: [Shape; 6] = [
    Shape {
        kind: "body",
        meaning: "a male human with N triangles (rounded down to even)",
        range: body::TRIANGLES,
        make: |n| Body::new(Build::Male, n).mesh,
    },
    Shape {
        kind: "body-female",
        meaning: "a female human with N triangles (rounded down to even)",
        range: body::TRIANGLES,
        make: |n| Body::new(Build::Female, n).mesh,
    },
    Shape {
        kind: "body-template",
        meaning: "the human that carries the walk, with N triangles (rounded down to even)",
        range: body::TRIANGLES,
        make: |n| Body::new(Build::Template, n).mesh,
    },
    Shape {
        kind: "sphere",
        meaning: "an icosahedron whose triangles are quartered N times, on the unit sphere",
        range: 0..=9,
        make: sphere,
    },
    Shape {
        kind: "grid",
        meaning: "N x N vertices on the unit square, each cell cut into two right triangles",
        range: 2..=2048,
        make: grid,
    },
    Shape {
        kind: "torus",
        meaning: "2N x N vertices on a torus of radii 1 and 0.4",
        range: 3..=1024,
        make: torus,
    },
];

/// The mesh that `name` asks for; none if the name is not `kind:...` with a kind of [`SHAPES`] (then it is a file).
/// The fault says which numbers are allowed.
pub fn generate(name: &str) -> Option<Result<TriangleMesh, Fault>> {
    let (kind, text) = name.split_once(':')?;
    let Shape { kind, meaning, range, make } = SHAPES.iter().find(|shape| shape.kind == kind)?;
    let number = text.parse().ok().filter(|n| range.contains(n));
    Some(number.map(make).ok_or_else(|| {
        let (low, high) = (range.start(), range.end());
        Fault::new(
            format!("`{text}` is not a whole number from {low} to {high}"),
            format!("`{kind}:N` is {meaning}, with N from {low} to {high}"),
        )
    }))
}

fn mesh(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> TriangleMesh {
    TriangleMesh::new(positions, triangles).expect("shapes are finite and index their own vertices")
}

/// Icosphere: 20 x 4^level triangles, 10 x 4^level + 2 vertices, oriented outwards. Level 7 has 327,680 triangles.
fn sphere(level: usize) -> TriangleMesh {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut positions = Vec::new();
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        positions.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]].map(normalize));
    }
    let mut triangles = icosahedron_faces(&positions);
    for _ in 0..level {
        quarter(&mut positions, &mut triangles);
    }
    mesh(positions, triangles)
}

/// The 20 faces: the triples of vertices that are mutual nearest neighbours, counter-clockwise seen from outside.
fn icosahedron_faces(p: &[[f64; 3]]) -> Vec<[u32; 3]> {
    use crate::vector::{area_normal, dot, sub};
    // Squared edge on the unit sphere 1.106, next distance 2.894.
    let near = |i: usize, j: usize| dot(sub(p[i], p[j]), sub(p[i], p[j])) < 2.0;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outwards = dot(area_normal(p[a], p[b], p[c]), p[a]) > 0.0;
                    let face = if outwards { [a, b, c] } else { [a, c, b] };
                    faces.push(face.map(|v| v as u32));
                }
            }
        }
    }
    faces
}

/// Cuts every triangle into four; new vertices go to the unit sphere.
fn quarter(positions: &mut Vec<[f64; 3]>, triangles: &mut Vec<[u32; 3]>) {
    let mut middle_of = BTreeMap::new();
    let mut middle = |a: u32, b: u32| {
        *middle_of.entry((a.min(b), a.max(b))).or_insert_with(|| {
            positions.push(normalize(add(positions[a as usize], positions[b as usize])));
            positions.len() as u32 - 1
        })
    };
    *triangles = triangles
        .iter()
        .flat_map(|&[a, b, c]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        })
        .collect();
}

/// n x n vertices (row by row, x fastest) with spacing 1/(n-1) in the plane z = 0, facing +z. All cells are cut along
/// the diagonal from (0, 0) to (1, 1): the angles opposite to it are right, its cotangent weight is 0, and L is
/// exactly the 5-point stencil with weights 1 inside and 1/2 on boundary edges.
fn grid(n: usize) -> TriangleMesh {
    let step = (n - 1) as f64;
    let positions = (0..n * n).map(|v| [(v % n) as f64 / step, (v / n) as f64 / step, 0.0]).collect();
    let cells = (0..(n - 1) * (n - 1)).map(|cell| (cell / (n - 1) * n + cell % (n - 1)) as u32);
    let row = n as u32;
    mesh(positions, cells.flat_map(|v| [[v, v + 1, v + row + 1], [v, v + row + 1, v + row]]).collect())
}

/// 2n x n vertices around the ring and around the tube, 4 n^2 triangles, oriented outwards; the ring lies in z = 0.
fn torus(n: usize) -> TriangleMesh {
    let angle = |i: usize, count: usize| 2.0 * std::f64::consts::PI * i as f64 / count as f64;
    let mut positions = Vec::with_capacity(2 * n * n);
    for ring in 0..2 * n {
        let (sin, cos) = libm::sincos(angle(ring, 2 * n));
        for tube in 0..n {
            let (up, out) = libm::sincos(angle(tube, n));
            let radius = 1.0 + 0.4 * out;
            positions.push([radius * cos, radius * sin, 0.4 * up]);
        }
    }
    let vertex = |ring: usize, tube: usize| (ring % (2 * n) * n + tube % n) as u32;
    let mut triangles = Vec::with_capacity(4 * n * n);
    for ring in 0..2 * n {
        for tube in 0..n {
            let [a, b] = [vertex(ring, tube), vertex(ring + 1, tube)];
            let [c, d] = [vertex(ring + 1, tube + 1), vertex(ring, tube + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh(positions, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{area_normal, cross, dot, norm};
    use lapsolve::topology::Topology;

    fn made(name: &str) -> TriangleMesh {
        generate(name).expect("a known kind").expect("a number in range")
    }

    /// Area and enclosed volume.
    fn area_and_volume(mesh: &TriangleMesh) -> (f64, f64) {
        let at = |v: u32| mesh.positions()[v as usize];
        mesh.triangles().iter().fold((0.0, 0.0), |(area, volume), &[a, b, c]| {
            let [a, b, c] = [at(a), at(b), at(c)];
            (area + 0.5 * norm(area_normal(a, b, c)), volume + dot(a, cross(b, c)) / 6.0)
        })
    }

    #[test]
    fn sphere_and_torus_are_closed_and_have_the_area_and_volume_of_the_smooth_surface() {
        use std::f64::consts::PI;
        for (name, triangles, euler, area, volume) in [
            ("sphere:5", 20_480, 2, 4.0 * PI, 4.0 / 3.0 * PI),
            ("torus:100", 40_000, 0, 4.0 * PI * PI * 0.4, 2.0 * PI * PI * 0.16),
        ] {
            let mesh = made(name);
            let found = Topology::of(&mesh);
            assert!(found.is_manifold() && found.is_closed() && found.clashing_edges.count == 0, "{name}");
            assert_eq!(mesh.triangles().len(), triangles);
            assert_eq!(mesh.positions().len() as i64 - triangles as i64 / 2, euler);
            let (found_area, found_volume) = area_and_volume(&mesh);
            assert!((found_area / area - 1.0).abs() < 2e-3 && found_area < area, "{name}: area {found_area}");
            assert!(
                (found_volume / volume - 1.0).abs() < 3e-3 && found_volume < volume,
                "{name}: {found_volume}"
            );
        }
    }

    #[test]
    fn grid_covers_the_unit_square_and_faces_up() {
        let mesh = made("grid:5");
        assert_eq!((mesh.positions().len(), mesh.triangles().len()), (25, 32));
        assert!((area_and_volume(&mesh).0 - 1.0).abs() < 1e-15);
        let at = |v: u32| mesh.positions()[v as usize];
        for &[a, b, c] in mesh.triangles() {
            assert!(area_normal(at(a), at(b), at(c))[2] > 0.0);
        }
    }

    #[test]
    fn names_of_no_known_kind_are_files_and_bad_numbers_say_what_is_allowed() {
        for file in ["a.ply", "mesh:7", "C:/a.ply", "sphere"] {
            assert!(generate(file).is_none(), "{file}");
        }
        for bad in ["sphere:10", "sphere:", "sphere:-1", "sphere:x", "body:999", "body:2000001", "grid:1"] {
            let message = generate(bad).expect("known").expect_err("out of range").to_string();
            assert!(message.contains("is not a whole number from"), "{bad}: {message}");
        }
    }
}
