//! The similarity that lays the template's reference pose over the target's.

use crate::rotation::{IDENTITY, Quaternion, dominant_eigenvector, rotate};
use crate::vector::{Vector, add, dot, scale, sub};

/// x -> s A x + d with A a rotation (det +1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// A as a unit quaternion.
    pub rotation: Quaternion,
    /// s > 0.
    pub scale: f64,
    /// d.
    pub translation: Vector,
}

/// Second largest over largest spread (variance) of points at and below which they count as collinear: a thickness of
/// 1e-6 of the length determines no rotation about it.
const COLLINEAR: f64 = 1e-12;

impl Similarity {
    /// Minimises sum |s A p_i + d - t_i|^2 over the pairs (p_i, t_i) of `pairs`. With fewer than three pairs, or where the
    /// points of one side are collinear, A = I and s = 1, and d matches the means.
    ///
    /// A by Horn's quaternion method (1987), s as the least-squares factor of Umeyama (1991). Pairs must not be empty.
    pub fn between(pairs: &[(Vector, Vector)]) -> Self {
        let inverse = 1.0 / pairs.len() as f64;
        let mean = |of: fn(&(Vector, Vector)) -> Vector| {
            pairs.iter().map(of).fold([0.0; 3], |sum, p| add(sum, scale(inverse, p)))
        };
        let (from, to) = (mean(|p| p.0), mean(|p| p.1));
        let mut centred: Vec<_> = pairs.iter().map(|&(p, t)| (sub(p, from), sub(t, to))).collect();
        let (from_unit, to_unit) =
            (largest(centred.iter().map(|c| c.0)), largest(centred.iter().map(|c| c.1)));
        for (p, t) in &mut centred {
            (*p, *t) = (p.map(|x| x / from_unit), t.map(|x| x / to_unit)); // squares stay in range
        }
        let flat = is_collinear(centred.iter().map(|c| c.0)) || is_collinear(centred.iter().map(|c| c.1));
        if flat {
            return Self { rotation: IDENTITY, scale: 1.0, translation: sub(to, from) };
        }
        let rotation = best_rotation(&centred);
        let along: f64 = centred.iter().map(|&(p, t)| dot(rotate(rotation, p), t)).sum();
        let size: f64 = centred.iter().map(|&(p, _)| dot(p, p)).sum();
        let scale = along / size * (to_unit / from_unit);
        Self { rotation, scale, translation: sub(to, crate::vector::scale(scale, rotate(rotation, from))) }
    }

    /// s A x + d.
    pub fn apply(&self, x: Vector) -> Vector {
        add(scale(self.scale, rotate(self.rotation, x)), self.translation)
    }
}

/// The rotation A that maximises sum t . A p: the dominant eigenvector of Horn's 4 x 4 matrix.
fn best_rotation(pairs: &[(Vector, Vector)]) -> Quaternion {
    let mut m = [[0.0; 3]; 3]; // sum p t^T
    for (p, t) in pairs {
        for i in 0..3 {
            for j in 0..3 {
                m[i][j] += p[i] * t[j];
            }
        }
    }
    let (a, b, c) = (m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]);
    let symmetric = |i: usize, j: usize| m[i][j] + m[j][i];
    let horn = [
        [m[0][0] + m[1][1] + m[2][2], a, b, c],
        [a, m[0][0] - m[1][1] - m[2][2], symmetric(0, 1), symmetric(0, 2)],
        [b, symmetric(0, 1), m[1][1] - m[0][0] - m[2][2], symmetric(1, 2)],
        [c, symmetric(0, 2), symmetric(1, 2), m[2][2] - m[0][0] - m[1][1]],
    ];
    dominant_eigenvector(&horn).0
}

/// The largest coordinate, or 1 where all are zero.
fn largest(points: impl Iterator<Item = Vector>) -> f64 {
    let largest = points.flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}

fn is_collinear(points: impl Iterator<Item = Vector>) -> bool {
    let mut covariance = [[0.0; 3]; 3];
    for p in points {
        for i in 0..3 {
            for j in 0..3 {
                covariance[i][j] += p[i] * p[j];
            }
        }
    }
    let (_, variances) = dominant_eigenvector(&covariance);
    variances[1] <= COLLINEAR * variances[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::{about_axis, product};
    use crate::vector::{distance_squared, norm};

    const POINTS: [Vector; 4] = [[0.3, 1.0, -0.2], [2.0, 0.1, 0.0], [-1.0, 0.4, 3.0], [0.5, -2.0, 1.0]];

    #[test]
    fn recovers_a_similarity() {
        for angle in [0.3, 2.0, std::f64::consts::PI] {
            let rotation = product(about_axis(0, angle), about_axis(2, 0.7));
            let known = Similarity { rotation, scale: 2.5, translation: [10.0, -3.0, 0.1] };
            let found = Similarity::between(&POINTS.map(|p| (p, known.apply(p))));
            assert!((found.scale - 2.5).abs() < 1e-14);
            for p in [[1.0, 2.0, 3.0], [-4.0, 0.0, 1.0]] {
                assert!(distance_squared(found.apply(p), known.apply(p)).sqrt() < 1e-13);
            }
        }
    }

    #[test]
    fn a_mirror_image_is_met_by_a_rotation() {
        let found = Similarity::between(&POINTS.map(|p| (p, [-p[0], p[1], p[2]])));
        let image = |p| rotate(found.rotation, p);
        let (x, y, z) = (image([1.0, 0.0, 0.0]), image([0.0, 1.0, 0.0]), image([0.0, 0.0, 1.0]));
        assert!(distance_squared(crate::vector::cross(x, y), z) < 1e-28, "det +1");
        assert!(found.scale > 0.0);
    }

    #[test]
    fn too_few_or_collinear_marks_only_translate() {
        let line = [0.0, 1.0, 5.0].map(|x| ([x, 2.0 * x, 0.0], [0.0, x, 1.0]));
        for pairs in [&line[..], &line[1..], &line[2..]] {
            let found = Similarity::between(pairs);
            assert_eq!((found.rotation, found.scale), (IDENTITY, 1.0));
        }
        let single = Similarity::between(&line[2..]);
        assert!(norm(sub(single.apply(line[2].0), line[2].1)) == 0.0);
    }
}
