//! Checks whole frames: both solves by their residuals, the positions against a refined frame.

use super::transfer::Setting;
use crate::record::result::Accuracy;
use crate::verify::reference::largest_difference;
use crate::verify::refined::Refined;
use crate::verify::solution::{Checked, Question, Tolerance, check_solution};
use anyhow::anyhow;
use lapsolve::backend::TransferFrame;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::limits::Limits;
use lapsolve::registry::Entry;
use lapsolve::workload::transfer::marks::MarkPose;
use lapsolve::workload::transfer::{Transfer, TransferProblem};

/// What frames are checked against.
#[derive(Debug)]
pub struct FrameCheck {
    problem: TransferProblem,
    /// L with one vertex fixed in every component: the system of step 5.
    grounded: Dirichlet,
    /// The grounded vertex of every marked component.
    ground: Vec<u32>,
    diagonal: f64,
    /// The frame that is known.
    known: Option<Known>,
}

/// A frame computed with refined solves.
#[derive(Debug)]
struct Known {
    positions: Vec<[f64; 3]>,
    spread: f64,
    made_by: String,
}

/// Columns of the quaternion field.
const FIELD: usize = 4;

/// What a child gives back of a frame.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Target positions, n x 3.
    pub positions: Vec<[f64; 3]>,
    /// The field before it is normalised (n x 4) and U (n x 3), where the solver keeps them.
    pub trace: Option<(Vec<f64>, Vec<f64>)>,
}

impl FrameCheck {
    /// Computes the checked frame of `setting` with the best of `backends`, twice, with two elimination orders.
    ///
    /// # Errors
    /// Marks that do not fit, or a Laplacian that is not acceptable.
    pub fn new(setting: &Setting, problem: TransferProblem, backends: &[Entry]) -> anyhow::Result<Self> {
        let laplacian = problem.laplacian().matrix().clone();
        let grounded = Dirichlet::grounded(laplacian, Some(setting.target.positions()))?;
        let pose = setting.checked_pose();
        let known = known(&problem, &pose, backends);
        if let Err(why) = &known {
            eprintln!("no reference frame: {why}");
        }
        let mut ground = vec![0; problem.pieces().marks_of().len()];
        for &v in grounded.fixed() {
            ground[problem.pieces().of_vertex(v as usize)] = v;
        }
        let diagonal = setting.target.diagonal();
        Ok(Self { problem, grounded, ground, diagonal, known: known.ok() })
    }

    /// Unknowns of the larger of the two systems.
    pub fn unknowns(&self) -> usize {
        self.grounded.free().len()
    }

