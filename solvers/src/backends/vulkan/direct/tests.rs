//! Solves on the device against the matrix itself, with every way of reading, staged and not, cut and whole.
mod harmonic;
mod refined;
mod transfer;

use super::*;
use crate::backends::vulkan::device::Access;
use crate::backends::vulkan::tests::{again, skip};
use crate::columns::Columns;
use crate::error::SolveError;
use crate::limits::Limits;
use crate::registry::{Accuracy, Precision};
use crate::residual::Residual;

/// The five-point stencil on a w x h grid plus `shift` on the diagonal.
fn grid(w: u32, h: u32, shift: f64) -> System {
    let mut triplets = Vec::new();
    for y in 0..h {
        for x in 0..w {
            let i = y * w + x;
            triplets.push((i, i, shift));
            for j in [(x + 1 < w).then_some(i + 1), (y + 1 < h).then_some(i + w)].into_iter().flatten() {
                triplets.extend([(i, j, -1.0), (i, i, 1.0), (j, j, 1.0)]);
            }
        }
    }
    let matrix = SymmetricCsr::from_triplets((w * h) as usize, &triplets).expect("an upper triangle");
    System::new(matrix, None).expect("a positive diagonal")
}

fn wave(length: usize) -> Vec<f64> {
    (0..length).map(|i| (0.37 * i as f64).sin()).collect()
}

fn opened<T: Number, M: Method<T>>(settings: &Settings) -> Option<Direct<T, M>> {
    match Direct::open(&OpenOptions::default(), settings) {
        Ok(backend) => Some(backend),
        Err(reason) => {
            skip(&reason.to_string());
            None
        }
    }
}

/// Solves with random-looking right-hand sides of 1 to 8 columns and checks the backward error.
fn solves<T: Number, M: Method<T>>(settings: &Settings, system: &System, precision: Precision) {
    let Some(backend) = opened::<T, M>(settings) else { return };
    let mut factor = backend.prepare(system, &PrepareOptions::columns(8), &mut |_| {}).expect("definite");
    let limits = Limits::of(precision, Accuracy::Direct, 0.0);
    let n = system.n();
    for k in [1, 3, 4, 5, 8, 11] {
        let (b, mut x) = (wave(n * k), vec![f64::NAN; n * k]);
        factor.solve(Columns::new(&b, n, k), Columns::new(&mut x[..], n, k)).expect("finite");
        let residual = Residual::measure(system.matrix(), Columns::new(&x, n, k), Columns::new(&b, n, k));
        assert!(limits.accepts(&residual), "{settings:?}, {k} columns: {residual:?}");
    }
}

fn all_settings() -> impl Iterator<Item = Settings> {
    [(Access::Texel, false), (Access::Storage, false), (Access::Storage, true)].into_iter().map(
        |(access, force_staging)| Settings { access: Some(access), force_staging, ..Settings::default() },
    )
}

/// Those of a GPU, which does all that it can.
fn apart() -> impl Iterator<Item = Settings> {
    all_settings().filter(|settings| settings.access == Some(Access::Storage))
}

#[test]
fn every_precision_solves_odd_sizes_with_one_to_eleven_columns() {
    let system = grid(61, 47, 1e-3);
    for settings in all_settings() {
        solves::<f64, Single<f64>>(&settings, &system, Precision::F64);
        solves::<f32, Single<f32>>(&settings, &system, Precision::F32);
        solves::<f32, Mixed>(&settings, &system, Precision::Mixed);
    }
}

