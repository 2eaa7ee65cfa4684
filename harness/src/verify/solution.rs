//! Checks one solution of one system: residual, constraints, distance from the reference, verdict.

use super::reference::Reference;
use crate::record::result::Accuracy;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::limits::Limits;
use lapsolve::residual::Residual;
use lapsolve::sparse::SymmetricCsr;

/// What was asked for.
#[derive(Clone, Copy, Debug)]
pub enum Question<'a> {
    /// A x = b, both n x k.
    System {
        /// A.
        matrix: &'a SymmetricCsr,
        /// b.
        rhs: Columns<&'a [f64]>,
    },
    /// The field over all vertices that extends `values` (|C| x k) harmonically.
    Harmonic {
        /// L and C.
        problem: &'a Dirichlet,
        /// g.
        values: Columns<&'a [f64]>,
    },
}

/// How far from the reference an answer may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// What the residual is held to.
    pub limits: Limits,
    /// Largest forward error, relative to `scale`; `None` where forward errors cannot be certified for any backend.
    pub forward: Option<f64>,
    /// The unit of the forward error: the mesh's diagonal, the largest constraint, the largest |x|.
    pub scale: f64,
}

/// The outcome of a check.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// All figures, for the record.
    pub accuracy: Accuracy,
    /// Why the answer is wrong; empty if it is not.
    pub faults: Vec<String>,
}

impl Checked {
    /// Whether the answer counts.
    pub fn is_valid(&self) -> bool {
        self.faults.is_empty()
    }
}

/// Checks `x` (n x k; over all vertices for a harmonic field) against the question, and against `reference` (over the
/// free rows for a harmonic field) where there is one.
///
/// Above a limit the answer is wrong. Only where the two refined solutions behind the reference differ by more than a
/// tenth of the forward limit, nothing is claimed about the forward error: `certifiable` is then false.
///
/// # Panics
/// If shapes do not fit.
pub fn check_solution(
    question: Question<'_>,
    x: Columns<&[f64]>,
    reference: Option<&Reference>,
    tolerance: &Tolerance,
) -> Checked {
    match question {
        Question::System { matrix, rhs } => check_rows(matrix, rhs, x, reference, tolerance),
        Question::Harmonic { problem, values } => check_field(problem, values, x, reference, tolerance),
    }
}

fn check_field(
    problem: &Dirichlet,
    values: Columns<&[f64]>,
    field: Columns<&[f64]>,
    reference: Option<&Reference>,
    tolerance: &Tolerance,
) -> Checked {
    let k = values.k();
    let largest = values.slice().iter().fold(0.0f64, |m, g| m.max(g.abs()));
    let constraint_error =
        constraint_error(problem, values, field) / if largest > 0.0 { largest } else { 1.0 };
    let mut checked = match problem.system() {
        None => Checked { accuracy: Accuracy::default(), faults: Vec::new() },
        Some(system) => {
            let rows = problem.free().len();
            let (mut free, mut rhs) = (vec![0.0; rows * k], vec![0.0; rows * k]);
            problem.gather(field, Columns::new(&mut free, rows, k));
            problem.right_hand_side(values, Columns::new(&mut rhs, rows, k));
            let (rhs, free) = (Columns::new(&rhs[..], rows, k), Columns::new(&free[..], rows, k));
            check_rows(system.matrix(), rhs, free, reference, tolerance)
        }
    };
    checked.accuracy.constraint_error = Some(constraint_error);
    if constraint_error.is_nan() || constraint_error > tolerance.limits.harmonic {
        checked.faults.push(format!("a constrained or absent vertex is off by {constraint_error:.1e}"));
    }
    checked
}

/// Largest deviation from g on C, and from 0 on absent vertices.
fn constraint_error(problem: &Dirichlet, values: Columns<&[f64]>, field: Columns<&[f64]>) -> f64 {
    let larger = |m: f64, d: f64| if d.is_nan() { f64::INFINITY } else { m.max(d) };
    let mut absent = vec![true; field.n()];
    let mut worst = 0.0f64;
    for (row, &v) in problem.fixed().iter().enumerate() {
        absent[v as usize] = false;
        let pairs = field.row(v as usize).iter().zip(values.row(row));
        worst = pairs.map(|(u, g)| (u - g).abs()).fold(worst, larger);
    }
    problem.free().iter().for_each(|&v| absent[v as usize] = false);
    let zeros = (0..field.n()).filter(|&v| absent[v]).flat_map(|v| field.row(v));
    zeros.map(|u| u.abs()).fold(worst, larger)
}

