//! What heat-equilibrium weights must fulfil, on shapes small enough for the dense backend.

use super::*;
use crate::registry::{OpenOptions, find};

fn backend() -> Box<dyn Backend> {
    (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there")
}

/// A closed box with square sections along x, from 0 to `length`, `around` from the axis; two triangles per square.
fn bar(length: u32, half: f64, y: f64, first: u32) -> (Vec<Vector>, Vec<[u32; 3]>) {
    let section = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let positions = (0..=length)
        .flat_map(|s| section.map(|[a, b]| [f64::from(s) * 2.0 * half, y + half * a, half * b]))
        .collect();
    let at = |s: u32, c: u32| first + 4 * s + c % 4;
    let mut triangles: Vec<[u32; 3]> = (0..length)
        .flat_map(|s| (0..4).map(move |c| (s, c)))
        .flat_map(|(s, c)| {
            [[at(s, c), at(s, c + 1), at(s + 1, c)], [at(s + 1, c), at(s, c + 1), at(s + 1, c + 1)]]
        })
        .collect();
    triangles.extend([[0, 2, 1], [0, 3, 2]].map(|t| t.map(|c| at(0, c))));
    triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|c| at(length, c))));
    (positions, triangles)
}

/// A bar of length 10 with two bones along its axis that meet at x = 5.
fn elbow() -> (TriangleMesh, Vec<Bone>) {
    let (positions, triangles) = bar(10, 0.5, 0.0, 0);
    let bones = vec![
        Bone::segment([0.5, 0.0, 0.0], [5.0, 0.0, 0.0]),
        Bone::segment([5.0, 0.0, 0.0], [9.5, 0.0, 0.0]),
    ];
    (TriangleMesh::new(positions, triangles).expect("valid"), bones)
}

fn weights(mesh: &TriangleMesh, bones: &[Bone], heat: f64) -> (SkinningProblem, Vec<f64>) {
    let problem = SkinningProblem::new(mesh, bones, heat).expect("usable");
    let weights = problem.weights(&*backend()).expect("definite");
    (problem, weights)
}

#[test]
fn weights_are_a_partition_of_one_and_pass_from_bone_to_bone() {
    let (mesh, bones) = elbow();
    let (problem, w) = weights(&mesh, &bones, HEAT);
    assert!(problem.heat().iter().all(|&h| h > 0.0), "every bone is visible");
    for (v, row) in w.chunks(2).enumerate() {
        assert!(
            (row[0] + row[1] - 1.0).abs() < 1e-12 && row.iter().all(|x| (0.0..=1.0).contains(x)),
            "{row:?}"
        );
        let x = mesh.positions()[v][0];
        assert!(if x < 4.9 { row[0] > row[1] } else { x < 5.1 || row[0] < row[1] }, "{x}: {row:?}");
        if x == 5.0 {
            assert_eq!(problem.nearest(v), [0, 1], "shared at the joint");
        }
    }
}

#[test]
fn weights_sum_to_one_on_slivers() {
    // One corner almost on its neighbour: the rounding of cotangents of 1e7 beside faint heat.
    let (mut positions, triangles) = bar(10, 0.5, 0.0, 0);
    let bent = |i: usize, p: Vector| std::array::from_fn(|c| p[c] + 0.03 * ((7 * i + c) as f64).sin());
    positions = (0..).zip(positions).map(|(i, p)| bent(i, p)).collect();
    positions[20] = [positions[16][0] + 1e-7, positions[16][1], positions[16][2]];
    let mesh = TriangleMesh::new(positions, triangles).expect("valid");
    let (_, bones) = elbow();
    let problem = SkinningProblem::new(&mesh, &bones, 1e-6).expect("usable");
    let rhs = problem.right_hand_side();
    let (rows, mut raw) = (problem.system().vertices().len(), vec![0.0; rhs.len()]);
    let mut factor = backend()
        .prepare(problem.system().system(), &PrepareOptions::columns(2), &mut |_| {})
        .expect("definite");
    factor.solve(Columns::new(&rhs[..], rows, 2), Columns::new(&mut raw[..], rows, 2)).expect("solved");
    let off = |w: &[f64]| w.chunks(2).map(|row| (row[0] + row[1] - 1.0).abs()).fold(0.0, f64::max);
    assert!(off(&raw) > 1e-8, "no sliver: {:e}", off(&raw));
    let weights = problem.weights(&*backend()).expect("definite");
    assert!(off(&weights) < 1e-15, "{:e}", off(&weights));
    // What makes no weights is not made to look like some.
    for bad in [[0.0, 0.0], [1.0, -2.0], [f64::NAN, 1.0], [f64::INFINITY, 1.0]] {
        raw[..2].copy_from_slice(&bad);
        let kept = problem.weights_of(Columns::new(&raw[..], rows, 2));
        assert_eq!(format!("{:?}", &kept[..2]), format!("{bad:?}"));
    }
}

