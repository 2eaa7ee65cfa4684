//! What deformations must fulfil, on shapes small enough for the dense backend.

use super::*;
use crate::registry::{OpenOptions, find};
use crate::rotation::{about_axis, product, rotate};
use crate::vector::{Vector, add};

fn backend(id: &str, threads: usize) -> Box<dyn Backend> {
    let options = OpenOptions { threads, ..OpenOptions::default() };
    (find(id).expect("built in").open)(&options).expect("always there")
}

/// A wavy sheet of 9 x 7 vertices and, apart from it, a vertex of no triangle.
fn sheet() -> TriangleMesh {
    let (nx, ny) = (9_u32, 7_u32);
    let mut positions: Vec<Vector> = (0..nx * ny)
        .map(|v| (f64::from(v % nx), f64::from(v / nx)))
        .map(|(x, y)| [x, y, 0.4 * (0.9 * x).sin() * (1.3 * y).cos()])
        .collect();
    positions.push([50.0; 3]);
    let triangles = (0..(nx - 1) * (ny - 1))
        .map(|i| i % (nx - 1) + nx * (i / (nx - 1)))
        .flat_map(|v| [[v, v + 1, v + nx], [v + 1, v + nx + 1, v + nx]])
        .collect();
    TriangleMesh::new(positions, triangles).expect("valid")
}

const CORNERS: [u32; 4] = [0, 8, 54, 62];

fn prepared(mesh: &TriangleMesh, handles: &[u32], weights: Weights, threads: usize) -> Arap {
    let problem = ArapProblem::new(mesh, handles, weights).expect("usable");
    Arap::prepare(&*backend("framechol-f64", threads), &problem, &mut |_| {}).expect("definite")
}

fn largest_distance(a: &[Vector], b: &[Vector]) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

#[test]
fn handles_in_place_change_nothing() {
    let mesh = sheet();
    let mut arap = prepared(&mesh, &CORNERS, Weights::Plain, 1);
    let handles = CORNERS.map(|v| mesh.positions()[v as usize]);
    let mut x = vec![[9.0; 3]; 64];
    for iterations in [0, 1, 5] {
        arap.solve(&handles, iterations, &mut x).expect("solves");
        assert!(largest_distance(&x, mesh.positions()) < 1e-12, "{iterations}");
    }
    assert!(arap.energy() < 1e-20);
}

#[test]
fn rigidly_moved_handles_move_the_mesh_rigidly() {
    let mesh = sheet();
    let mut arap = prepared(&mesh, &CORNERS, Weights::ClampedPerEdge, 1);
    for angle in [0.3, 1.5, 3.0] {
        let q = product(about_axis(2, angle), about_axis(0, 0.7));
        let moved = |p: Vector| add(rotate(q, p), [1.0, -2.0, 3.0]);
        let handles = CORNERS.map(|v| moved(mesh.positions()[v as usize]));
        let mut x = vec![[0.0; 3]; 64];
        arap.solve(&handles, 2000, &mut x).expect("solves");
        let expected: Vec<Vector> = mesh.positions()[..63].iter().map(|&p| moved(p)).collect();
        assert!(largest_distance(&x[..63], &expected) < 1e-10, "{angle}"); // 0.002 after 400
        assert_eq!(x[63], mesh.positions()[63], "a vertex of no triangle stays");
        // From the answer itself nothing moves any more.
        arap.resume(&handles, &expected.iter().copied().chain([[50.0; 3]]).collect::<Vec<_>>())
            .expect("finite");
        arap.iterate(3).expect("solves");
        arap.write(&mut x);
        assert!(largest_distance(&x[..63], &expected) < 1e-12, "{angle}");
    }
}

#[test]
fn the_energy_never_rises_and_falls_at_first() {
    let mesh = sheet();
    let (vertices, targets) = defaults::handles(&mesh);
    let (vertices, mut targets) = (vertices[..12].to_vec(), targets[..12].to_vec());
    targets.iter_mut().for_each(|p| p[2] += 0.3 * p[0]);
    let mut arap = prepared(&mesh, &vertices, Weights::ClampedPerEdge, 1);
    arap.start(&targets).expect("solves");
    let (first, mut before) = (arap.energy(), arap.energy());
    for _ in 0..30 {
        arap.iterate(1).expect("solves");
        let now = arap.energy();
        assert!(now <= before * (1.0 + 1e-12), "{now} {before}");
        before = now;
    }
    assert!(before < 0.7 * first, "{before} {first}");
}

