//! The walk: joint angles over one stride, after the shape of the curves of gait analysis.

use super::pose::{IDENTITY, Rotation, about, after};
use super::skeleton::{FIRST_SIDE, PER_SIDE, Skeleton};
use crate::vector::{Vector, cross, normalize, sub};

/// (part of the stride since the heel of that side touched the ground, degrees), ascending, periodic.
type Curve = [(f64, f64)];

/// Thigh forwards.
const HIP: &Curve =
    &[(0.0, 29.0), (0.12, 25.0), (0.30, 7.0), (0.50, -12.0), (0.62, -3.0), (0.75, 20.0), (0.87, 31.0)];
/// Shin backwards.
const KNEE: &Curve = &[
    (0.0, 5.0),
    (0.13, 18.0),
    (0.40, 5.0),
    (0.52, 14.0),
    (0.62, 40.0),
    (0.72, 62.0),
    (0.86, 30.0),
    (0.96, 4.0),
];
/// Toes up.
const ANKLE: &Curve = &[
    (0.0, 1.0),
    (0.07, -6.0),
    (0.20, 3.0),
    (0.42, 10.0),
    (0.54, 0.0),
    (0.63, -17.0),
    (0.74, -5.0),
    (0.86, 2.0),
];

/// Value of a curve at `phase` (any number): cubics with the slopes of the neighbours' chords.
fn curve(keys: &Curve, phase: f64) -> f64 {
    let phase = phase - phase.floor();
    let count = keys.len() as i64;
    // The key k, for any integer k, with its phase unwrapped.
    let key = |k: i64| {
        let (at, value) = keys[k.rem_euclid(count) as usize];
        (at + k.div_euclid(count) as f64, value)
    };
    let next = keys.iter().position(|&(at, _)| at > phase).unwrap_or(keys.len()) as i64;
    let [before, from, to, beyond] = [next - 2, next - 1, next, next + 1].map(key);
    let width = to.0 - from.0;
    let slope = |a: (f64, f64), b: (f64, f64)| (b.1 - a.1) / (b.0 - a.0) * width;
    let (m0, m1, step) = (slope(before, to), slope(from, beyond), to.1 - from.1);
    let t = (phase - from.0) / width;
    from.1 + t * (m0 + t * (3.0 * step - 2.0 * m0 - m1 + t * (m0 + m1 - 2.0 * step)))
}

/// cos(2 pi phase).
fn wave(phase: f64) -> f64 {
    libm::cos(2.0 * std::f64::consts::PI * phase)
}

/// Rotation of every bone at `phase` of the stride (0: the left heel touches the ground).
pub(super) fn rotations(skeleton: &Skeleton, phase: f64) -> Vec<Rotation> {
    let mut local = vec![IDENTITY; skeleton.bones.len()];
    let turn = |lean: f64, yaw: f64, list: f64| {
        after(
            &about([0.0, 1.0, 0.0], yaw),
            &after(&about([0.0, 0.0, 1.0], list), &about([1.0, 0.0, 0.0], lean)),
        )
    };
    // The hip of the leading leg comes forward and that of the standing leg rises; chest and head make up for it.
    let (forward, rise) = (wave(phase), wave(phase - 0.2));
    local[0] = turn(1.0, -5.0 * forward, 3.5 * rise);
    local[1] = turn(1.0, 5.0 * forward, -2.5 * rise);
    local[2] = turn(1.0, 6.0 * forward, -2.0 * rise);
    local[3] = turn(0.0, -3.0 * forward, 0.5 * rise);
    local[4] = turn(-2.0, -3.0 * forward, 0.5 * rise);
    for (side, sign, phase) in [(0, 1.0, phase), (1, -1.0, phase + 0.5)] {
        let first = FIRST_SIDE + side * PER_SIDE;
        arm(skeleton, &mut local, first, sign, phase);
        leg(skeleton, &mut local, first + 4, sign, phase);
    }
    local
}

/// Collar, upper arm, forearm and hand: the arm hangs and swings against the leg of its side.
fn arm(skeleton: &Skeleton, local: &mut [Rotation], first: usize, sign: f64, phase: f64) {
    const HANG: f64 = 27.0; // of the 38 degrees by which the arms stand off in the reference pose
    let swing = -wave(phase - 0.03);
    let inward = |degrees: f64| about([0.0, 0.0, 1.0], -sign * degrees);
    let back = |degrees: f64| about([1.0, 0.0, 0.0], degrees);
    local[first] = inward(0.15 * HANG);
    local[first + 1] = after(&back(-3.0 - 21.0 * swing), &inward(0.85 * HANG));
    local[first + 2] = forwards(skeleton, first + 2, 17.0 + 9.0 * swing);
    local[first + 3] = forwards(skeleton, first + 3, 4.0);
}

/// Thigh, shin and foot.
fn leg(skeleton: &Skeleton, local: &mut [Rotation], thigh: usize, sign: f64, phase: f64) {
    const CLOSE: f64 = 3.0; // degrees by which the legs come together from the reference pose
    let inward = |degrees: f64| about([0.0, 0.0, 1.0], -sign * degrees);
    local[thigh] = after(&forwards(skeleton, thigh, curve(HIP, phase)), &inward(CLOSE));
    local[thigh + 1] = forwards(skeleton, thigh + 1, -curve(KNEE, phase));
    local[thigh + 2] = after(&about([1.0, 0.0, 0.0], -curve(ANKLE, phase)), &inward(-CLOSE));
}

/// The rotation that swings a bone towards +z.
fn forwards(skeleton: &Skeleton, bone: usize, degrees: f64) -> Rotation {
    let bone = &skeleton.bones[bone];
    let axis: Vector = normalize(cross(sub(bone.tail, bone.head), [0.0, 0.0, 1.0]));
    about(axis, degrees)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_pass_through_their_keys_and_close() {
        for keys in [HIP, KNEE, ANKLE] {
            for &(phase, value) in keys {
                assert!((curve(keys, phase) - value).abs() < 1e-12);
                assert!((curve(keys, phase - 3.0) - value).abs() < 1e-9);
            }
            let step = 1e-4;
            let jump = (0..10_000)
                .map(|i| curve(keys, f64::from(i) * step + step) - curve(keys, f64::from(i) * step));
            // No curve is steeper than 400 degrees per stride.
            assert!(jump.map(f64::abs).fold(0.0, f64::max) < 400.0 * step);
        }
    }
}
