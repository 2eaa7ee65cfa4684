//! Reference solutions: what an answer is compared with, and how far that comparison can be trusted.
//!
//! A direct f64 solution is refined with residuals in twice the precision until corrections stop shrinking. Two such
//! solutions, made with two elimination orders, differ by what rounding leaves undetermined: where that is more than a tenth
//! of a limit, nothing is claimed about the forward error.

use lapsolve::backend::{Factor, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::registry::{Accuracy, Entry, OpenOptions, Precision};
use lapsolve::residual::compensated_residual;
use lapsolve::system::System;

/// A refined solution.
#[derive(Clone, Debug)]
pub struct Reference {
    /// n x k.
    pub x: Vec<f64>,
    /// Largest difference from a second one with another elimination order; infinite where there is none.
    pub spread: f64,
    /// How it was made, for the result file.
    pub made_by: String,
}

/// Corrections stop when they no longer halve: then rounding of x itself is reached, or conditioning allows no progress.
const MAX_CORRECTIONS: usize = 10;

/// Refines A X = B with the first direct f64 backend of `backends` that takes a system of this size; none where there is no
/// such backend or it fails. With `second`, another order is tried too, which costs as much again.
pub fn refined(backends: &[Entry], system: &System, b: &[f64], k: usize, second: bool) -> Option<Reference> {
    let fits = |entry: &&Entry| {
        entry.precision == Precision::F64
            && entry.accuracy == Accuracy::Direct
            && entry.max_unknowns.is_none_or(|most| system.n() <= most)
    };
    // The readable oracle comes last: it is n^3.
    let large = |entry: &&Entry| entry.max_unknowns.is_none();
    let candidates = backends.iter().filter(fits);
    let in_order = candidates.clone().filter(large).chain(candidates.filter(|e| !large(e)));
    in_order.into_iter().find_map(|entry| with_backend(entry, system, b, k, second))
}

fn with_backend(entry: &Entry, system: &System, b: &[f64], k: usize, second: bool) -> Option<Reference> {
    let reversed: Vec<u32> = (0..system.n() as u32).rev().collect();
    let (x, other) = rayon::join(
        || solve(entry, system, b, k),
        || if second { solve_permuted(entry, system, b, k, &reversed) } else { None },
    );
    let x = x?;
    let spread = other.map_or(f64::INFINITY, |other| {
        x.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    });
    let made_by = format!("{} in f64, refined with compensated residuals", entry.id);
    Some(Reference { x, spread, made_by })
}

/// The same system with its rows renumbered: ties in the backend's ordering fall otherwise, and it eliminates in another
/// order of about the same cost.
fn solve_permuted(entry: &Entry, system: &System, b: &[f64], k: usize, order: &[u32]) -> Option<Vec<f64>> {
    let (matrix, _) = system.matrix().permuted(order);
    let rows = |block: &[f64]| -> Vec<f64> {
        order.iter().flat_map(|&i| &block[i as usize * k..(i as usize + 1) * k]).copied().collect()
    };
    let positions = system.positions().map(|p| order.iter().map(|&i| p[i as usize]).collect());
    let permuted = System::new(matrix, positions).ok()?;
    let y = solve(entry, &permuted, &rows(b), k)?;
    let mut x = vec![0.0; y.len()];
    for (row, &i) in y.chunks_exact(k).zip(order) {
        x[i as usize * k..(i as usize + 1) * k].copy_from_slice(row);
    }
    Some(x)
}

fn solve(entry: &Entry, system: &System, b: &[f64], k: usize) -> Option<Vec<f64>> {
    let backend = (entry.open)(&OpenOptions::default()).ok()?;
    let mut factor = backend.prepare(system, &PrepareOptions::columns(k), &mut |_| {}).ok()?;
    refine(&mut *factor, system, b, k)
}

/// x <- x + A^-1 (b - A x), from x = 0, the residual rounded once from a double-double sum.
fn refine(factor: &mut dyn Factor, system: &System, b: &[f64], k: usize) -> Option<Vec<f64>> {
    let n = system.n();
    let (mut x, mut r, mut d) = (vec![0.0; n * k], vec![0.0; n * k], vec![0.0; n * k]);
    let mut last = f64::INFINITY;
    for _ in 0..MAX_CORRECTIONS {
        compensated_residual(
            system.matrix(),
            Columns::new(&x, n, k),
            Columns::new(b, n, k),
            Columns::new(&mut r, n, k),
        );
        d.fill(0.0);
        factor.solve(Columns::new(&r, n, k), Columns::new(&mut d, n, k)).ok()?;
        let size = d.iter().map(|v| v.abs()).fold(0.0, f64::max);
        if !size.is_finite() {
            return None;
        }
        if size > 0.5 * last {
            break;
        }
        x.iter_mut().zip(&d).for_each(|(x, d)| *x += d);
        last = size;
        if size == 0.0 {
            break;
        }
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::registry::BACKENDS;
    use lapsolve::sparse::SymmetricCsr;

    /// The one-dimensional Laplacian: x_i = i is exact, and refinement reaches it to the last bit or two.
    #[test]
    fn reaches_a_known_solution() {
        let n = 500u32;
        let triplets: Vec<_> =
            (0..n).flat_map(|i| [(i, i, 2.0), (i, (i + 1).min(n - 1), if i + 1 < n { -1.0 } else { 0.0 })]).collect();
        let matrix = SymmetricCsr::from_triplets(n as usize, &triplets).unwrap();
        let expected: Vec<f64> = (0..n).flat_map(|i| [f64::from(i), 1.0 / 3.0]).collect();
        let mut b = vec![0.0; expected.len()];
        matrix.multiply(Columns::new(&expected, n as usize, 2), Columns::new(&mut b, n as usize, 2));
        let system = System::new(matrix, None).unwrap();
        let reference = refined(BACKENDS, &system, &b, 2, true).unwrap();
        let worst = reference.x.iter().zip(&expected).map(|(a, e)| (a - e).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{worst:e}"); // b itself is rounded: condition 1e5 times eps times 500
        assert!(reference.spread < 1e-12, "{:e}", reference.spread);
    }

    #[test]
    fn no_backend_no_reference() {
        let matrix = SymmetricCsr::from_triplets(1, &[(0, 0, 1.0)]).unwrap();
        let system = System::new(matrix, None).unwrap();
        assert!(refined(&[], &system, &[1.0], 1, true).is_none());
    }
}
