//! The Krylov core through its handle.

use super::approxchol::ApproximateCholesky;
use super::chebyshev::Chebyshev;
use super::fsai::{Fsai, Pattern};
use super::ic0::IncompleteCholesky;
use super::jacobi::Jacobi;
use super::operator::{FullCsr, Operator};
use super::test_systems::{assert_spd, dirichlet, slivers, sphere, wave};
use super::workers::Workers;
use crate::backend::{Factor, PrepareOptions};
use crate::columns::Columns;
use crate::conformance;
use crate::error::SolveError;
use crate::registry::{OpenOptions, find};
use crate::residual::Residual;
use crate::sparse::SymmetricCsr;
use crate::system::System;

/// The five-point stencil on a side x side grid plus `shift` on the diagonal.
fn grid(side: u32, shift: f64) -> SymmetricCsr {
    let mut triplets = Vec::new();
    for i in 0..side * side {
        triplets.push((i, i, shift));
        for j in [(i % side + 1 < side).then_some(i + 1), (i + side < side * side).then_some(i + side)] {
            triplets.extend(j.into_iter().flat_map(|j| [(i, j, -1.0), (i, i, 1.0), (j, j, 1.0)]));
        }
    }
    SymmetricCsr::from_triplets((side * side) as usize, &triplets).expect("an upper triangle")
}

fn prepare(matrix: &SymmetricCsr, columns: usize, tolerance: f64) -> Box<dyn Factor> {
    let options = OpenOptions { tolerance, ..OpenOptions::default() };
    let backend = (find("cg-jacobi").expect("a row").open)(&options).expect("always there");
    let system = System::new(matrix.clone(), None).expect("valid");
    backend.prepare(&system, &PrepareOptions::columns(columns), &mut |_| {}).expect("prepares")
}

fn relative(matrix: &SymmetricCsr, x: &[f64], b: &[f64], k: usize) -> f64 {
    Residual::measure(matrix, Columns::new(x, matrix.n(), k), Columns::new(b, matrix.n(), k)).relative
}

#[test]
fn conforms() {
    for id in ["cg-jacobi", "cg-ic0", "cg-fsai", "cg-chebyshev", "cg-approxchol"] {
        assert_eq!(conformance::check(find(id).expect("a row")).expect("available"), [], "{id}");
    }
}

#[cfg(feature = "sprs")]
#[test]
fn sprs_cg_conforms() {
    assert_eq!(conformance::check(find("sprs-cg").expect("a row")).expect("available"), []);
}

#[test]
fn columns_of_any_size_converge_together() {
    let (matrix, n, k) = (grid(20, 1e-2), 400, 11);
    let mut b = wave(n, k);
    for (at, b) in b.iter_mut().enumerate() {
        *b *= [1.0, 1e-200, 1e200, 0.0][at % k % 4]; // squares of these leave the range of f64
    }
    let mut x = vec![0.0; n * k];
    let solved = prepare(&matrix, k, 1e-10).solve(Columns::new(&b, n, k), Columns::new(&mut x[..], n, k));
    assert!(solved.expect("converges").residual.is_some_and(|r| r <= 1.05e-10));
    for c in 0..k {
        let column = |v: &[f64]| -> Vec<f64> { v.iter().skip(c).step_by(k).copied().collect() };
        let scale = [1.0, 1e200, 1e-200, 1.0][c % 4];
        let scaled = |v: Vec<f64>| -> Vec<f64> { v.iter().map(|v| v * scale).collect() };
        let error = relative(&matrix, &scaled(column(&x)), &scaled(column(&b)), 1);
        assert!(error <= 1.1e-10, "column {c}: {error:e}");
    }
}