fn check_rows(
    matrix: &SymmetricCsr,
    rhs: Columns<&[f64]>,
    x: Columns<&[f64]>,
    reference: Option<&Reference>,
    tolerance: &Tolerance,
) -> Checked {
    let residual = Residual::measure(matrix, x, rhs);
    let limits = &tolerance.limits;
    let mut faults = Vec::new();
    let mut judge = |what: &str, value: f64, limit: Option<f64>| {
        if limit.is_some_and(|limit| value > limit || value.is_nan()) {
            faults.push(format!("{what} {value:.1e} exceeds {:.1e}", limit.unwrap_or_default()));
        }
    };
    judge("backward error", residual.backward_error, limits.backward_error);
    judge("relative residual", residual.relative, limits.relative_residual);
    let scale = if tolerance.scale > 0.0 { tolerance.scale } else { 1.0 };
    let forward_error = reference.map(|r| r.distance(x.slice()) / scale);
    let certifiable =
        reference.map(|r| tolerance.forward.is_some_and(|limit| r.spread() / scale <= 0.1 * limit));
    if let (Some(error), Some(true)) = (forward_error, certifiable) {
        judge("forward error", error, tolerance.forward);
    }
    let accuracy = Accuracy {
        backward_error: finite(residual.backward_error),
        backward_limit: limits.backward_error,
        componentwise: finite(residual.componentwise),
        relative_residual: finite(residual.relative),
        residual_limit: limits.relative_residual,
        forward_error: forward_error.and_then(finite),
        reference: reference.map(|r| r.description().to_owned()),
        limit: tolerance.forward,
        certifiable,
        ..Accuracy::default()
    };
    Checked { accuracy, faults }
}

/// JSON has no infinity; a figure that is none is unknown there, and a fault says why.
fn finite(x: f64) -> Option<f64> {
    Some(x).filter(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::registry::{Accuracy as Class, BACKENDS, Precision};
    use lapsolve::system::System;

    fn path(n: u32, shift: f64) -> SymmetricCsr {
        let triplets: Vec<_> =
            (0..n - 1).flat_map(|i| [(i, i, 1.0 + shift), (i + 1, i + 1, 1.0), (i, i + 1, -1.0)]).collect();
        SymmetricCsr::from_triplets(n as usize, &triplets).expect("an upper triangle")
    }

    fn strict(scale: f64) -> Tolerance {
        let limits = Limits::of(Precision::F64, Class::Direct, 0.0);
        Tolerance { limits, forward: Some(limits.poisson), scale }
    }

    #[test]
    fn right_answers_pass_and_wrong_ones_say_why() {
        let (n, k) = (30, 2);
        let matrix = path(n as u32, 0.1);
        let b: Vec<f64> = (0..n * k).map(|i| (i as f64).cos()).collect();
        let system = System::new(matrix.clone(), None).expect("finite");
        let b = Columns::new(&b[..], n, k);
        let reference = Reference::solve(BACKENDS, &system, b).expect("positive definite");
        let question = Question::System { matrix: &matrix, rhs: b };
        let check =
            |x: &[f64]| check_solution(question, Columns::new(x, n, k), Some(&reference), &strict(1.0));
        let right = check(reference.solution());
        assert!(right.is_valid() && right.accuracy.certifiable == Some(true), "{right:?}");
        assert_eq!(right.accuracy.forward_error, Some(0.0));

        let mut wrong = reference.solution().to_vec();
        wrong[17] += 1e-6;
        let wrong = check(&wrong);
        assert_eq!(wrong.faults.len(), 2, "{:?}", wrong.faults);
        let nan = check(&vec![f64::NAN; n * k]);
        assert!(!nan.is_valid() && nan.accuracy.backward_error.is_none());
    }

    #[test]
    fn small_residual_with_a_large_error_is_caught() {
        // Nearly singular: adding a constant changes the residual by 1e-16 only.
        let n = 30;
        let matrix = path(n as u32, 1e-13);
        let b: Vec<f64> = (0..n)
            .map(|i| {
                if i == 0 {
                    1.0
                } else if i == n - 1 {
                    -1.0
                } else {
                    0.0
                }
            })
            .collect();
        let system = System::new(matrix.clone(), None).expect("finite");
        let b = Columns::new(&b[..], n, 1);
        let reference = Reference::solve(BACKENDS, &system, b).expect("positive definite");
        let shifted: Vec<f64> = reference.solution().iter().map(|x| x + 1e-3).collect();
        let question = Question::System { matrix: &matrix, rhs: b };
        let checked = check_solution(question, Columns::new(&shifted, n, 1), Some(&reference), &strict(15.0));
        assert_eq!(checked.faults.len(), 1, "{checked:?}");
        assert!(checked.faults[0].contains("forward"), "{:?}", checked.faults);
    }

    #[test]
    fn fields_are_checked_on_constraints_and_absent_vertices_too() {
        let mut triplets = Vec::new();
        for i in 0..8u32 {
            triplets.extend([(i, i, 1.0), (i + 1, i + 1, 1.0), (i, i + 1, -1.0)]);
        }
        let laplacian = SymmetricCsr::from_triplets(10, &triplets).expect("an upper triangle");
        let problem = Dirichlet::new(laplacian, None, &[0, 8]).expect("constrained");
        let values = [0.0, 8.0];
        let question = Question::Harmonic { problem: &problem, values: Columns::new(&values, 2, 1) };
        let mut field: Vec<f64> = (0..9).map(f64::from).chain([0.0]).collect();
        let check =
            |field: &[f64]| check_solution(question, Columns::new(field, 10, 1), None, &strict(8.0)).faults;
        assert_eq!(check(&field), [""; 0]);
        field[9] = 1.0;
        assert!(check(&field)[0].contains("absent"));
        field[9] = 0.0;
        field[8] = 7.9;
        assert!(check(&field)[0].contains("constrained"));
    }
}
