//! Bone weights that come with the construction: a vertex follows the chains of parts it is nearest to, and within a
//! chain the weight passes from bone to bone across each joint.

use super::anatomy::Chain;
use super::skeleton::{FIRST_SIDE, PER_SIDE, Skeleton};
use super::surface::Surface;
use crate::vector::{Vector, add, dot, normalize, scale, sub};
use rayon::prelude::*;

/// Number of bones of a body.
pub const BONES: usize = FIRST_SIDE + 2 * PER_SIDE;

/// Metres by which one chain may be farther than the nearest and still have a share.
const CHAIN_FADE: f64 = 0.05;

/// A run of bones, each with half the length (metres) over which its parent's weight passes to it.
struct Run {
    chain: Chain,
    /// Bone, joint, direction across the joint, half-width.
    joints: Vec<(usize, Vector, Vector, f64)>,
}

/// Weights of all bones at every position: they lie in [0, 1] and sum to 1.
pub(super) fn weights(surface: &Surface, skeleton: &Skeleton, positions: &[Vector]) -> Vec<[f64; BONES]> {
    let runs = runs(skeleton);
    positions
        .par_iter()
        .map(|&p| {
            let mut distances = runs.each_ref().map(|run| surface.distance_to(run.chain, p));
            let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
            for d in &mut distances {
                let share = (1.0 - (*d - nearest) / CHAIN_FADE).max(0.0);
                *d = share * share;
            }
            let total: f64 = distances.iter().sum();
            let mut weights = [0.0; BONES];
            for (run, share) in runs.iter().zip(distances) {
                run.add(&mut weights, share / total, p);
            }
            weights
        })
        .collect()
}

impl Run {
    /// Distributes `share` over the bones of this run. With s_k the smooth step across joint k (s_0 = 1), bone k gets
    /// s_0 ... s_k (1 - s_(k+1)): the sum telescopes to 1.
    fn add(&self, weights: &mut [f64; BONES], share: f64, p: Vector) {
        let mut left = share;
        for (k, &(bone, ..)) in self.joints.iter().enumerate() {
            let pass = self.joints.get(k + 1).map_or(0.0, |&(_, joint, direction, half)| {
                smooth_step(dot(sub(p, joint), direction) / half)
            });
            weights[bone] += left * (1.0 - pass);
            left *= pass;
        }
    }
}

/// 0 below -1, 1 above 1, a cubic with flat ends between.
fn smooth_step(x: f64) -> f64 {
    let t = (0.5 + 0.5 * x).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The trunk, and the four limbs; a limb begins with the bone it hangs on.
fn runs(skeleton: &Skeleton) -> [Run; 5] {
    let size = skeleton.bones[0].tail[1] - skeleton.bones[0].head[1]; // 11 cm of a body of 180 cm
    let run = |chain: Chain, bones: &[usize], half_widths: &[f64]| {
        let joint = |k: usize| {
            let bone = &skeleton.bones[bones[k]];
            let along = |b: usize| normalize(sub(skeleton.bones[b].tail, skeleton.bones[b].head));
            let before = if k == 0 { bones[0] } else { bones[k - 1] };
            // At the ankle the foot turns off at a right angle: the heel must stay with it.
            let share = if bone.name.ends_with("foot") { 0.3 } else { 1.0 };
            let direction = if k == 1 && chain != Chain::Trunk {
                along(bones[k])
            } else {
                normalize(add(along(before), scale(share, along(bones[k]))))
            };
            (bones[k], bone.head, direction, half_widths[k] * size / 11.0)
        };
        Run { chain, joints: (0..bones.len()).map(joint).collect() }
    };
    let [left, right] = [FIRST_SIDE, FIRST_SIDE + PER_SIDE];
    let arm = |chain, first| run(chain, &[first, first + 1, first + 2, first + 3], &[1.0, 6.0, 4.5, 2.5]);
    let leg = |chain, first| run(chain, &[0, first + 4, first + 5, first + 6], &[1.0, 8.0, 6.0, 3.5]);
    [
        run(Chain::Trunk, &[0, 1, 2, 3, 4], &[1.0, 7.0, 8.0, 3.0, 4.0]),
        arm(Chain::LeftArm, left),
        arm(Chain::RightArm, right),
        leg(Chain::LeftLeg, left),
        leg(Chain::RightLeg, right),
    ]
}
