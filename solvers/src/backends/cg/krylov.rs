//! Preconditioned conjugate gradients on a block of columns (Hestenes and Stiefel 1952; Saad 2003, algorithm 9.1).
//!
//! Every lane is its own CG with its own scalars; lanes share the passes over the matrix and stop one by one. Per
//! iteration and row of W lanes the core itself moves: q = A p (reads A and p, writes q), x and r updated (4 reads, 2
//! writes), the dot products (2 or 3 reads), p updated (2 reads, 1 write): 12 rows of 8 W bytes besides A and M.
//!
//! The recurrence for r drifts away from b - A x, so the true residual is computed before success is claimed; if it is
//! too large the iteration starts again from it. The best iterate survives in the caller's x: when a residual rises
//! after a minimum, the iterate before the step, x - alpha p, is written there.

use super::lanes::Window;
use super::operator::Operator;
use super::preconditioner::{Budget, Preconditioner};
use crate::backend::Solved;
use crate::columns::Columns;
use crate::error::SolveError;

/// The true residual may exceed the tolerance by this factor: half of what the limits leave to iterative backends
/// (1.1), because theirs is measured with compensated sums and ours is not.
const ACCEPTED: f64 = 1.05;
/// A restart must at least halve the true residual, or rounding is all that is left.
const RESTART_GAIN: f64 = 0.5;
/// An iterate counts as better, and as progress, where its residual is below nine tenths of the smallest before.
const PROGRESS: f64 = 0.9;

/// The vectors of a solve, n rows each.
pub(crate) struct Vectors<'a, const W: usize> {
    /// Iterate.
    pub(crate) x: &'a mut [[f64; W]],
    /// Residual.
    pub(crate) r: &'a mut [[f64; W]],
    /// Preconditioned residual.
    pub(crate) z: &'a mut [[f64; W]],
    /// Search direction.
    pub(crate) p: &'a mut [[f64; W]],
    /// A p.
    pub(crate) q: &'a mut [[f64; W]],
}

/// What to reach, and when to give up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    /// Relative residual to reach.
    pub(crate) tolerance: f64,
    /// Limits on the iterations.
    pub(crate) budget: Budget,
    /// Whether the preconditioner needs the flexible formula.
    pub(crate) flexible: bool,
}

/// State of one lane.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lane {
    /// Iterating.
    Active,
    /// At its tolerance, or without a right-hand side.
    Done,
    /// p . A p <= 0 or a number overflowed: not positive definite, as far as rounding lets one see.
    Broken,
}

/// Solves A X = B for the columns of `window`; `x` holds the guess, then the solution or the best iterate.
/// `observe` hears the iteration and the largest relative residual by recurrence.
pub(crate) fn solve<A: Operator, const W: usize>(
    a: &A,
    m: &mut dyn Preconditioner<W>,
    goal: Goal,
    window: Window<W>,
    b: Columns<&[f64]>,
    x: Columns<&mut [f64]>,
    vectors: Vectors<'_, W>,
    observe: &mut dyn FnMut(u32, f64),
) -> Result<Solved, SolveError> {
    let mut run = Run::new(a, m, goal, window, b, x, vectors);
    run.guess();
    let mut before = run.rr;
    loop {
        run.iterate(observe);
        run.true_residual();
        let reached = (0..W).all(|c| run.reached(c, ACCEPTED));
        let hopeless = run.exhausted()
            || (0..W).any(|c| {
                !run.reached(c, ACCEPTED)
                    && (run.lane[c] == Lane::Broken
                        || run.rr[c].is_nan()
                        || run.rr[c] > RESTART_GAIN * RESTART_GAIN * before[c])
            });
        if reached || hopeless {
            return run.finish(reached);
        }
        before = run.rr;
        run.lane = std::array::from_fn(|c| if run.reached(c, ACCEPTED) { Lane::Done } else { Lane::Active });
    }
}

struct Run<'a, A, const W: usize> {
    a: &'a A,
    m: &'a mut dyn Preconditioner<W>,
    goal: Goal,
    window: Window<W>,
    b: Columns<&'a [f64]>,
    out: Columns<&'a mut [f64]>,
    v: Vectors<'a, W>,
    lane: [Lane; W],
    /// ||b||^2, ||r||^2 and the smallest ||r||^2 seen, per lane.
    bb: [f64; W],
    rr: [f64; W],
    best: [f64; W],
    /// Whether `out` (else the current iterate) holds the best one.
    saved: [bool; W],
    iterations: u32,
    /// Iteration of the last progress of any active lane.
    progress: u32,
}

