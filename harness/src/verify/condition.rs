//! Condition numbers: ||A||_1 ||A^-1||_1 estimated from a few solves.

use lapsolve::backend::Factor;
use lapsolve::columns::Columns;
use lapsolve::sparse::SymmetricCsr;

/// Condition number of `matrix` in the 1-norm (for a symmetric matrix also the infinity norm), as found with `factor`;
/// `None` where a solve fails. A lower bound, in practice within a factor of three.
pub fn condition_number(factor: &mut dyn Factor, matrix: &SymmetricCsr) -> Option<f64> {
    Some(matrix.infinity_norm() * inverse_norm(factor, &vec![1.0; matrix.n()])?)
}

/// Largest entry of x - y where A y = b and |A x - b| <= `residual` row by row: || |A^-1| r ||_inf for a symmetric A, as
/// LAPACK's xPORFS estimates it, with `factor` for A^-1. From below, as [`condition_number`]; `None` where a solve fails.
pub fn forward_bound(factor: &mut dyn Factor, residual: &[f64]) -> Option<f64> {
    inverse_norm(factor, residual)
}

/// ||D A^-1||_1 = ||A^-1 D||_inf, D the diagonal `scale` (>= 0), by Higham's version of Hager's method (Higham 1988, algorithm 4.1; LAPACK's DLACON): gradient ascent of
/// ||D A^-1 x||_1 over the unit ball, whose maximum is at a corner, and one alternating vector against bad luck.
fn inverse_norm(factor: &mut dyn Factor, scale: &[f64]) -> Option<f64> {
    const STEPS: usize = 5;
    let n = scale.len();
    let mut solve = |b: &[f64]| {
        let mut x = vec![0.0; n];
        factor.solve(Columns::new(b, n, 1), Columns::new(&mut x, n, 1)).ok().map(|_| x)
    };
    let norm = |x: &[f64]| x.iter().zip(scale).map(|(v, d)| (v * d).abs()).sum::<f64>();
    let mut y = solve(&vec![1.0 / n as f64; n])?;
    let mut estimate = norm(&y);
    let mut corner = None;
    for _ in 0..STEPS {
        let signs: Vec<f64> = y.iter().zip(scale).map(|(v, d)| if *v < 0.0 { -d } else { *d }).collect();
        let gradient = solve(&signs)?; // A is symmetric: A^-T = A^-1, so (D A^-1)^T = A^-1 D
        let steepest =
            (0..n).fold(0, |best, i| if gradient[i].abs() > gradient[best].abs() { i } else { best });
        if corner == Some(steepest) {
            break;
        }
        corner = Some(steepest);
        let mut unit = vec![0.0; n];
        unit[steepest] = 1.0;
        y = solve(&unit)?;
        let next = norm(&y);
        if next <= estimate {
            break;
        }
        estimate = next;
    }
    let alternating: Vec<f64> = (0..n)
        .map(|i| (1.0 + i as f64 / (n.max(2) - 1) as f64) * if i % 2 == 0 { 1.0 } else { -1.0 })
        .collect();
    let other = 2.0 * norm(&solve(&alternating)?) / (3.0 * n as f64);
    Some(estimate.max(other))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::backend::PrepareOptions;
    use lapsolve::registry::{OpenOptions, find};
    use lapsolve::system::System;

    fn estimate(n: usize, triplets: &[(u32, u32, f64)]) -> f64 {
        let system = System::new(SymmetricCsr::from_triplets(n, triplets).unwrap(), None).unwrap();
        let backend = (find("dense").unwrap().open)(&OpenOptions::default()).unwrap();
        let mut factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).unwrap();
        condition_number(&mut *factor, system.matrix()).unwrap()
    }

    #[test]
    fn diagonal_matrix() {
        assert!((estimate(3, &[(0, 0, 4.0), (1, 1, 0.5), (2, 2, 1e-3)]) / 4e3 - 1.0).abs() < 1e-12);
        assert!((estimate(1, &[(0, 0, 7.0)]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn bound_of_a_residual() {
        // A^-1 = [2 1; 1 2] / 3: |A^-1| (6, 0) = (4, 2), |A^-1| (1, 9) = (11/3, 19/3).
        let matrix =
            SymmetricCsr::from_triplets(2, &[(0, 0, 2.0), (0, 1, -1.0), (1, 1, 2.0)]).expect("a triangle");
        let system = System::new(matrix, None).unwrap();
        let backend = (find("dense").unwrap().open)(&OpenOptions::default()).unwrap();
        let mut factor = backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}).unwrap();
        for (residual, bound) in [([6.0, 0.0], 4.0), ([1.0, 9.0], 19.0 / 3.0)] {
            assert!((forward_bound(&mut *factor, &residual).unwrap() - bound).abs() < 1e-12);
        }
    }

    #[test]
    fn second_difference() {
        // ||A||_1 = 4; the inverse is i (n + 1 - j) / (n + 1): for n = 9 the middle column sums to 12.5.
        let triplets: Vec<_> =
            (0..9).flat_map(|i| [(i, i, 2.0), (i, (i + 1).min(8), if i < 8 { -1.0 } else { 0.0 })]).collect();
        assert!((estimate(9, &triplets) - 50.0).abs() < 1e-10);
    }
}
