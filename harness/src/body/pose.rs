//! Forward kinematics: from rotations of the bones to where everything goes.

use super::skeleton::Skeleton;
use crate::vector::{Vector, add, dot, scale, sub};

/// A rotation as its three rows.
pub type Rotation = [Vector; 3];

/// No rotation.
pub const IDENTITY: Rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// x -> rotation x + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// Orthogonal, determinant 1.
    pub rotation: Rotation,
    /// In metres.
    pub translation: Vector,
}

impl Rigid {
    /// Where a point goes.
    pub fn apply(&self, p: Vector) -> Vector {
        add(rotate(&self.rotation, p), self.translation)
    }
}

/// Rotation by `degrees` about a unit axis through the origin, counter-clockwise seen from the axis' tip (Rodrigues).
pub fn about(axis: Vector, degrees: f64) -> Rotation {
    let (sin, cos) = libm::sincos(degrees * (std::f64::consts::PI / 180.0));
    let [x, y, z] = axis;
    let one = 1.0 - cos;
    [
        [cos + one * x * x, one * x * y - sin * z, one * x * z + sin * y],
        [one * x * y + sin * z, cos + one * y * y, one * y * z - sin * x],
        [one * x * z - sin * y, one * y * z + sin * x, cos + one * z * z],
    ]
}

/// a b: first b, then a.
pub fn after(a: &Rotation, b: &Rotation) -> Rotation {
    let column = |j: usize| [b[0][j], b[1][j], b[2][j]];
    a.map(|row| [dot(row, column(0)), dot(row, column(1)), dot(row, column(2))])
}

fn rotate(rotation: &Rotation, v: Vector) -> Vector {
    rotation.map(|row| dot(row, v))
}

impl Skeleton {
    /// Where each bone goes when it turns by `local[bone]` about its joint, given in the axes of the reference pose and
    /// carried along by its parents; the whole body then moves by `shift`.
    ///
    /// # Panics
    /// If there is not one rotation per bone.
    pub fn pose(&self, local: &[Rotation], shift: Vector) -> Vec<Rigid> {
        assert_eq!(local.len(), self.bones.len(), "one rotation per bone");
        let mut posed: Vec<Rigid> = Vec::with_capacity(local.len());
        for (bone, own) in self.bones.iter().zip(local) {
            let parent = match bone.parent {
                Some(parent) => posed[parent],
                None => Rigid { rotation: IDENTITY, translation: shift },
            };
            let rotation = after(&parent.rotation, own);
            // The joint goes where the parent takes it.
            let translation = sub(parent.apply(bone.head), rotate(&rotation, bone.head));
            posed.push(Rigid { rotation, translation });
        }
        posed
    }
}

/// Linear-blend skinning: sum of weight times transformed point over the bones with a weight.
pub fn blend(transforms: &[Rigid], weights: &[f64], p: Vector) -> Vector {
    transforms
        .iter()
        .zip(weights)
        .filter(|&(_, &weight)| weight != 0.0)
        .fold([0.0; 3], |sum, (transform, &weight)| add(sum, scale(weight, transform.apply(p))))
}
