//! L5 for `transfer`: poses whose answer is known. The identity changes nothing, rigid motions stay rigid, and neither the order
//! of vertices nor that of marks matters.

use super::agreement::Answers;
use super::finding::{Findings, Level, Outcome};
use super::noise::shuffled;
use super::subject::{NoAnswer, Subject};
use lapsolve::backend::TransferFrame;
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Precision;
use lapsolve::rotation::{about_axis, product, rotate};
use lapsolve::vector::{Vector, add, distance_squared, scale};
use lapsolve::workload::transfer::TransferProblem;
use lapsolve::workload::transfer::defaults::default_marks;
use lapsolve::workload::twist::{EXTREME_FRAME, Twist};

/// All checks of `transfer` on a mesh that is its own template, and the agreement of all subjects on a twisted pose.
pub fn check(
    case: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
    must_converge: bool,
    findings: &mut Findings,
) {
    let marks = default_marks(mesh);
    let problem = match TransferProblem::new(mesh, mesh.clone(), &marks, Weights::Plain) {
        Ok(problem) => problem,
        Err(error) => {
            findings.about(case, None);
            return findings.note(Level::Input, "transfer", Outcome::Failed, error.to_string());
        }
    };
    let mut answers = Answers::new(mesh.diagonal());
    for subject in subjects {
        findings.about(case, Some(&subject.id));
        if !subject.takes(mesh.positions().len()) {
            findings.note(Level::Behaviour, "identity pose", Outcome::Skipped, "more unknowns than it takes");
            continue;
        }
        match poses(mesh, &problem, subject, findings) {
            Ok(twisted) => {
                let renamed = vertex_names(mesh, &marks, &twisted, subject, findings);
                if let Err(no) = renamed {
                    no.record(findings, Level::Behaviour, "transfer, vertex names", must_converge);
                }
                answers.add(&subject.id, subject.limits.transfer, twisted.concat());
            }
            Err(no) => no.record(findings, Level::Behaviour, "identity pose", must_converge),
        }
    }
    findings.about(format!("{case}, transfer"), None);
    answers.compare(0.0, findings);
}

/// Identity and rigid motions against what is known; returns the answer to the twisted pose.
fn poses(
    mesh: &TriangleMesh,
    problem: &TransferProblem,
    subject: &Subject,
    findings: &mut Findings,
) -> Result<Vec<Vector>, NoAnswer> {
    let mut frames = subject.transfer(problem)?;
    let mut target = vec![[f64::NAN; 3]; mesh.positions().len()];
    subject.ask(|| Ok(frames.frame(mesh.positions(), &mut target)?))?;
    let identity = if subject.exact { 0.1 * subject.limits.transfer } else { subject.limits.transfer };
    let off = distance(mesh, &target, mesh.positions());
    findings.at_most(Level::Behaviour, "identity pose", off, identity, "of the diagonal");
    let mut worst = 0.0f64;
    for (angle, steps) in [(0.5, 0.0), (3.1, 0.3), (-2.0, 1.0)] {
        let q = product(about_axis(1, angle), about_axis(0, 0.4));
        let shift = scale(steps * mesh.diagonal(), [0.6, -0.8, 0.2]);
        let pose: Vec<Vector> = mesh.positions().iter().map(|&p| add(rotate(q, p), shift)).collect();
        subject.ask(|| Ok(frames.frame(&pose, &mut target)?))?;
        let stay = problem.pieces().unreferenced();
        let mut expected = pose;
        stay.iter().for_each(|&v| expected[v as usize] = mesh.positions()[v as usize]);
        worst = worst.max(distance(mesh, &target, &expected));
    }
    findings.at_most(Level::Behaviour, "rigid motion", worst, subject.limits.transfer, "of the diagonal");
    let mut pose = mesh.positions().to_vec();
    Twist::of(mesh).frame(EXTREME_FRAME, &mut pose);
    subject.ask(|| Ok(frames.frame(&pose, &mut target)?))?;
    right_hand_side(frames.trace().map(|t| t.rhs), subject, findings);
    let twisted = target.clone();
    for axis in 0..3 {
        half_turn(mesh, problem, axis, (&pose, &twisted), &mut *frames, findings, subject)?;
    }
    Ok(twisted)
}

