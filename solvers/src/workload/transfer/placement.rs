//! The end of step 5: where the solution, known up to a translation per component, goes, and what follows it.

use super::TransferProblem;
use super::marks::{MarkPose, centroid};
use crate::rotation::{Quaternion, rotate};
use crate::vector::{Vector, add, scale, sub};

/// The translation of every marked component.
#[derive(Clone, Debug)]
pub(crate) struct Placement {
    shifts: Vec<Vector>,
}

impl Placement {
    /// Room for those of `problem`.
    pub(crate) fn new(problem: &TransferProblem) -> Self {
        Self { shifts: vec![[0.0; 3]; problem.pieces.marks_of().len()] }
    }

    /// Works them out: the mean over a component's marks of the way from the centroid of the target triangle, as `solved`
    /// has its vertices, to where the mark's pose wants it.
    pub(crate) fn update(
        &mut self,
        problem: &TransferProblem,
        poses: &[MarkPose],
        solved: impl Fn(usize) -> Vector,
    ) {
        self.shifts.fill([0.0; 3]);
        let marks = problem.marks.all().iter().zip(poses).zip(problem.pieces.of_mark());
        for ((mark, pose), &piece) in marks {
            let missing = sub(pose.centroid, centroid(mark.target.map(|v| solved(v as usize))));
            let share = 1.0 / f64::from(problem.pieces.marks_of()[piece as usize]);
            let shift = &mut self.shifts[piece as usize];
            *shift = add(*shift, scale(share, missing));
        }
    }

    /// Writes the solution at vertices from `first` on, moved, to `target`.
    pub(crate) fn apply(
        &self,
        problem: &TransferProblem,
        first: usize,
        solved: impl Iterator<Item = Vector>,
        target: &mut [Vector],
    ) {
        let moved = target.iter_mut().zip(solved);
        match self.shifts[..] {
            [shift] => moved.for_each(|(x, s)| *x = add(s, shift)),
            _ => (first..)
                .zip(moved)
                .for_each(|(v, (x, s))| *x = add(s, self.shifts[problem.pieces.of_vertex(v)])),
        }
    }

    /// Writes the vertices that are in no system: detached pieces turn by `rotation` of their number about their anchor, which
    /// is in `target`; the others stay in the reference pose.
    pub(crate) fn follow(
        problem: &TransferProblem,
        rotation: impl Fn(usize) -> Quaternion,
        target: &mut [Vector],
    ) {
        let reference = problem.target.positions();
        for &v in problem.pieces.unreferenced() {
            target[v as usize] = reference[v as usize];
        }
        for (number, piece) in problem.pieces.detached().iter().enumerate() {
            let anchor = piece.anchor as usize;
            let (turn, at) = (rotation(number), target[anchor]);
            for &v in &piece.vertices {
                target[v as usize] = add(at, rotate(turn, sub(reference[v as usize], reference[anchor])));
            }
        }
    }
}
