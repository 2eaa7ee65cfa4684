//! Volumes known on paper, and surfaces brought back to them.

use super::*;
use crate::mesh::TriangleMesh;
use crate::registry::{OpenOptions, find};
use crate::rotation::{Quaternion, about_axis, product, rotate};
use crate::vector::{Vector, add, distance_squared, norm, scale};

/// An octahedron with each face divided into `4^levels`, on the unit sphere about `centre`.
fn sphere(levels: u32, centre: Vector) -> TriangleMesh {
    let mut faces: Vec<[Vector; 3]> = (0..8)
        .map(|i| {
            let sign = |bit: u32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let [x, y, z] = [[sign(0), 0.0, 0.0], [0.0, sign(1), 0.0], [0.0, 0.0, sign(2)]];
            if sign(0) * sign(1) * sign(2) > 0.0 { [x, y, z] } else { [x, z, y] }
        })
        .collect();
    for _ in 0..levels {
        let split = |[a, b, c]: [Vector; 3]| {
            let middle = |p: Vector, q: Vector| add(p, q).map(|x| x / norm(add(p, q)));
            let (d, e, f) = (middle(b, c), middle(c, a), middle(a, b));
            [[a, f, e], [f, b, d], [e, d, c], [d, e, f]]
        };
        faces = faces.into_iter().flat_map(split).collect();
    }
    let (mut positions, mut triangles) = (Vec::<Vector>::new(), Vec::new());
    for face in faces {
        triangles.push(face.map(|p| {
            let same = |q: &Vector| distance_squared(*q, p) < 1e-12;
            positions.iter().position(same).unwrap_or_else(|| {
                positions.push(p);
                positions.len() - 1
            }) as u32
        }));
    }
    TriangleMesh::new(positions.iter().map(|&p| add(p, centre)).collect(), triangles).expect("valid")
}

fn prepared(mesh: &TriangleMesh, threads: usize) -> Result<Inflation, VolumeError> {
    let backend = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
    Inflation::new(&*backend, mesh, threads)
}

/// No rotation, of another length everywhere.
fn unturned(n: usize) -> Vec<Quaternion> {
    (1..=n).map(|i| [i as f64, 0.0, 0.0, 0.0]).collect()
}

fn largest_move(a: &[Vector], b: &[Vector]) -> f64 {
    a.iter().zip(b).map(|(&p, &q)| distance_squared(p, q).sqrt()).fold(0.0, f64::max)
}

/// A sphere, pinched to a bean: far from convex, far from its volume.
fn bean(mesh: &TriangleMesh) -> Vec<Vector> {
    let bend = |&[x, y, z]: &Vector| [x, y * (0.4 + 0.5 * x * x) + 0.3 * x * x, 0.8 * z];
    mesh.positions().iter().map(bend).collect()
}

#[test]
fn the_octahedron_has_its_volume_far_from_the_origin_too() {
    for centre in [[0.0; 3], [1e6, -1e6, 1e6]] {
        let volume = Enclosure::new(&sphere(0, centre)).expect("closed").at_rest();
        assert!((volume - 4.0 / 3.0).abs() < 1e-12, "{volume}");
    }
}

#[test]
fn a_smaller_sphere_grows_back_by_what_it_lacks() {
    let mesh = sphere(3, [3.0, 0.0, 0.0]);
    let mut inflation = prepared(&mesh, 1).expect("closed");
    let mut x: Vec<Vector> = mesh.positions().iter().map(|&[x, y, z]| [0.9 * x, 0.9 * y, 0.9 * z]).collect();
    let step = inflation.restore(1.0, &unturned(x.len()), &mut x).expect("reachable");
    // Smoothing shortens the normals of a sphere by the factor 1 / (1 + 2 l^2 / r^2), l = 0.02 sqrt 3.
    assert!((step - 0.1 * 1.0024).abs() < 5e-4, "{step}");
    assert!((inflation.enclosure().volume(&x) / inflation.enclosure().at_rest() - 1.0).abs() < 1e-14);
    let moved: Vec<Vector> = mesh.positions().iter().map(|&[x, y, z]| [x - 0.3, y, z]).collect();
    assert!(largest_move(&x, &moved) < 5e-3, "{}", largest_move(&x, &moved));
}

#[test]
fn a_bean_gets_any_volume_with_any_number_of_threads() {
    let mesh = sphere(3, [0.0; 3]);
    for ratio in [0.3, 0.6, 1.0, 1.5] {
        let results = [1, 2, 3].map(|threads| {
            let mut inflation = prepared(&mesh, threads).expect("closed");
            let mut x = bean(&mesh);
            inflation.restore(ratio, &unturned(x.len()), &mut x).expect("reachable");
            let reached = inflation.enclosure().volume(&x) / inflation.enclosure().at_rest();
            assert!((reached / ratio - 1.0).abs() < 1e-13, "{ratio}: {reached}");
            x
        });
        assert!(results[0] == results[1] && results[1] == results[2]);
    }
}

