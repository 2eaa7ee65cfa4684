//! L5 for `skinning`: weights of all bones sum to one, lie between none and all, and end at the nearest bone.

use super::behaviour::is_m_matrix;
use super::finding::{Findings, Level, Outcome};
use super::subject::{NoAnswer, Subject};
use lapsolve::columns::Columns;
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::skinning::defaults::default_bones;
use lapsolve::workload::skinning::{HEAT, SkinningProblem};

/// What the sum of the weights of a vertex may be off by with a direct f64 solver.
const SUM: f64 = 1e-10;

/// Heat so strong that only the nearest bone is left.
const STRONG: f64 = 1e8;

/// All checks with the default bones of `mesh`.
pub fn check(
    case: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
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
        let outcome = partition(usual, subject, findings).and_then(|()| nearest(strong, subject, findings));
        if let Err(no) = outcome {
            no.record(findings, Level::Behaviour, "weights sum to 1", must_converge);
        }
    }
}

fn weights(problem: &SkinningProblem, subject: &Subject) -> Result<Vec<f64>, NoAnswer> {
    let (rows, k) = (problem.system().vertices().len(), problem.bones());
    let rhs = problem.right_hand_side();
    subject.solve(problem.system().system(), Columns::new(&rhs[..], rows, k))
}

fn partition(problem: &SkinningProblem, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let (w, k) = (weights(problem, subject)?, problem.bones());
    let limit = if subject.exact { SUM } else { k as f64 * subject.limits.poisson };
    let sum = worst(w.chunks_exact(k).map(|row| (row.iter().sum::<f64>() - 1.0).abs()));
    findings.at_most(Level::Behaviour, "weights sum to 1", sum, limit, format!("{k} bones"));
    if is_m_matrix(problem.system().system().matrix()) {
        let outside = worst(w.iter().map(|&x| (-x).max(x - 1.0).max(0.0)));
        findings.at_most(Level::Behaviour, "weights in [0, 1]", outside, limit, "no positive off-diagonal");
    }
    Ok(())
}

/// |w - p| <= |L w| / h row by row, and |L w| <= (sum of |L_ij|) max |w|.
fn nearest(problem: &SkinningProblem, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let (w, k) = (weights(problem, subject)?, problem.bones());
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
