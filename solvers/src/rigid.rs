//! Rigid motions: a rotation followed by a translation.

use crate::rotation::{IDENTITY, Quaternion, conjugate, product, rotate};
use crate::vector::{Vector, add, scale};

/// p -> q p q* + t, with q a unit quaternion (w, x, y, z) and t in the units of p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// The rotation q, of norm 1.
    pub rotation: Quaternion,
    /// The translation t.
    pub translation: Vector,
}

impl Default for Rigid {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Rigid {
    /// The motion that changes nothing.
    pub const IDENTITY: Self = Self { rotation: IDENTITY, translation: [0.0; 3] };

    /// A translation alone.
    pub fn translation(translation: Vector) -> Self {
        Self { translation, ..Self::IDENTITY }
    }

    /// Where `point` goes.
    #[inline(always)]
    pub fn apply(&self, point: Vector) -> Vector {
        add(rotate(self.rotation, point), self.translation)
    }

    /// First `other`, then this one.
    pub fn after(&self, other: &Self) -> Self {
        Self { rotation: product(self.rotation, other.rotation), translation: self.apply(other.translation) }
    }

    /// The motion back.
    pub fn inverse(&self) -> Self {
        let rotation = conjugate(self.rotation);
        Self { rotation, translation: scale(-1.0, rotate(rotation, self.translation)) }
    }

    /// The same as a matrix of three rows (r_1, r_2, r_3, t).
    pub fn rows(&self) -> [[f64; 4]; 3] {
        let [w, x, y, z] = self.rotation;
        let [a, b, c] = self.translation;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y), a],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x), b],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y), c],
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::about_axis;

    fn motion(angle: f64) -> Rigid {
        Rigid {
            rotation: product(about_axis(0, angle), about_axis(1, 0.4)),
            translation: [1.0, -2.0, 0.5 * angle],
        }
    }

    fn close(a: Vector, b: Vector) -> bool {
        a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-14)
    }

    #[test]
    fn composes_inverts_and_has_a_matrix() {
        let (a, b, p) = (motion(0.7), motion(-1.9), [0.3, 0.1, -2.0]);
        assert!(close(a.after(&b).apply(p), a.apply(b.apply(p))));
        assert!(close(a.inverse().apply(a.apply(p)), p));
        let by_rows: Vector =
            std::array::from_fn(|i| (0..3).map(|j| a.rows()[i][j] * p[j]).sum::<f64>() + a.rows()[i][3]);
        assert!(close(by_rows, a.apply(p)));
        assert_eq!(Rigid::IDENTITY.apply(p), p);
    }
}
