//! Rotations that fit best: argmax over R of tr(R S), sixteen at a time.
//!
//! Newton's method on the rotation group. With A = R S and R -> exp(w) R the function is
//! tr A + g . w - w . H w / 2 + ..., g the axial vector of A - A^T and H = tr(A) I - (A + A^T) / 2; a step solves H w = g and
//! turns R by the unit quaternion of (1, w / 2). At a maximum H is positive definite, and on the rotation group there is no
//! maximum but the largest; so a converged step with positive pivots proves its answer, and steps without them give the
//! matrix to [`robust`]. From the rotation of the previous iteration two or three steps suffice, some 150 flops each: an SVD
//! costs ten times that and does not run in vector lanes.

use crate::isa::{Features, Kernel};
use crate::rotation::{IDENTITY, Matrix, Quaternion, dominant_eigenvector};

/// Matrices that are worked on together: two vectors of AVX-512, so that one's divisions hide behind the other's.
pub const LANES: usize = 16;

/// Most steps before [`robust`] takes over.
const STEPS: usize = 10;

/// Squared turn after which a step was the last one: Newton doubles the digits, 1e-8 of a step is followed by 1e-16.
const SMALL: f64 = 1e-17;

/// Least pivot of H, relative to the trace of A, that counts as positive: flatter maxima are a matter of rounding.
const LEAST_PIVOT: f64 = 1e-12;

/// What a lane has come to: still on its way, converged with positive pivots, or without them and left where it was.
const MOVING: f64 = 0.0;
const PROVEN: f64 = 1.0;
const STUCK: f64 = -1.0;

/// A number per lane.
pub type Wide = [f64; LANES];

/// Up to [`LANES`] matrices S and the rotations that fit them.
#[derive(Clone, Debug)]
pub struct Block {
    /// Entries of S by rows.
    pub s: [Wide; 9],
    /// Components w, x, y, z: on entry the rotations to start from, then the ones that fit.
    pub q: [Wide; 4],
}

impl Default for Block {
    fn default() -> Self {
        let mut q = [[0.0; LANES]; 4];
        q[0] = [1.0; LANES];
        Self { s: [[0.0; LANES]; 9], q }
    }
}

/// Fits the rotations of all lanes of a block.
pub struct Fit<'a>(pub &'a mut Block);

impl Kernel for Fit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let block = self.0;
        let mut state = [MOVING; LANES];
        for _ in 0..STEPS {
            step(block, &mut state);
            if state.iter().all(|&s| s != MOVING) {
                break;
            }
        }
        for l in (0..LANES).filter(|&l| state[l] != PROVEN) {
            let q = robust(&std::array::from_fn(|i| std::array::from_fn(|j| block.s[3 * i + j][l])));
            (0..4).for_each(|c| block.q[c][l] = q[c]);
        }
    }
}

/// One step in every lane; lanes that are proven already only change by rounding, stuck ones not at all.
#[inline(always)]
fn step(block: &mut Block, state: &mut Wide) {
    let Block { s, q } = block;
    for l in 0..LANES {
        let (w, x, y, z) = (q[0][l], q[1][l], q[2][l], q[3][l]);
        let r = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let entry = |i: usize, j: usize| r[i][0] * s[j][l] + r[i][1] * s[3 + j][l] + r[i][2] * s[6 + j][l];
        let (a00, a11, a22) = (entry(0, 0), entry(1, 1), entry(2, 2));
        let (a01, a10) = (entry(0, 1), entry(1, 0));
        let (a02, a20) = (entry(0, 2), entry(2, 0));
        let (a12, a21) = (entry(1, 2), entry(2, 1));
        let g = [a12 - a21, a20 - a02, a01 - a10];
        let trace = a00 + a11 + a22;
        let (h00, h11, h22) = (a11 + a22, a00 + a22, a00 + a11);
        let (h01, h02, h12) = (-0.5 * (a01 + a10), -0.5 * (a02 + a20), -0.5 * (a12 + a21));
        // H = L D L^T; all pivots are products with one reciprocal each.
        let i0 = 1.0 / h00;
        let (l10, l20) = (h01 * i0, h02 * i0);
        let d1 = h11 - l10 * h01;
        let i1 = 1.0 / d1;
        let e12 = h12 - l10 * h02;
        let l21 = e12 * i1;
        let d2 = h22 - l20 * h02 - l21 * e12;
        let (y0, y1) = (g[0], g[1] - l10 * g[0]);
        let y2 = g[2] - l20 * y0 - l21 * y1;
        let wz = y2 / d2;
        let wy = y1 * i1 - l21 * wz;
        let wx = y0 * i0 - l10 * wy - l20 * wz;
        let turn = wx * wx + wy * wy + wz * wz;
        let least = LEAST_PIVOT * trace;
        // Written so that NaN counts as "no".
        let good = least > 0.0 && h00 > least && d1 > least && d2 > least;
        let last = good && turn <= SMALL;
        // Without positive pivots the step leads elsewhere: it is not taken.
        let safe = |t: f64| if good { 0.5 * t } else { 0.0 };
        let (tx, ty, tz) = (safe(wx), safe(wy), safe(wz));
        let nw = w - tx * x - ty * y - tz * z;
        let nx = x + tx * w + ty * z - tz * y;
        let ny = y + ty * w + tz * x - tx * z;
        let nz = z + tz * w + tx * y - ty * x;
        let scale = 1.0 / (nw * nw + nx * nx + ny * ny + nz * nz).sqrt();
        q[0][l] = nw * scale;
        q[1][l] = nx * scale;
        q[2][l] = ny * scale;
        q[3][l] = nz * scale;
        state[l] = if !good {
            STUCK
        } else if last {
            PROVEN
        } else {
            MOVING
        };
    }
}

