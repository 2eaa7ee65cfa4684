//! The passes of the iteration over one strip of rows, compiled for every instruction set.

use super::lanes::Window;
use super::norms::{Norms, larger};
use super::operator::Operator;
use crate::columns::Columns;
use crate::isa::{Features, Kernel, Real};
use std::ops::Range;

/// What one strip adds to the sums of an iteration, up to three for every lane; strips do not share cache lines.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(128))]
pub(crate) struct Sums([[f64; 8]; 3]);

impl Sums {
    /// Sets the first W lanes of the first N sums.
    pub(crate) fn set<const W: usize, const N: usize>(&mut self, sums: [[f64; W]; N]) {
        for (own, new) in self.0.iter_mut().zip(sums) {
            own[..W].copy_from_slice(&new);
        }
    }

    /// Adds up strips, in order.
    pub(crate) fn total<const W: usize, const N: usize>(strips: &[Self]) -> [[f64; W]; N] {
        let mut total = [[0.0; W]; N];
        for strip in strips {
            for (total, own) in total.iter_mut().zip(&strip.0) {
                (0..W).for_each(|c| total[c] += own[c]);
            }
        }
        total
    }

    /// The norms of all strips, whose own are in the first two places.
    pub(crate) fn norms<const W: usize>(strips: &[Self]) -> Norms<W> {
        let [plain] = Self::total(strips);
        let largest = |c: usize| strips.iter().map(|strip| strip.0[1][c]).fold(0.0, larger);
        Norms { plain, scaled: std::array::from_fn(largest) }
    }
}

/// r = b, x = the guess, both scaled; results: both norms of b and ||x||^2 (NaN where the guess has one).
pub(crate) struct Load<'a, S, const W: usize> {
    pub(crate) window: &'a Window<W>,
    pub(crate) b: Columns<&'a [f64]>,
    pub(crate) guess: Columns<&'a [f64]>,
    /// Rows of the system behind the rows of the strip.
    pub(crate) names: &'a [u32],
    /// Inverse diagonal of the rows of the strip.
    pub(crate) inverse: &'a [f64],
    pub(crate) r: &'a mut [[S; W]],
    pub(crate) x: &'a mut [[f64; W]],
}

impl<S: Real, const W: usize> Kernel for Load<'_, S, W> {
    type Output = [[f64; W]; 3];

    #[inline(always)]
    fn run<F: Features>(self) -> [[f64; W]; 3] {
        let (mut norms, mut guess) = (Norms::ZERO, [0.0; W]);
        for (((&name, &inverse), r), x) in self.names.iter().zip(self.inverse).zip(self.r).zip(self.x) {
            let b = self.window.read(self.b, name as usize);
            *x = self.window.read(self.guess, name as usize);
            norms.add(&b, inverse);
            for c in 0..W {
                r[c] = S::from_f64(b[c]);
                guess[c] += x[c] * x[c];
            }
        }
        [norms.plain, norms.scaled, guess]
    }
}

/// r = b - A x in f64, rounded once; results: both norms of r.
pub(crate) struct Residual<'a, A, S, const W: usize> {
    pub(crate) a: &'a A,
    pub(crate) rows: Range<usize>,
    /// Inverse diagonal, of all rows.
    pub(crate) inverse: &'a [f64],
    pub(crate) window: &'a Window<W>,
    pub(crate) b: Columns<&'a [f64]>,
    pub(crate) x: &'a [[f64; W]],
    pub(crate) r: &'a mut [[S; W]],
}

impl<A: Operator, S: Real, const W: usize> Kernel for Residual<'_, A, S, W> {
    type Output = [[f64; W]; 2];

    #[inline(always)]
    fn run<F: Features>(self) -> [[f64; W]; 2] {
        let mut norms = Norms::ZERO;
        for (i, r) in self.rows.zip(self.r) {
            let b = self.window.read(self.b, self.a.rows()[i] as usize);
            let ax = self.a.product::<F, f64, W>(i, self.x);
            let residual = std::array::from_fn(|c| b[c] - ax[c]);
            *r = residual.map(S::from_f64);
            norms.add(&residual, self.inverse[i]);
        }
        [norms.plain, norms.scaled]
    }
}

