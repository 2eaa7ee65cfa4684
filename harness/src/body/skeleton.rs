//! Joints and bones of a body, named and placed by its anatomy.

use super::build::{Build, Proportions};
use crate::vector::{Vector, lerp};

/// A rigid segment from its joint (`head`) to its end (`tail`), in metres; it turns about `head`.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// For example `left_thigh`.
    pub name: &'static str,
    /// Index of the bone it hangs on, always smaller than its own; none for the pelvis.
    pub parent: Option<usize>,
    /// The joint about which it turns.
    pub head: Vector,
    /// Its far end.
    pub tail: Vector,
}

/// Bones in an order in which parents come before their children; the same order and names for every build.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// 19 bones: pelvis, spine, chest, neck, head, then per side collar, upper arm, forearm, hand, thigh, shin,
    /// foot (left first).
    pub bones: Vec<Bone>,
}

/// Bones of the trunk, in the order of [`Skeleton::bones`].
pub(super) const TRUNK: [&str; 5] = ["pelvis", "spine", "chest", "neck", "head"];
const SIDES: [[&str; 7]; 2] = [
    ["left_collar", "left_upper_arm", "left_forearm", "left_hand", "left_thigh", "left_shin", "left_foot"],
    [
        "right_collar",
        "right_upper_arm",
        "right_forearm",
        "right_hand",
        "right_thigh",
        "right_shin",
        "right_foot",
    ],
];
/// Index of the first bone of the left side, and how many each side has.
pub(super) const FIRST_SIDE: usize = TRUNK.len();
pub(super) const PER_SIDE: usize = SIDES[0].len();

const PELVIS: usize = 0;
const CHEST: usize = 2;

impl Skeleton {
    /// The skeleton in the reference pose: arms 38 degrees off the body, legs slightly apart, facing +z, y up.
    pub(super) fn new(p: &Proportions) -> Self {
        let joints = Joints::new(p);
        let mut bones: Vec<Bone> = (0..TRUNK.len())
            .map(|i| Bone {
                name: TRUNK[i],
                parent: i.checked_sub(1),
                head: joints.trunk[i],
                tail: joints.trunk[i + 1],
            })
            .collect();
        for (names, flip) in SIDES.into_iter().zip([1.0, -1.0]) {
            let first = bones.len();
            let parents = [CHEST, first, first + 1, first + 2, PELVIS, first + 4, first + 5];
            let ends = joints.arm.windows(2).chain(joints.leg.windows(2));
            for ((name, parent), end) in names.into_iter().zip(parents).zip(ends) {
                let side = |v: Vector| [flip * v[0], v[1], v[2]];
                bones.push(Bone { name, parent: Some(parent), head: side(end[0]), tail: side(end[1]) });
            }
        }
        Self { bones }
    }

    /// The skeleton of a body in its reference pose, without its surface.
    pub fn of(build: Build) -> Self {
        Self::new(&Proportions::new(build))
    }

    /// Index of the bone with this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.bones.iter().position(|b| b.name == name)
    }
}

/// Places of the joints of the trunk and of the left side.
pub(super) struct Joints {
    /// Pelvis, spine, chest, neck, head, crown.
    pub(super) trunk: [Vector; 6],
    /// Collar, shoulder, elbow, wrist, finger tips.
    pub(super) arm: [Vector; 5],
    /// Hip, knee, ankle, toes.
    pub(super) leg: [Vector; 4],
}

impl Joints {
    pub(super) fn new(p: &Proportions) -> Self {
        let point = |x: f64, y: [f64; 2], z: f64| [p.one(x), p.of(y), p.one(z)];
        let trunk = [
            point(0.0, [95.0, 95.0], -1.0),
            point(0.0, [106.0, 106.5], -1.5),
            point(0.0, [122.0, 122.5], -2.5),
            point(0.0, [150.0, 150.0], -2.5),
            point(0.0, [160.5, 160.5], 0.5),
            point(0.0, [180.0, 180.0], 0.5),
        ];
        let shoulder = [p.of([18.8, 16.6]), p.one(142.5), p.one(-2.5)];
        // 38 degrees off the vertical: sin 0.616, cos 0.788.
        let reach = |length: f64| {
            let length = p.one(length);
            [shoulder[0] + 0.616 * length, shoulder[1] - 0.788 * length, shoulder[2]]
        };
        let hip = [p.of([9.6, 9.4]), p.one(92.5), p.one(-0.5)];
        let ankle = [p.of([15.0, 13.6]), p.one(8.0), p.one(-3.0)];
        let toes = [ankle[0] + p.one(2.0), p.one(1.5), p.one(15.5)];
        Self {
            trunk,
            arm: [point(2.5, [146.0, 146.0], -1.5), shoulder, reach(31.0), reach(57.0), reach(76.0)],
            leg: [hip, lerp(hip, ankle, 0.5), ankle, toes],
        }
    }
}