#[test]
fn a_good_guess_saves_iterations_and_a_bad_one_costs_none() {
    let matrix = grid(40, 1e-3);
    let (n, k) = (matrix.n(), 3);
    let b = wave(n, k);
    let mut factor = prepare(&matrix, k, 1e-8);
    let mut solve = |x: &mut [f64]| {
        let solved = factor.solve(Columns::new(&b, n, k), Columns::new(x, n, k)).expect("converges");
        solved.iterations.expect("counted")
    };
    let mut x = vec![0.0; n * k];
    let cold = solve(&mut x);
    assert!(cold > 20, "{cold} iterations");
    assert_eq!(solve(&mut x.clone()), 0, "the solution itself needs none");
    x.iter_mut().for_each(|x| *x += 1e-6);
    let warm = solve(&mut x);
    assert!(warm < cold, "{warm} against {cold}");
    assert_eq!(solve(&mut vec![1e30; n * k]), cold);
    assert_eq!(solve(&mut vec![f64::NAN; n * k]), cold);
}

/// A mass rules, and that of some rows is a ten-thousandth of the usual: the 2-norm of the residual alone would allow their
/// values, which are 1, to be off by 0.3.
#[test]
fn rows_with_small_entries_are_solved_as_well_as_others() {
    let (mut matrix, tolerance) = (grid(40, 0.0), 1e-4);
    let n = matrix.n();
    matrix.values_mut().iter_mut().for_each(|value| *value *= 1e-5);
    let mass: Vec<f64> = (0..n).map(|i| if i % 50 < 5 { 1e-4 } else { 1.0 }).collect();
    matrix.add_diagonal(&mass);
    let b = mass; // rows of the grid's matrix add up to 0
    let mut x = vec![0.0; n];
    let solved = prepare(&matrix, 1, tolerance).solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1));
    assert!(solved.is_ok(), "{solved:?}");
    let error = x.iter().map(|x| (x - 1.0).abs()).fold(0.0, f64::max);
    assert!(error <= 10.0 * tolerance, "{error:e}");
}

/// With a tolerance that rounding denies, the iteration ends by itself, and early, with its best iterate.
#[test]
fn stagnation_is_noticed_and_the_best_iterate_kept() {
    let matrix = grid(40, 1e-6);
    let (n, k) = (matrix.n(), 2);
    let b = wave(n, k);
    let mut x = vec![0.0; n * k];
    let outcome = prepare(&matrix, k, 1e-30).solve(Columns::new(&b, n, k), Columns::new(&mut x[..], n, k));
    let Err(SolveError::NotConverged { iterations, residual }) = outcome else { panic!("{outcome:?}") };
    assert!(iterations < 5_000, "{iterations} iterations");
    assert!(residual < 1e-9, "claims {residual:e}");
    let error = relative(&matrix, &x, &b, k);
    assert!(error <= 2.0 * residual, "claims {residual:e}, has {error:e}");
}

/// Indefinite with a positive diagonal: the first search direction or a later one has p . A p <= 0.
#[test]
fn an_indefinite_matrix_is_reported() {
    let mut triplets: Vec<_> = (0..50u32).map(|i| (i, i, 1.0)).collect();
    triplets.extend((0..49u32).map(|i| (i, i + 1, -0.6)));
    let matrix = SymmetricCsr::from_triplets(50, &triplets).expect("an upper triangle");
    let b = wave(50, 1);
    let mut x = vec![0.0; 50];
    let outcome = prepare(&matrix, 1, 1e-10).solve(Columns::new(&b, 50, 1), Columns::new(&mut x[..], 50, 1));
    assert!(matches!(outcome, Err(SolveError::NotConverged { .. })), "{outcome:?}");
    assert!(x.iter().all(|x| x.is_finite()));
}

#[test]
fn a_right_hand_side_that_is_not_finite_is_named() {
    let matrix = grid(4, 1.0);
    let mut b = vec![1.0; 16];
    b[5] = f64::INFINITY;
    let outcome =
        prepare(&matrix, 1, 1e-10).solve(Columns::new(&b, 16, 1), Columns::new(&mut [0.0; 16][..], 16, 1));
    assert_eq!(outcome, Err(SolveError::NonFinite { row: 5 }));
}

