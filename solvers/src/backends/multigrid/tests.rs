//! The hierarchy and the backends on it.

use super::hierarchy::{Hierarchy, Interpolation};
use super::stiff;
use crate::backend::{Factor, PrepareOptions};
use crate::backends::cg::operator::{Csr, FullCsr, Operator};
use crate::backends::cg::test_systems::{assert_spd, dirichlet, slivers, sphere, wave};
use crate::backends::cg::workers::Workers;
use crate::columns::Columns;
use crate::conformance;
use crate::error::SolveError;
use crate::registry::{OpenOptions, find};
use crate::residual::Residual;
use crate::sparse::SymmetricCsr;
use crate::system::System;

const ALL: [&str; 3] = ["cg-amg", "cg-multigrid", "multigrid"];
const TOLERANCE: f64 = 1e-8;

fn prepare(id: &str, system: &System) -> Box<dyn Factor> {
    let options = OpenOptions { tolerance: TOLERANCE, ..OpenOptions::default() };
    let backend = (find(id).expect("a row").open)(&options).expect("always there");
    backend.prepare(system, &PrepareOptions::columns(3), &mut |_| {}).expect("prepares")
}

/// Solves for three columns, checks the residual, and returns the iterations.
fn iterations(factor: &mut dyn Factor, matrix: &SymmetricCsr) -> Result<u32, SolveError> {
    let n = matrix.n();
    let (b, mut x) = (wave(n, 3), vec![0.0; n * 3]);
    let (b, x) = (Columns::new(&b[..], n, 3), Columns::new(&mut x[..], n, 3));
    let mut x = x;
    let solved = factor.solve(b, x.reborrow())?;
    let relative = Residual::measure(matrix, x.view(), b).relative;
    assert!(relative <= 1.1 * TOLERANCE, "residual {relative:e}");
    Ok(solved.iterations.expect("counted"))
}

#[test]
fn conforms() {
    for id in ALL {
        assert_eq!(conformance::check(find(id).expect("a row")).expect("available"), [], "{id}");
    }
}

#[test]
fn cycles_are_spd() {
    for mesh in [sphere(24, 1.0), sphere(24, 20.0), slivers(24, 1e-3)] {
        let system = dirichlet(&mesh, 60);
        assert_spd(&system, 1e-5, |workers, a| {
            Hierarchy::new(workers, a, Interpolation::Smoothed, 4).expect("definite")
        });
        let rows = FullCsr::new(&mut Workers::one(), system.matrix()).rows().to_vec();
        let all = system.positions().expect("a mesh");
        let points: Vec<_> = rows.iter().map(|&row| all[row as usize]).collect();
        let build = |workers: &mut Workers, a: Csr<'_>| {
            Hierarchy::new(workers, a, Interpolation::Barycentric(&points), 4).expect("definite")
        };
        assert_spd(&system, 1e-5, build);
    }
}

/// 3 thousand and 50 thousand triangles take about the same number of iterations.
#[test]
fn iterations_hardly_grow_with_the_mesh() {
    for (id, most) in [("cg-amg", 14), ("cg-multigrid", 14), ("multigrid", 40)] {
        let [small, large] = [20, 80].map(|f| {
            let system = dirichlet(&sphere(f, 1.0), (f * f) as usize);
            iterations(&mut *prepare(id, &system), system.matrix()).expect("converges")
        });
        assert!(large <= most, "{id}: {large} iterations");
        assert!(2 * large <= 3 * small, "{id}: {small} iterations grow to {large}");
    }
}

/// Stretched and slivered meshes, whose matrices have large positive off-diagonals.
#[test]
fn bad_triangles_cost_few_iterations() {
    for mesh in [sphere(40, 30.0), slivers(40, 1e-2), slivers(40, 1e-5)] {
        let system = dirichlet(&mesh, 500);
        let matrix = system.matrix();
        let positive = (0..matrix.n()).any(|i| matrix.row(i).1[1..].iter().any(|&v| v > 0.1));
        assert!(positive, "the mesh is too good for this test");
        for id in ["cg-amg", "cg-multigrid"] {
            let count = iterations(&mut *prepare(id, &system), matrix).expect("converges");
            assert!(count <= 50, "{id}: {count} iterations");
        }
    }
}

