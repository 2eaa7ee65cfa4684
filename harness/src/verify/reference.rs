//! Reference solutions: a direct solve, refined until its residual, computed in double-double, asks for no change.
//!
//! Refinement with a residual of twice the precision gives a solution that is right to the last digits as long as the
//! condition number stays below about 1e15 (Wilkinson 1963; Higham 2002, chapter 12). Whether it did is tested, not assumed:
//! the solution is computed twice, with two elimination orders, and where the two differ nothing can be claimed.

use super::condition::condition_number;
use lapsolve::backend::{Backend, Factor, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::error::SolveError;
use lapsolve::ordering::{Graph, minimum_degree};
use lapsolve::registry::{Accuracy, Entry, OpenOptions, Precision};
use lapsolve::residual::compensated_residual;
use lapsolve::system::System;

/// A solution to measure others against.
#[derive(Clone, Debug)]
pub struct Reference {
    solution: Vec<f64>,
    columns: usize,
    spread: f64,
    condition: Option<f64>,
    description: String,
}

impl Reference {
    /// Solves `system` for `rhs` (n x k) with the first direct f64 backend of `backends` that takes it, twice.
    ///
    /// Cost: two factorisations, per column and factor about five solves and five compensated residuals, five more solves for
    /// the condition number.
    ///
    /// # Errors
    /// What stood in the way, in words: no backend, or a factorisation that failed.
    pub fn solve(backends: &[Entry], system: &System, rhs: Columns<&[f64]>) -> Result<Self, String> {
        let trusted = Trusted::choose(backends, system.n())?;
        let own = trusted.prepare(system, None, rhs.k())?;
        let (solution, steps, condition) = {
            let mut factor = own;
            let (x, steps) = refine(&mut *factor, system, rhs).map_err(|error| error.to_string())?;
            (x, steps, condition_number(&mut *factor, system.matrix()))
        };
        let order = second_order(system);
        let mut other = trusted.prepare(system, Some(&order), rhs.k())?;
        let (second, _) = refine(&mut *other, system, rhs).map_err(|error| error.to_string())?;
        let spread = largest_difference(&solution, &second);
        let description = format!("{}, refined {steps} times with a double-double residual", trusted.id);
        Ok(Self { solution, columns: rhs.k(), spread, condition, description })
    }

    /// The solution, n x k.
    pub fn solution(&self) -> &[f64] {
        &self.solution
    }

    /// Number of columns k.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Largest absolute difference between the two refined solutions.
    pub fn spread(&self) -> f64 {
        self.spread
    }

    /// Estimate of ||A||_1 ||A^-1||_1, from below.
    pub fn condition(&self) -> Option<f64> {
        self.condition
    }

    /// How it was made, for the record.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Largest absolute difference of `x` from the solution; infinite where `x` is not finite.
    pub fn distance(&self, x: &[f64]) -> f64 {
        largest_difference(&self.solution, x)
    }
}

/// Below this many unknowns fill does not matter.
const SMALL: usize = 2_000;

/// Corrections after which refinement gives up: each gains at least a binary digit, most gain ten.
const MOST_STEPS: usize = 60;

/// An elimination order that most likely is not the backend's own.
pub fn second_order(system: &System) -> Vec<u32> {
    let graph = Graph::from_triangle_of_matrix(system.matrix().row_starts(), system.matrix().columns());
    let mut order = minimum_degree(&graph).order;
    if system.n() <= SMALL {
        order.reverse(); // there both orders may well be the same
    }
    order
}

/// The backend that makes references.
pub struct Trusted {
    /// Its name.
    pub id: &'static str,
    /// The backend, on one thread.
    pub backend: Box<dyn Backend>,
}

impl Trusted {
    /// The first direct f64 backend of the list that can be opened and takes `n` unknowns.
    ///
    /// # Errors
    /// That there is none, in words.
    pub fn choose(backends: &[Entry], n: usize) -> Result<Self, String> {
        let options = OpenOptions { threads: 1, ..OpenOptions::default() };
        // The textbook oracle is for small systems only; among the others the list's order decides.
        let is_direct = |e: &&Entry| {
            e.precision == Precision::F64
                && e.accuracy == Accuracy::Direct
                && e.max_unknowns.is_none_or(|m| n <= m)
        };
        let mut candidates: Vec<&Entry> = backends.iter().filter(is_direct).collect();
        candidates.sort_by_key(|e| e.max_unknowns.is_some() && n > SMALL);
        candidates
            .iter()
            .find_map(|e| Some(Self { id: e.id, backend: (e.open)(&options).ok()? }))
            .ok_or_else(|| format!("no direct f64 backend takes {n} unknowns"))
    }

    fn prepare(
        &self,
        system: &System,
        order: Option<&[u32]>,
        columns: usize,
    ) -> Result<Box<dyn Factor>, String> {
        let options = PrepareOptions { max_columns: columns, order };
        self.backend.prepare(system, &options, &mut |_| {}).map_err(|error| format!("{}: {error}", self.id))
    }
}

/// x with A x = b by refinement, and the number of corrections.
///
/// # Errors
/// As [`Factor::solve`].
pub fn refine(
    factor: &mut dyn Factor,
    system: &System,
    rhs: Columns<&[f64]>,
) -> Result<(Vec<f64>, usize), SolveError> {
    let (n, k) = (rhs.n(), rhs.k());
    let (mut x, mut residual, mut correction) = (vec![0.0; n * k], vec![0.0; n * k], vec![0.0; n * k]);
    let mut last = f64::INFINITY;
    for step in 0..MOST_STEPS {
        compensated_residual(system.matrix(), Columns::new(&x, n, k), rhs, Columns::new(&mut residual, n, k));
        correction.fill(0.0);
        factor.solve(Columns::new(&residual, n, k), Columns::new(&mut correction, n, k))?;
        let size = correction.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        let scale = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        // The first solve is the "correction" of zero and tells nothing about convergence.
        if step > 1 && size > 0.5 * last {
            return Ok((x, step - 1));
        }
        x.iter_mut().zip(&correction).for_each(|(x, c)| *x += c);
        if size <= 0.5 * f64::EPSILON * scale {
            return Ok((x, step));
        }
        last = if step == 0 { f64::INFINITY } else { size };
    }
    Ok((x, MOST_STEPS))
}

/// max |a_i - b_i|; infinite where a difference is not a number.
pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "blocks of the same shape");
    let larger = |m: f64, d: f64| if d.is_nan() { f64::INFINITY } else { m.max(d) };
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, larger)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::registry::BACKENDS;
    use lapsolve::sparse::SymmetricCsr;

    /// The Hilbert matrix of order n: condition 1.6e13 for n = 10.
    fn hilbert(n: u32) -> SymmetricCsr {
        let triplets: Vec<_> =
            (0..n).flat_map(|i| (i..n).map(move |j| (i, j, 1.0 / f64::from(i + j + 1)))).collect();
        SymmetricCsr::from_triplets(n as usize, &triplets).expect("an upper triangle")
    }

    #[test]
    fn refinement_beats_the_condition_number() {
        let matrix = hilbert(9); // entries rounded: x below is the solution of the rounded matrix to 2e-5 only
        let n = matrix.n();
        let ones = vec![1.0; n];
        let mut b = vec![0.0; n];
        matrix.multiply(Columns::new(&ones, n, 1), Columns::new(&mut b, n, 1));
        let system = System::new(matrix.clone(), None).expect("finite");
        let reference =
            Reference::solve(BACKENDS, &system, Columns::new(&b, n, 1)).expect("positive definite");
        assert!(reference.spread() < 1e-14, "{}", reference.spread());
        assert!(reference.condition().expect("estimated") > 1e11);
        let mut r = vec![0.0; n];
        compensated_residual(
            &matrix,
            Columns::new(reference.solution(), n, 1),
            Columns::new(&b, n, 1),
            Columns::new(&mut r, n, 1),
        );
        assert!(r.iter().all(|r| r.abs() < 1e-15));
    }

    #[test]
    fn a_numerically_singular_system_shows_in_the_spread_or_fails() {
        let system = System::new(hilbert(16), None).expect("finite");
        let b = vec![1.0; 16];
        if let Ok(reference) = Reference::solve(BACKENDS, &system, Columns::new(&b, 16, 1)) {
            let scale = reference.solution().iter().fold(0.0f64, |m, v| m.max(v.abs()));
            assert!(reference.spread() > 1e-6 * scale, "{} of {scale}", reference.spread());
        }
    }
}
