//! Bones: rigid sets of segments, and which of them is nearest.

use crate::vector::{Vector, add, distance_squared, dot, scale, sub};

/// A rigid part of a skeleton: the segments that move together. Usually one; a hip that carries spine and legs has three.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bone {
    /// Ends of each segment, in the coordinates of the mesh. A bone without a segment is nearest to nothing.
    pub segments: Vec<[Vector; 2]>,
}

impl Bone {
    /// A bone of one segment.
    pub fn segment(from: Vector, to: Vector) -> Self {
        Self { segments: vec![[from, to]] }
    }

    /// The squared distance of `point` and the point of the bone nearest to it; `None` without a segment.
    pub fn nearest(&self, point: Vector) -> Option<(f64, Vector)> {
        let closer = |a: (f64, Vector), b: (f64, Vector)| if b.0 < a.0 { b } else { a };
        self.segments.iter().map(|ends| nearest_of_segment(ends, point)).reduce(closer)
    }
}

/// Ends are returned as they are, so that bones that share a joint are equally far from the points nearest to it.
fn nearest_of_segment(&[from, to]: &[Vector; 2], point: Vector) -> (f64, Vector) {
    let along = sub(to, from);
    let (place, length) = (dot(sub(point, from), along), dot(along, along));
    let nearest = if place <= 0.0 {
        from
    } else if place >= length {
        to
    } else {
        add(from, scale(place / length, along))
    };
    (distance_squared(point, nearest), nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_middles() {
        let bone = Bone::segment([0.0; 3], [2.0, 0.0, 0.0]);
        assert_eq!(bone.nearest([1.0, 3.0, 0.0]), Some((9.0, [1.0, 0.0, 0.0])));
        assert_eq!(bone.nearest([-1.0, 0.0, 0.0]), Some((1.0, [0.0; 3])));
        assert_eq!(bone.nearest([5.0, 0.0, 4.0]), Some((25.0, [2.0, 0.0, 0.0])));
        assert_eq!(Bone::segment([1.0; 3], [1.0; 3]).nearest([1.0, 1.0, 2.0]), Some((1.0, [1.0; 3])));
        assert_eq!(Bone::default().nearest([0.0; 3]), None);
        let fork = Bone { segments: vec![[[0.0; 3], [1.0, 0.0, 0.0]], [[0.0; 3], [0.0, 1.0, 0.0]]] };
        assert_eq!(fork.nearest([0.0, 3.0, 0.0]), Some((4.0, [0.0, 1.0, 0.0])));
    }
}