impl<'a, A: Operator, const W: usize> Run<'a, A, W> {
    fn new(
        a: &'a A,
        m: &'a mut dyn Preconditioner<W>,
        goal: Goal,
        window: Window<W>,
        b: Columns<&'a [f64]>,
        out: Columns<&'a mut [f64]>,
        v: Vectors<'a, W>,
    ) -> Self {
        let lane = std::array::from_fn(|c| if window.is_used(c) { Lane::Active } else { Lane::Done });
        let (bb, rr, best) = ([0.0; W], [0.0; W], [f64::INFINITY; W]);
        Self {
            a,
            m,
            goal,
            window,
            b,
            out,
            v,
            lane,
            bb,
            rr,
            best,
            saved: [false; W],
            iterations: 0,
            progress: 0,
        }
    }

    /// Loads b and the guess; a guess worse than x = 0 is dropped. One product with A unless the guess is zero.
    fn guess(&mut self) {
        let mut is_zero = true;
        for i in 0..self.b.n() {
            let (b, x) = (self.window.read(self.b, i), self.window.read(self.out.view(), i));
            is_zero &= x.iter().all(|&x| x == 0.0);
            (self.v.r[i], self.v.x[i]) = (b, x);
            for c in 0..W {
                self.bb[c] += b[c] * b[c];
            }
        }
        self.rr = self.bb;
        if is_zero {
            return;
        }
        self.a.multiply(self.v.x, self.v.q);
        let rr = self.residual_from_product();
        let keep: [bool; W] = std::array::from_fn(|c| rr[c] <= self.bb[c]); // false for NaN as well
        for (i, (x, r)) in self.v.x.iter_mut().zip(self.v.r.iter_mut()).enumerate() {
            let b = self.window.read(self.b, i);
            for c in 0..W {
                (x[c], r[c]) = if keep[c] { (x[c], r[c]) } else { (0.0, b[c]) };
            }
        }
        self.rr = std::array::from_fn(|c| if keep[c] { rr[c] } else { self.bb[c] });
        self.lane = std::array::from_fn(|c| if self.reached(c, 1.0) { Lane::Done } else { Lane::Active });
    }

    /// r = b - q, and ||r||^2.
    fn residual_from_product(&mut self) -> [f64; W] {
        let mut rr = [0.0; W];
        for (i, (r, q)) in self.v.r.iter_mut().zip(self.v.q.iter()).enumerate() {
            let b = self.window.read(self.b, i);
            for c in 0..W {
                r[c] = b[c] - q[c];
                rr[c] += r[c] * r[c];
            }
        }
        rr
    }

    fn true_residual(&mut self) {
        self.a.multiply(self.v.x, self.v.q);
        self.rr = self.residual_from_product();
    }

    fn reached(&self, c: usize, slack: f64) -> bool {
        let limit = slack * self.goal.tolerance;
        !self.window.is_used(c) || self.rr[c] <= limit * limit * self.bb[c]
    }

    fn exhausted(&self) -> bool {
        self.iterations >= self.goal.budget.iterations
            || self.iterations - self.progress > self.goal.budget.patience
    }

    fn any_active(&self) -> bool {
        self.lane.contains(&Lane::Active)
    }

    /// CG from the current x and r until no lane is active or the budget is spent.
    fn iterate(&mut self, observe: &mut dyn FnMut(u32, f64)) {
        if !self.any_active() {
            return;
        }
        self.m.apply(self.v.r, self.v.z);
        self.v.p.copy_from_slice(self.v.z);
        let mut rz = dot(self.v.r, self.v.z);
        while self.any_active() && !self.exhausted() {
            let pq = self.a.multiply(self.v.p, self.v.q);
            let alpha = self.step_lengths(&rz, &pq);
            self.rr = step(&alpha, self.v.p, self.v.q, self.v.x, self.v.r);
            self.iterations += 1;
            self.keep_best(&alpha);
            observe(self.iterations, self.worst());
            self.stop_lanes();
            if !self.any_active() {
                return;
            }
            self.m.apply(self.v.r, self.v.z);
            let new = dot(self.v.r, self.v.z);
            let beta = if self.goal.flexible {
                // z . (r - r_old) / rz, with r - r_old = -alpha q and alpha = rz / pq.
                let qz = dot(self.v.q, self.v.z);
                std::array::from_fn(|c| if self.lane[c] == Lane::Active { -qz[c] / pq[c] } else { 0.0 })
            } else {
                std::array::from_fn(|c| if self.lane[c] == Lane::Active { new[c] / rz[c] } else { 0.0 })
            };
            rz = new;
            advance(&beta, self.v.z, self.v.p);
        }
    }