/// Elimination takes the ties out of S, all but a few, and few rows go; a mesh without slivers keeps all of them.
#[test]
fn stiff_rows_are_few_and_sufficient() {
    let system = dirichlet(&slivers(40, 1e-4), 500);
    let matrix = FullCsr::new(&mut Workers::one(), system.matrix());
    let order = stiff::choose(&mut Workers::one(), matrix.csr());
    assert!(!order.is_empty() && order.len() < system.n() / 4, "{} of {}", order.len(), system.n());
    let stiff_pairs = |a: Csr<'_>| -> usize {
        let d = a.diagonal();
        let of = |i: usize| {
            let (columns, values) = a.row(i);
            let stiff = |(j, v): (&u32, &f64)| *j as usize > i && v * v > 0.5 * d[i] * d[*j as usize];
            columns.iter().zip(values).filter(|&e| stiff(e)).count()
        };
        (0..a.n()).map(of).sum()
    };
    let (_, schur) = stiff::Stiff::factor(matrix.csr(), order, 1).expect("definite");
    let (before, after) = (stiff_pairs(matrix.csr()), stiff_pairs(schur.csr()));
    assert!(before > 500 && after * 20 < before, "{before} stiff pairs become {after}");
    let good = FullCsr::new(&mut Workers::one(), dirichlet(&sphere(20, 1.0), 500).matrix());
    assert!(stiff::choose(&mut Workers::one(), good.csr()).is_empty());
}

/// Where there is nothing to coarsen, smoothing alone must do; and a dense bottom of thousands of rows must not come up.
#[test]
fn a_dominant_diagonal_needs_no_levels() {
    let triplets: Vec<_> =
        (0..20_000u32).map(|i| (i, i, 1.0)).chain((1..20_000).map(|i| (i - 1, i, -1e-3))).collect();
    let matrix = SymmetricCsr::from_triplets(20_000, &triplets).expect("an upper triangle");
    let points: Vec<[f64; 3]> = (0..20_000).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    for id in ALL {
        let system = System::new(matrix.clone(), Some(points.clone())).expect("a positive diagonal");
        iterations(&mut *prepare(id, &system), system.matrix()).expect("converges");
    }
    let system = System::new(matrix, None).expect("a positive diagonal");
    let count = iterations(&mut *prepare("cg-amg", &system), system.matrix()).expect("converges");
    assert!(count <= 4, "{count} iterations");
}

/// New values on the same pattern give what a new handle gives.
#[test]
fn updates_keep_the_quality() {
    let (mesh, other) = (sphere(30, 1.0), slivers(30, 0.3));
    let (system, changed) = (dirichlet(&mesh, 300), dirichlet(&other, 300));
    for id in ["cg-amg", "cg-multigrid"] {
        let mut factor = prepare(id, &system);
        factor.update_values(changed.matrix().values(), &mut |_| {}).expect("definite");
        let updated = iterations(&mut *factor, changed.matrix()).expect("converges");
        let fresh = iterations(&mut *prepare(id, &changed), changed.matrix()).expect("converges");
        assert!(updated <= 2 * fresh, "{id}: {updated} against {fresh}");
    }
}

#[test]
fn an_indefinite_matrix_is_refused_or_reported() {
    let mut triplets: Vec<_> = (0..900u32).map(|i| (i, i, 2.0)).collect();
    triplets.extend((1..900u32).map(|i| (i - 1, i, -1.0)));
    triplets.extend([(0, 0, -1.9), (500, 500, -1.5)]);
    let matrix = SymmetricCsr::from_triplets(900, &triplets).expect("an upper triangle");
    let system = System::new(matrix, None).expect("a positive diagonal");
    for id in ALL {
        let options = OpenOptions { tolerance: TOLERANCE, ..OpenOptions::default() };
        let backend = (find(id).expect("a row").open)(&options).expect("always there");
        if let Ok(mut factor) = backend.prepare(&system, &PrepareOptions::columns(3), &mut |_| {}) {
            let outcome = iterations(&mut *factor, system.matrix());
            assert!(matches!(outcome, Err(SolveError::NotConverged { .. })), "{id}: {outcome:?}");
        }
    }
}