    /// Checks the answer to the pose `template`; `is_known` where that is the pose of the checked frame.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn frame(
        &self,
        template: &[[f64; 3]],
        is_known: bool,
        answer: &Answer,
        limits: &Limits,
    ) -> anyhow::Result<Checked> {
        let mut checked = match &answer.trace {
            Some((field, rhs)) => {
                let mut checked = self.field(template, field, limits)?;
                let space = self.space(rhs, &answer.positions, limits);
                checked.accuracy.worsen(&space.accuracy);
                checked.faults.extend(space.faults);
                checked
            }
            None => Checked { accuracy: Accuracy::default(), faults: Vec::new() },
        };
        checked.accuracy.limit = Some(limits.transfer);
        if answer.positions.as_flattened().iter().any(|x| !x.is_finite()) {
            checked.faults.push("a position is not finite".to_owned());
        }
        if let Some(known) = self.known.as_ref().filter(|_| is_known) {
            self.forward(known, &answer.positions, limits, &mut checked);
        }
        Ok(checked)
    }

    /// Step 2: L_FF u_F = -L_FC g with g of this pose, computed here.
    fn field(&self, template: &[[f64; 3]], field: &[f64], limits: &Limits) -> anyhow::Result<Checked> {
        let marks = self.problem.marks();
        let mut poses = vec![MarkPose::default(); marks.all().len()];
        marks.pose(template, &mut poses).map_err(|error| anyhow!("{error}"))?;
        let mut g = vec![0.0; FIELD * marks.vertices().len()];
        marks.constraint_values(&poses, &mut g);
        let values = Columns::new(&g[..], marks.vertices().len(), FIELD);
        let question = Question::Harmonic { problem: self.problem.harmonic(), values };
        let tolerance = Tolerance { limits: *limits, forward: None, scale: 1.0 };
        let mut checked = check_solution(
            question,
            Columns::new(field, self.problem.target().positions().len(), FIELD),
            None,
            &tolerance,
        );
        prefix(&mut checked.faults, "rotation field");
        Ok(checked)
    }

    /// Step 5: L x' = U with the child's own U; a wrong U shows in the positions.
    ///
    /// The system is that of the grounded vertices, so positions are taken relative to those. Positions are rounded to eps of
    /// their own size, however far from the origin the mesh lies; the limit is therefore meant relative to that size.
    fn space(&self, rhs: &[f64], positions: &[[f64; 3]], limits: &Limits) -> Checked {
        let Some(system) = self.grounded.system() else {
            return Checked { accuracy: Accuracy::default(), faults: Vec::new() };
        };
        let free = self.grounded.free();
        let relative = |v: u32| {
            let (x, x0) = (
                positions[v as usize],
                positions[self.ground[self.problem.pieces().of_vertex(v as usize)] as usize],
            );
            [0, 1, 2].map(|i| x[i] - x0[i])
        };
        let x: Vec<f64> = free.iter().flat_map(|&v| relative(v)).collect();
        let b: Vec<f64> =
            free.iter().flat_map(|&v| &rhs[3 * v as usize..3 * v as usize + 3]).copied().collect();
        let largest = |block: &[f64]| block.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let distance = (largest(positions.as_flattened()) / largest(&x)).max(1.0);
        let limits = Limits {
            backward_error: limits
                .backward_error
                .map(|limit| limit * if distance.is_finite() { distance } else { 1.0 }),
            ..*limits
        };
        let question = Question::System { matrix: system.matrix(), rhs: Columns::new(&b[..], free.len(), 3) };
        let tolerance = Tolerance { limits, forward: None, scale: 1.0 };
        let mut checked = check_solution(question, Columns::new(&x[..], free.len(), 3), None, &tolerance);
        prefix(&mut checked.faults, "positions");
        checked
    }

    fn forward(&self, known: &Known, positions: &[[f64; 3]], limits: &Limits, checked: &mut Checked) {
        let unit = if self.diagonal > 0.0 { self.diagonal } else { 1.0 };
        let error = largest_difference(known.positions.as_flattened(), positions.as_flattened()) / unit;
        let certifiable = known.spread / unit <= 0.1 * limits.transfer;
        checked.accuracy.forward_error = Some(error).filter(|e| e.is_finite());
        checked.accuracy.certifiable = Some(certifiable);
        checked.accuracy.reference = Some(known.made_by.clone());
        if certifiable && error > limits.transfer {
            checked.faults.push(format!("forward error {error:.1e} exceeds {:.1e}", limits.transfer));
        }
    }
}

/// Says of which solve faults are.
fn prefix(faults: &mut [String], what: &str) {
    faults.iter_mut().for_each(|fault| *fault = format!("{what}: {fault}"));
}

/// The frame of `pose` with refined solves, and how far two elimination orders leave it undetermined.
fn known(problem: &TransferProblem, pose: &[[f64; 3]], backends: &[Entry]) -> Result<Known, String> {
    let n = problem.target().positions().len();
    let frame = |other_order: bool| -> Result<(Vec<[f64; 3]>, String), String> {
        let backend = Refined::choose(backends, n, other_order)?;
        let mut transfer =
            Transfer::prepare(&backend, problem, &mut |_| {}).map_err(|error| error.to_string())?;
        let mut positions = vec![[0.0; 3]; n];
        transfer.frame(pose, &mut positions).map_err(|error| error.to_string())?;
        Ok((positions, backend.description()))
    };
    let (first, second) = rayon::join(|| frame(false), || frame(true));
    let ((positions, made_by), (second, _)) = (first?, second?);
    let spread = largest_difference(positions.as_flattened(), second.as_flattened());
    Ok(Known { positions, spread, made_by })
}
