//! L5 for `skinning`: weights of all bones sum to one, lie between none and all, and end at the nearest bone.
//!
//! Two sums are looked at. That of the *weights* is 1 for everyone who uses them, because they are divided by it. That of the
//! *solution* says whether it was right to: it may differ from 1 by what rounding does to the system, no more.

use super::behaviour::is_m_matrix;
use super::condition::forward_bound;
use super::finding::{Findings, Level, Outcome};
use super::reference::Trusted;
use super::subject::{NoAnswer, Subject};
use lapsolve::backend::{Factor, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::limits::Limits;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;
use lapsolve::residual::Residual;
use lapsolve::workload::skinning::defaults::default_bones;
use lapsolve::workload::skinning::{HEAT, SkinningProblem};

/// What the sum of the weights of a vertex may be off by with a direct f64 solver.
const SUM: f64 = 1e-10;

/// Heat so strong that only the nearest bone is left.
const STRONG: f64 = 1e8;

/// A solution that may be off by this share of a weight says nothing about its solver.
const VAGUE: f64 = 1e-2;

/// All checks with the default bones of `mesh`.
pub fn check(
    case: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
    trusted: &[Entry],
    must_converge: bool,
    findings: &mut Findings,
) {
    let bones = default_bones(mesh);
    let problems = [HEAT, STRONG].map(|heat| SkinningProblem::new(mesh, &bones, heat));
    let [Ok(usual), Ok(strong)] = &problems else {
        findings.about(case, None);
        let why = problems.into_iter().find_map(Result::err).map_or(String::new(), |error| error.to_string());
        return findings.note(Level::Input, "skinning", Outcome::Failed, why);
    };
    let mut sums = Sums { problem: usual, trusted, factor: None };
    for subject in subjects {
        findings.about(case, Some(&subject.id));
        if !subject.takes(usual.system().vertices().len()) {
            findings.note(
                Level::Behaviour,
                "weights sum to 1",
                Outcome::Skipped,
                "more unknowns than it takes",
            );
            continue;
        }
        let outcome =
            partition(&mut sums, subject, findings).and_then(|()| nearest(strong, subject, findings));
        if let Err(no) = outcome {
            no.record(findings, Level::Behaviour, "weights sum to 1", must_converge);
        }
    }
}

/// The row sums of a problem's solution, and how far from 1 they may be.
struct Sums<'a> {
    problem: &'a SkinningProblem,
    trusted: &'a [Entry],
    factor: Option<Box<dyn Factor>>,
}

impl Sums<'_> {
    /// || |A^-1| r ||_inf, where r_i = eta (|A| 1 + b)_i with the backward error eta that the class is held to, b = M H 1; for
    /// backends that iterate, which promise ||r||_2 <= tolerance ||b||_2, every r_i is that. The rounding of the
    /// stored diagonal, a few eps A_ii, is in it: A 1 = b holds to no more. `None` where no trusted factor is to be had.
    fn limit(&mut self, limits: &Limits) -> Option<f64> {
        let system = self.problem.system().system();
        let b = self.problem.system().vertices().iter().map(|&v| self.problem.heat()[v as usize]);
        let residual: Vec<f64> = match (limits.backward_error, limits.relative_residual) {
            (Some(eta), _) => {
                system.matrix().absolute_row_sums().iter().zip(b).map(|(a, b)| eta * (a + b)).collect()
            }
            (None, tolerance) => {
                let size = b.map(|b| b * b).sum::<f64>().sqrt();
                vec![tolerance? * size; system.n()]
            }
        };
        if self.factor.is_none() {
            let backend = Trusted::choose(self.trusted, system.n()).ok()?.backend;
            self.factor = backend.prepare(system, &PrepareOptions::columns(1), &mut |_| {}).ok();
        }
        forward_bound(&mut **self.factor.as_mut()?, &residual)
    }

    /// Holds `off`, the largest |sum - 1|, against the limit `usual` of well-conditioned systems, and where it is beyond, against
    /// what the condition allows.
    fn judge(&mut self, off: f64, usual: f64, subject: &Subject, findings: &mut Findings) {
        const CHECK: &str = "solution sums to 1";
        if off <= usual {
            return findings.at_most(Level::Behaviour, CHECK, off, usual, "");
        }
        let limit = self.limit(&subject.limits).unwrap_or(usual).max(usual);
        let outcome = match off <= limit {
            false => Outcome::Failed,
            true if limit > VAGUE => Outcome::NotCertifiable,
            true => Outcome::Passed,
        };
        let note = "what the condition makes of the backward error allowed";
        findings.push(Level::Behaviour, CHECK, Some(off), Some(limit), outcome, note);
    }
}

