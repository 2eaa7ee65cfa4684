//! Every path of framechol against the dense oracle, and the instruction sets against each other.
use super::*;
use crate::limits::Limits;
use crate::registry::{self, Accuracy, Precision};
use crate::residual::Residual;
use crate::sparse::SymmetricCsr;
use proptest::prelude::*;

mod edits;
mod precision;

/// A diagonally dominant matrix with the pattern of the given edges.
fn matrix(n: usize, edges: &[(u32, u32)]) -> SymmetricCsr {
    let mut triplets: Vec<(u32, u32, f64)> = (0..n as u32).map(|i| (i, i, 0.1)).collect();
    for &(a, b) in edges.iter().filter(|(a, b)| a != b) {
        let weight = 0.5 + f64::from((a * 7 + b * 13) % 11);
        triplets.extend([(a.min(b), a.max(b), -weight), (a, a, weight), (b, b, weight)]);
    }
    SymmetricCsr::from_triplets(n, &triplets).expect("an upper triangle")
}

/// Graphs of every density: isolated vertices, several components, up to complete.
fn graphs() -> impl Strategy<Value = (usize, Vec<(u32, u32)>)> {
    (1_usize..90, 0_usize..8).prop_flat_map(|(n, density)| {
        let edge = (0..n as u32, 0..n as u32);
        (Just(n), proptest::collection::vec(edge, 0..n * density * density / 4 + 1))
    })
}

/// A square grid with diagonals: the pattern of a mesh.
fn mesh(side: u32) -> (usize, Vec<(u32, u32)>) {
    let at = |x, y| y * side + x;
    let steps = [(1, 0), (0, 1), (1, 1)];
    let inside = move |x: u32, y: u32| x < side && y < side;
    let vertices = (0..side).flat_map(move |y| (0..side).map(move |x| (x, y)));
    let edges = vertices.flat_map(move |(x, y)| steps.map(|(dx, dy)| (x, y, x + dx, y + dy)));
    let edges = edges.filter(|e| inside(e.2, e.3)).map(|(x, y, p, q)| (at(x, y), at(p, q)));
    ((side * side) as usize, edges.collect())
}

fn backend<M: Method>(isa: Isa, threads: usize) -> FrameChol<M> {
    FrameChol { isa, threads, least_parallel: 0, method: PhantomData }
}

