//! The template's walk, frame by frame.

use super::Body;
use super::gait;
use super::pose::{Rigid, blend};
use super::weights::{BONES, weights};
use crate::vector::Vector;
use rayon::prelude::*;

/// Frames of one stride (two steps) that the number of strides is chosen for: 1.1 s at 30 frames per second.
const FRAMES_PER_STRIDE: usize = 32;

/// A walk on the spot that closes after its last frame. The body's own mesh is the reference pose; it is no frame.
#[derive(Clone, Debug)]
pub struct Walk<'a> {
    body: &'a Body,
    frames: usize,
    weights: Vec<[f64; BONES]>,
}

/// A walk of `frames` frames (156 and 330 are the lengths used here), in as many strides of about 32 frames as fit.
///
/// # Panics
/// If `frames` is zero.
pub fn walk(body: &Body, frames: usize) -> Walk<'_> {
    assert!(frames > 0, "a walk has frames");
    Walk { body, frames, weights: body.weights() }
}

impl Walk<'_> {
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Where each bone goes in a frame.
    pub fn pose(&self, frame: usize) -> Vec<Rigid> {
        let strides = ((self.frames + FRAMES_PER_STRIDE / 2) / FRAMES_PER_STRIDE).max(1);
        let phase = (strides * (frame % self.frames)) as f64 / self.frames as f64;
        let skeleton = &self.body.skeleton;
        let rotations = gait::rotations(skeleton, phase);
        let standing = skeleton.pose(&rotations, [0.0; 3]);
        let lowest = self.soles().map(|(bone, p)| standing[bone].apply(p)[1]).fold(f64::INFINITY, f64::min);
        skeleton.pose(&rotations, [0.0, -lowest, 0.0])
    }

    /// Positions of all vertices in a frame (frames beyond the last begin anew).
    pub fn positions(&self, frame: usize) -> Vec<Vector> {
        let mut positions = vec![[0.0; 3]; self.weights.len()];
        self.write(frame, &mut positions);
        positions
    }

    /// [`Self::positions`] into memory of the caller.
    ///
    /// # Panics
    /// If `positions` is not as long as the mesh has vertices.
    pub fn write(&self, frame: usize, positions: &mut [Vector]) {
        assert_eq!(positions.len(), self.weights.len(), "one position per vertex");
        let pose = self.pose(frame);
        let reference = self.body.mesh.positions();
        positions.par_iter_mut().zip(reference).zip(&self.weights).for_each(|((to, &from), weights)| {
            *to = blend(&pose, weights, from);
        });
    }

    /// Heel and toe of both feet on the ground, with the bone that carries them.
    fn soles(&self) -> impl Iterator<Item = (usize, Vector)> {
        let bones = &self.body.skeleton.bones;
        let feet =
            ["left_foot", "right_foot"].map(|name| self.body.skeleton.find(name).expect("a body has feet"));
        feet.into_iter().flat_map(move |foot| {
            let [ankle, toes] = [bones[foot].head, bones[foot].tail];
            let behind = ankle[2] - 0.25 * (toes[2] - ankle[2]);
            [[ankle[0], 0.0, behind], [toes[0], 0.0, toes[2]]].map(|p| (foot, p))
        })
    }
}

impl Body {
    /// Weights of all bones at every vertex, in [0, 1], each row of sum 1; smooth functions of the place on the body.
    pub fn weights(&self) -> Vec<[f64; BONES]> {
        weights(&self.surface, &self.skeleton, self.mesh.positions())
    }
}

#[cfg(test)]
mod tests {
    use super::super::pose::IDENTITY;
    use super::super::{Body, Build};
    use super::*;
    use crate::vector::{norm, sub};

    #[test]
    fn weights_are_shares_and_the_reference_pose_moves_nothing() {
        let body = Body::new(Build::Template, 4_000);
        let rest = body.skeleton.pose(&[IDENTITY; BONES], [0.0; 3]);
        for (&p, weights) in body.mesh.positions().iter().zip(body.weights()) {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            assert!(norm(sub(blend(&rest, &weights, p), p)) < 1e-12);
        }
    }

    #[test]
    fn every_frame_stands_on_the_ground_and_follows_smoothly_on_the_one_before() {
        let body = Body::new(Build::Template, 4_000);
        for frames in [156, 330] {
            let walk = walk(&body, frames);
            let mut before = walk.positions(frames - 1);
            for frame in 0..frames {
                let now = walk.positions(frame);
                let lowest = now.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
                assert!(lowest.abs() < 0.03, "frame {frame} of {frames}: lowest point at {lowest} m");
                let step = now.iter().zip(&before).map(|(&a, &b)| norm(sub(a, b))).fold(0.0, f64::max);
                // The swinging foot is the fastest, about 4 m/s.
                assert!((0.01..0.16).contains(&step), "frame {frame} of {frames}: {step} m");
                before = now;
            }
        }
    }

    #[test]
    fn skin_stretches_moderately() {
        let body = Body::new(Build::Template, 20_000);
        let (walk, reference) = (walk(&body, 32), body.mesh.positions());
        let edges = || body.mesh.triangles().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let length = |p: &[Vector], [a, b]: [u32; 2]| norm(sub(p[a as usize], p[b as usize]));
        for frame in (0..32).step_by(4) {
            let posed = walk.positions(frame);
            let far = |e: &[u32; 2]| {
                let stretch = length(&posed, *e) / length(reference, *e);
                !(0.5..2.0).contains(&stretch)
            };
            let share = edges().filter(far).count() as f64 / edges().count() as f64;
            assert!(share < 0.005, "frame {frame}: {share} of the edges are halved or doubled");
        }
    }
}
