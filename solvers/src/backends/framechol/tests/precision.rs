//! Accuracy where numbers are extreme or matrices nearly singular.
use super::*;
use crate::residual::compensated_residual;

#[test]
fn extreme_units_do_not_leave_the_range_of_f32() {
    let (n, edges) = mesh(20);
    for (unit, size) in [(1e-30, 1.0), (1e30, 1e-40), (1.0, 1e60)] {
        let mut a = matrix(n, &edges);
        a.values_mut().iter_mut().for_each(|v| *v *= unit);
        let b: Vec<f64> = right_hand_side(n, 3).into_iter().map(|v| v * size).collect();
        let exact = solve(&backend::<Single<f64>>(Isa::best(), 1), &a, &b, 3);
        let largest = exact.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        for x in [
            solve(&backend::<Single<f32>>(Isa::best(), 1), &a, &b, 3),
            solve(&backend::<Careful<Refined>>(Isa::best(), 2), &a, &b, 3),
        ] {
            let worst = x.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-5 * largest, "{unit:e} {size:e}: {worst:e} of {largest:e}");
        }
    }
}

/// Patches of 4 x 4 vertices that are stiff in themselves and hang on each other by weak edges, one of them on the ground.
fn stiff_patches(side: u32, stiffness: f64) -> SymmetricCsr {
    let (n, edges) = mesh(side);
    let patch = |v: u32| (v % side / 4, v / side / 4);
    let mut triplets: Vec<(u32, u32, f64)> = vec![(0, 0, 1.0)];
    for (a, b) in edges {
        let stiff = patch(a) == patch(b);
        let weight = if stiff { stiffness } else { 1.0 } * (1.5 + f64::from(a + b).sin());
        triplets.extend([(a.min(b), a.max(b), -weight), (a, a, weight), (b, b, weight)]);
    }
    SymmetricCsr::from_triplets(n, &triplets).expect("an upper triangle")
}

/// The largest error of `x`, relative to the largest entry of the solution: A^-1 of the residual in twice the precision.
fn forward_error(a: &SymmetricCsr, b: &[f64], x: &[f64], k: usize) -> f64 {
    let n = a.n();
    let mut rest = vec![0.0; n * k];
    let columns = |x| Columns::new(x, n, k);
    compensated_residual(a, columns(x), columns(b), Columns::new(&mut rest[..], n, k));
    let error = solve(&backend::<Single<f64>>(Isa::Portable, 1), a, &rest, k);
    let largest = |x: &[f64]| x.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    largest(&error) / largest(x)
}

#[test]
fn ill_conditioned_systems_are_refined_and_others_are_not() {
    let a = stiff_patches(24, 1e5);
    let (n, k) = (a.n(), 3);
    let b = right_hand_side(n, k);
    for isa in Isa::available() {
        for threads in [1, 2] {
            let plain = forward_error(&a, &b, &solve(&backend::<Single<f64>>(isa, threads), &a, &b, k), k);
            let careful =
                forward_error(&a, &b, &solve(&backend::<Careful<Single<f64>>>(isa, threads), &a, &b, k), k);
            assert!(plain > 1e-10 && careful < 1e-15, "{isa:?} {threads}: {plain:e} {careful:e}");
        }
    }
    let bytes = |a: &SymmetricCsr, backend: &dyn Backend| {
        let system = System::new(a.clone(), None).expect("valid");
        let handle = backend.prepare(&system, &PrepareOptions::columns(k), &mut |_| {}).expect("definite");
        let footprint = handle.footprint();
        (footprint.host_bytes, footprint.bytes_per_solve)
    };
    let (plain, careful) =
        (backend::<Single<f64>>(Isa::best(), 2), backend::<Careful<Single<f64>>>(Isa::best(), 2));
    assert!(bytes(&a, &careful).1 > bytes(&a, &plain).1);
    let easy = stiff_patches(24, 1.0);
    assert_eq!(bytes(&easy, &careful), bytes(&easy, &plain));
}

#[test]
fn refined_handles_follow_new_values_and_take_any_number_of_columns() {
    let mut a = stiff_patches(24, 1e5);
    let n = a.n();
    let backend = backend::<Careful<Single<f64>>>(Isa::best(), 2);
    let system = System::new(a.clone(), None).expect("valid");
    let mut handle = backend.prepare(&system, &PrepareOptions::columns(8), &mut |_| {}).expect("definite");
    a.values_mut().iter_mut().for_each(|v| *v *= 3.0);
    handle.update_values(a.values(), &mut |_| {}).expect("definite");
    for k in [8, 1, 5, 11] {
        let (b, mut x) = (right_hand_side(n, k), vec![f64::NAN; n * k]);
        handle.solve(Columns::new(&b[..], n, k), Columns::new(&mut x[..], n, k)).expect("finite");
        let error = forward_error(&a, &b, &x, k);
        assert!(error < 1e-15, "{k} columns: {error:e}");
    }
    let (mut b, mut x) = (right_hand_side(n, 8), vec![f64::NAN; n * 8]);
    b[8 * 77 + 5] = f64::NAN;
    let outcome = handle.solve(Columns::new(&b[..], n, 8), Columns::new(&mut x[..], n, 8));
    assert_eq!(outcome, Err(SolveError::NonFinite { row: 77 }));
    let (b, mut x) = (right_hand_side(n, 3), vec![f64::NAN; n * 3]);
    handle.solve(Columns::new(&b[..], n, 3), Columns::new(&mut x[..], n, 3)).expect("nothing is left behind");
}

#[test]
fn mixed_keeps_its_promise_on_stiff_systems_and_takes_two_pairs_on_others() {
    let k = 3;
    // The trial solve of one right-hand side decides; another may lose somewhat more (2.1e-9 at a stiffness of 1e3).
    let limit = 1.5 * Limits::of(Precision::Mixed, Accuracy::Direct, 0.0).poisson;
    for stiffness in [1.0, 1e1, 1e2, 1e3, 1e4, 1e5] {
        let a = stiff_patches(24, stiffness);
        let n = a.n();
        let (rough, mut smooth) = (right_hand_side(n, k), vec![0.0; n * k]);
        a.multiply(Columns::new(&rough[..], n, k), Columns::new(&mut smooth[..], n, k));
        let system = System::new(a.clone(), None).expect("valid");
        let backend = backend::<Careful<Refined>>(Isa::best(), 2);
        let mut handle =
            backend.prepare(&system, &PrepareOptions::columns(k), &mut |_| {}).expect("definite");
        for (b, least) in [(&rough, 2), (&smooth, 3)] {
            let mut x = vec![f64::NAN; n * k];
            let solved =
                handle.solve(Columns::new(&b[..], n, k), Columns::new(&mut x[..], n, k)).expect("finite");
            let pairs = solved.iterations.expect("counted");
            assert!(
                if stiffness > 1.0 { pairs >= least } else { pairs == least },
                "{stiffness:e}: {pairs} pairs"
            );
            let error = forward_error(&a, b, &x, k);
            assert!(error < limit, "{stiffness:e}: {error:e} after {pairs} pairs");
        }
    }
}
