//! Systems for the tests of the iterative family.

use super::operator::{Csr, FullCsr, Operator};
use super::preconditioner::Preconditioner;
use super::workers::Workers;
use crate::dirichlet::Dirichlet;
use crate::isa::Real;
use crate::laplacian::{Laplacian, Weights};
use crate::mesh::TriangleMesh;
use crate::system::System;
use std::collections::HashMap;

/// An octahedron subdivided into 8 f^2 triangles on a bumpy sphere; coordinates x are stretched by `stretch`.
pub(crate) fn sphere(f: u32, stretch: f64) -> TriangleMesh {
    let (mut ids, mut positions, mut triangles) = (HashMap::new(), Vec::new(), Vec::new());
    for corner in 0..8 {
        let sign = [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { 1.0 } else { -1.0 });
        let mut id = |i: u32, j: u32| {
            let p = [i, j, f - i - j];
            let key: [i64; 3] = std::array::from_fn(|k| i64::from(p[k]) * sign[k] as i64);
            *ids.entry(key).or_insert_with(|| {
                let length = p.iter().map(|&x| f64::from(x * x)).sum::<f64>().sqrt();
                let unit: [f64; 3] = std::array::from_fn(|k| key[k] as f64 / length);
                let bump = 1.0 + 0.1 * (3.0 * unit[0] + 1.0).sin() * (4.0 * unit[1]).cos();
                positions.push([stretch * bump * unit[0], bump * unit[1], bump * unit[2]]);
                positions.len() as u32 - 1
            })
        };
        for i in 0..f {
            for j in 0..f - i {
                triangles.push([id(i, j), id(i + 1, j), id(i, j + 1)]);
                if i + j + 1 < f {
                    triangles.push([id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)]);
                }
            }
        }
    }
    TriangleMesh::new(positions, triangles).expect("finite, indices in range")
}

/// The same with needles and caps: of every ninth triangle one corner is moved to within `gap` of the opposite edge.
pub(crate) fn slivers(f: u32, gap: f64) -> TriangleMesh {
    let mesh = sphere(f, 1.0);
    let mut positions = mesh.positions().to_vec();
    for [a, b, c] in mesh.triangles().iter().step_by(9).copied() {
        let [p, q, r] = [a, b, c].map(|v| positions[v as usize]);
        let share = if a % 2 == 0 { 0.5 } else { 0.02 };
        positions[a as usize] = std::array::from_fn(|k| {
            let foot = q[k] + share * (r[k] - q[k]);
            foot + gap * (p[k] - foot)
        });
    }
    mesh.with_positions(positions).expect("finite")
}

/// The cotangent Laplacian with every `step`-th vertex fixed.
pub(crate) fn dirichlet(mesh: &TriangleMesh, step: usize) -> System {
    let fixed: Vec<u32> = (0..mesh.positions().len() as u32).step_by(step).collect();
    let laplacian = Laplacian::assemble(mesh, Weights::default()).into_matrix();
    let problem = Dirichlet::new(laplacian, Some(mesh.positions()), &fixed).expect("valid constraints");
    problem.system().expect("free vertices").clone()
}

/// Smooth, oscillating and distinct columns: x_ij = sin(i + 3 j + 1).
pub(crate) fn wave(n: usize, k: usize) -> Vec<f64> {
    (0..n * k).map(|at| ((at / k) as f64 + 3.0 * (at % k) as f64 + 1.0).sin()).collect()
}

/// Asserts that M^-1, built by `build`, is symmetric and positive definite as far as `rounding` allows, and that it leaves
/// its argument as it was.
pub(crate) fn assert_spd<S: Real, P: Preconditioner<S, 4>>(
    system: &System,
    rounding: f64,
    build: impl Fn(&mut Workers, Csr<'_>) -> P,
) {
    for threads in [1, 3] {
        spd_with(system, rounding, threads, &build);
    }
}

fn spd_with<S: Real, P: Preconditioner<S, 4>>(
    system: &System,
    rounding: f64,
    threads: usize,
    build: &impl Fn(&mut Workers, Csr<'_>) -> P,
) {
    let mut workers = Workers::new(threads).expect("threads");
    let matrix = FullCsr::new(&mut Workers::one(), system.matrix());
    let mut m = build(&mut workers, matrix.csr());
    let n = system.n();
    let mut r: Vec<[S; 4]> =
        wave(n, 4).chunks(4).map(|row| std::array::from_fn(|c| S::from_f64(row[c]))).collect();
    let (before, mut z) = (r.clone(), vec![[S::default(); 4]; n]);
    m.apply(&mut workers, &mut r, &mut z);
    assert!(r == before, "r has changed");
    let inner = |c: usize, d: usize| -> f64 { (0..n).map(|i| r[i][c].to_f64() * z[i][d].to_f64()).sum() };
    for c in 0..4 {
        assert!(inner(c, c) > 0.0, "r . M^-1 r = {}", inner(c, c));
        for d in 0..c {
            let (there, back) = (inner(c, d), inner(d, c));
            let scale = (inner(c, c) * inner(d, d)).sqrt();
            assert!((there - back).abs() <= rounding * scale, "{there} against {back}, scale {scale}");
        }
    }
}
