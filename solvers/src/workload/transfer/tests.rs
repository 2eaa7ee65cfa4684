//! Whole frames on small meshes with the dense backend.

use super::defaults::{default_marks, default_problem, thinned};
use super::*;
use crate::registry::{OpenOptions, find};
use crate::rotation::{about_axis, product, rotate};
use crate::vector::{Vector, add, distance_squared, norm, scale, sub};
use crate::workload::twist::Twist;

/// A closed tube of 12 x `rings` vertices with pinched ends, its axis along x, `bump` making it irregular.
pub(crate) fn tube(rings: u32, bump: f64, centre: Vector) -> TriangleMesh {
    const AROUND: u32 = 12;
    let point = |ring: u32, i: u32| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(AROUND);
        let along = f64::from(ring) / f64::from(rings - 1);
        let radius =
            0.05 + (std::f64::consts::PI * along).sin() * (1.0 + bump * (3.0 * angle + 9.0 * along).sin());
        add(centre, [8.0 * along, radius * angle.cos(), radius * angle.sin()])
    };
    let positions = (0..rings).flat_map(|r| (0..AROUND).map(move |i| point(r, i))).collect();
    let at = |r: u32, i: u32| AROUND * r + i % AROUND;
    let side = (0..rings - 1).flat_map(|r| (0..AROUND).map(move |i| (r, i))).flat_map(|(r, i)| {
        [[at(r, i), at(r, i + 1), at(r + 1, i)], [at(r, i + 1), at(r + 1, i + 1), at(r + 1, i)]]
    });
    let last = rings - 1;
    let caps = (1..AROUND - 1)
        .flat_map(|i| [[at(0, 0), at(0, i + 1), at(0, i)], [at(last, 0), at(last, i), at(last, i + 1)]]);
    TriangleMesh::new(positions, side.chain(caps).collect()).expect("valid")
}

/// Two meshes in one.
pub(crate) fn together(a: &TriangleMesh, b: &TriangleMesh) -> TriangleMesh {
    let shift = a.positions().len() as u32;
    let moved = b.triangles().iter().map(|t| t.map(|v| v + shift));
    let positions = a.positions().iter().chain(b.positions()).copied().collect();
    TriangleMesh::new(positions, a.triangles().iter().copied().chain(moved).collect()).expect("valid")
}

fn frames_of(problem: &TransferProblem) -> Transfer {
    let backend = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
    Transfer::prepare(&*backend, problem, &mut |_| {}).expect("positive definite")
}

fn frame(transfer: &mut Transfer, template: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut target = vec![[f64::NAN; 3]; transfer.problem().target().positions().len()];
    transfer.frame(template, &mut target).expect("solvable");
    target
}

/// Largest distance between corresponding points, relative to the diagonal.
pub(crate) fn error(mesh: &TriangleMesh, a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let larger = |m: f64, d: f64| if d.is_nan() { f64::INFINITY } else { m.max(d) };
    a.iter().zip(b).map(|(&p, &q)| distance_squared(p, q).sqrt()).fold(0.0, larger) / mesh.diagonal()
}

fn rigid(points: &[[f64; 3]], by: crate::rotation::Quaternion, and: Vector) -> Vec<[f64; 3]> {
    points.iter().map(|&p| add(rotate(by, p), and)).collect()
}

#[test]
fn the_identity_pose_returns_the_target() {
    let template = tube(10, 0.0, [5.0, -3.0, 2.0]);
    let target = tube(20, 0.3, [0.0; 3]);
    let pairs: Vec<(u32, u32)> = (0..40).map(|i| (5 * i, 11 * i)).collect();
    let problem = TransferProblem::new(&template, target.clone(), &pairs, Weights::Plain).expect("usable");
    let moved = frame(&mut frames_of(&problem), template.positions());
    assert!(error(&target, &moved, target.positions()) < 1e-13);
}