#[test]
fn strong_heat_leaves_only_the_nearest_bone() {
    let (mesh, bones) = elbow();
    for (heat, limit) in [(1e4, 1e-3), (1e8, 1e-7)] {
        let (problem, w) = weights(&mesh, &bones, heat);
        for (v, row) in w.chunks(2).enumerate() {
            let nearest = problem.nearest(v);
            let p = |j: u32| if nearest.contains(&j) { 1.0 / nearest.len() as f64 } else { 0.0 };
            assert!((row[0] - p(0)).abs() < limit && (row[1] - p(1)).abs() < limit, "{heat} {row:?}");
        }
    }
}

#[test]
fn bones_behind_the_surface_give_no_heat() {
    // Two bars side by side; the bone of the second lies in the first, nearer to its wall than the first's own bone.
    let ((mut positions, mut triangles), other) = (bar(10, 0.5, 0.0, 0), bar(10, 0.5, 1.2, 44));
    positions.extend(other.0);
    triangles.extend(other.1);
    let mesh = TriangleMesh::new(positions, triangles).expect("valid");
    let own = Bone::segment([0.5, 0.0, 0.0], [9.5, 0.0, 0.0]);
    let problem = SkinningProblem::new(&mesh, std::slice::from_ref(&own), HEAT).expect("usable");
    assert!(problem.heat()[..44].iter().all(|&h| h > 0.0));
    // The near wall of the second bar sees the bone through the wall of the first only.
    let lit: Vec<usize> = (44..88).filter(|&v| problem.heat()[v] > 0.0).collect();
    assert_eq!(lit.len(), 1, "one vertex of a component that sees nothing: {lit:?}");
    let far = Bone::segment([0.5, 9.0, 0.0], [0.6, 9.0, 0.0]);
    let (_, w) = weights(&mesh, &[own, far], HEAT);
    assert!(w[88..].chunks(2).all(|row| (row[0] - 1.0).abs() < 1e-12 && row[1].abs() < 1e-12));
}

#[test]
fn unused_vertices_stay_and_units_do_not_matter() {
    let (mesh, bones) = elbow();
    let (_, plain) = weights(&mesh, &bones, HEAT);
    for exponent in [-600, 600] {
        let scale = |p: Vector| p.map(|x| times_power_of_two(x, exponent));
        let mut positions: Vec<Vector> = mesh.positions().iter().map(|&p| scale(p)).collect();
        positions.push([0.0; 3]);
        let scaled = TriangleMesh::new(positions, mesh.triangles().to_vec()).expect("finite");
        let bones: Vec<Bone> =
            bones.iter().map(|b| Bone { segments: vec![b.segments[0].map(scale)] }).collect();
        let (problem, w) = weights(&scaled, &bones, HEAT);
        assert_eq!(&w[w.len() - 2..], [0.0, 0.0]);
        let skin = Skin::new(scaled.positions(), Columns::new(&w[..], w.len() / 2, 2), 2);
        assert!(skin.influences(w.len() / 2 - 1).is_empty());
        assert_eq!(problem.system().vertices().len(), mesh.positions().len());
        assert!(w.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-12), "2^{exponent}");
    }
}

#[test]
fn bad_bones_are_named() {
    let (mesh, bones) = elbow();
    let new = |bones: &[Bone], heat| SkinningProblem::new(&mesh, bones, heat).map(|_| ()).unwrap_err();
    assert_eq!(new(&[], HEAT), SkinningError::NoBones);
    assert_eq!(new(&[Bone::default()], HEAT), SkinningError::NoBones);
    let bad = [bones[0].clone(), Bone::segment([0.0; 3], [f64::INFINITY, 0.0, 0.0])];
    assert_eq!(new(&bad, HEAT), SkinningError::NonFinite { bone: 1 });
    assert!(matches!(new(&bones, 0.0), SkinningError::Heat { .. }));
    assert!(matches!(new(&vec![bones[0].clone(); 2000], HEAT), SkinningError::TooMany { count: 2000 }));
    let flat = TriangleMesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]]).expect("valid");
    let nothing = SkinningProblem::new(&flat, &bones, HEAT);
    assert!(nothing.is_err() || nothing.is_ok_and(|p| p.system().vertices().is_empty()));
}