/// The rotation that fits best, whatever the matrix: the dominant eigenvector of Horn's symmetric 4 x 4 matrix (1987). Where
/// several fit equally well (S of rank below two) one of them; without any information no rotation.
pub fn robust(s: &Matrix) -> Quaternion {
    let scale = s.as_flattened().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !(scale > 0.0 && scale.is_finite()) {
        return IDENTITY;
    }
    let s = s.map(|row| row.map(|x| x / scale));
    // tr(R(q) S) = q' K q.
    let [[a, b, c], [d, e, f], [g, h, i]] = s;
    let k = [
        [a + e + i, f - h, g - c, b - d],
        [f - h, a - e - i, b + d, c + g],
        [g - c, b + d, e - a - i, f + h],
        [b - d, c + g, f + h, i - a - e],
    ];
    dominant_eigenvector(&k).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::Isa;
    use crate::rotation::{about_axis, dot4, product, rotate};

    fn turned(q: Quaternion, stretch: [f64; 3], frame: Quaternion) -> Matrix {
        // S = sum p (R p)^T over stretched axes p of a rotated frame: R fits best.
        let mut s = [[0.0; 3]; 3];
        for axis in 0..3 {
            let mut e = [0.0; 3];
            e[axis] = 1.0;
            let p = rotate(frame, e);
            let moved = rotate(q, p);
            for i in 0..3 {
                for j in 0..3 {
                    s[i][j] += stretch[axis] * p[i] * moved[j];
                }
            }
        }
        s
    }

    fn fit(isa: Isa, matrices: &[Matrix], from: Quaternion) -> Vec<Quaternion> {
        let mut block = Block::default();
        for l in 0..LANES {
            let s = matrices[l % matrices.len()];
            (0..9).for_each(|e| block.s[e][l] = s[e / 3][e % 3]);
            (0..4).for_each(|c| block.q[c][l] = from[c]);
        }
        isa.run(Fit(&mut block));
        (0..matrices.len()).map(|l| block.q.map(|c| c[l])).collect()
    }

    fn assert_same(a: Quaternion, b: Quaternion, limit: f64) {
        assert!(dot4(a, b).abs() > 1.0 - limit && (dot4(a, a) - 1.0).abs() < 1e-14, "{a:?} {b:?}");
    }

    #[test]
    fn finds_rotations_of_any_angle_from_anywhere() {
        let frame = product(about_axis(0, 0.3), about_axis(2, 1.0));
        for isa in Isa::available() {
            for from in [IDENTITY, about_axis(1, 2.0)] {
                for angle in [0.0, 1e-9, 0.5, 1.5, 2.5, 3.0, -2.0] {
                    let q = product(about_axis(1, angle), about_axis(0, 0.5 * angle));
                    // A body, a flat patch, a reflected one (the smallest stretch negative), a needle.
                    let stretches = [[3.0, 2.0, 1.0], [2.0, 1.0, 0.0], [3.0, 2.0, -0.5], [1.0, 1e-5, 0.0]];
                    let matrices = stretches.map(|stretch| turned(q, stretch, frame));
                    for (found, s) in fit(isa, &matrices, from).into_iter().zip(&matrices) {
                        assert_same(found, q, 1e-10);
                        assert_same(robust(s), q, 1e-10);
                    }
                }
            }
        }
    }

    #[test]
    fn agrees_with_the_eigenvector_on_any_matrix() {
        let matrices: Vec<Matrix> = (0..LANES)
            .map(|k| {
                std::array::from_fn(|i| std::array::from_fn(|j| ((9 * k + 3 * i + j) as f64 * 1.7).sin()))
            })
            .collect();
        for isa in Isa::available() {
            for (found, s) in fit(isa, &matrices, IDENTITY).into_iter().zip(&matrices) {
                assert_same(found, robust(s), 1e-13);
            }
        }
    }

    #[test]
    fn nothing_to_fit_gives_a_rotation_all_the_same() {
        for s in [[[0.0; 3]; 3], [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]], [[1e-300; 3]; 3], [[f64::NAN; 3]; 3]]
        {
            let q = fit(Isa::best(), &[s], IDENTITY)[0];
            assert!((dot4(q, q) - 1.0).abs() < 1e-14, "{q:?}");
        }
    }
}
