//! Does a backend keep the contract? One call answers it, for ours and for a third party's:
//!
//! ```
//! let mine = lapsolve::registry::find("dense").unwrap();
//! assert!(lapsolve::conformance::check(mine).unwrap().is_empty());
//! ```
//!
//! Small systems with known solutions, every promise of [`crate::backend`]: accuracy within the class's limits, one to
//! eight columns, fewer columns than prepared for, zero right-hand sides, new values on the same pattern, a foreign
//! order, handles that outlive their input, repeatable results, harmonic fields, and the declared error where the
//! matrix is not positive definite.

use crate::backend::{Backend, Factor, PrepareOptions};
use crate::columns::Columns;
use crate::dirichlet::Dirichlet;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::limits::Limits;
use crate::registry::{Entry, OpenOptions};
use crate::residual::Residual;
use crate::sparse::SymmetricCsr;
use crate::system::System;
use std::fmt;

/// One broken promise: which check, and what was seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// Name of the check.
    pub check: &'static str,
    /// The case and the figures.
    pub seen: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.seen)
    }
}

/// Runs every check on `entry` with one and two threads; an empty list means that the contract holds.
///
/// # Errors
/// [`Unavailable`] where the backend cannot be opened here: nothing was checked then.
pub fn check(entry: &Entry) -> Result<Vec<Violation>, Unavailable> {
    let mut violations = Vec::new();
    for threads in [1, 2] {
        let backend = (entry.open)(&OpenOptions { threads, ..OpenOptions::default() })?;
        let mut run = Run { entry, backend: &*backend, threads, violations: &mut violations };
        for case in cases() {
            run.solutions(&case);
            run.updates(&case);
            run.foreign_order(&case);
        }
        run.indefinite();
        run.harmonic();
        run.repeatable();
    }
    Ok(violations)
}

/// A named SPD matrix.
struct Case {
    name: &'static str,
    matrix: SymmetricCsr,
}

fn cases() -> Vec<Case> {
    let case = |name, n, triplets: &[(u32, u32, f64)]| Case {
        name,
        matrix: SymmetricCsr::from_triplets(n, triplets).expect("cases are upper triangles"),
    };
    let path: Vec<_> = (0..31).flat_map(|i| [(i, i, 2.5), (i, i + 1, -1.0)]).chain([(31, 31, 2.5)]).collect();
    let star: Vec<_> = (1..40).flat_map(|i| [(0, i, -1.0), (i, i, 1.5)]).chain([(0, 0, 60.0)]).collect();
    let halves: Vec<_> = (0..9)
        .flat_map(|i| [(2 * i, 2 * i, 2.0), (2 * i, 2 * i + 1, 1.0), (2 * i + 1, 2 * i + 1, 2.0)])
        .collect();
    vec![
        case("1 x 1", 1, &[(0, 0, 4.0)]),
        case("diagonal", 5, &[(0, 0, 1.0), (1, 1, 1e-3), (2, 2, 7.0), (3, 3, 1e3), (4, 4, 2.0)]),
        case("path of 32", 32, &path),
        case("star with a dense row", 40, &star),
        case("nine components, positive off-diagonals", 18, &halves),
        Case { name: "shifted grid 13 x 11", matrix: grid(13, 11, 0.1) },
        Case { name: "shifted grid 41 x 37", matrix: grid(41, 37, 1e-3) },
    ]
}

/// The five-point stencil on a w x h grid plus `shift` on the diagonal.
fn grid(w: u32, h: u32, shift: f64) -> SymmetricCsr {
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
    SymmetricCsr::from_triplets((w * h) as usize, &triplets).expect("neighbours come later")
}

/// Smooth, oscillating and distinct columns: x_ij = sin(i + 3 j + 1).
fn wave(n: usize, k: usize) -> Vec<f64> {
    (0..n * k).map(|at| ((at / k) as f64 + 3.0 * (at % k) as f64 + 1.0).sin()).collect()
}

fn product(matrix: &SymmetricCsr, x: &[f64], k: usize) -> Vec<f64> {
    let mut b = vec![0.0; x.len()];
    matrix.multiply(Columns::new(x, matrix.n(), k), Columns::new(&mut b[..], matrix.n(), k));
    b
}

const MAX_COLUMNS: usize = 8;

struct Run<'a> {
    entry: &'a Entry,
    backend: &'a dyn Backend,
    threads: usize,
    violations: &'a mut Vec<Violation>,
}

