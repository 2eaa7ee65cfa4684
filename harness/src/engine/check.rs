//! The parent checks every answer itself: the equations of a task, a reference solution, and what follows for its cells.

use super::equations::Equations;
use super::task::pipeline::Pipeline;
use crate::record::result::Accuracy;
use crate::verify::reference::Reference;
use crate::verify::solution::{Checked, Tolerance, check_solution};
use lapsolve::columns::Columns;
use lapsolve::limits::Limits;
use lapsolve::registry::Entry;

/// Equations, and a reference solution of them where one could be had.
#[derive(Clone, Debug)]
pub struct Check {
    /// What is solved.
    pub equations: Equations,
    /// Why there is no reference solution, where there is none.
    pub no_reference: Option<String>,
    reference: Option<Reference>,
    scale: f64,
    forward: ForwardLimit,
}

/// What the answers of a cell are held against: equations, or the refined answer of a whole pipeline.
#[derive(Debug)]
pub enum Judge {
    /// The answer solves one system.
    Equations(Check),
    /// The answer comes out of several solves and steps between them.
    Pipeline(Pipeline),
}

impl Judge {
    /// Rows of an answer.
    pub fn rows(&self) -> usize {
        match self {
            Judge::Equations(check) => check.equations.rows(),
            Judge::Pipeline(pipeline) => pipeline.rows(),
        }
    }

    /// Columns of an answer.
    pub fn columns(&self) -> usize {
        match self {
            Judge::Equations(check) => check.equations.columns(),
            Judge::Pipeline(pipeline) => pipeline.columns(),
        }
    }

    /// Unknowns of the (larger) system that is solved.
    pub fn unknowns(&self) -> usize {
        match self {
            Judge::Equations(check) => check.equations.unknowns(),
            Judge::Pipeline(pipeline) => pipeline.unknowns(),
        }
    }

    /// An answer as one row per vertex.
    pub fn on_vertices(&self, x: Vec<f64>) -> Vec<f64> {
        match self {
            Judge::Equations(check) => check.equations.on_vertices(&x),
            Judge::Pipeline(_) => x,
        }
    }

    /// Checks `x` (rows x columns) against the limits of its class; `convention` names the definition that the solver follows
    /// where there are several.
    pub fn solution(&self, x: &[f64], limits: &Limits, convention: Option<&str>) -> Checked {
        match self {
            Judge::Equations(check) => check.solution(x, limits),
            Judge::Pipeline(pipeline) => pipeline.check(x, limits, convention),
        }
    }

    /// Checks `x` in the same equations with other values. A pipeline has none: nothing is found.
    pub fn updated(&self, equations: &Equations, x: &[f64], limits: &Limits) -> Checked {
        match self {
            Judge::Equations(check) => check.updated(equations, x, limits),
            Judge::Pipeline(_) => Checked { accuracy: Accuracy::default(), faults: Vec::new() },
        }
    }
}

/// The forward limit that applies to a workload; none where it cannot be certified for any backend.
pub type ForwardLimit = fn(&Limits) -> Option<f64>;

impl Check {
    /// Solves `equations` for reference with the best of `backends`.
    ///
    /// Forward errors are relative to `scale`; without one, to the largest |g| of `harmonic` and the largest |x| of a
    /// system.
    pub fn new(equations: Equations, scale: Option<f64>, forward: ForwardLimit, backends: &[Entry]) -> Self {
        let k = equations.columns();
        let solved = equations
            .reduced()
            .map(|(system, b)| Reference::solve(backends, system, Columns::new(&b[..], system.n(), k)));
        let (reference, no_reference) = match solved {
            None => (None, None), // nothing is unknown
            Some(Ok(reference)) => (Some(reference), None),
            Some(Err(why)) => (None, Some(why)),
        };
        let largest = |block: &[f64]| block.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let natural = || match (&equations, &reference) {
            (Equations::Harmonic { g, .. }, _) => largest(g),
            (Equations::System { .. }, Some(reference)) => largest(reference.solution()),
            (Equations::System { .. }, None) => 1.0,
        };
        let scale = scale.unwrap_or_else(natural);
        Self { equations, no_reference, reference, scale, forward }
    }