#[test]
fn a_factor_larger_than_kernels_may_see_is_cut() {
    // Vectors and index tables must fit whole; the factor, written once for each sweep, needs several parts.
    const RANGE: u64 = 416 << 10;
    let system = grid(61, 47, 1e-3);
    for (access, force_staging) in [(Access::Texel, true), (Access::Storage, false)] {
        let settings =
            Settings { access: Some(access), force_staging, range: Some(RANGE), ..Settings::default() };
        solves::<f64, Single<f64>>(&settings, &system, Precision::F64);
        let settings = Settings { range: Some(RANGE / 2), ..settings };
        solves::<f32, Single<f32>>(&settings, &system, Precision::F32);
        solves::<f32, Mixed>(&settings, &system, Precision::Mixed);
    }
    let Some(backend) = opened::<f64, Single<f64>>(&Settings::default()) else { return };
    let factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("definite");
    assert!(factor.footprint().factor_bytes.is_some_and(|bytes| bytes > 4 * RANGE));
}

#[test]
fn too_little_device_memory_is_an_error_with_everything_released() {
    let settings = Settings { budget: Some(1 << 20), ..Settings::default() };
    let Some(backend) = opened::<f64, Single<f64>>(&settings) else { return };
    let error = backend.prepare(&grid(61, 47, 1e-3), &PrepareOptions::columns(4), &mut |_| {}).err();
    assert!(matches!(error, Some(PrepareError::OutOfMemory { bytes }) if bytes > 0), "{error:?}");
    for allowed in 0..14 {
        backend.device.faults.fail_allocations_after(allowed);
        let tiny = backend.prepare(&grid(5, 4, 1.0), &PrepareOptions::columns(4), &mut |_| {});
        backend.device.faults.fail_allocations_after(-1);
        drop(tiny);
        assert_eq!(backend.device.used(), 0, "{allowed} allocations succeeded");
    }
}

#[test]
fn one_row_is_a_system() {
    for settings in all_settings() {
        solves::<f64, Single<f64>>(&settings, &grid(1, 1, 3.0), Precision::F64);
        solves::<f32, Mixed>(&settings, &grid(1, 1, 3.0), Precision::Mixed);
    }
}

#[test]
fn devices_without_f64_solve_in_f32_and_refine() {
    let settings = Settings { without_f64: true, ..Settings::default() };
    solves::<f32, Single<f32>>(&settings, &grid(31, 17, 1e-3), Precision::F32);
    solves::<f32, Mixed>(&settings, &grid(31, 17, 1e-3), Precision::Mixed);
    if opened::<f32, Mixed>(&settings).is_some() {
        let Err(reason) = Direct::<f64, Single<f64>>::open(&OpenOptions::default(), &settings) else {
            panic!("f64 on a device without it")
        };
        assert!(reason.how_to_get_it.contains("vulkan-direct-mixed"), "{reason}");
    }
}

#[test]
fn frames_allocate_nothing_and_a_timeout_reaches_the_caller() {
    let Some(backend) = opened::<f64, Single<f64>>(&Settings::default()) else { return };
    let system = grid(9, 7, 0.1);
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("definite");
    let mut solve = || {
        let (b, mut x) = (wave(63), vec![0.0; 63]);
        factor.solve(Columns::new(&b, 63, 1), Columns::new(&mut x[..], 63, 1)).map(|_| x)
    };
    let expected = solve();
    backend.device.faults.fail_allocations_after(0);
    assert!(expected.is_ok() && solve() == expected);
    backend.device.faults.fail_allocations_after(-1);
    backend.device.faults.time_out_after(0);
    for _ in 0..2 {
        let outcome = solve();
        assert!(matches!(&outcome, Err(SolveError::DeviceLost { .. })), "{outcome:?}");
        backend.device.faults.time_out_after(-1);
    }
}

#[test]
fn a_lost_device_reaches_the_caller() {
    let Some(backend) = opened::<f64, Single<f64>>(&Settings::default()) else { return };
    let system = grid(9, 7, 0.1);
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).expect("definite");
    backend.device.faults.lose_device_after(0);
    for _ in 0..2 {
        let (b, mut x) = (wave(63), vec![0.0; 63]);
        let outcome = factor.solve(Columns::new(&b, 63, 1), Columns::new(&mut x[..], 63, 1));
        assert!(matches!(outcome, Err(SolveError::DeviceLost { .. })), "{outcome:?}");
        backend.device.faults.lose_device_after(-1);
    }
}

