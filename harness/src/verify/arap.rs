//! L5 for `arap`: handles in place change nothing, translations are exact, rigid poses are at rest, the energy never rises.

use super::finding::{Findings, Level, Outcome};
use super::subject::{NoAnswer, Subject};
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::rotation::{about_axis, product, rotate};
use lapsolve::vector::{Vector, add};
use lapsolve::workload::arap::{Arap, ArapError, ArapProblem, defaults};

/// Rounding that an iteration may add to the energy, relative to the first one.
const ROUNDING: f64 = 1e-9;

impl From<ArapError> for NoAnswer {
    fn from(error: ArapError) -> Self {
        match error {
            ArapError::Prepare(error) => error.into(),
            other => NoAnswer::Failed(other.to_string()),
        }
    }
}

/// All checks with the default handles of `mesh`.
pub fn check(
    case: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
    must_converge: bool,
    findings: &mut Findings,
) {
    let (handles, targets) = defaults::handles(mesh);
    for subject in subjects {
        findings.about(case, Some(&subject.id));
        if !subject.takes(mesh.positions().len()) {
            findings.note(
                Level::Behaviour,
                "arap, identity",
                Outcome::Skipped,
                "more unknowns than it takes",
            );
            continue;
        }
        if let Err(no) = poses(mesh, &handles, &targets, subject, findings) {
            no.record(findings, Level::Behaviour, "arap, identity", must_converge);
        }
    }
}

fn poses(
    mesh: &TriangleMesh,
    handles: &[u32],
    targets: &[Vector],
    subject: &Subject,
    findings: &mut Findings,
) -> Result<(), NoAnswer> {
    let limit = subject.limits.arap;
    let problem = ArapProblem::new(mesh, handles, Weights::ClampedPerEdge)?;
    let mut arap = subject.ask(|| Ok(Arap::prepare(&*subject.backend, &problem, &mut |_| {})?))?;
    let used = used(mesh);
    let at = |pose: &[Vector]| -> Vec<Vector> { handles.iter().map(|&v| pose[v as usize]).collect() };
    let mut x = mesh.positions().to_vec();
    subject.ask(|| Ok(arap.solve(&at(mesh.positions()), 2, &mut x)?))?;
    let off = distance(mesh, &used, &x, mesh.positions());
    findings.at_most(Level::Behaviour, "arap, identity", off, limit, "of the diagonal");

    let shift = [0.7, -0.4, 0.2].map(|t| t * mesh.diagonal());
    let moved: Vec<Vector> = mesh.positions().iter().map(|&p| add(p, shift)).collect();
    subject.ask(|| Ok(arap.solve(&at(&moved), 2, &mut x)?))?;
    let off = distance(mesh, &used, &x, &moved);
    findings.at_most(Level::Behaviour, "arap, translation", off, limit, "of the diagonal");

    let q = product(about_axis(1, 2.5), about_axis(0, 0.4));
    let turned: Vec<Vector> = mesh.positions().iter().map(|&p| add(rotate(q, p), shift)).collect();
    arap.resume(&at(&turned), &turned)?;
    subject.ask(|| Ok(arap.iterate(2)?))?;
    arap.write(&mut x);
    let off = distance(mesh, &used, &x, &turned);
    findings.at_most(Level::Behaviour, "arap, a rigid pose is at rest", off, limit, "of the diagonal");

    arap.start(targets)?;
    energy(&mut arap, subject, findings)
}

/// With no negative weight neither step can raise the energy.
fn energy(arap: &mut Arap, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let first = arap.energy();
    let (mut before, mut rise) = (first, 0.0_f64);
    for _ in 0..5 {
        subject.ask(|| Ok(arap.iterate(1)?))?;
        let now = arap.energy();
        rise = if now.is_nan() { f64::INFINITY } else { rise.max(now - before) };
        before = now;
    }
    let limit = if subject.exact { ROUNDING } else { subject.limits.arap.max(ROUNDING) };
    let unit = if first > 0.0 { first } else { 1.0 };
    findings.at_most(
        Level::Behaviour,
        "arap, the energy never rises",
        rise / unit,
        limit,
        "of the first energy",
    );
    Ok(())
}

/// Vertices of triangles that have an area: the others stay where they are.
fn used(mesh: &TriangleMesh) -> Vec<bool> {
    let mut used = vec![false; mesh.positions().len()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        if !mesh.is_zero_area(t) {
            triangle.iter().for_each(|&v| used[v as usize] = true);
        }
    }
    used
}

fn distance(mesh: &TriangleMesh, used: &[bool], x: &[Vector], expected: &[Vector]) -> f64 {
    let unit = if mesh.diagonal() > 0.0 { mesh.diagonal() } else { 1.0 };
    let pairs = x.iter().zip(expected).zip(used).filter(|&(_, &used)| used);
    let off = pairs.flat_map(|((a, b), _)| (0..3).map(move |i| (a[i] - b[i]).abs()));
    off.fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) }) / unit
}