/// An iteration written as the paper has it: dense, one rotation by the robust fit per vertex.
fn plain_iteration(
    mesh: &TriangleMesh,
    l: &SymmetricCsr,
    fixed: &[u32],
    x: &[Vector],
    start: bool,
) -> Vec<Vector> {
    let n = mesh.positions().len();
    let p = mesh.positions();
    let mut w = vec![vec![0.0; n]; n];
    for i in 0..n {
        for (&j, &v) in l.row(i).0.iter().zip(l.row(i).1).skip(1) {
            (w[i][j as usize], w[j as usize][i]) = (-v, -v);
        }
    }
    let rotations: Vec<_> = (0..n)
        .map(|i| {
            let mut s = [[0.0; 3]; 3];
            for j in 0..n {
                for a in 0..3 {
                    for b in 0..3 {
                        s[a][b] += w[i][j] * (p[i][a] - p[j][a]) * (x[i][b] - x[j][b]);
                    }
                }
            }
            if start { crate::rotation::IDENTITY } else { polar::robust(&s) }
        })
        .collect();
    let mut rhs = vec![0.0; 3 * n];
    for i in 0..n {
        for j in 0..n {
            let e = std::array::from_fn(|c| 0.5 * w[i][j] * (p[i][c] - p[j][c]));
            let (a, b) = (rotate(rotations[i], e), rotate(rotations[j], e));
            (0..3).for_each(|c| rhs[3 * i + c] += a[c] + b[c]);
        }
    }
    let problem = Dirichlet::new(l.clone(), None, fixed).expect("usable");
    let (free, handles) = (problem.free(), problem.fixed());
    let given: Vec<f64> = handles.iter().flat_map(|&v| x[v as usize]).collect();
    let mut b = vec![0.0; 3 * free.len()];
    problem
        .right_hand_side(Columns::new(&given[..], handles.len(), 3), Columns::new(&mut b[..], free.len(), 3));
    for (row, &v) in b.chunks_mut(3).zip(free) {
        (0..3).for_each(|c| row[c] += rhs[3 * v as usize + c]);
    }
    let system = problem.system().expect("free vertices");
    let mut factor =
        backend("dense", 1).prepare(system, &PrepareOptions::columns(3), &mut |_| {}).expect("definite");
    let mut solution = vec![0.0; b.len()];
    factor
        .solve(Columns::new(&b[..], free.len(), 3), Columns::new(&mut solution[..], free.len(), 3))
        .expect("solves");
    let mut next = x.to_vec();
    for (&v, row) in free.iter().zip(solution.as_chunks().0) {
        next[v as usize] = *row;
    }
    next
}

#[test]
fn iterations_follow_the_definition_and_any_number_of_threads() {
    let mesh = sheet();
    let turned = |v: u32| rotate(about_axis(1, 0.02 * f64::from(v)), mesh.positions()[v as usize]);
    let handles = CORNERS.map(turned);
    for weights in [Weights::Plain, Weights::ClampedPerEdge] {
        let l = Laplacian::assemble(&mesh, weights).into_matrix();
        let mut expected = mesh.positions().to_vec();
        CORNERS.iter().zip(handles).for_each(|(&v, h)| expected[v as usize] = h);
        expected = plain_iteration(&mesh, &l, &CORNERS, &expected, true);
        for _ in 0..3 {
            expected = plain_iteration(&mesh, &l, &CORNERS, &expected, false);
        }
        let mut first = Vec::new();
        for threads in [1, 2, 3] {
            let mut arap = prepared(&mesh, &CORNERS, weights, threads);
            let mut x = vec![[0.0; 3]; 64];
            for _ in 0..2 {
                arap.solve(&handles, 3, &mut x).expect("solves");
                assert!(largest_distance(&x, &expected) < 1e-11, "{weights:?} {threads}");
            }
            first.push(x);
        }
        assert!(
            largest_distance(&first[0], &first[2]) < 1e-13,
            "threads change the solve's order of sums only"
        );
    }
}

#[test]
fn bad_handles_are_named_and_all_vertices_may_be_handles() {
    let mesh = sheet();
    let new = |handles: &[u32]| ArapProblem::new(&mesh, handles, Weights::Plain).map(|_| ()).unwrap_err();
    assert!(matches!(new(&[99]), ArapError::Handles(DirichletError::OutOfRange { vertex: 99, .. })));
    assert!(matches!(new(&[63]), ArapError::Handles(DirichletError::Absent { vertex: 63 })));
    assert!(matches!(new(&[]), ArapError::Handles(DirichletError::UnconstrainedComponent { .. })));
    let all: Vec<u32> = (0..63).collect();
    let mut arap = prepared(&mesh, &all, Weights::Plain, 2);
    let moved: Vec<Vector> = (0..63).map(|v| [f64::from(v), 1.0, 2.0]).collect();
    let mut x = vec![[0.0; 3]; 64];
    arap.solve(&moved, 2, &mut x).expect("nothing to solve");
    assert_eq!(&x[..63], &moved[..]);
    let bad: Vec<Vector> = moved.iter().map(|&p| if p[0] == 5.0 { [f64::NAN; 3] } else { p }).collect();
    assert_eq!(arap.solve(&bad, 2, &mut x).map(|_| ()), Err(SolveError::NonFinite { row: 5 }));
}