#[test]
fn what_keeps_its_volume_stays() {
    let mesh = sphere(3, [0.5, 0.0, 0.0]);
    let mut inflation = prepared(&mesh, 2).expect("closed");
    let mut x = mesh.positions().to_vec();
    assert_eq!(inflation.restore(1.0, &unturned(x.len()), &mut x), Ok(0.0));
    assert_eq!(x, mesh.positions(), "the rest pose, to the bit");
    let turn = product(about_axis(1, 2.0), about_axis(0, 0.7));
    let rigid = |&p: &Vector| add(rotate(turn, p), [5.0, -7.0, 1.0]);
    let moved: Vec<Vector> = mesh.positions().iter().map(rigid).collect();
    x.copy_from_slice(&moved);
    let step = inflation.restore(1.0, &vec![turn; x.len()], &mut x).expect("reachable");
    assert!(step.abs() < 1e-14 && largest_move(&x, &moved) < 1e-14, "{step}");
}

#[test]
fn directions_turn_with_the_surface() {
    // A shrunk sphere that was turned too is the sphere again, turned.
    let mesh = sphere(3, [0.0; 3]);
    let turn = product(about_axis(2, 1.0), about_axis(0, 2.5));
    let turned = |s: f64| mesh.positions().iter().map(|&p| rotate(turn, scale(s, p))).collect::<Vec<_>>();
    let mut x = turned(0.9);
    prepared(&mesh, 1).expect("closed").restore(1.0, &vec![turn; x.len()], &mut x).expect("reachable");
    assert!(largest_move(&x, &turned(1.0)) < 5e-3, "{}", largest_move(&x, &turned(1.0)));
}

#[test]
fn directions_of_triangles_and_parts_that_stand_still() {
    // Inside out: the volume is negative, and grows in size with s below 0.
    let mesh = sphere(2, [0.0; 3]);
    let flipped: Vec<[u32; 3]> = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    let inward = TriangleMesh::new(mesh.positions().to_vec(), flipped).expect("valid");
    let mut inflation = prepared(&inward, 1).expect("closed");
    let mut x: Vec<Vector> = mesh.positions().iter().map(|&p| scale(0.8, p)).collect();
    let step = inflation.restore(1.0, &unturned(x.len()), &mut x).expect("reachable");
    assert!(inflation.enclosure().at_rest() < 0.0 && step < -0.1, "{step}");
    // A second sphere that stands still, and a vertex of no triangle.
    let n = mesh.positions().len() as u32;
    let both: Vec<Vector> = sphere(2, [9.0, 0.0, 0.0])
        .positions()
        .iter()
        .chain(mesh.positions())
        .copied()
        .chain([[4.0; 3]])
        .collect();
    let triangles = mesh.triangles().iter().copied().chain(mesh.triangles().iter().map(|t| t.map(|v| v + n)));
    let pair = TriangleMesh::new(both.clone(), triangles.collect()).expect("valid");
    let mut inflation = prepared(&pair, 1).expect("closed");
    let mut x = both.clone();
    let mut rotations = unturned(x.len());
    rotations[n as usize..].fill([0.0; 4]);
    inflation.restore(1.1, &rotations, &mut x).expect("reachable");
    assert_eq!(x[n as usize..], both[n as usize..]);
    assert!((inflation.enclosure().volume(&x) / inflation.enclosure().at_rest() - 1.1).abs() < 1e-13);
}

#[test]
fn small_holes_are_closed_and_open_surfaces_refused() {
    let mesh = sphere(3, [0.0; 3]);
    let whole = Enclosure::new(&mesh).expect("closed").at_rest();
    let torn = |gone: usize| {
        TriangleMesh::new(mesh.positions().to_vec(), mesh.triangles()[gone..].to_vec()).expect("valid")
    };
    // The fan of three is the triangle that is gone.
    let mut inflation = prepared(&torn(1), 1).expect("a small hole");
    assert!((inflation.enclosure().at_rest() - whole).abs() < 1e-12);
    let mut x = bean(&mesh);
    inflation.restore(1.0, &unturned(x.len()), &mut x).expect("reachable");
    assert!((inflation.enclosure().volume(&x) / whole - 1.0).abs() < 1e-13);
    assert!(matches!(Enclosure::new(&torn(256)), Err(VolumeError::Open { edges }) if edges > 7));
    let flat = TriangleMesh::new(
        mesh.positions().iter().map(|p| [p[0], p[1], 0.0]).collect(),
        mesh.triangles().to_vec(),
    );
    assert_eq!(Enclosure::new(&flat.expect("valid")).unwrap_err(), VolumeError::Nothing { volume: 0.0 });
}

#[test]
fn volumes_out_of_reach_are_errors_and_nothing_moves() {
    let mesh = sphere(2, [0.0; 3]);
    let mut inflation = prepared(&mesh, 1).expect("closed");
    for ratio in [-1.0, f64::NAN, f64::INFINITY] {
        let mut x = mesh.positions().to_vec();
        assert!(
            matches!(
                inflation.restore(ratio, &unturned(x.len()), &mut x),
                Err(VolumeError::Unreachable { .. })
            ),
            "{ratio}"
        );
        assert_eq!(x, mesh.positions());
    }
}
