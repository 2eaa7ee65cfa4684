//! A skeleton: joints in a tree, their rest pose, and forward kinematics.

use super::bone::Bone;
use crate::rigid::Rigid;
use crate::vector::Vector;
use thiserror::Error;

/// A joint: a frame of coordinates that moves with respect to its parent's.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Index of the joint that carries it, smaller than its own; `None` for a root.
    pub parent: Option<u32>,
    /// Its frame in its parent's at rest (a root: in the world). A BVH file's OFFSET is the translation, without a rotation.
    pub rest: Rigid,
    /// The far end of a joint that carries no other one, in its own frame (a BVH file's End Site).
    pub tip: Option<Vector>,
}

/// Joints, parents before their children.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    joints: Vec<Joint>,
    /// From the mesh's coordinates at rest to the frame of each joint.
    inverse_rest: Vec<Rigid>,
}

/// Why joints make no skeleton.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SkeletonError {
    /// There is no joint.
    #[error("a skeleton needs at least one joint")]
    Empty,
    /// A parent comes after its child or does not exist.
    #[error("joint {joint} (\"{name}\") hangs on joint {parent}, which does not come before it")]
    Parent {
        /// 0-based joint.
        joint: usize,
        /// Its name.
        name: String,
        /// The parent it names.
        parent: u32,
    },
    /// A number is NaN or infinite, or a rotation not of norm 1.
    #[error("joint {joint} (\"{name}\") has a rest pose that is not a finite rigid motion")]
    Rest {
        /// 0-based joint.
        joint: usize,
        /// Its name.
        name: String,
    },
}

impl Skeleton {
    /// Checks the joints.
    ///
    /// # Errors
    /// [`SkeletonError`] naming the first offending joint.
    pub fn new(joints: Vec<Joint>) -> Result<Self, SkeletonError> {
        const NOT_UNIT: f64 = 1e-6; // of a quaternion's norm: far above rounding, far below a mistake
        if joints.is_empty() {
            return Err(SkeletonError::Empty);
        }
        for (joint, Joint { name, parent, rest, tip }) in joints.iter().enumerate() {
            if let Some(parent) = parent.filter(|&parent| parent as usize >= joint) {
                return Err(SkeletonError::Parent { joint, name: name.clone(), parent });
            }
            let norm = rest.rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
            let finite = rest.translation.iter().chain(tip.iter().flatten()).all(|x| x.is_finite());
            if !finite || !((norm - 1.0).abs() < NOT_UNIT) {
                return Err(SkeletonError::Rest { joint, name: name.clone() });
            }
        }
        let mut skeleton = Self { inverse_rest: vec![Rigid::IDENTITY; joints.len()], joints };
        let mut world = skeleton.inverse_rest.clone();
        skeleton.world(&skeleton.rest(), &mut world);
        skeleton.inverse_rest = world.iter().map(Rigid::inverse).collect();
        Ok(skeleton)
    }

    /// The joints, parents before their children.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Index of the joint with this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// The rest pose: the frame of every joint in its parent's. A pose is made by changing a copy of it.
    pub fn rest(&self) -> Vec<Rigid> {
        self.joints.iter().map(|joint| joint.rest).collect()
    }

    /// Forward kinematics: frames in the world from frames in the parents', one per joint. No allocation.
    ///
    /// # Panics
    /// If a length is not the number of joints.
    pub fn world(&self, pose: &[Rigid], world: &mut [Rigid]) {
        assert_eq!(
            (pose.len(), world.len()),
            (self.joints.len(), self.joints.len()),
            "pose, world: one per joint"
        );
        for (i, joint) in self.joints.iter().enumerate() {
            world[i] = joint.parent.map_or(pose[i], |parent| world[parent as usize].after(&pose[i]));
        }
    }

    /// How every joint moves the surface from the rest pose to `pose`: (world frame of the pose) o (world frame at
    /// rest)^-1, what [`Skin::pose`](super::Skin::pose) takes. The rest pose gives identities. No allocation.
    ///
    /// # Panics
    /// As [`world`](Self::world).
    pub fn motions(&self, pose: &[Rigid], motions: &mut [Rigid]) {
        self.world(pose, motions);
        for (motion, inverse) in motions.iter_mut().zip(&self.inverse_rest) {
            *motion = motion.after(inverse);
        }
    }

