//! Harmonic fields whose constraints meet the factor on the device.
use super::*;

/// Columns of the grid, and vertices in all: its last one is absent.
const WIDE: u32 = 61;
const N: usize = (WIDE * 47 + 1) as usize;

/// The Laplacian of a 61 x 47 grid with `weight` on every edge, and a last vertex without a row.
fn laplacian(weight: f64) -> SymmetricCsr {
    let triplets: Vec<_> = (0..N as u32 - 1)
        .flat_map(|i| [((i + 1) % WIDE > 0, i, i + 1), (i + WIDE < N as u32 - 1, i, i + WIDE)])
        .filter(|edge| edge.0)
        .flat_map(|(_, i, j)| [(i, j, -weight), (i, i, weight), (j, j, weight)])
        .collect();
    SymmetricCsr::from_triplets(N, &triplets).expect("an upper triangle")
}

/// A few scattered constraints, one pair of them neighbours, one with a constrained vertex between it and a free one.
fn problem(weight: f64) -> Dirichlet {
    let fixed = [3, 4, 64, 65, 66, 1000, 1402, 1403, 2600, 2866];
    Dirichlet::new(laplacian(weight), None, &fixed).expect("one component")
}

/// The constraints' values reach the field as they are, absent rows are zero, and free rows solve the reduced system.
fn check(problem: &Dirichlet, g: &[f64], field: &[f64], k: usize, precision: Precision, what: &str) {
    let (free, fixed) = (problem.free(), problem.fixed());
    let row = |v: u32| &field[v as usize * k..(v as usize + 1) * k];
    fixed.iter().zip(g.chunks(k)).for_each(|(&v, g)| assert_eq!(row(v), g, "{what}"));
    assert_eq!(row(N as u32 - 1), vec![0.0; k], "{what}");
    let (mut b, x) =
        (vec![0.0; free.len() * k], free.iter().flat_map(|&v| row(v)).copied().collect::<Vec<_>>());
    problem.right_hand_side(Columns::new(g, fixed.len(), k), Columns::new(&mut b[..], free.len(), k));
    let (x, b) = (Columns::new(&x[..], free.len(), k), Columns::new(&b[..], free.len(), k));
    let residual = Residual::measure(problem.system().expect("free rows").matrix(), x, b);
    assert!(Limits::of(precision, Accuracy::Direct, 0.0).accepts(&residual), "{what}: {residual:?}");
    if !(g.iter().all(|g| *g == 0.0)) {
        assert!(x.slice().iter().any(|x| *x != 0.0), "{what}");
    }
}

fn fields<T: Number, M: Method<T>>(settings: &Settings, precision: Precision) {
    let Some(backend) = opened::<T, M>(settings) else { return };
    let mut problem = problem(1.0);
    let fixed = problem.fixed().len();
    let options = PrepareOptions::columns(11);
    let mut handle = backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("definite");
    // Weights far from 1 are new values on the same pattern; g is scaled with the columns.
    for weight in [1.0, 1e-30] {
        if weight != 1.0 {
            let values = laplacian(weight).values().to_vec();
            problem.update_values(&values).expect("positive diagonal");
            handle.update_values(&values, &mut |_| {}).expect("definite");
        }
        for (k, size) in
            [(1, 1.0), (2, 1e25), (3, 1.0), (4, 0.0), (5, 1.0), (6, 1.0), (7, 1e-25), (8, 1.0), (11, 1.0)]
        {
            let g: Vec<f64> = wave(fixed * k).iter().map(|g| size * g).collect();
            let mut field = vec![f64::NAN; N * k];
            let columns = Columns::new(&mut field[..], N, k);
            handle.solve(Columns::new(&g, fixed, k), columns).expect("finite");
            check(&problem, &g, &field, k, precision, &format!("{settings:?}, {weight:e}, {k} columns"));
        }
    }
}

#[test]
fn fields_of_one_to_eleven_columns_in_every_precision() {
    for settings in all_settings() {
        fields::<f64, Single<f64>>(&settings, Precision::F64);
        fields::<f32, Single<f32>>(&settings, Precision::F32);
        fields::<f32, Mixed>(&settings, Precision::Mixed);
    }
}

/// A few constraints reach few blocks: the factor of a field is smaller than that of its system, and reads less.
#[test]
fn blocks_without_a_constraint_are_left_out() {
    let Some(backend) = opened::<f64, Single<f64>>(&Settings::default()) else { return };
    let problem = Dirichlet::new(laplacian(1.0), None, &[0]).expect("one component");
    let options = PrepareOptions::columns(4);
    let field = backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("definite").footprint();
    let system = problem.system().expect("free rows");
    let whole = backend.prepare(system, &options, &mut |_| {}).expect("definite").footprint();
    assert_eq!(field.factor_nonzeros, whole.factor_nonzeros);
    let (field, whole) = (field.bytes_per_solve.expect("known"), whole.bytes_per_solve.expect("known"));
    assert!(4 * field < 3 * whole, "{field} of {whole} bytes");
}

#[test]
fn a_bad_value_is_an_error_with_a_row_and_is_forgotten() {
    for settings in all_settings() {
        let Some(backend) = opened::<f64, Single<f64>>(&settings) else { return };
        let problem = problem(1.0);
        let fixed = problem.fixed().len();
        let options = PrepareOptions::columns(4);
        let mut handle = backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("definite");
        let mut solve = |g: &[f64]| {
            let mut field = vec![0.0; N];
            let columns = Columns::new(&mut field[..], N, 1);
            handle.solve(Columns::new(g, fixed, 1), columns).map(|_| field)
        };
        let good = wave(fixed);
        let expected = solve(&good).expect("finite");
        let mut bad = good.clone();
        for value in [f64::NAN, f64::INFINITY] {
            bad[5] = value;
            assert!(matches!(solve(&bad), Err(SolveError::NonFinite { row }) if row < N));
            assert_eq!(solve(&good).as_ref(), Ok(&expected), "nothing of it is left");
        }
    }
}

#[test]
fn failures_while_a_field_is_prepared_release_everything() {
    for settings in all_settings() {
        let Some(backend) = opened::<f64, Single<f64>>(&settings) else { return };
        let mut failed = 0;
        for allowed in 0..40 {
            backend.device.faults.fail_allocations_after(allowed);
            let field = backend.prepare_harmonic(&problem(1.0), &PrepareOptions::columns(4), &mut |_| {});
            backend.device.faults.fail_allocations_after(-1);
            failed += u32::from(field.is_err());
            drop(field);
            assert_eq!(backend.device.used(), 0, "{allowed} allocations succeeded");
        }
        assert!((10..40).contains(&failed), "{failed} of 40 failed");
    }
}
