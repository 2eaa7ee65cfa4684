//! L5 for `smoothing`: lines stay, nothing changes without lambda, the highest frequency shrinks as foretold.

use super::finding::{Findings, Level};
use super::reference::largest_difference;
use super::subject::{NoAnswer, Subject};
use lapsolve::columns::Columns;
use lapsolve::workload::smoothing;

/// Frames of the sequences: a minute of a depth camera, and the ends far from the middle.
const FRAMES: usize = 1_801;

/// All checks; none needs a mesh.
pub fn check(subjects: &[Subject], findings: &mut Findings) {
    for subject in subjects.iter().filter(|subject| subject.takes(FRAMES)) {
        findings.about("joint angles", Some(&subject.id));
        if let Err(no) = sequences(subject, findings) {
            no.record(findings, Level::Behaviour, "a line stays", true);
        }
    }
}

fn sequences(subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
    let at = |f: usize, c: usize| if c == 0 { f as f64 / FRAMES as f64 } else { 1.0 - 2.0 * (f % 2) as f64 };
    let angles: Vec<f64> = (0..FRAMES).flat_map(|f| [at(f, 0), at(f, 1)]).collect();
    let limit = subject.limits.poisson;
    for lambda in [0.0, 1.0, 10.0] {
        let smooth = solve(subject, &angles, lambda)?;
        if lambda == 0.0 {
            let off = largest_difference(&smooth, &angles);
            findings.at_most(Level::Behaviour, "lambda 0 changes nothing", off, limit, "");
            continue;
        }
        let note = format!("lambda {lambda}");
        let line = (0..FRAMES).map(|f| (smooth[2 * f] - angles[2 * f]).abs());
        findings.at_most(Level::Behaviour, "a line stays", worst(line), limit, note.clone());
        let shrunk =
            (smooth[FRAMES - 1 + FRAMES % 2] / angles[FRAMES - 1 + FRAMES % 2]) * (1.0 + 16.0 * lambda);
        findings.at_most(
            Level::Behaviour,
            "the highest frequency shrinks by 1 / (1 + 16 lambda)",
            worst([shrunk - 1.0].map(f64::abs).into_iter()),
            limit * (1.0 + 16.0 * lambda),
            note,
        );
    }
    Ok(())
}

fn solve(subject: &Subject, angles: &[f64], lambda: f64) -> Result<Vec<f64>, NoAnswer> {
    let system = smoothing::system(FRAMES, lambda).map_err(|error| NoAnswer::Failed(error.to_string()))?;
    subject.solve(&system, Columns::new(angles, FRAMES, 2))
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m, x| if x.is_nan() { f64::INFINITY } else { m.max(x) })
}