impl Run<'_> {
    fn report(&mut self, check: &'static str, case: &str, seen: impl fmt::Display) {
        let seen = format!("{} with {} thread(s), {case}: {seen}", self.entry.id, self.threads);
        self.violations.push(Violation { check, seen });
    }

    fn prepare(&mut self, case: &Case, order: Option<&[u32]>) -> Option<Box<dyn Factor>> {
        // The system is dropped here: a handle that borrowed from it could not be returned.
        let system = System::new(case.matrix.clone(), None).expect("cases are finite with positive diagonal");
        match self.backend.prepare(&system, &PrepareOptions { max_columns: MAX_COLUMNS, order }, &mut |_| {})
        {
            Ok(factor) => Some(factor),
            Err(PrepareError::Unsupported { .. }) => None,
            Err(error) => {
                self.report("prepares every SPD matrix", case.name, error);
                None
            }
        }
    }

    /// Solves A x = b and compares with the limits of the class.
    fn solve(
        &mut self,
        check: &'static str,
        case: &Case,
        factor: &mut dyn Factor,
        b: &[f64],
        k: usize,
    ) -> Vec<f64> {
        let n = case.matrix.n();
        let mut x = vec![0.0; n * k];
        if let Err(error) = factor.solve(Columns::new(b, n, k), Columns::new(&mut x[..], n, k)) {
            self.report(check, case.name, format_args!("{k} columns: {error}"));
        }
        let residual = Residual::measure(&case.matrix, Columns::new(&x[..], n, k), Columns::new(b, n, k));
        let limits = Limits::of(self.entry.precision, self.entry.accuracy, OpenOptions::default().tolerance);
        if !limits.accepts(&residual) {
            self.report(check, case.name, format_args!("{k} columns: {residual:?}, limits {limits:?}"));
        }
        x
    }

    /// Every number of columns on one handle, interleaved with a zero right-hand side, which must give exactly zero.
    fn solutions(&mut self, case: &Case) {
        let Some(mut factor) = self.prepare(case, None) else { return };
        let n = case.matrix.n();
        for k in [MAX_COLUMNS, 1, 3, 4, 7, 2, 5, 6] {
            let b = product(&case.matrix, &wave(n, k), k);
            self.solve("solves within the limits of its class", case, &mut *factor, &b, k);
        }
        let x = self.solve("zero right-hand side", case, &mut *factor, &vec![0.0; n * 3], 3);
        if x.iter().any(|&v| v != 0.0) {
            self.report("zero right-hand side", case.name, "the solution is not zero");
        }
        if factor.permutation().is_some_and(|p| !is_permutation(p, n)) {
            self.report("permutation() is a permutation", case.name, "it is not");
        }
    }

    /// Values doubled and the diagonal raised: the same handle must solve the new system.
    fn updates(&mut self, case: &Case) {
        let Some(mut factor) = self.prepare(case, None) else { return };
        let mut changed = Case { name: case.name, matrix: case.matrix.clone() };
        let starts = changed.matrix.row_starts().to_vec();
        let values = changed.matrix.values_mut();
        values.iter_mut().for_each(|v| *v *= 2.0);
        starts[..starts.len() - 1].iter().for_each(|&s| values[s as usize] += 0.25);
        const CHECK: &str = "update_values solves the new system";
        if let Err(error) = factor.update_values(changed.matrix.values(), &mut |_| {}) {
            return self.report(CHECK, case.name, error);
        }
        let b = product(&changed.matrix, &wave(changed.matrix.n(), 3), 3);
        self.solve(CHECK, &changed, &mut *factor, &b, 3);
    }

    /// An order from outside (here: reversed) is accepted and changes nothing but rounding.
    fn foreign_order(&mut self, case: &Case) {
        let n = case.matrix.n();
        let order: Vec<u32> = (0..n as u32).rev().collect();
        let Some(mut factor) = self.prepare(case, Some(&order)) else { return };
        let b = product(&case.matrix, &wave(n, 2), 2);
        self.solve("takes an elimination order", case, &mut *factor, &b, 2);
    }

    /// An indefinite matrix with a positive diagonal: a direct backend must say so, an iterative one must not claim success.
    fn indefinite(&mut self) {
        const CHECK: &str = "an indefinite matrix is refused or reported";
        let matrix = SymmetricCsr::from_triplets(3, &[(0, 0, 1.0), (0, 1, 2.0), (1, 1, 1.0), (2, 2, 1.0)])
            .expect("an upper triangle");
        let system = System::new(matrix, None).expect("a positive diagonal");
        match self.backend.prepare(&system, &PrepareOptions::columns(1), &mut |_| {}) {
            Err(PrepareError::NotPositiveDefinite { row }) if row < 3 => {}
            Err(PrepareError::Unsupported { .. }) => {}
            Err(error) => self.report(CHECK, "3 x 3", error),
            Ok(mut factor) => {
                let (b, mut x) = ([1.0, -1.0, 1.0], [0.0; 3]);
                let outcome = factor.solve(Columns::new(&b, 3, 1), Columns::new(&mut x[..], 3, 1));
                match outcome {
                    Err(SolveError::NotConverged { .. }) => {}
                    other => self.report(CHECK, "3 x 3", format_args!("{other:?}")),
                }
            }
        }
    }

    /// A linear function on a grid whose boundary is fixed is harmonic; all vertices fixed is legal.
    fn harmonic(&mut self) {
        const CHECK: &str = "harmonic fields";
        const SIDE: u32 = 17;
        let n = (SIDE * SIDE) as usize;
        let value = |v: u32| [f64::from(v % SIDE), 1.0 - f64::from(v / SIDE)];
        let inside = |v: u32| (1..SIDE - 1).contains(&(v % SIDE)) && (1..SIDE - 1).contains(&(v / SIDE));
        let all: Vec<u32> = (0..n as u32).collect();
        let boundary: Vec<u32> = all.iter().copied().filter(|&v| !inside(v)).collect();
        let limit = Limits::of(self.entry.precision, self.entry.accuracy, OpenOptions::default().tolerance)
            .harmonic
            * f64::from(SIDE);
        for fixed in [boundary, all] {
            let problem = Dirichlet::new(grid(SIDE, SIDE, 0.0), None, &fixed).expect("valid constraints");
            let g: Vec<f64> = problem.fixed().iter().flat_map(|&v| value(v)).collect();
            let mut field = vec![0.0; n * 2];
            let outcome = self
                .backend
                .prepare_harmonic(&problem, &PrepareOptions::columns(2), &mut |_| {})
                .map_err(|e| e.to_string())
                .and_then(|mut harmonic| {
                    harmonic
                        .solve(Columns::new(&g, fixed.len(), 2), Columns::new(&mut field[..], n, 2))
                        .map_err(|e| e.to_string())
                });
            if let Err(error) = outcome {
                self.report(CHECK, "linear function", error);
                continue;
            }
            let expected = (0..n as u32).flat_map(value);
            let worst = field.iter().zip(expected).map(|(u, e)| (u - e).abs()).fold(0.0, f64::max);
            if worst > limit {
                self.report(CHECK, "linear function", format_args!("off by {worst:e}, limit {limit:e}"));
            }
        }
    }

    /// Two fresh handles and a second solve on one of them agree to the last bit.
    fn repeatable(&mut self) {
        let case = Case { name: "shifted grid 41 x 37", matrix: grid(41, 37, 1e-3) };
        let n = case.matrix.n();
        let b = product(&case.matrix, &wave(n, 3), 3);
        let mut results = Vec::new();
        for _ in 0..2 {
            let Some(mut factor) = self.prepare(&case, None) else { return };
            for _ in 0..2 {
                results.push(self.solve("repeatable", &case, &mut *factor, &b, 3));
            }
        }
        if results.iter().any(|x| x != &results[0]) {
            self.report("repeatable", case.name, "the same solve gave different bits");
        }
    }
}

fn is_permutation(p: &[u32], n: usize) -> bool {
    let mut seen = vec![false; n];
    p.len() == n && p.iter().all(|&i| seen.get_mut(i as usize).is_some_and(|s| !std::mem::replace(s, true)))
}

#[cfg(test)]
mod tests {
    use crate::registry::{BACKENDS, Family};

    #[test]
    fn every_built_in_backend_conforms() {
        for entry in BACKENDS {
            match super::check(entry) {
                Ok(violations) => assert!(violations.is_empty(), "{}: {violations:#?}", entry.id),
                Err(unavailable) => {
                    let required = std::env::var("LAPBENCH_REQUIRE").unwrap_or_default();
                    let mut words = required.split(',').map(str::trim);
                    // What is not built in cannot be required; the run with default features has it.
                    let vulkan =
                        cfg!(feature = "vulkan") && words.any(|word| ["all", "1", "vulkan"].contains(&word));
                    assert!(!(vulkan && entry.family == Family::Gpu), "{}: {unavailable}", entry.id);
                    println!("SKIPPED {}: {unavailable}", entry.id);
                }
            }
        }
    }
}