fn solution(problem: &SkinningProblem, subject: &Subject) -> Result<Vec<f64>, NoAnswer> {
    let (rows, k) = (problem.system().vertices().len(), problem.bones());
    let rhs = problem.right_hand_side();
    subject.solve(problem.system().system(), Columns::new(&rhs[..], rows, k))
}

fn partition(sums: &mut Sums<'_>, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let problem = sums.problem;
    let (solved, rows, k) = (solution(problem, subject)?, problem.system().vertices().len(), problem.bones());
    let (matrix, rhs) = (problem.system().system().matrix(), problem.right_hand_side());
    let solved = Columns::new(&solved[..], rows, k);
    let residual = Residual::measure(matrix, solved, Columns::new(&rhs[..], rows, k));
    let (value, limit) = match subject.limits.backward_error {
        Some(limit) => (residual.backward_error, Some(limit)),
        None => (residual.relative, subject.limits.relative_residual),
    };
    let limit = limit.unwrap_or(f64::INFINITY);
    findings.at_most(Level::Residual, "weights solve the system", value, limit, format!("{k} bones"));
    let usual = if subject.exact { SUM } else { k as f64 * subject.limits.poisson };
    let off = |w: &[f64]| worst(w.chunks_exact(k).map(|row| (row.iter().sum::<f64>() - 1.0).abs()));
    sums.judge(off(solved.slice()), usual, subject, findings);
    let w = problem.system().gather(Columns::new(&problem.weights_of(solved)[..], problem.heat().len(), k));
    findings.at_most(Level::Behaviour, "weights sum to 1", off(&w), SUM, format!("{k} bones"));
    if is_m_matrix(matrix) {
        let outside = worst(w.iter().map(|&x| (-x).max(x - 1.0).max(0.0)));
        findings.at_most(Level::Behaviour, "weights in [0, 1]", outside, usual, "no positive off-diagonal");
    }
    Ok(())
}

/// |w - p| <= |L w| / h row by row, and |L w| <= (sum of |L_ij|) max |w|.
fn nearest(problem: &SkinningProblem, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let (w, k) = (solution(problem, subject)?, problem.bones());
    let largest = worst(w.iter().map(|x| x.abs()));
    let sums = problem.system().system().matrix().absolute_row_sums();
    let mut exceeds = 0.0_f64;
    for (row, (&v, sum)) in w.chunks_exact(k).zip(problem.system().vertices().iter().zip(sums)) {
        let heat = problem.heat()[v as usize];
        if heat == 0.0 {
            continue;
        }
        let near = problem.nearest(v as usize);
        let p = |j: u32| if near.contains(&j) { 1.0 / near.len() as f64 } else { 0.0 };
        let off = worst((0..).zip(row).map(|(j, x)| (x - p(j)).abs()));
        exceeds = worst([exceeds, off - (sum - heat) * largest / heat].into_iter());
    }
    let limit = if subject.exact { SUM } else { k as f64 * subject.limits.poisson };
    findings.at_most(
        Level::Behaviour,
        "strong heat leaves the nearest bone",
        exceeds,
        limit,
        "beyond |L w| / h",
    );
    Ok(())
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m, x| if x.is_nan() { f64::INFINITY } else { m.max(x) })
}
