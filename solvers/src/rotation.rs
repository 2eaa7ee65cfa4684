//! Rotations as unit quaternions (w, x, y, z) and as 3 x 3 matrices, and the mean of several.

use crate::vector::{Vector, cross};

/// w + x i + y j + z k in this order; a rotation where the norm is 1, and then q and -q are the same one.
pub type Quaternion = [f64; 4];

/// A 3 x 3 matrix by rows.
pub type Matrix = [[f64; 3]; 3];

/// The rotation by nothing.
pub const IDENTITY: Quaternion = [1.0, 0.0, 0.0, 0.0];

/// Rotation by `angle` (radians, right-handed) about coordinate axis `axis` (0, 1, 2).
pub fn about_axis(axis: usize, angle: f64) -> Quaternion {
    let (sin, cos) = (0.5 * angle).sin_cos();
    let mut q = [cos, 0.0, 0.0, 0.0];
    q[1 + axis] = sin;
    q
}

/// The Hamilton product a b: first b, then a.
pub fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    let ([aw, ax, ay, az], [bw, bx, by, bz]) = (a, b);
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// The inverse rotation.
pub fn conjugate([w, x, y, z]: Quaternion) -> Quaternion {
    [w, -x, -y, -z]
}

/// The scalar product of two quaternions as vectors of R^4.
#[inline(always)]
pub fn dot4(a: Quaternion, b: Quaternion) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}

/// q / |q|; `None` where |q| < `least`.
#[inline(always)]
pub fn normalised(q: Quaternion, least: f64) -> Option<Quaternion> {
    let squared = dot4(q, q);
    if squared < least * least || squared == 0.0 {
        return None;
    }
    let inverse = 1.0 / squared.sqrt();
    Some(q.map(|x| x * inverse))
}

/// v turned by the unit quaternion q: v + 2 w (u x v) + 2 u x (u x v), u = (x, y, z). Exact for the identity.
#[inline(always)]
pub fn rotate([w, x, y, z]: Quaternion, v: Vector) -> Vector {
    let u = [x, y, z];
    let t = cross(u, v).map(|s| 2.0 * s);
    let c = cross(u, t);
    [v[0] + w * t[0] + c[0], v[1] + w * t[1] + c[1], v[2] + w * t[2] + c[2]]
}