    /// alpha = r.z / p.Ap, 0 for lanes at rest. Lanes where A or M turns out not to be positive definite break here.
    fn step_lengths(&mut self, rz: &[f64; W], pq: &[f64; W]) -> [f64; W] {
        let mut alpha = [0.0; W];
        for c in 0..W {
            if self.lane[c] != Lane::Active {
                continue;
            }
            let length = rz[c] / pq[c];
            if pq[c] > 0.0 && rz[c] > 0.0 && length.is_finite() {
                alpha[c] = length;
            } else {
                self.lane[c] = Lane::Broken;
            }
        }
        alpha
    }

    /// Notes progress; where a residual rises after the best iterate, writes that iterate to the caller's x.
    fn keep_best(&mut self, alpha: &[f64; W]) {
        let mut rescue = [false; W];
        for c in 0..W {
            if self.rr[c] < PROGRESS * PROGRESS * self.best[c] {
                (self.best[c], self.saved[c]) = (self.rr[c], false);
                self.progress = self.iterations;
            } else if !self.saved[c] && alpha[c] != 0.0 {
                (rescue[c], self.saved[c]) = (true, true);
            }
        }
        if rescue.contains(&true) {
            for i in 0..self.v.x.len() {
                let (x, p) = (&self.v.x[i], &self.v.p[i]);
                let previous = std::array::from_fn(|c| x[c] - alpha[c] * p[c]);
                self.window.write(&mut self.out, i, &rescue, &previous);
            }
        }
    }

    fn stop_lanes(&mut self) {
        for c in 0..W {
            if self.lane[c] == Lane::Active && self.reached(c, 1.0) {
                self.lane[c] = Lane::Done;
            } else if self.lane[c] == Lane::Active && !self.rr[c].is_finite() {
                self.lane[c] = Lane::Broken;
            }
        }
    }

    /// Largest relative residual of the lanes in use.
    fn worst(&self) -> f64 {
        (0..W)
            .filter(|&c| self.window.is_used(c))
            .map(|c| (self.rr[c] / self.bb[c]).sqrt())
            .fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Writes the solution. Where the goal was missed, a lane whose saved iterate has the smaller residual keeps that.
    fn finish(mut self, reached: bool) -> Result<Solved, SolveError> {
        let current = std::array::from_fn(|c| reached || !self.saved[c] || self.rr[c] <= self.best[c]);
        for (i, x) in self.v.x.iter().enumerate() {
            self.window.write(&mut self.out, i, &current, x);
        }
        for c in 0..W {
            self.rr[c] = if current[c] { self.rr[c] } else { self.best[c] };
        }
        let (iterations, residual) = (self.iterations, self.worst());
        if reached {
            Ok(Solved { iterations: Some(iterations), residual: Some(residual), device_ns: None })
        } else {
            Err(SolveError::NotConverged { iterations, residual })
        }
    }
}

/// x += alpha p, r -= alpha q; returns ||r||^2.
fn step<const W: usize>(
    alpha: &[f64; W],
    p: &[[f64; W]],
    q: &[[f64; W]],
    x: &mut [[f64; W]],
    r: &mut [[f64; W]],
) -> [f64; W] {
    let mut rr = [0.0; W];
    for (((x, r), p), q) in x.iter_mut().zip(r).zip(p).zip(q) {
        for c in 0..W {
            x[c] += alpha[c] * p[c];
            r[c] -= alpha[c] * q[c];
            rr[c] += r[c] * r[c];
        }
    }
    rr
}

/// p = z + beta p.
fn advance<const W: usize>(beta: &[f64; W], z: &[[f64; W]], p: &mut [[f64; W]]) {
    for (p, z) in p.iter_mut().zip(z) {
        for c in 0..W {
            p[c] = z[c] + beta[c] * p[c];
        }
    }
}

/// a . b for every lane.
fn dot<const W: usize>(a: &[[f64; W]], b: &[[f64; W]]) -> [f64; W] {
    let mut sum = [0.0; W];
    for (a, b) in a.iter().zip(b) {
        for c in 0..W {
            sum[c] += a[c] * b[c];
        }
    }
    sum
}
