//! Skeleton motions: a hierarchy of joints with channels, and their values frame after frame.

use lapsolve::rotation::{Quaternion, about_axis, product, rotate};
use lapsolve::vector::{Vector, add};

/// What a number of a frame does to its joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Coordinate 0, 1 or 2 of the joint relative to its parent; takes the place of the offset's.
    Position(usize),
    /// Degrees about axis 0, 1 or 2; rotations of one joint apply in reverse order of its channels.
    Rotation(usize),
}

/// A joint: where it sits on its parent, and which numbers of a frame move it.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name, as in the file.
    pub name: String,
    /// Index of the joint that carries it, smaller than its own; none for the root.
    pub parent: Option<usize>,
    /// From the parent's joint to this one when nothing turns.
    pub offset: Vector,
    /// Its channels, in the order of its numbers.
    pub channels: Vec<Channel>,
    /// From this joint to the tip of its bone, where the file says so.
    pub end: Option<Vector>,
}

/// A joint in a frame: where it is, and its rotation from the state in which nothing turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// In the units of the offsets.
    pub position: Vector,
    /// Unit quaternion.
    pub rotation: Quaternion,
}

/// A motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Joints, parents before their children, the root first.
    pub joints: Vec<Joint>,
    /// Seconds from one frame to the next.
    pub frame_time: f64,
    /// Frames x channels, frame after frame.
    pub values: Vec<f64>,
}

impl Clip {
    /// Numbers of a frame.
    pub fn channels(&self) -> usize {
        self.joints.iter().map(|joint| joint.channels.len()).sum()
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.values.len().checked_div(self.channels()).unwrap_or(0)
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The numbers of frame `k`.
    pub fn frame(&self, k: usize) -> &[f64] {
        let width = self.channels();
        &self.values[k * width..][..width]
    }

    /// All joints when nothing turns: offsets alone.
    pub fn rest(&self) -> Vec<Vector> {
        let mut rest: Vec<Vector> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            rest.push(add(joint.parent.map_or([0.0; 3], |parent| rest[parent]), joint.offset));
        }
        rest
    }

    /// All joints in frame `k`.
    pub fn place(&self, k: usize) -> Vec<Placed> {
        let mut values = self.frame(k).iter();
        let mut placed: Vec<Placed> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let mut own = Placed { position: joint.offset, rotation: lapsolve::rotation::IDENTITY };
            for (&channel, &value) in joint.channels.iter().zip(&mut values) {
                match channel {
                    Channel::Position(axis) => own.position[axis] = value,
                    Channel::Rotation(axis) => {
                        own.rotation = product(own.rotation, about_axis(axis, value.to_radians()));
                    }
                }
            }
            placed.push(joint.parent.map_or(own, |parent| {
                let Placed { position, rotation } = placed[parent];
                Placed {
                    position: add(position, rotate(rotation, own.position)),
                    rotation: product(rotation, own.rotation),
                }
            }));
        }
        placed
    }

    /// Indices of the rotation channels of every joint within a frame, in their order.
    pub fn rotations(&self) -> Vec<Vec<(usize, usize)>> {
        let mut next = 0;
        let own = |joint: &Joint| {
            let first = next;
            next += joint.channels.len();
            let axes = joint.channels.iter().zip(first..);
            axes.filter_map(|(channel, at)| match channel {
                Channel::Rotation(axis) => Some((at, *axis)),
                Channel::Position(_) => None,
            })
            .collect()
        };
        self.joints.iter().map(own).collect()
    }

    /// Every `step`-th frame, from the first on.
    pub fn thinned(&self, step: usize) -> Self {
        let width = self.channels().max(1);
        let values = self.values.chunks_exact(width).step_by(step.max(1)).flatten().copied().collect();
        Self { joints: self.joints.clone(), frame_time: self.frame_time * step.max(1) as f64, values }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A hip that may move, a thigh and a shin of length 1 each, hanging down.
    pub fn leg(values: Vec<f64>) -> Clip {
        use Channel::{Position, Rotation};
        let joint = |name: &str, parent, offset, channels: &[Channel]| Joint {
            name: name.into(),
            parent,
            offset,
            channels: channels.to_vec(),
            end: None,
        };
        let moving = [Position(0), Position(1), Position(2), Rotation(2), Rotation(0), Rotation(1)];
        let mut joints = vec![
            joint("hip", None, [0.0; 3], &moving),
            joint("knee", Some(0), [0.0, -1.0, 0.0], &[Rotation(2), Rotation(0), Rotation(1)]),
        ];
        joints[1].end = Some([0.0, -1.0, 0.0]);
        Clip { joints, frame_time: 0.01, values }
    }

    #[test]
    fn children_follow_and_rotations_apply_last_channel_first() {
        let clip = leg(vec![5.0, 2.0, 0.0, 90.0, 90.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((clip.len(), clip.channels()), (1, 9));
        let placed = clip.place(0);
        // The thigh points down: first about x by 90 degrees (down -> -z), then about z (-z stays).
        let expected = [5.0, 2.0, -1.0];
        assert!(placed[1].position.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{placed:?}");
        assert_eq!(clip.rest(), [[0.0; 3], [0.0, -1.0, 0.0]]);
        assert_eq!(clip.rotations()[1], [(6, 2), (7, 0), (8, 1)]);
    }

    #[test]
    fn thinning_keeps_the_first_frame_and_the_speed() {
        let clip = leg((0..5 * 9).map(f64::from).collect()).thinned(2);
        assert_eq!((clip.len(), clip.frame(1)[0], clip.frame_time), (3, 18.0, 0.02));
    }
}
