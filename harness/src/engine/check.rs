//! The parent checks every answer itself, against the matrix it made and its own reference.

use super::equations::Equations;
use super::reference::{Reference, refined};
use crate::record::result::Accuracy;
use lapsolve::limits::Limits;
use lapsolve::registry::Entry;

/// Equations, and a reference solution of them.
#[derive(Clone, Debug)]
pub struct Check {
    /// What is solved.
    pub equations: Equations,
    scale: f64,
    forward: ForwardLimit,
    reference: Option<Reference>,
}

/// The forward limit that applies to a workload.
pub type ForwardLimit = fn(&Limits) -> f64;

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checked {
    /// The figures.
    pub accuracy: Accuracy,
    /// What is wrong with the answer, if anything.
    pub wrong: Option<String>,
}

impl Check {
    /// Solves `equations` for reference with the best of `backends`, with two elimination orders if `thorough`.
    ///
    /// Errors are relative to `scale`; without one, to the largest |g| of `harmonic` and the largest |x| of a system.
    pub fn new(
        equations: Equations,
        scale: Option<f64>,
        forward: ForwardLimit,
        backends: &[Entry],
        thorough: bool,
    ) -> Self {
        let k = equations.columns();
        let reference = equations.reduced().and_then(|(system, b)| refined(backends, system, &b, k, thorough));
        let largest = |block: &[f64]| block.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let natural = match (&equations, &reference) {
            (Equations::Harmonic { g, .. }, _) => largest(g),
            (Equations::System { .. }, Some(reference)) => largest(&reference.x),
            (Equations::System { .. }, None) => 0.0,
        };
        let scale = Some(scale.unwrap_or(natural)).filter(|&s| s > 0.0).unwrap_or(1.0);
        Self { equations, scale, forward, reference }
    }