    /// Checks `x` (rows x k) against the limits of its class.
    pub fn solution(&self, x: &[f64], limits: &Limits) -> Checked {
        self.check(&self.equations, self.reference.as_ref(), x, limits)
    }

    /// Checks `x` in the same equations with other values, for which there is no reference solution.
    pub fn updated(&self, equations: &Equations, x: &[f64], limits: &Limits) -> Checked {
        self.check(equations, None, x, limits)
    }

    fn check(
        &self,
        equations: &Equations,
        reference: Option<&Reference>,
        x: &[f64],
        limits: &Limits,
    ) -> Checked {
        let tolerance = Tolerance { limits: *limits, forward: (self.forward)(limits), scale: self.scale };
        let x = Columns::new(x, equations.rows(), equations.columns());
        check_solution(equations.question(), x, reference, &tolerance)
    }
}

impl Accuracy {
    /// Keeps the larger error of two checks of one cell; unknown figures give way to known ones.
    pub fn worsen(&mut self, other: &Self) {
        let worst = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => Some(if a >= b { a } else { b }),
            (a, b) => a.or(b),
        };
        *self = Self {
            backward_error: worst(self.backward_error, other.backward_error),
            backward_limit: self.backward_limit.or(other.backward_limit),
            componentwise: worst(self.componentwise, other.componentwise),
            relative_residual: worst(self.relative_residual, other.relative_residual),
            residual_limit: self.residual_limit.or(other.residual_limit),
            forward_error: worst(self.forward_error, other.forward_error),
            constraint_error: worst(self.constraint_error, other.constraint_error),
            reference: self.reference.take().or_else(|| other.reference.clone()),
            limit: self.limit.or(other.limit),
            certifiable: match (self.certifiable, other.certifiable) {
                (Some(a), Some(b)) => Some(a && b),
                (a, b) => a.or(b),
            },
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::dirichlet::Dirichlet;
    use lapsolve::registry::{Accuracy as Class, BACKENDS, Precision};
    use lapsolve::sparse::SymmetricCsr;

    #[test]
    fn a_stale_solution_does_not_pass_after_an_update() {
        let path =
            [(0, 0, 1.0), (0, 1, -1.0), (1, 1, 2.0), (1, 2, -1.0), (2, 2, 2.0), (2, 3, -1.0), (3, 3, 1.0)];
        let laplacian = SymmetricCsr::from_triplets(4, &path).unwrap();
        let problem = Box::new(Dirichlet::new(laplacian, None, &[0, 3]).unwrap());
        let equations =
            Equations::Harmonic { problem, positions: None, triangles: None, g: vec![0.0, 3.0], k: 1 };
        let check = Check::new(equations, None, |l| Some(l.harmonic), BACKENDS);
        let limits = Limits::of(Precision::F64, Class::Direct, 1e-10);
        let stale = [0.0, 1.0, 2.0, 3.0];
        let checked = check.solution(&stale, &limits);
        assert!(checked.is_valid() && checked.accuracy.certifiable == Some(true), "{checked:?}");
        // The middle edge ten times as stiff: u = (0, 10/7, 11/7, 3).
        let changed = check.equations.with_values(&[1.0, -1.0, 11.0, -10.0, 11.0, -1.0, 1.0]).unwrap();
        assert!(check.updated(&changed, &[0.0, 10.0 / 7.0, 11.0 / 7.0, 3.0], &limits).is_valid());
        assert!(!check.updated(&changed, &stale, &limits).is_valid());
    }

    #[test]
    fn the_worst_of_two_checks_is_kept() {
        let mut a = Accuracy { backward_error: Some(1.0), certifiable: Some(true), ..Accuracy::default() };
        let b = Accuracy {
            backward_error: Some(2.0),
            forward_error: Some(3.0),
            certifiable: Some(false),
            ..Accuracy::default()
        };
        a.worsen(&b);
        assert_eq!((a.backward_error, a.forward_error, a.certifiable), (Some(2.0), Some(3.0), Some(false)));
    }
}