/// A twisted pose turned by 180 degrees gives the twisted answer turned by 180 degrees: rotations of the marks then lie on both
/// sides of half a turn, where a rule such as "w >= 0" tears the field.
fn half_turn(
    mesh: &TriangleMesh,
    problem: &TransferProblem,
    axis: usize,
    (pose, answer): (&[Vector], &[Vector]),
    frames: &mut dyn TransferFrame,
    findings: &mut Findings,
    subject: &Subject,
) -> Result<(), NoAnswer> {
    let q = about_axis(axis, std::f64::consts::PI);
    let turned: Vec<Vector> = pose.iter().map(|&p| rotate(q, p)).collect();
    let mut target = vec![[f64::NAN; 3]; answer.len()];
    subject.ask(|| Ok(frames.frame(&turned, &mut target)?))?;
    let mut expected: Vec<Vector> = answer.iter().map(|&p| rotate(q, p)).collect();
    problem.pieces().unreferenced().iter().for_each(|&v| expected[v as usize] = mesh.positions()[v as usize]);
    let off = distance(mesh, &target, &expected);
    findings.at_most(
        Level::Behaviour,
        "half a turn",
        off,
        2.0 * subject.limits.transfer,
        "a twisted pose turned by 180 degrees",
    );
    Ok(())
}

/// U sums to zero: the fragments pull on each other, not on the whole.
fn right_hand_side(rhs: Option<&[f64]>, subject: &Subject, findings: &mut Findings) {
    let Some(rhs) = rhs else { return };
    let total: f64 = (0..3).map(|c| rhs.iter().skip(c).step_by(3).sum::<f64>().abs()).fold(0.0, f64::max);
    let size: f64 = rhs.iter().map(|x| x.abs()).sum();
    let relative = if total == 0.0 { 0.0 } else { total / size };
    // Every entry may be rounded: half an eps of f32, where frames are put together in it.
    let limit = if subject.precision == Precision::F32 { f64::from(f32::EPSILON) } else { 1e-12 };
    findings.at_most(Level::Behaviour, "U sums to zero", relative, limit, "of the sum of absolute values");
}

fn vertex_names(
    mesh: &TriangleMesh,
    marks: &[(u32, u32)],
    expected: &[Vector],
    subject: &Subject,
    findings: &mut Findings,
) -> Result<(), NoAnswer> {
    let n = mesh.positions().len();
    let old_of_new = shuffled(n, 11);
    let mut new_of_old = vec![0u32; n];
    (0..).zip(&old_of_new).for_each(|(new, &old)| new_of_old[old as usize] = new);
    let positions = old_of_new.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| new_of_old[v as usize])).collect();
    let renamed = TriangleMesh::new(positions, triangles).map_err(|e| NoAnswer::Failed(e.to_string()))?;
    let backwards: Vec<_> = marks.iter().rev().copied().collect();
    let problem = TransferProblem::new(mesh, renamed, &backwards, Weights::Plain)?;
    let mut pose = mesh.positions().to_vec();
    Twist::of(mesh).frame(EXTREME_FRAME, &mut pose);
    let mut target = vec![[f64::NAN; 3]; n];
    subject.transfer(&problem)?.frame(&pose, &mut target)?;
    let back: Vec<Vector> = (0..n).map(|v| target[new_of_old[v] as usize]).collect();
    let off = distance(mesh, &back, expected);
    findings.at_most(
        Level::Behaviour,
        "transfer, vertex names",
        off,
        2.0 * subject.limits.transfer,
        "shuffled vertices and marks",
    );
    Ok(())
}

/// Largest distance between corresponding points, relative to the diagonal.
fn distance(mesh: &TriangleMesh, a: &[Vector], b: &[Vector]) -> f64 {
    let larger = |m: f64, d: f64| if d.is_nan() { f64::INFINITY } else { m.max(d) };
    a.iter().zip(b).map(|(&p, &q)| distance_squared(p, q).sqrt()).fold(0.0, larger) / mesh.diagonal()
}