/// All rows of the registry, in parallel however small the system is.
fn backends(threads: usize) -> [(&'static str, Box<dyn Backend>); 3] {
    let isa = Isa::best();
    [
        ("framechol-f64", Box::new(backend::<Careful<Single<f64>>>(isa, threads))),
        ("framechol-f32", Box::new(backend::<Single<f32>>(isa, threads))),
        ("framechol-mixed", Box::new(backend::<Careful<Refined>>(isa, threads))),
    ]
}

/// x with A x = b for k columns.
fn solve<M: Method>(backend: &FrameChol<M>, a: &SymmetricCsr, b: &[f64], k: usize) -> Vec<f64> {
    let system = System::new(a.clone(), None).expect("a valid system");
    let mut factor =
        backend.prepare(&system, &PrepareOptions::columns(k), &mut |_| {}).expect("positive definite");
    let mut x = vec![f64::NAN; b.len()];
    factor.solve(Columns::new(b, a.n(), k), Columns::new(&mut x[..], a.n(), k)).expect("finite");
    x
}

fn right_hand_side(n: usize, k: usize) -> Vec<f64> {
    (0..n * k).map(|i| (1.3 * i as f64 + 0.7).sin()).collect()
}

/// The solution's residual is within the limits of its class.
fn assert_solves<M: Method>(precision: Precision, isa: Isa, threads: usize, a: &SymmetricCsr, k: usize) {
    let b = right_hand_side(a.n(), k);
    let x = solve(&backend::<M>(isa, threads), a, &b, k);
    let residual = Residual::measure(a, Columns::new(&x[..], a.n(), k), Columns::new(&b[..], a.n(), k));
    let limits = Limits::of(precision, Accuracy::Direct, 0.0);
    assert!(limits.accepts(&residual), "{precision:?} {isa:?} {threads} threads, {k} columns: {residual:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn random_patterns_are_solved((n, edges) in graphs(), threads in 1_usize..4, k in 1_usize..10) {
        let a = matrix(n, &edges);
        for isa in Isa::available() {
            assert_solves::<Single<f64>>(Precision::F64, isa, threads, &a, k);
            assert_solves::<Single<f32>>(Precision::F32, isa, threads, &a, k);
            assert_solves::<Refined>(Precision::Mixed, isa, threads, &a, k);
        }
    }
}

#[test]
fn fronts_wider_than_a_strip_are_solved() {
    let complete = |n: u32| (0..n).flat_map(|a| (0..a).map(move |b| (b, a))).collect::<Vec<_>>();
    for n in [63, 64, 65, 130, 201] {
        let a = matrix(n, &complete(n as u32));
        for isa in Isa::available() {
            assert_solves::<Single<f64>>(Precision::F64, isa, 1, &a, 3);
            assert_solves::<Refined>(Precision::Mixed, isa, 2, &a, 5);
        }
    }
}

#[test]
fn large_fronts_are_shared_by_the_threads() {
    // A cube of vertices: its separators are squares, of some 17 x 17 and 17 x 8, in the top where there are four threads.
    let side = 17;
    let mut edges = Vec::new();
    for v in 0..side * side * side {
        let next = [(v % side, 1), (v / side % side, side), (v / side / side, side * side)];
        edges.extend(next.into_iter().filter(|(at, _)| at + 1 < side).map(|(_, step)| (v + step, v)));
    }
    let a = matrix((side * side * side) as usize, &edges);
    for isa in Isa::available() {
        assert_solves::<Single<f64>>(Precision::F64, isa, 4, &a, 3);
        assert_solves::<Refined>(Precision::Mixed, isa, 3, &a, 3);
    }
}

#[test]
fn few_columns_of_a_wide_handle_are_solved() {
    let (n, edges) = mesh(40);
    let a = matrix(n, &edges);
    let system = System::new(a.clone(), None).expect("a valid system");
    for (id, backend) in backends(2) {
        let mut factor =
            backend.prepare(&system, &PrepareOptions::columns(8), &mut |_| {}).expect("positive definite");
        for k in [8, 1, 3, 4, 5, 7, 11] {
            let (b, mut x) = (right_hand_side(n, k), vec![f64::NAN; n * k]);
            factor.solve(Columns::new(&b[..], n, k), Columns::new(&mut x[..], n, k)).expect("finite");
            let residual = Residual::measure(&a, Columns::new(&x[..], n, k), Columns::new(&b[..], n, k));
            assert!(residual.backward_error < 1e-6, "{id}, {k} columns: {residual:?}");
        }
    }
}

#[test]
fn stars_diagonals_and_single_rows_are_solved() {
    let star = |n: u32| (1..n).map(|v| (n / 2, v - 1)).collect::<Vec<_>>();
    let two_stars = |n: u32| {
        star(n / 2).into_iter().chain(star(n / 2).into_iter().map(move |(a, b)| (a + n / 2, b + n / 2)))
    };
    let cases: [(u32, Vec<(u32, u32)>); 5] =
        [(1, vec![]), (2, vec![]), (700, vec![]), (2000, star(2000)), (3000, two_stars(3000).collect())];
    for (n, edges) in cases {
        let a = matrix(n as usize, &edges);
        for threads in [1, 2] {
            assert_solves::<Single<f64>>(Precision::F64, Isa::best(), threads, &a, 3);
            assert_solves::<Single<f32>>(Precision::F32, Isa::best(), threads, &a, 3);
            assert_solves::<Refined>(Precision::Mixed, Isa::best(), threads, &a, 3);
        }
    }
}

#[test]
fn instruction_sets_and_thread_counts_agree() {
    let (n, edges) = mesh(60);
    let a = matrix(n, &edges);
    let b = right_hand_side(n, 4);
    let reference = solve(&backend::<Single<f64>>(Isa::Portable, 1), &a, &b, 4);
    let scale = reference.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    for isa in Isa::available() {
        for threads in [1, 2, 4] {
            let apart = |x: Vec<f64>| {
                x.iter().zip(&reference).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / scale
            };
            let f64s = apart(solve(&backend::<Single<f64>>(isa, threads), &a, &b, 4));
            let f32s = apart(solve(&backend::<Single<f32>>(isa, threads), &a, &b, 4));
            let mixed = apart(solve(&backend::<Careful<Refined>>(isa, threads), &a, &b, 4));
            assert!(
                f64s < 1e-12 && f32s < 1e-5 && mixed < 1e-9,
                "{isa:?} {threads}: {f64s:e} {f32s:e} {mixed:e}"
            );
        }
    }
}

#[test]
fn sparse_right_hand_sides_give_the_field_of_the_dense_path() {
    let (n, edges) = mesh(50);
    let mut laplacian = matrix(n, &edges);
    // The shift of `matrix` would make a constant field decay: harmonic fields are those of the pure Laplacian.
    let starts = laplacian.row_starts().to_vec();
    starts[..n].iter().for_each(|&s| laplacian.values_mut()[s as usize] -= 0.1);
    let fixed = [7, 333, 1202, 2499];
    let problem = Dirichlet::new(laplacian, None, &fixed).expect("a constrained component");
    let (options, k) = (PrepareOptions::columns(4), 4);
    let g = right_hand_side(fixed.len(), k);
    for (id, backend) in backends(1).into_iter().chain(backends(2)) {
        let entry = registry::find(id).expect("a row");
        {
            let dense = backend
                .prepare(problem.system().expect("free rows"), &options, &mut |_| {})
                .expect("definite");
            let mut dense: Box<dyn Harmonic> =
                Box::new(ReducedHarmonic::new(problem.clone(), Some(dense), k));
            let mut sparse = backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("definite");
            let values: Vec<f64> = problem.laplacian().values().iter().map(|v| 2.0 * v).collect();
            for round in 0..2 {
                let mut fields = [vec![f64::NAN; n * k], vec![f64::NAN; n * k]];
                for (handle, field) in [&mut dense, &mut sparse].into_iter().zip(&mut fields) {
                    let field = Columns::new(&mut field[..], n, k);
                    handle.solve(Columns::new(&g, fixed.len(), k), field).expect("finite");
                }
                let apart = fields[0].iter().zip(&fields[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                let limit = Limits::of(entry.precision, entry.accuracy, 0.0).harmonic;
                assert!(apart < limit, "{id}, {}, round {round}: {apart:e}", backend.describe().threads);
                dense.update_values(&values, &mut |_| {}).expect("definite");
                sparse.update_values(&values, &mut |_| {}).expect("definite");
            }
        }
    }
}

#[test]
fn bad_numbers_are_reported_with_their_row() {
    let (n, edges) = mesh(12);
    let system = System::new(matrix(n, &edges), None).expect("valid");
    let backend = backend::<Single<f64>>(Isa::best(), 2);
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(2), &mut |_| {}).expect("definite");
    let mut b = right_hand_side(n, 2);
    b[2 * 77 + 1] = f64::NAN;
    let mut x = vec![0.0; 2 * n];
    let outcome = factor.solve(Columns::new(&b, n, 2), Columns::new(&mut x[..], n, 2));
    assert_eq!(outcome, Err(SolveError::NonFinite { row: 77 }));
    let mut values = system.matrix().values().to_vec();
    values[system.matrix().row_starts()[40] as usize] = f64::NAN;
    assert_eq!(factor.update_values(&values, &mut |_| {}), Err(PrepareError::NonFinite { row: 40 }));
    values[system.matrix().row_starts()[40] as usize] = 1e-3;
    assert!(matches!(
        factor.update_values(&values, &mut |_| {}),
        Err(PrepareError::NotPositiveDefinite { .. })
    ));
    factor.update_values(system.matrix().values(), &mut |_| {}).expect("the first values again");
    b[2 * 77 + 1] = 1.0;
    factor.solve(Columns::new(&b, n, 2), Columns::new(&mut x[..], n, 2)).expect("finite");
}

#[test]
fn an_order_of_the_free_rows_serves_the_whole_pattern() {
    let (n, edges) = mesh(15);
    let problem = Dirichlet::new(matrix(n, &edges), None, &[0, 40, 41, 112]).expect("valid");
    let reversed: Vec<u32> = (0..problem.free().len() as u32).rev().collect();
    let mut order = extend_order(&problem, &reversed);
    let free: Vec<u32> = order.iter().copied().filter(|v| problem.free().contains(v)).collect();
    assert!(free.is_sorted_by(|a, b| a > b));
    order.sort_unstable();
    assert!(order.into_iter().eq(0..n as u32));
}