    /// One bone per joint, at rest, in the world: segments from the joint to every joint it carries and to its tip. A joint
    /// without either has a bone without a segment, which gets no weight; joints that coincide with their parents add
    /// nothing.
    pub fn bones(&self) -> Vec<Bone> {
        let mut world = vec![Rigid::IDENTITY; self.joints.len()];
        self.world(&self.rest(), &mut world);
        let mut bones = vec![Bone::default(); self.joints.len()];
        for (i, joint) in self.joints.iter().enumerate() {
            let at = world[i].translation;
            if let Some(parent) = joint.parent.map(|parent| parent as usize)
                && world[parent].translation != at
            {
                bones[parent].segments.push([world[parent].translation, at]);
            }
            bones[i].segments.extend(joint.tip.map(|tip| [at, world[i].apply(tip)]));
        }
        bones
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::about_axis;

    fn joint(name: &str, parent: Option<u32>, offset: Vector) -> Joint {
        Joint { name: name.into(), parent, rest: Rigid::translation(offset), tip: None }
    }

    /// A hip at height 1 with two thighs and their feet.
    fn legs() -> Vec<Joint> {
        let mut joints = vec![
            joint("hip", None, [0.0, 1.0, 0.0]),
            joint("left", Some(0), [0.2, 0.0, 0.0]),
            joint("right", Some(0), [-0.2, 0.0, 0.0]),
        ];
        joints[1].tip = Some([0.0, -1.0, 0.0]);
        joints[2].tip = Some([0.0, -1.0, 0.0]);
        joints
    }

    #[test]
    fn rest_moves_nothing_and_children_follow() {
        let skeleton = Skeleton::new(legs()).expect("valid");
        let mut motions = vec![Rigid::IDENTITY; 3];
        let mut pose = skeleton.rest();
        skeleton.motions(&pose, &mut motions);
        assert!(motions.iter().all(|m| m.translation.iter().all(|x| x.abs() < 1e-15)));
        // The hip turns by a right angle about z (left foot: from (0.2, 0, 0) to (1, 1.2, 0)), then the left leg back.
        pose[0].rotation = about_axis(2, std::f64::consts::FRAC_PI_2);
        skeleton.motions(&pose, &mut motions);
        let foot = motions[1].apply([0.2, 0.0, 0.0]);
        assert!(foot.iter().zip([1.0, 1.2, 0.0]).all(|(a, b)| (a - b).abs() < 1e-15), "{foot:?}");
        pose[1].rotation = about_axis(2, -std::f64::consts::FRAC_PI_2);
        skeleton.motions(&pose, &mut motions);
        let foot = motions[1].apply([0.2, 0.0, 0.0]);
        assert!(foot.iter().zip([0.0, 0.2, 0.0]).all(|(a, b)| (a - b).abs() < 1e-15), "{foot:?}");
    }

    #[test]
    fn bones_lead_to_children_and_tips() {
        let bones = Skeleton::new(legs()).expect("valid").bones();
        assert_eq!(bones[0].segments.len(), 2);
        assert_eq!(bones[1], Bone::segment([0.2, 1.0, 0.0], [0.2, 0.0, 0.0]));
    }

    #[test]
    fn bad_joints_are_named() {
        assert_eq!(Skeleton::new(vec![]), Err(SkeletonError::Empty));
        let mut joints = legs();
        joints[1].parent = Some(1);
        assert!(matches!(Skeleton::new(joints), Err(SkeletonError::Parent { joint: 1, parent: 1, .. })));
        for rest in [Rigid::translation([f64::NAN; 3]), Rigid { rotation: [0.0; 4], ..Rigid::IDENTITY }] {
            let mut joints = legs();
            joints[2].rest = rest;
            assert!(matches!(Skeleton::new(joints), Err(SkeletonError::Rest { joint: 2, .. })));
        }
    }
}
