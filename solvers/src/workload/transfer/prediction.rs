//! The initial guess of a frame from the frames before it, for backends that iterate.
//!
//! All frames solve A X = B with one A, so any combination of past solutions solves for the same combination of their
//! right-hand sides. The guess is the combination whose right-hand side comes nearest to the new one (Fischer 1998), every
//! new column from *all* columns of the past: minimise over c, with S a sample of the rows,
//!
//! ```text
//! ||b - sum_j c_j b_j||_S^2 + noise^2 sum_j c_j^2 ||b_j||_S^2
//! ```
//! The second term is what the residuals of the past solutions, `noise` relative to their right-hand sides, add to that of
//! the guess. Unlike extrapolation in time it needs no even frame rate and does no harm after a jump.

use crate::isa::Real;
use crate::team::Team;

/// Rows that decide the combination: a hundred times as many as it has unknowns.
const SAMPLE: usize = 4_000;
/// Least weight of the second term: Gram matrices are rounded to 1e-16.
const LEAST_NOISE: f64 = 1e-7;

/// Past solutions, stored as T.
pub(super) struct Prediction<T> {
    /// Columns of a solution.
    k: usize,
    /// Solutions kept.
    depth: usize,
    noise: f64,
    /// Every so many rows of a right-hand side are looked at.
    stride: usize,
    /// Solutions seen so far, at most `depth`; the slot that the next one goes to.
    known: usize,
    next: usize,
    /// Sampled right-hand sides, column by column: `depth` times k, then the k of the new one.
    samples: Vec<f64>,
    /// b_i . b_j over the sample, of all kept columns.
    gram: Vec<f64>,
    /// b . b_j for the new columns b.
    products: Vec<f64>,
    factor: Vec<f64>,
    /// c_j, k for each kept column.
    weights: Vec<f64>,
    /// Kept solutions, n x k each.
    solutions: Vec<Vec<T>>,
}

impl<T: Real> Prediction<T> {
    /// For right-hand sides of `rows` x k numbers and solutions of `unknowns` x k, of which the last `depth` are kept. `noise`:
    /// the relative residual they come with.
    pub(super) fn new(rows: usize, unknowns: usize, k: usize, depth: usize, noise: f64) -> Self {
        let stride = rows.div_ceil(SAMPLE).max(1);
        let (kept, sampled) = (depth * k, rows.div_ceil(stride));
        Self {
            k,
            depth,
            noise: noise.max(LEAST_NOISE),
            stride,
            known: 0,
            next: 0,
            samples: vec![0.0; (kept + k) * sampled],
            gram: vec![0.0; kept * kept],
            products: vec![0.0; k * kept],
            factor: vec![0.0; kept * kept],
            weights: vec![0.0; k * kept],
            solutions: vec![vec![T::default(); unknowns * k]; depth],
        }
    }

    /// Writes the guess for `rhs` to `x`; leaves it alone where nothing is known.
    pub(super) fn guess(&mut self, team: &mut Team, rhs: &[f64], x: &mut [f64]) {
        self.sample(rhs);
        if self.known == 0 || !self.weigh() {
            return;
        }
        let (k, kept) = (self.k, self.known * self.k);
        let (solutions, weights) = (&self.solutions[..self.known], &self.weights[..kept * k]);
        team.for_each_run(x, k, |rows, x| match k {
            3 => combine::<T, 3>(solutions, weights, rows.start, x.as_chunks_mut().0),
            4 => combine::<T, 4>(solutions, weights, rows.start, x.as_chunks_mut().0),
            _ => unreachable!("frames have three or four columns"),
        });
    }

    /// Keeps the solution `x` for the right-hand side of the last guess in the place of the oldest one.
    pub(super) fn remember(&mut self, team: &mut Team, x: &[f64]) {
        let (k, kept, slot) = (self.k, self.depth * self.k, self.next);
        team.for_each_run(&mut self.solutions[slot], k, |rows, own| {
            let new = &x[rows.start * k..rows.end * k];
            own.iter_mut().zip(new).for_each(|(own, &new)| *own = T::from_f64(new));
        });
        let sampled = self.samples.len() / (kept + k);
        self.samples.copy_within(kept * sampled.., slot * k * sampled);
        for c in 0..k {
            for j in 0..kept {
                let own = j / k == slot;
                let product = if own {
                    dot(self.column(kept + c), self.column(j))
                } else {
                    self.products[c * kept + j]
                };
                let i = slot * k + c;
                (self.gram[i * kept + j], self.gram[j * kept + i]) = (product, product);
            }
        }
        self.known = self.depth.min(self.known + 1);
        self.next = (slot + 1) % self.depth;
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let solutions: usize = self.solutions.iter().map(Vec::len).sum();
        size_of::<T>() * solutions + 8 * (self.samples.len() + 2 * (self.gram.len() + self.products.len()))
    }

    /// Sampled column `j`; those from depth * k on are the new ones.
    fn column(&self, j: usize) -> &[f64] {
        let sampled = self.samples.len() / ((self.depth + 1) * self.k);
        &self.samples[j * sampled..(j + 1) * sampled]
    }