#[test]
fn a_rigid_motion_of_the_template_moves_the_target_rigidly() {
    let template = tube(10, 0.0, [5.0, -3.0, 2.0]);
    // The target lies turned, at half the size: A and s are not trivial.
    let posed = tube(20, 0.3, [0.0; 3]);
    let lying = rigid(posed.positions(), about_axis(2, 1.2), [1.0, 1.0, -1.0])
        .iter()
        .map(|&p| scale(0.5, p))
        .collect();
    let target = posed.with_positions(lying).expect("finite");
    let pairs: Vec<(u32, u32)> = (0..40).map(|i| (5 * i, 11 * i)).collect();
    let problem = TransferProblem::new(&template, target.clone(), &pairs, Weights::Plain).expect("usable");
    let a = *problem.marks().alignment();
    let mut transfer = frames_of(&problem);
    for angle in [0.5, 3.1, -2.0] {
        let q = product(about_axis(1, angle), about_axis(0, 0.4));
        let step = [4.0, -2.0, 7.0];
        let moved = frame(&mut transfer, &rigid(template.positions(), q, step));
        // x = s A p + d must go to s A (q p + step) + d = Q (x - d) + s A step + d with Q = A q A^-1.
        let turn = product(product(a.rotation, q), crate::rotation::conjugate(a.rotation));
        let shift = scale(a.scale, rotate(a.rotation, step));
        let expected: Vec<_> = target
            .positions()
            .iter()
            .map(|&x| add(add(rotate(turn, sub(x, a.translation)), shift), a.translation))
            .collect();
        assert!(error(&target, &moved, &expected) < 1e-12, "{}", error(&target, &moved, &expected));
    }
}

#[test]
fn per_corner_clamped_weights_are_the_same_on_both_sides() {
    let mesh = tube(20, 0.3, [0.0; 3]);
    let problem = TransferProblem::new(&mesh, mesh.clone(), &default_marks(&mesh), Weights::ClampedPerCorner)
        .expect("usable");
    let moved = frame(&mut frames_of(&problem), mesh.positions());
    assert!(error(&mesh, &moved, mesh.positions()) < 1e-13);
    for weights in [Weights::ClampedPerEdge, Weights::IntrinsicDelaunay] {
        let refused = TransferProblem::new(&mesh, mesh.clone(), &[(0, 0)], weights).map(|_| ());
        assert_eq!(refused, Err(TransferError::Weights { weights }));
    }
}

#[test]
fn the_order_of_vertices_and_marks_does_not_matter() {
    let mesh = tube(20, 0.3, [0.0; 3]);
    let n = mesh.positions().len() as u32;
    let twist = Twist::of(&mesh);
    let mut pose = mesh.positions().to_vec();
    twist.frame(39, &mut pose);
    let marks = default_marks(&mesh);
    let problem = TransferProblem::new(&mesh, mesh.clone(), &marks, Weights::Plain).expect("usable");
    let expected = frame(&mut frames_of(&problem), &pose);

    let new_place = |v: u32| (v * 77 + 5) % n; // 77 and n = 240 have no common divisor
    let mut positions = vec![[0.0; 3]; n as usize];
    (0..n).for_each(|v| positions[new_place(v) as usize] = mesh.positions()[v as usize]);
    let triangles = mesh.triangles().iter().map(|t| t.map(new_place)).collect();
    let shuffled = TriangleMesh::new(positions, triangles).expect("valid");
    let backwards: Vec<_> = marks.iter().rev().copied().collect();
    let problem = TransferProblem::new(&mesh, shuffled, &backwards, Weights::Plain).expect("usable");
    let moved = frame(&mut frames_of(&problem), &pose);
    let back: Vec<_> = (0..n).map(|v| moved[new_place(v) as usize]).collect();
    assert!(error(&mesh, &back, &expected) < 1e-12, "{}", error(&mesh, &back, &expected));
}