    /// Checks `x` (rows x k) against the limits of its class.
    pub fn solution(&self, x: &[f64], limits: &Limits) -> Checked {
        let mut checked = self.residual_of(&self.equations, x, limits);
        let Some(reference) = &self.reference else { return checked };
        let limit = (self.forward)(limits);
        let x = self.equations.unknown_rows(x);
        let worst = x.iter().zip(&reference.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (error, certifiable) = (worst / self.scale, reference.spread / self.scale <= 0.1 * limit);
        checked.accuracy.forward_error = Some(error);
        checked.accuracy.certifiable = Some(certifiable);
        checked.accuracy.reference = Some(reference.made_by.clone());
        if certifiable && error > limit {
            checked.wrong.get_or_insert(format!("forward error {error:.1e} exceeds {limit:.1e}"));
        }
        checked
    }

    /// Checks the residual of `x` in `equations`: these or the same with other values, for which there is no reference.
    pub fn residual_of(&self, equations: &Equations, x: &[f64], limits: &Limits) -> Checked {
        let limit = (self.forward)(limits);
        let misfit = equations.misfit(x);
        let constraint_error = misfit.constraints.map(|worst| worst / self.scale);
        let accuracy = Accuracy {
            backward_error: Some(misfit.residual.backward_error),
            backward_limit: limits.backward_error,
            componentwise: Some(misfit.residual.componentwise),
            relative_residual: Some(misfit.residual.relative),
            residual_limit: limits.relative_residual,
            constraint_error,
            limit: Some(limit),
            ..Accuracy::default()
        };
        let not_finite = x.iter().position(|v| !v.is_finite());
        let wrong = if let Some(at) = not_finite {
            Some(format!("row {} of the solution is not finite", at / equations.columns()))
        } else if let Some(error) = constraint_error.filter(|&error| error > limit) {
            Some(format!("constrained values are off by {error:.1e}"))
        } else if !limits.accepts(&misfit.residual) {
            Some(excess(&misfit.residual, limits))
        } else {
            None
        };
        Checked { accuracy, wrong }
    }
}

/// Which residual limit is exceeded, and by what.
fn excess(residual: &lapsolve::residual::Residual, limits: &Limits) -> String {
    match (limits.backward_error, limits.relative_residual) {
        (Some(limit), _) if residual.backward_error > limit => {
            format!("backward error {:.1e} exceeds {limit:.1e}", residual.backward_error)
        }
        (_, Some(limit)) => format!("relative residual {:.1e} exceeds {limit:.1e}", residual.relative),
        _ => "the residual exceeds its limit".to_owned(),
    }
}

impl Accuracy {
    /// Keeps the larger error of two checks of one cell.
    pub fn worsen(&mut self, other: &Self) {
        let worst = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => Some(if a >= b || a.is_nan() { a } else { b }),
            (a, b) => a.or(b),
        };
        *self = Self {
            backward_error: worst(self.backward_error, other.backward_error),
            componentwise: worst(self.componentwise, other.componentwise),
            relative_residual: worst(self.relative_residual, other.relative_residual),
            forward_error: worst(self.forward_error, other.forward_error),
            constraint_error: worst(self.constraint_error, other.constraint_error),
            certifiable: match (self.certifiable, other.certifiable) {
                (Some(a), Some(b)) => Some(a && b),
                (a, b) => a.or(b),
            },
            ..other.clone()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::dirichlet::Dirichlet;
    use lapsolve::registry::{Accuracy as Class, BACKENDS, Precision};
    use lapsolve::sparse::SymmetricCsr;

    fn path() -> SymmetricCsr {
        SymmetricCsr::from_triplets(4, &[
            (0, 0, 1.0), (0, 1, -1.0), (1, 1, 2.0), (1, 2, -1.0), (2, 2, 2.0), (2, 3, -1.0), (3, 3, 1.0),
        ])
        .unwrap()
    }

    fn field() -> Check {
        let problem = Box::new(Dirichlet::new(path(), None, &[0, 3]).unwrap());
        let equations = Equations::Harmonic { problem, positions: None, g: vec![0.0, 3.0], k: 1 };
        Check::new(equations, None, |l| l.harmonic, BACKENDS, true)
    }

    fn limits() -> Limits {
        Limits::of(Precision::F64, Class::Direct, 1e-10)
    }

    #[test]
    fn the_right_field_passes() {
        let checked = field().solution(&[0.0, 1.0, 2.0, 3.0], &limits());
        assert_eq!(checked.wrong, None);
        assert_eq!(checked.accuracy.certifiable, Some(true));
        assert!(checked.accuracy.forward_error.unwrap() < 1e-15);
    }

    #[test]
    fn wrong_fields_are_caught_and_the_reason_says_why() {
        let reason = |x: [f64; 4]| field().solution(&x, &limits()).wrong.unwrap();
        assert!(reason([0.0, 1.0 + 1e-8, 2.0, 3.0]).contains("backward error"));
        assert!(reason([0.1, 1.0, 2.0, 3.0]).contains("constrained values"));
        assert!(reason([0.0, f64::NAN, 2.0, 3.0]).contains("row 1 of the solution is not finite"));
    }

    #[test]
    fn a_stale_solution_does_not_pass_after_an_update() {
        let check = field();
        // The middle edge ten times as stiff: u = (0, 10/7, 11/7, 3).
        let changed = check.equations.with_values(&[1.0, -1.0, 11.0, -10.0, 11.0, -1.0, 1.0]).unwrap();
        let u = [0.0, 10.0 / 7.0, 11.0 / 7.0, 3.0];
        assert_eq!(check.residual_of(&changed, &u, &limits()).wrong, None);
        assert!(check.residual_of(&changed, &[0.0, 1.0, 2.0, 3.0], &limits()).wrong.is_some());
    }

    #[test]
    fn an_iterative_class_is_held_to_its_tolerance() {
        let loose = Limits::of(Precision::F64, Class::Iterative, 1e-4);
        assert_eq!(field().solution(&[0.0, 1.0 + 1e-5, 2.0, 3.0], &loose).wrong, None);
        let wrong = field().solution(&[0.0, 1.001, 2.0, 3.0], &loose).wrong.unwrap();
        assert!(wrong.contains("relative residual"), "{wrong}");
    }

    #[test]
    fn the_worst_of_two_checks_is_kept() {
        let mut a = Accuracy { backward_error: Some(1.0), certifiable: Some(true), ..Accuracy::default() };
        let b = Accuracy { backward_error: Some(2.0), forward_error: Some(3.0), certifiable: Some(false), ..Accuracy::default() };
        a.worsen(&b);
        assert_eq!((a.backward_error, a.forward_error, a.certifiable), (Some(2.0), Some(3.0), Some(false)));
    }
}
