//! The frames of a moving template.

use crate::mesh_io::frames::Frames;
use lapsolve::workload::twist::{EXTREME_FRAME, FRAMES, Twist};

/// A template's motion: frame after frame, then from the first one again.
#[derive(Clone, Debug)]
pub enum Motion {
    /// The default: a mesh twists, there and back; computed when needed.
    Twist(Twist),
    /// Given or made beforehand.
    Frames(Frames),
}

impl Motion {
    /// Number of different frames.
    pub fn len(&self) -> usize {
        match self {
            Motion::Twist(_) => FRAMES as usize,
            Motion::Frames(frames) => frames.len(),
        }
    }

    /// Never: a motion has frames.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The frame by which answers are held against the reference: the largest twist, or a quarter into the motion.
    pub fn checked_frame(&self) -> usize {
        match self {
            Motion::Twist(_) => EXTREME_FRAME as usize,
            Motion::Frames(frames) => frames.len() / 4,
        }
    }

    /// Vertex positions of frame `k` modulo the number of frames.
    ///
    /// # Panics
    /// If `positions` has not one entry per template vertex.
    pub fn write(&self, k: usize, positions: &mut [[f64; 3]]) {
        let k = k % self.len();
        match self {
            Motion::Twist(twist) => twist.frame(k as u32, positions),
            Motion::Frames(frames) => positions.copy_from_slice(frames.frame(k)),
        }
    }
}
