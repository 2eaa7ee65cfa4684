//! Refinement on the device against that of the host.
use super::*;
use crate::backends::vulkan::buffer::{constant, read};
use crate::backends::vulkan::plan::Plan;

/// What a pair leaves: a solution, its residual in f32, and four norms.
#[test]
fn a_pair_leaves_its_norms() {
    for settings in apart() {
        let Some(backend) = opened::<f32, Mixed>(&settings) else { return };
        if !Refined::fits(&backend.device) {
            return skip("no f64");
        }
        let (system, options) = (grid(31, 17, 1e-3), PrepareOptions::columns(8));
        let (matrix, n, device) = (system.matrix(), system.n(), &backend.device);
        let places = Places::all(n);
        for planes in [1, 2] {
            let (tables, _) = backend.factorise(matrix, &options, &places, &mut |_| {}).expect("definite");
            let scale = tables.scale;
            let mut core = Refined::new(tables, matrix, &places, planes).expect("room");
            let k = PLANE * planes;
            let mut b = wave((n + 1) * k);
            b[n * k..].fill(0.0);
            b[77] = -3.0; // the largest is negative
            let (b_there, x_there) = (
                constant(device, &b).expect("room"),
                constant(device, &vec![0.0; (n + 1) * k]).expect("room"),
            );
            let mut plan = Plan::new(device);
            core.clear(&mut plan);
            plan.barrier();
            core.list(&mut plan, &b_there, &x_there, planes, 0..1);
            plan.record().expect("recorded").run().expect("runs");
            let x: Vec<f64> = read(device, &x_there, n * k).expect("room");
            let mut product = vec![0.0; n * k];
            matrix.multiply(Columns::new(&x, n, k), Columns::new(&mut product[..], n, k));
            let residual: Vec<f64> = b.iter().zip(&product).map(|(b, ax)| b - scale * ax).collect();
            let most = |v: &[f64]| v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            // The step is the first one: it is the solution. A residual is a difference, rounded to f64.
            let expected = [most(&x), most(&x), most(&residual[..n * k]), 3.0];
            let seen: Vec<f64> =
                core.norms.host()[..4].iter().map(|bits| f64::from(f32::from_bits(*bits))).collect();
            for (seen, expected) in seen.iter().zip(expected) {
                assert!((seen - expected).abs() <= 1e-7 * expected + 1e-12, "{planes}: {seen} {expected}");
            }
        }
    }
}

/// As many pairs as the host takes, give or take one, and two where these suffice.
#[test]
fn as_many_pairs_as_on_the_host() {
    for settings in apart() {
        let hosted = Settings { without_f64: true, ..settings };
        let Some(backends) =
            [&settings, &hosted].map(opened::<f32, Mixed>).into_iter().collect::<Option<Vec<_>>>()
        else {
            return;
        };
        let mut most = 0;
        for shift in [1.0, 1e-3, 1e-5, 1e-6] {
            let (system, k) = (grid(61, 47, shift), 5);
            let n = system.n();
            let pairs = [0, 1].map(|at| {
                let options = PrepareOptions::columns(k);
                let mut factor = backends[at].prepare(&system, &options, &mut |_| {}).expect("definite");
                let (b, mut x) = (wave(n * k), vec![0.0; n * k]);
                let b = Columns::new(&b[..], n, k);
                let solved = factor.solve(b, Columns::new(&mut x[..], n, k)).expect("finite");
                let residual = Residual::measure(system.matrix(), Columns::new(&x, n, k), b);
                let limits = Limits::of(Precision::Mixed, Accuracy::Direct, 0.0);
                assert!(limits.accepts(&residual), "{settings:?}, {shift:e}, {at}: {residual:?}");
                solved.iterations.expect("counted")
            });
            assert!(pairs[0].abs_diff(pairs[1]) <= 1, "{shift:e}: {pairs:?}");
            assert!(shift < 1.0 || pairs[0] == 2, "{pairs:?}");
            most = most.max(pairs[0]);
        }
        assert!(most > 2, "{most} pairs");
    }
}

#[test]
fn zeros_and_bad_numbers_end_refinement_and_leave_nothing_behind() {
    for settings in apart() {
        let Some(backend) = opened::<f32, Mixed>(&settings) else { return };
        let (system, n) = (grid(31, 17, 1e-3), 527);
        let mut factor =
            backend.prepare(&system, &PrepareOptions::columns(8), &mut |_| {}).expect("definite");
        let mut solve = |b: &[f64]| {
            let (k, mut x) = (b.len() / n, vec![f64::NAN; b.len()]);
            factor
                .solve(Columns::new(b, n, k), Columns::new(&mut x[..], n, k))
                .map(|solved| (x, solved.iterations))
        };
        let good = wave(8 * n);
        let expected = solve(&good).expect("finite");
        assert_eq!(solve(&vec![0.0; 3 * n]), Ok((vec![0.0; 3 * n], Some(2))));
        for value in [f64::NAN, f64::INFINITY] {
            let mut bad = good.clone();
            bad[8 * 77 + 5] = value;
            assert_eq!(solve(&bad), Err(SolveError::NonFinite { row: 77 }));
            assert_eq!(solve(&good).as_ref(), Ok(&expected));
        }
        // Far from 1, up to the range of f64: the host scales, the device stays where f32 does well.
        for size in [1e-250, 1e-30, 1e30, 1e250] {
            let scaled: Vec<f64> = good.iter().map(|b| size * b).collect();
            let (x, pairs) = solve(&scaled).expect("finite");
            assert_eq!(pairs, expected.1, "{size:e}");
            let off = x.iter().zip(&expected.0).map(|(a, b)| (a / size - b).abs()).fold(0.0, f64::max);
            let largest = expected.0.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert!(off < 1e-9 * largest, "{size:e}: {off:e}");
        }
    }
}

#[test]
fn new_values_reach_the_residual() {
    for settings in apart() {
        let Some(backend) = opened::<f32, Mixed>(&settings) else { return };
        let system = grid(31, 17, 1e-3);
        let n = system.n();
        let mut factor =
            backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("definite");
        let new = grid(31, 17, 2.0);
        factor.update_values(new.matrix().values(), &mut |_| {}).expect("definite");
        let (b, mut x) = (wave(n), vec![0.0; n]);
        factor.solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1)).expect("finite");
        let residual = Residual::measure(new.matrix(), Columns::new(&x, n, 1), Columns::new(&b, n, 1));
        assert!(Limits::of(Precision::Mixed, Accuracy::Direct, 0.0).accepts(&residual), "{residual:?}");
    }
}

#[test]
fn failures_release_everything() {
    for settings in apart() {
        let Some(backend) = opened::<f32, Mixed>(&settings) else { return };
        let mut failed = 0;
        for allowed in 0..40 {
            backend.device.faults.fail_allocations_after(allowed);
            let factor = backend.prepare(&grid(9, 7, 0.1), &PrepareOptions::columns(5), &mut |_| {});
            backend.device.faults.fail_allocations_after(-1);
            failed += u32::from(factor.is_err());
            drop(factor);
            assert_eq!(backend.device.used(), 0, "{allowed} allocations succeeded");
        }
        assert!((15..40).contains(&failed), "{failed} of 40 failed");
    }
}