#[test]
fn a_bad_right_hand_side_is_named_and_forgotten() {
    let Some(backend) = opened::<f64, Single<f64>>(&Settings::default()) else { return };
    let system = grid(31, 17, 1e-3);
    let n = system.n();
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(2), &mut |_| {}).expect("definite");
    let mut solve = |b: &[f64]| {
        let mut x = vec![0.0; n];
        factor.solve(Columns::new(b, n, 1), Columns::new(&mut x[..], n, 1)).map(|_| x)
    };
    let good = wave(n);
    let expected = solve(&good).expect("finite");
    let mut bad = good.clone();
    for value in [f64::NAN, f64::INFINITY] {
        bad[77] = value;
        assert_eq!(solve(&bad), Err(SolveError::NonFinite { row: 77 }));
        assert_eq!(solve(&good).as_ref(), Ok(&expected), "nothing of it is left");
    }
    assert_eq!(solve(&vec![0.0; n]), Ok(vec![0.0; n]));
}

/// Every level of both sweeps is timed, and the frame that is repeated for it leaves later ones alone.
#[test]
fn phases_of_the_device_are_told_apart() {
    let Some(backend) = opened::<f64, Single<f64>>(&Settings { force_staging: true, ..Settings::default() })
    else {
        return;
    };
    let (system, n) = (grid(31, 17, 1e-3), 527);
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(5), &mut |_| {}).expect("definite");
    let (b, mut x, mut again) = (wave(5 * n), vec![0.0; 5 * n], vec![0.0; 5 * n]);
    factor.solve(Columns::new(&b, n, 5), Columns::new(&mut x[..], n, 5)).expect("finite");
    let phases = factor.device_phases().expect("runs");
    factor.solve(Columns::new(&b, n, 5), Columns::new(&mut again[..], n, 5)).expect("finite");
    assert_eq!(x, again);
    if backend.device.traits().tick_ns.is_some() {
        let levels = |name: &str| phases.iter().filter(|phase| phase.0.starts_with(name)).count();
        assert!(levels("forward") >= 2 && levels("forward") == levels("backward"), "{phases:?}");
        assert_eq!((levels("upload"), levels("download")), (1, 1));
        assert!(
            phases.iter().all(|phase| phase.1 < 10_000_000_000) && phases.iter().any(|phase| phase.1 > 0)
        );
    }
}

#[test]
fn many_frames_of_two_handles_keep_their_bits_and_their_memory() {
    let Some(backend) = opened::<f32, Single<f32>>(&Settings::default()) else { return };
    let (system, n) = (grid(20, 11, 0.1), 220);
    let prepare = || backend.prepare(&system, &PrepareOptions::columns(4), &mut |_| {}).expect("definite");
    let mut factors = [prepare(), prepare()];
    let (b, mut first, mut x) = (wave(n), vec![0.0; n], vec![0.0; n]);
    let mut used = 0;
    for frame in 0..2_000 {
        let factor = &mut factors[frame % 2];
        factor.solve(Columns::new(&b, n, 1), Columns::new(&mut x[..], n, 1)).expect("finite");
        if frame == 0 {
            first.copy_from_slice(&x);
            used = backend.device.used();
        }
        assert_eq!(first, x, "frame {frame}");
    }
    assert_eq!(backend.device.used(), used);
}

