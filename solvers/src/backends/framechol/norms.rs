//! When a refinement may stop: the largest residual, solution and step, and what they say of the errors.

/// Backward error at which refinement stops, where the class promises 5e-12. It is counted in the largest diagonal entry of
/// A; for a Laplacian the norm is twice that or more, so the true one is at most half as large.
const ENOUGH: f64 = 4e-12;
/// How much more than the first sweep pair a later one may lose. On nine meshes of 14 to 871 thousand triangles and four
/// workloads it lost up to 7.8 times as much, mostly once to twice.
const CAUTION: f64 = 16.0;
/// Relative size that the error after the last pair may have, estimated as the last step times the contraction seen: a
/// twentieth of what the class promises, for the estimate takes the next contraction to be like the last. Two pairs stay below
/// 3e-11 on nine scans and bodies of 14 to 306 thousand triangles.
const SMALL: f64 = 1e-10;

/// Largest absolute values, lane by lane.
#[derive(Clone, Copy, Default)]
pub struct Norms {
    pub residual: [f64; 8],
    pub solution: [f64; 8],
    pub step: [f64; 8],
}

impl Norms {
    /// The larger of both, lane by lane.
    pub fn join(mut self, other: &Self) -> Self {
        for c in 0..8 {
            self.residual[c] = larger(self.residual[c], other.residual[c]);
            self.solution[c] = larger(self.solution[c], other.solution[c]);
            self.step[c] = larger(self.step[c], other.step[c]);
        }
        self
    }

    /// Backward error of every column: residual / (norm * solution + right-hand side).
    pub fn backward_error(&self, norm: f64, right_hand_side: &[f64; 8]) -> [f64; 8] {
        std::array::from_fn(|c| {
            let size = norm * self.solution[c] + right_hand_side[c];
            if size > 0.0 { self.residual[c] / size } else { 0.0 }
        })
    }

    /// The residual that a pair leaves which loses as much as the first: a sweep pair solves A d = r with the backward error
    /// `loss`, whatever r is, within [`CAUTION`].
    pub fn expect_residual(&mut self, before: &Self, norm: f64, loss: &[f64; 8]) {
        for c in 0..8 {
            self.residual[c] = CAUTION * loss[c] * (norm * self.step[c] + before.residual[c]);
        }
    }

    /// Whether every column is good enough, given the norms before the last pair, the norm of A and that of the right-hand
    /// side.
    pub fn suffice(&self, before: &Self, norm: f64, right_hand_side: &[f64; 8]) -> bool {
        (0..8).all(|c| {
            let (step, solution) = (self.step[c], self.solution[c]);
            // The error left is about step * (step / step before).
            self.residual[c] <= ENOUGH * (norm * solution + right_hand_side[c])
                && step * step <= SMALL * solution * before.step[c]
        })
    }
}

/// The larger of the two; a NaN is larger than anything.
#[inline(always)]
pub fn larger(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A second pair whose step is `step` of the solution, after a first one that left `residual` of the right-hand side.
    fn suffices(residual: f64, step: f64) -> bool {
        let (norm, b) = (1.0, [1.0; 8]);
        let first = Norms { residual: [residual; 8], solution: [1.0; 8], step: [1.0; 8] };
        let mut second = Norms { residual: [0.0; 8], solution: [1.0; 8], step: [step; 8] };
        second.expect_residual(&first, norm, &first.backward_error(norm, &b));
        second.suffice(&first, norm, &b)
    }

    #[test]
    fn a_second_pair_is_trusted_as_far_as_the_first_one_was_good() {
        assert!(suffices(1e-7, 1e-7));
        assert!(!suffices(1e-6, 1e-6), "the residual may be 2e-11");
        assert!(!suffices(1e-9, 1e-4), "the step shrinks too slowly");
    }
}