#[test]
fn a_twist_follows_the_marks() {
    let mesh = tube(30, 0.1, [0.0; 3]);
    let problem = default_problem(&mesh).expect("usable");
    let twist = Twist::of(&mesh);
    let mut pose = mesh.positions().to_vec();
    twist.frame(39, &mut pose);
    let mut transfer = frames_of(&problem);
    let moved = frame(&mut transfer, &pose);
    // 64 marks on 700 triangles: the interpolated motion stays within a few percent of the twist itself.
    assert!(error(&mesh, &moved, &pose) < 0.03, "{}", error(&mesh, &moved, &pose));
    assert!(error(&mesh, &moved, mesh.positions()) > 0.05, "and it does move");
    assert_eq!(transfer.replaced(), 0);
    let trace = transfer.trace().expect("kept");
    for column in 0..3 {
        let sum: f64 = trace.rhs.iter().skip(column).step_by(3).sum();
        assert!(sum.abs() < 1e-12, "U sums to zero: {sum}");
    }
}

#[test]
fn marked_components_keep_their_own_translation() {
    let (a, b) = (tube(10, 0.2, [0.0; 3]), tube(12, 0.1, [0.0, 20.0, 0.0]));
    let both = together(&a, &b);
    let first = a.triangles().len() as u32;
    let pairs: Vec<_> =
        (0..20).map(|i| (7 * i, 7 * i)).chain((0..20).map(|i| (first + 8 * i, first + 8 * i))).collect();
    let problem = TransferProblem::new(&both, both.clone(), &pairs, Weights::Plain).expect("usable");
    // The two parts of the template go different ways.
    let n = a.positions().len();
    let mut pose = rigid(&both.positions()[..n], about_axis(0, 1.0), [0.0, 0.0, 5.0]);
    pose.extend(rigid(&both.positions()[n..], about_axis(1, -0.7), [3.0, 0.0, 0.0]));
    let moved = frame(&mut frames_of(&problem), &pose);
    assert!(error(&both, &moved, &pose) < 1e-12, "{}", error(&both, &moved, &pose));
}

#[test]
fn components_without_marks_follow_and_unused_vertices_stay() {
    let body = tube(10, 0.2, [0.0; 3]);
    let both = together(&body, &tube(6, 0.0, [1.0, 3.0, 0.0]));
    let n = body.positions().len();
    let mut positions = both.positions().to_vec();
    positions.push([100.0, 100.0, 100.0]);
    let target = TriangleMesh::new(positions, both.triangles().to_vec()).expect("valid");
    let pairs: Vec<_> = (0..20).map(|i| (7 * i, 7 * i)).collect();
    let problem = TransferProblem::new(&body, target.clone(), &pairs, Weights::Plain).expect("usable");
    assert_eq!(problem.pieces().detached().len(), 1);
    assert_eq!(problem.pieces().unreferenced(), [target.positions().len() as u32 - 1]);
    let (q, step) = (about_axis(2, 0.9), [1.0, 2.0, 3.0]);
    let moved = frame(&mut frames_of(&problem), &rigid(body.positions(), q, step));
    let expected = rigid(&target.positions()[..target.positions().len() - 1], q, step);
    assert!(error(&target, &moved[..expected.len()], &expected) < 1e-12);
    assert_eq!(moved[expected.len()], [100.0; 3]);
    assert!(norm(sub(moved[n], target.positions()[n])) > 1.0, "the detached part moved");
}

#[test]
fn thinning_keeps_usable_pairs_apart() {
    let mesh = tube(10, 0.2, [0.0; 3]);
    let all: Vec<_> = (0..mesh.triangles().len() as u32).map(|t| (t, t)).collect();
    let few = thinned(&mesh, &mesh, &all, 30).expect("in range");
    assert_eq!(few.len(), 30);
    assert_eq!(few, default_marks(&mesh)[..30], "the same sampling as the default marks");
    assert!(thinned(&mesh, &mesh, &[(0, 9999)], 3).is_err());
}
