//! Up, left and forwards of a figure.

use lapsolve::rotation::{Quaternion, from_matrix};
use lapsolve::vector::{Vector, cross, norm, scale};

/// Orthonormal directions with left x up = forwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyFrame {
    /// From the feet to the head.
    pub up: Vector,
    /// The side of its left hand.
    pub left: Vector,
    /// Where it looks.
    pub forwards: Vector,
}

impl BodyFrame {
    /// The convention: up along axis `up` (1: y, 2: z), left along +x; so it faces +z or -y.
    pub fn standing(up: usize) -> Self {
        Self::with_left(up, [1.0, 0.0, 0.0])
    }

    /// Up along axis `up`, facing `forwards` as nearly as possible.
    ///
    /// # Panics
    /// If `forwards` is along `up`.
    pub fn facing(up: usize, mut forwards: Vector) -> Self {
        forwards[up] = 0.0;
        let length = norm(forwards);
        assert!(length > 0.0, "forwards is not along up");
        let forwards = scale(1.0 / length, forwards);
        let above = unit(up);
        Self { up: above, left: cross(above, forwards), forwards }
    }

    /// Up along axis `up`, left along `left`, which must be a unit vector across it.
    pub fn with_left(up: usize, left: Vector) -> Self {
        let above = unit(up);
        Self { up: above, left, forwards: cross(left, above) }
    }

    /// The rotation that carries the directions of `self` to those of `other`.
    pub fn rotation_to(&self, other: &Self) -> Quaternion {
        let rows = |i: usize, j: usize| {
            other.left[i] * self.left[j] + other.up[i] * self.up[j] + other.forwards[i] * self.forwards[j]
        };
        from_matrix(&std::array::from_fn(|i| std::array::from_fn(|j| rows(i, j))))
    }
}

fn unit(axis: usize) -> Vector {
    let mut unit = [0.0; 3];
    unit[axis] = 1.0;
    unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::rotation::rotate;

    #[test]
    fn conventions_and_rotations() {
        assert_eq!(BodyFrame::standing(1).forwards, [0.0, 0.0, 1.0]);
        assert_eq!(BodyFrame::standing(2).forwards, [0.0, -1.0, 0.0]);
        assert_eq!(BodyFrame::facing(1, [0.0, 3.0, 2.0]), BodyFrame::standing(1));
        let (a, b) = (BodyFrame::standing(1), BodyFrame::facing(2, [1.0, 0.3, 0.0]));
        let q = a.rotation_to(&b);
        for (from, to) in [(a.up, b.up), (a.left, b.left), (a.forwards, b.forwards)] {
            assert!(rotate(q, from).iter().zip(to).all(|(x, y)| (x - y).abs() < 1e-15));
        }
    }
}