/// q = A p; sums p . q.
pub(crate) struct Multiply<'a, A, S, const W: usize> {
    pub(crate) a: &'a A,
    pub(crate) rows: Range<usize>,
    pub(crate) p: &'a [[S; W]],
    pub(crate) q: &'a mut [[S; W]],
}

impl<A: Operator, S: Real, const W: usize> Kernel for Multiply<'_, A, S, W> {
    type Output = [[f64; W]; 1];

    #[inline(always)]
    fn run<F: Features>(self) -> [[f64; W]; 1] {
        let mut sum = [0.0; W];
        for (i, q) in self.rows.zip(self.q) {
            let row = self.a.product::<F, S, W>(i, self.p);
            for c in 0..W {
                q[c] = S::from_f64(row[c]);
                sum[c] += self.p[i][c].to_f64() * row[c];
            }
        }
        [sum]
    }
}

/// r -= alpha q; results: both norms of r.
pub(crate) struct Step<'a, S, const W: usize> {
    pub(crate) alpha: &'a [f64; W],
    /// Inverse diagonal of the rows of the strip.
    pub(crate) inverse: &'a [f64],
    pub(crate) q: &'a [[S; W]],
    pub(crate) r: &'a mut [[S; W]],
}

impl<S: Real, const W: usize> Kernel for Step<'_, S, W> {
    type Output = [[f64; W]; 2];

    #[inline(always)]
    fn run<F: Features>(self) -> [[f64; W]; 2] {
        let mut norms = Norms::ZERO;
        for ((r, q), &inverse) in self.r.iter_mut().zip(self.q).zip(self.inverse) {
            let value = std::array::from_fn(|c| r[c].to_f64() - self.alpha[c] * q[c].to_f64());
            *r = value.map(S::from_f64);
            norms.add(&value, inverse);
        }
        [norms.plain, norms.scaled]
    }
}

/// Sums r . z and q . z.
pub(crate) struct Dots<'a, S, const W: usize> {
    pub(crate) r: &'a [[S; W]],
    pub(crate) q: &'a [[S; W]],
    pub(crate) z: &'a [[S; W]],
}

impl<S: Real, const W: usize> Kernel for Dots<'_, S, W> {
    type Output = [[f64; W]; 2];

    #[inline(always)]
    fn run<F: Features>(self) -> [[f64; W]; 2] {
        let mut sums = [[0.0; W]; 2];
        for ((r, q), z) in self.r.iter().zip(self.q).zip(self.z) {
            for c in 0..W {
                let z = z[c].to_f64();
                sums[0][c] += r[c].to_f64() * z;
                sums[1][c] += q[c].to_f64() * z;
            }
        }
        sums
    }
}

/// x += alpha p.
pub(crate) struct Follow<'a, S, const W: usize> {
    pub(crate) alpha: &'a [f64; W],
    pub(crate) p: &'a [[S; W]],
    pub(crate) x: &'a mut [[f64; W]],
}

impl<S: Real, const W: usize> Kernel for Follow<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (x, p) in self.x.iter_mut().zip(self.p) {
            for c in 0..W {
                x[c] += self.alpha[c] * p[c].to_f64();
            }
        }
    }
}

/// x += alpha p, then p = z + beta p.
pub(crate) struct Advance<'a, S, const W: usize> {
    pub(crate) alpha: &'a [f64; W],
    pub(crate) beta: &'a [f64; W],
    pub(crate) z: &'a [[S; W]],
    pub(crate) p: &'a mut [[S; W]],
    pub(crate) x: &'a mut [[f64; W]],
}

impl<S: Real, const W: usize> Kernel for Advance<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for ((p, z), x) in self.p.iter_mut().zip(self.z).zip(self.x) {
            for c in 0..W {
                let old = p[c].to_f64();
                x[c] += self.alpha[c] * old;
                p[c] = S::from_f64(z[c].to_f64() + self.beta[c] * old);
            }
        }
    }
}