    /// Takes the sample of `rhs` and its products with those that are kept.
    fn sample(&mut self, rhs: &[f64]) {
        let (k, kept) = (self.k, self.depth * self.k);
        let sampled = self.samples.len() / (kept + k);
        let new = &mut self.samples[kept * sampled..];
        for (at, row) in rhs.chunks_exact(k).step_by(self.stride).enumerate() {
            (0..k).for_each(|c| new[c * sampled + at] = row[c]);
        }
        for c in 0..k {
            for j in 0..self.known * k {
                self.products[c * kept + j] = dot(self.column(kept + c), self.column(j));
            }
        }
    }

    /// Solves for the weights by Cholesky's method; false where it breaks down.
    fn weigh(&mut self) -> bool {
        let (k, all, kept) = (self.k, self.depth * self.k, self.known * self.k);
        let l = &mut self.factor[..kept * kept];
        for i in 0..kept {
            for j in 0..=i {
                let done: f64 = (0..j).map(|m| l[i * kept + m] * l[j * kept + m]).sum();
                let entry = self.gram[i * all + j];
                l[i * kept + j] = if j < i {
                    (entry - done) / l[j * kept + j]
                } else if entry == 0.0 {
                    1.0 // a column of zeros: its weight becomes zero
                } else {
                    (entry * (1.0 + self.noise * self.noise) - done).sqrt()
                };
            }
            if !(l[i * kept + i] > 0.0) {
                return false;
            }
        }
        for c in 0..k {
            let at = |j: usize| j * k + c;
            for i in 0..kept {
                let done: f64 = (0..i).map(|j| l[i * kept + j] * self.weights[at(j)]).sum();
                self.weights[at(i)] = (self.products[c * all + i] - done) / l[i * kept + i];
            }
            for i in (0..kept).rev() {
                let done: f64 = (i + 1..kept).map(|j| l[j * kept + i] * self.weights[at(j)]).sum();
                self.weights[at(i)] = (self.weights[at(i)] - done) / l[i * kept + i];
            }
        }
        self.weights[..kept * k].iter().all(|w| w.is_finite())
    }
}

/// Rows from `first` on of the combination: row i is the sum over s and j of `solutions_s[i][j] weights[s K + j]`.
fn combine<T: Real, const K: usize>(solutions: &[Vec<T>], weights: &[f64], first: usize, x: &mut [[f64; K]]) {
    x.fill([0.0; K]);
    let weights = weights.as_chunks::<K>().0.as_chunks::<K>().0;
    for (solution, weights) in solutions.iter().zip(weights) {
        let rows = &solution.as_chunks::<K>().0[first..first + x.len()];
        for (x, row) in x.iter_mut().zip(rows) {
            for (value, weights) in row.iter().zip(weights) {
                let value = value.to_f64();
                (0..K).for_each(|c| x[c] += value * weights[c]);
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.0.iter().zip(b.0) {
        (0..4).for_each(|c| sums[c] += a[c] * b[c]);
    }
    sums.iter().sum::<f64>() + a.1.iter().zip(b.1).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Right-hand sides in a space of six dimensions, X = 2 B: once the past spans it, guesses are exact.
    #[test]
    fn the_span_of_the_past_is_solved_exactly() {
        const N: usize = 9_001; // more than the sample, and no multiple of it
        let mut team = Team::new(2).expect("threads");
        let mut prediction = Prediction::<f64>::new(N, N, 3, 4, 0.0);
        let mode = |m: usize, i: usize| ((m + 1) as f64 * 0.37 * i as f64).sin();
        for frame in 0..12 {
            let share = |m: usize, c: usize| ((frame * (m + 2) + c * (5 * m + 1)) as f64 * 0.61).cos();
            let value = |i: usize, c: usize| (0..6).map(|m| share(m, c) * mode(m, i)).sum::<f64>();
            let b: Vec<f64> = (0..3 * N).map(|at| value(at / 3, at % 3)).collect();
            let mut x = vec![7.0; 3 * N];
            prediction.guess(&mut team, &b, &mut x);
            let off = x.iter().zip(&b).map(|(x, b)| (x - 2.0 * b).abs()).fold(0.0, f64::max);
            match frame {
                0 => assert!(x.iter().all(|&x| x == 7.0), "nothing is known yet"),
                1 => assert!(off > 1e-3, "three columns do not span six dimensions"),
                2.. => assert!(off < 1e-6, "frame {frame}: {off:e}"),
            }
            let solution: Vec<f64> = b.iter().map(|b| 2.0 * b).collect();
            prediction.remember(&mut team, &solution);
        }
    }

    /// Columns of zeros and repeated frames make the Gram matrix singular, and change nothing.
    #[test]
    fn zeros_and_repetitions_do_no_harm() {
        let mut team = Team::new(1).expect("one thread");
        let mut prediction = Prediction::<f32>::new(5, 2, 4, 3, 1e-5);
        let b: Vec<f64> = (0..20).map(|at| if at % 4 == 2 { 0.0 } else { f64::from(at + 1) }).collect();
        let solution = [1.0, 2.0, 0.0, 4.0, 5.0, 6.0, 0.0, 8.0];
        let mut x = [0.0; 8];
        for frame in 0..6 {
            prediction.guess(&mut team, &b, &mut x);
            if frame > 0 {
                let off = x.iter().zip(&solution).map(|(x, s)| (x - s).abs()).fold(0.0, f64::max);
                assert!(off < 1e-3, "frame {frame}: {x:?}");
            }
            prediction.remember(&mut team, &solution);
        }
    }
}