#[test]
fn backends_side_by_side_do_not_disturb_each_other() {
    let system = grid(31, 17, 1e-3);
    let open = |id| (crate::registry::find(id).expect("a row").open)(&OpenOptions::default());
    let ids = ["vulkan-direct-f64", "vulkan-direct-mixed", "vulkan-cg-jacobi"];
    let mut factors = Vec::new();
    for id in ids {
        match open(id) {
            Ok(backend) => {
                factors.push(backend.prepare(&system, &PrepareOptions::columns(3), &mut |_| {}).expect(id));
            }
            Err(reason) => return skip(&reason.to_string()),
        }
    }
    let (n, b) = (system.n(), wave(3 * system.n()));
    let mut solve = |at: usize| {
        let mut x = vec![0.0; 3 * n];
        let x_columns = Columns::new(&mut x[..], n, 3);
        factors[at].solve(Columns::new(&b, n, 3), x_columns).expect(ids[at]);
        x
    };
    let first = [0, 1, 2].map(&mut solve);
    for round in 0..4 {
        for at in [2, 0, 1] {
            assert_eq!(solve(at), first[at], "{} in round {round}", ids[at]);
        }
    }
}

/// Solves in another process with so many threads of lavapipe; returns what it printed.
fn bits_with_threads(threads: &str) -> String {
    let text = again("direct::tests::prints_the_bits_of_a_solution", &[("LP_NUM_THREADS", threads)]);
    text.lines().find(|line| line.starts_with("bits")).unwrap_or_default().to_owned()
}

#[test]
fn threads_of_the_driver_do_not_change_a_bit() {
    if opened::<f64, Single<f64>>(&Settings::default()).is_some() {
        let alone = bits_with_threads("0");
        assert!(alone.len() > 5 && alone == bits_with_threads("2"), "{alone}");
    }
}

#[test]
#[ignore = "run by another test, with other numbers of threads"]
fn prints_the_bits_of_a_solution() {
    let system = grid(61, 47, 1e-3);
    let n = system.n();
    let mut sum = 0_u64;
    for settings in all_settings() {
        let backend = opened::<f64, Single<f64>>(&settings).expect("a device");
        let mut factor =
            backend.prepare(&system, &PrepareOptions::columns(5), &mut |_| {}).expect("definite");
        let (b, mut x) = (wave(5 * n), vec![0.0; 5 * n]);
        factor.solve(Columns::new(&b, n, 5), Columns::new(&mut x[..], n, 5)).expect("finite");
        sum = x.iter().fold(sum, |sum, v| sum.rotate_left(1) ^ v.to_bits());
        let target = if backend.device.is_apart() { transfer::frame(&backend) } else { Vec::new() };
        sum = target.as_flattened().iter().fold(sum, |sum, v| sum.rotate_left(1) ^ v.to_bits());
    }
    println!("bits {sum:x}");
}

#[test]
fn ten_thousand_frames_leave_the_memory_of_the_process_flat() {
    if opened::<f64, Single<f64>>(&Settings::default()).is_some() {
        again("direct::tests::solves_ten_thousand_times", &[]);
    }
}

/// Resident memory of this process, bytes; `None` where the system does not tell.
fn resident() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(4096 * text.split_whitespace().nth(1)?.parse::<u64>().ok()?)
}

#[test]
#[ignore = "run by another test, alone in its process"]
fn solves_ten_thousand_times() {
    // The validation layer keeps books of its own.
    let settings = Settings { validation: false, ..Settings::default() };
    let backend = opened::<f64, Single<f64>>(&settings).expect("a device");
    let (system, n) = (grid(9, 7, 0.1), 63);
    let mut factor = backend.prepare(&system, &PrepareOptions::columns(4), &mut |_| {}).expect("definite");
    let (b, mut x) = (wave(4 * n), vec![0.0; 4 * n]);
    let mut before = None;
    for frame in 0..10_000 {
        factor.solve(Columns::new(&b, n, 4), Columns::new(&mut x[..], n, 4)).expect("finite");
        if frame == 1_000 {
            before = resident();
        }
    }
    // A page of 4096 bytes per hundred frames would show.
    let grown = resident().zip(before).map(|(after, before)| after.saturating_sub(before));
    assert!(grown.is_none_or(|bytes| bytes < 90 * 4096), "{grown:?} bytes in 9,000 frames");
}