#[test]
fn preconditioners_are_spd() {
    for mesh in [sphere(12, 1.0), sphere(12, 20.0), slivers(12, 1e-3)] {
        let system = dirichlet(&mesh, 40);
        assert_spd(&system, 1e-12, |workers, a| Jacobi::new(workers, a));
        assert_spd(&system, 1e-12, |_, a| IncompleteCholesky::new(a));
        for pattern in [Pattern::LowerTriangle, Pattern::Width(8)] {
            assert_spd(&system, 1e-12, |workers, a| Fsai::new(workers, a, pattern, 4).expect("definite"));
        }
        assert_spd(&system, 1e-5, |workers, a| Chebyshev::new(workers, a, 4));
        assert_spd(&system, 1e-12, |_, a| ApproximateCholesky::new(a));
    }
}

/// Iterations on a sphere of 12,800 triangles, as shares of those of Jacobi.
#[test]
fn preconditioners_are_worth_their_cost() {
    let system = dirichlet(&sphere(40, 1.0), 1_000);
    let iterations = |id: &str| {
        let options = OpenOptions { tolerance: 1e-8, ..OpenOptions::default() };
        let backend = (find(id).expect("a row").open)(&options).expect("always there");
        let mut factor =
            backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("prepares");
        let (n, b) = (system.n(), wave(system.n(), 1));
        let mut x = vec![0.0; n];
        let solved = factor.solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1)).expect("converges");
        f64::from(solved.iterations.expect("counted"))
    };
    let jacobi = iterations("cg-jacobi");
    for (id, most) in [("cg-ic0", 0.45), ("cg-fsai", 0.5), ("cg-chebyshev", 0.35), ("cg-approxchol", 0.3)] {
        let share = iterations(id) / jacobi;
        assert!(share < most, "{id}: {share} of {jacobi}");
    }
}

/// Where IC(0) breaks down it is shifted until it stands: a matrix that loses a pivot without a shift.
#[test]
fn ic0_survives_positive_off_diagonals() {
    let system = dirichlet(&slivers(20, 1e-4), 100);
    let matrix = FullCsr::new(&mut Workers::one(), system.matrix());
    assert!(IncompleteCholesky::factor(matrix.csr(), &matrix.csr().diagonal(), 0.0).is_none());
    let n = system.n();
    let (b, mut x) = (wave(n, 1), vec![0.0; n]);
    let backend = (find("cg-ic0").expect("a row").open)(&OpenOptions::default()).expect("always there");
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("prepares");
    factor.solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1)).expect("converges");
    assert!(relative(system.matrix(), &x, &b, 1) <= 1.1e-10);
}

/// The observer hears every iteration once, in order, down to the tolerance.
#[test]
fn iterations_are_observed() {
    let matrix = grid(20, 1e-2);
    let (n, b) = (matrix.n(), wave(matrix.n(), 1));
    let mut factor = prepare(&matrix, 1, 1e-8);
    let (sender, receiver) = std::sync::mpsc::channel();
    assert!(factor.observe(Some(Box::new(move |iteration, residual| {
        sender.send((iteration, residual)).expect("the test listens");
    }))));
    let mut x = vec![0.0; n];
    let solved = factor.solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1)).expect("converges");
    assert!(factor.observe(None));
    let history: Vec<(u32, f64)> = receiver.iter().collect();
    assert_eq!(
        history.iter().map(|h| h.0).collect::<Vec<_>>(),
        (1..=history.len() as u32).collect::<Vec<_>>()
    );
    assert_eq!(solved.iterations, Some(history.len() as u32));
    let (first, last) = (history[0].1, history[history.len() - 1].1);
    assert!(last <= 1e-8 && first > 1e-3, "from {first:e} to {last:e}");
}