/// The unit quaternion of a rotation matrix; the largest component is taken from the diagonal (Shepperd 1978).
pub fn from_matrix(m: &Matrix) -> Quaternion {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let largest = (0..3)
        .fold(3, |best, i| if m[i][i] > if best == 3 { trace } else { m[best][best] } { i } else { best });
    let q = if largest == 3 {
        [1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    } else {
        let (i, j, k) = (largest, (largest + 1) % 3, (largest + 2) % 3);
        let mut q = [0.0; 4];
        q[0] = m[k][j] - m[j][k];
        q[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k];
        q[1 + j] = m[j][i] + m[i][j];
        q[1 + k] = m[k][i] + m[i][k];
        q
    };
    normalised(q, 0.0).unwrap_or(IDENTITY)
}

/// sum q q^T, to which every rotation adds the same whether it comes as q or as -q.
pub fn outer_products(quaternions: impl Iterator<Item = Quaternion>) -> [[f64; 4]; 4] {
    let mut sum = [[0.0; 4]; 4];
    for q in quaternions {
        for i in 0..4 {
            for j in 0..4 {
                sum[i][j] += q[i] * q[j];
            }
        }
    }
    sum
}

/// Unit eigenvector of the largest eigenvalue of a symmetric matrix, and all eigenvalues (the largest first), by cyclic
/// Jacobi rotations. Of sum q q^T it is the mean rotation (Markley 2007). Its sign is arbitrary.
pub fn dominant_eigenvector<const N: usize>(matrix: &[[f64; N]; N]) -> ([f64; N], [f64; N]) {
    const SWEEPS: usize = 30; // convergence is quadratic; five or six suffice for N = 4
    let mut a = *matrix;
    let mut vectors = [[0.0; N]; N]; // by columns
    for i in 0..N {
        vectors[i][i] = 1.0;
    }
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for p in 0..N {
            for q in p + 1..N {
                rotated |= annihilate(&mut a, &mut vectors, p, q);
            }
        }
        if !rotated {
            break;
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    (std::array::from_fn(|row| vectors[row][order[0]]), order.map(|i| a[i][i]))
}

/// Rotates the plane (p, q) so that a_pq becomes 0; false where it is negligible already.
fn annihilate<const N: usize>(
    a: &mut [[f64; N]; N],
    vectors: &mut [[f64; N]; N],
    p: usize,
    q: usize,
) -> bool {
    let scale = a[p][p].abs().max(a[q][q].abs());
    if a[p][q].abs() <= 0.25 * f64::EPSILON * scale || a[p][q] == 0.0 {
        return false;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for k in 0..N {
        let (x, y) = (a[k][p], a[k][q]);
        (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..N {
        let (x, y) = (a[p][k], a[q][k]);
        (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
    }
    (a[p][q], a[q][p]) = (0.0, 0.0);
    for row in vectors.iter_mut() {
        let (x, y) = (row[p], row[q]);
        (row[p], row[q]) = (c * x - s * y, s * x + c * y);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(a: &[f64], b: &[f64]) {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-14), "{a:?} {b:?}");
    }

    fn matrix_of(q: Quaternion) -> Matrix {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| rotate(q, e));
        std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]))
    }

    #[test]
    fn right_handed_about_each_axis() {
        let quarter = std::f64::consts::FRAC_PI_2;
        assert_close(&rotate(about_axis(2, quarter), [1.0, 0.0, 5.0]), &[0.0, 1.0, 5.0]);
        assert_close(&rotate(about_axis(0, quarter), [0.0, 1.0, 0.0]), &[0.0, 0.0, 1.0]);
        assert_close(&rotate(about_axis(1, quarter), [0.0, 0.0, 1.0]), &[1.0, 0.0, 0.0]);
        let (a, b) = (about_axis(0, 0.3), about_axis(1, 1.1));
        let v = [0.2, -0.5, 0.9];
        assert_close(&rotate(product(a, b), v), &rotate(a, rotate(b, v)));
        assert_close(&rotate(conjugate(a), rotate(a, v)), &v);
    }

    #[test]
    fn matrix_and_back_also_at_half_turns() {
        for q in [
            [1.0, 2.0, 3.0, 4.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 1e-9],
            [1e-9, 0.6, 0.8, 0.0],
            IDENTITY,
        ] {
            let q = normalised(q, 0.0).expect("not zero");
            let back = from_matrix(&matrix_of(q));
            let sign = dot4(q, back).signum();
            assert_close(&q.map(|x| sign * x), &back);
        }
    }

    #[test]
    fn mean_rotation_does_not_see_signs() {
        let (a, b) = (about_axis(1, 0.2), about_axis(1, 0.6));
        let sum = outer_products([a, b.map(|x| -x)].into_iter());
        let (mean, values) = dominant_eigenvector(&sum);
        let expected = about_axis(1, 0.4);
        assert_close(&mean.map(|x| x * dot4(mean, expected).signum()), &expected);
        assert_close(&[values.iter().sum::<f64>()], &[2.0]);
        assert!(values.is_sorted_by(|x, y| x >= y));
    }

    #[test]
    fn eigenvector_of_a_full_matrix() {
        let m = [[4.0, 1.0, -2.0], [1.0, 3.0, 0.5], [-2.0, 0.5, 5.0]];
        let (v, values) = dominant_eigenvector(&m);
        let product: [f64; 3] = std::array::from_fn(|i| (0..3).map(|j| m[i][j] * v[j]).sum());
        assert_close(&product, &v.map(|x| x * values[0]));
    }
}
