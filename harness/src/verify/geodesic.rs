//! L4 and L5 for `geodesic`: straight lines on planes, arcs on spheres, nothing at the source.

use super::finding::{Findings, Level, Outcome};
use super::subject::{NoAnswer, Subject};
use crate::shapes;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{Vector, distance_squared, dot, norm};
use lapsolve::workload::geodesic::{Geodesic, GeodesicError, GeodesicProblem};

/// Rounding at the source, in diagonals.
const ZERO: f64 = 1e-12;

impl From<GeodesicError> for NoAnswer {
    fn from(error: GeodesicError) -> Self {
        match error {
            GeodesicError::Prepare(error) => error.into(),
            other => NoAnswer::Failed(other.to_string()),
        }
    }
}

/// A surface on which distances are known: its name, the exact distance, and what the method may be off by there, relative to
/// the largest distance (it halves with the edges; a third more than seen).
type Known = (&'static str, fn(Vector, Vector) -> f64, f64);

const KNOWN: [Known; 2] = [
    ("grid:64", |a, b| distance_squared(a, b).sqrt(), 0.03),
    ("sphere:5", |a, b| (dot(a, b) / (norm(a) * norm(b))).clamp(-1.0, 1.0).acos(), 0.02),
];

/// All checks of direct f64 solvers; others cannot see the heat far from the source.
pub fn check(subjects: &[Subject], findings: &mut Findings) {
    for (name, exact, limit) in KNOWN {
        let mesh = shapes::generate(name).and_then(Result::ok).expect("a generated shape");
        for subject in subjects {
            findings.about(name, Some(&subject.id));
            if !subject.exact || !subject.takes(mesh.positions().len()) {
                let why =
                    if subject.exact { "more unknowns than it takes" } else { "needs a direct f64 solver" };
                findings.note(Level::Discretisation, "geodesic distances", Outcome::Skipped, why);
            } else if let Err(no) = distances(&mesh, exact, limit, subject, findings) {
                no.record(findings, Level::Discretisation, "geodesic distances", true);
            }
        }
    }
}

fn distances(
    mesh: &TriangleMesh,
    exact: fn(Vector, Vector) -> f64,
    limit: f64,
    subject: &Subject,
    findings: &mut Findings,
) -> Result<(), NoAnswer> {
    let source = mesh.positions().len() / 2;
    let problem = GeodesicProblem::new(mesh, Mass::Barycentric)?;
    let mut geodesic = Geodesic::prepare(&*subject.backend, &problem, &mut |_| {})?;
    let mut found = vec![0.0; mesh.positions().len()];
    geodesic.solve(&[source as u32], &mut found)?;
    let from = mesh.positions()[source];
    let expected: Vec<f64> = mesh.positions().iter().map(|&p| exact(from, p)).collect();
    let largest = expected.iter().fold(0.0_f64, |m, &d| m.max(d));
    let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs() / largest);
    let worst = off.fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) });
    findings.at_most(Level::Discretisation, "geodesic distances", worst, limit, "of the largest distance");
    let at_source = found[source].abs() / mesh.diagonal();
    findings.at_most(Level::Behaviour, "no distance at the source", at_source, ZERO, "of the diagonal");
    Ok(())
}
