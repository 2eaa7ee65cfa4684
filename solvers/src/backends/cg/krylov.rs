//! Preconditioned conjugate gradients on a block of columns (Hestenes and Stiefel 1952; Saad 2003, algorithm 9.1).
//!
//! Every lane is its own CG with its own scalars; lanes share the passes over the matrix and stop one by one. x is kept in
//! f64, the other vectors in S: f64, or f32 where the preconditioner is in f32 as well. Sums are always in f64. Per iteration
//! and row of W lanes the core moves, besides A and M: q = A p (reads p, writes q), r (reads r and q, writes r), the dot
//! products (read r, z, q), x and p (read x, p and z, write x and p): 11 rows of S and 2 of f64, and a number of the diagonal.
//!
//! The recurrence for r drifts away from b - A x, in f32 soon. So whenever it has carried the residual of a lane down by the
//! factor that its precision allows ([`Stored::TRUST`]), r is replaced by the true residual, computed in f64, while the
//! search directions live on (van der Vorst and Ye 2000): what they know of A is not lost. Success is claimed from the
//! true residual only, by its 2-norm and its scaled norm ([`Norms`]); where it is too large then, the iteration starts again from it. The best iterate survives in the
//! caller's x: when a residual rises after a minimum, the iterate before is written there.

use super::kernels::{Advance, Dots, Follow, Load, Multiply, Residual, Step, Sums};
use super::lanes::Window;
use super::norms::Norms;
use super::operator::Operator;
use super::preconditioner::{Budget, Preconditioner};
use super::workers::{Each, Strips, Workers};
use crate::backend::Solved;
use crate::columns::Columns;
use crate::error::SolveError;
use crate::isa::Real;

/// The true residual may exceed the tolerance by this factor: half of what the limits leave to iterative backends
/// (1.1), because theirs is measured with compensated sums and ours is not.
const ACCEPTED: f64 = 1.05;
/// A restart must at least halve the true residual, or rounding is all that is left.
const RESTART_GAIN: f64 = 0.5;
/// A recurrence is lost where the true residual is twice what it says.
const LOST: f64 = 2.0;
/// An iterate counts as better, and as progress, where its residual is below nine tenths of the smallest before.
const PROGRESS: f64 = 0.9;

/// Precision of the vectors of an iteration.
pub(crate) trait Stored: Real {
    /// Reduction of the residual over which its recurrence is believed; then the true residual takes its place.
    const TRUST: f64;
    /// Whether M^-1 is rounded so coarsely that it is unsymmetric to CG: one more dot product per iteration (the formula
    /// of Polak and Ribiere, see Golub and Ye 1999) then keeps it converging.
    const FLEXIBLE: bool;
}

impl Stored for f64 {
    const TRUST: f64 = 0.0; // to the tolerance, whatever it is
    const FLEXIBLE: bool = false;
}

impl Stored for f32 {
    /// Three digits above the unit roundoff 6e-8: drift stays below a thousandth of the residual.
    const TRUST: f64 = 1e-4;
    const FLEXIBLE: bool = true;
}

/// The vectors of a solve, n rows each.
pub(crate) struct Vectors<'a, S, const W: usize> {
    /// Iterate.
    pub(crate) x: &'a mut [[f64; W]],
    /// Residual.
    pub(crate) r: &'a mut [[S; W]],
    /// Preconditioned residual.
    pub(crate) z: &'a mut [[S; W]],
    /// Search direction.
    pub(crate) p: &'a mut [[S; W]],
    /// A p.
    pub(crate) q: &'a mut [[S; W]],
}

/// Who works on which rows.
pub(crate) struct Force<'a> {
    /// The threads.
    pub(crate) workers: &'a mut Workers,
    /// The rows of each.
    pub(crate) strips: &'a Strips,
    /// One item per strip.
    pub(crate) sums: &'a mut [Sums],
    /// The inverse diagonal of the matrix.
    pub(crate) inverse: &'a [f64],
}

/// What the preconditioner is used for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Method {
    /// Conjugate gradients.
    Conjugate,
    /// x += M^-1 (b - A x): steps of length 1 along M^-1 r, which shows what M does alone.
    Stationary,
}

/// What to reach, how, and when to give up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    /// How to iterate.
    pub(crate) method: Method,
    /// Relative residual to reach, in both norms.
    pub(crate) tolerance: f64,
    /// Limits on the iterations.
    pub(crate) budget: Budget,
}

/// State of one lane.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lane {
    /// Iterating.
    Active,
    /// At the tolerance as far as the recurrence knows, or without a right-hand side.
    Resting,
    /// p . A p <= 0 or a number overflowed: not positive definite, as far as rounding lets one see.
    Broken,
}

/// Solves A X = B for the columns of `window`; `x` holds the guess, then the solution or the best iterate.
/// `observe` hears the iteration and the largest relative residual by recurrence, in the 2-norm.
pub(crate) fn solve<A: Operator, S: Stored, const W: usize>(
    force: Force<'_>,
    a: &A,
    m: &mut dyn Preconditioner<S, W>,
    goal: Goal,
    window: Window<W>,
    b: Columns<&[f64]>,
    x: Columns<&mut [f64]>,
    vectors: Vectors<'_, S, W>,
    observe: &mut dyn FnMut(u32, f64),
) -> Result<Solved, SolveError> {
    let mut run = Run::new(force, a, m, goal, window, b, x, vectors);
    run.guess();
    loop {
        let before = run.size;
        run.iterate(observe);
        run.end_of_recurrence();
        let missing = |c: usize| !run.reached(c, ACCEPTED);
        let stuck = |c: usize| run.size[c].is_nan() || run.size[c] > RESTART_GAIN * RESTART_GAIN * before[c];
        let reached = !(0..W).any(missing);
        let hopeless =
            run.exhausted() || (0..W).any(|c| missing(c) && (run.lane[c] == Lane::Broken || stuck(c)));
        if reached || hopeless {
            return run.finish(reached);
        }
        run.lane = std::array::from_fn(|c| if missing(c) { Lane::Active } else { Lane::Resting });
    }
}

struct Run<'a, A, S, const W: usize> {
    force: Force<'a>,
    a: &'a A,
    m: &'a mut dyn Preconditioner<S, W>,
    goal: Goal,
    window: Window<W>,
    b: Columns<&'a [f64]>,
    out: Columns<&'a mut [f64]>,
    v: Vectors<'a, S, W>,
    lane: [Lane; W],
    b_norms: Norms<W>,
    r_norms: Norms<W>,
    /// Squares of the relative residual, the larger of both norms, and of the smallest so far.
    size: [f64; W],
    best: [f64; W],
    /// Whether `out` (else the current iterate) holds the best one.
    saved: [bool; W],
    iterations: u32,
    /// Iteration of the last progress of any active lane.
    progress: u32,
}

impl<'a, A: Operator, S: Stored, const W: usize> Run<'a, A, S, W> {
    fn new(
        force: Force<'a>,
        a: &'a A,
        m: &'a mut dyn Preconditioner<S, W>,
        goal: Goal,
        window: Window<W>,
        b: Columns<&'a [f64]>,
        out: Columns<&'a mut [f64]>,
        v: Vectors<'a, S, W>,
    ) -> Self {
        let lane = std::array::from_fn(|c| if window.is_used(c) { Lane::Active } else { Lane::Resting });
        Self {
            force,
            a,
            m,
            goal,
            window,
            b,
            out,
            v,
            lane,
            b_norms: Norms::ZERO,
            r_norms: Norms::ZERO,
            size: [0.0; W],
            best: [f64::INFINITY; W],
            saved: [false; W],
            iterations: 0,
            progress: 0,
        }
    }

    /// Loads b and the guess; a guess worse than x = 0 is dropped. One product with A unless the guess is zero.
    fn guess(&mut self) {
        let guess = self.load();
        if guess.iter().all(|&xx| xx == 0.0) {
            return self.measure(self.b_norms);
        }
        self.replace_residual();
        let keep = self.size.map(|size| size <= 1.0); // false for NaN as well
        if keep.contains(&false) {
            for (i, &row) in self.a.rows().iter().enumerate() {
                let b = self.window.read(self.b, row as usize);
                for c in (0..W).filter(|&c| !keep[c]) {
                    (self.v.x[i][c], self.v.r[i][c]) = (0.0, S::from_f64(b[c]));
                }
            }
        }
        let choose =
            |own: &[f64; W], b: &[f64; W]| std::array::from_fn(|c| if keep[c] { own[c] } else { b[c] });
        self.measure(Norms {
            plain: choose(&self.r_norms.plain, &self.b_norms.plain),
            scaled: choose(&self.r_norms.scaled, &self.b_norms.scaled),
        });
        self.lane = std::array::from_fn(|c| if self.reached(c, 1.0) { Lane::Resting } else { Lane::Active });
    }

    /// r = b, x = the guess; returns a sum that is 0 for lanes without a guess.
    fn load(&mut self) -> [f64; W] {
        let Force { workers, strips, sums, inverse } = &mut self.force;
        let (isa, window, b, guess, all) =
            (workers.isa, &self.window, self.b, self.out.view(), self.a.rows());
        workers.run(strips, (&mut *self.v.r, &mut *self.v.x, Each(sums)), |_, rows, (r, x, sum)| {
            let (names, inverse) = (&all[rows.clone()], &inverse[rows]);
            sum.set(isa.run(Load { window, b, guess, names, inverse, r, x }));
        });
        let strips = &sums[..strips.count()];
        self.b_norms = Sums::norms(strips);
        let [_, _, guess] = Sums::total(strips);
        guess
    }

    /// r = b - A x in f64, rounded once.
    fn replace_residual(&mut self) {
        let Force { workers, strips, sums, inverse } = &mut self.force;
        let (isa, a, window, b, x) = (workers.isa, self.a, &self.window, self.b, &*self.v.x);
        workers.run(strips, (&mut *self.v.r, Each(sums)), |_, rows, (r, sum)| {
            sum.set(isa.run(Residual { a, rows, inverse, window, b, x, r }));
        });
        let norms = Sums::norms(&sums[..strips.count()]);
        self.measure(norms);
    }

    /// Replaces r; where the recurrence had lost the true residual, what it called the best iterate is none.
    fn end_of_recurrence(&mut self) {
        let told = self.size;
        self.replace_residual();
        for c in (0..W).filter(|&c| self.size[c] > LOST * LOST * told[c]) {
            (self.best[c], self.saved[c]) = (self.size[c], false);
        }
    }

    /// Takes note of how large r is.
    fn measure(&mut self, norms: Norms<W>) {
        self.r_norms = norms;
        self.size = std::array::from_fn(|c| norms.relative(&self.b_norms, c));
    }

    fn reached(&self, c: usize, slack: f64) -> bool {
        let limit = slack * self.goal.tolerance;
        !self.window.is_used(c) || self.size[c] <= limit * limit
    }

    fn exhausted(&self) -> bool {
        self.iterations >= self.goal.budget.iterations
            || self.iterations - self.progress > self.goal.budget.patience
    }

    fn any_active(&self) -> bool {
        self.lane.contains(&Lane::Active)
    }

    /// CG from the current x and r to the tolerance, or as far as the budget lasts.
    fn iterate(&mut self, observe: &mut dyn FnMut(u32, f64)) {
        if !self.any_active() {
            return;
        }
        let mut trusted = self.size;
        self.m.apply(self.force.workers, self.v.r, self.v.z);
        let [mut rz, _] = self.dots();
        std::mem::swap(&mut self.v.p, &mut self.v.z);
        while self.any_active() && !self.exhausted() {
            let pq = self.multiply();
            let mut alpha = self.step_lengths(&rz, &pq);
            self.step(&alpha);
            self.iterations += 1;
            self.keep_best();
            observe(self.iterations, self.worst(|c| self.r_norms.plain[c] / self.b_norms.plain[c]));
            self.rest();
            let drifted = self.drifted(&trusted);
            let replaced = drifted.contains(&true);
            if replaced {
                self.follow(&std::mem::replace(&mut alpha, [0.0; W]));
                self.correct_drift(&drifted, &mut trusted);
            }
            if !self.any_active() {
                return self.follow(&alpha);
            }
            self.m.apply(self.force.workers, self.v.r, self.v.z);
            let [new, qz] = self.dots();
            let ratio = |c: usize| match self.goal.method {
                Method::Stationary => 0.0,
                // Flexible: z . (r - r_old) / rz, with r - r_old = -alpha q and alpha = rz / pq. A replaced r is not that.
                Method::Conjugate if S::FLEXIBLE && !replaced => -qz[c] / pq[c],
                Method::Conjugate => new[c] / rz[c],
            };
            let beta = std::array::from_fn(|c| if self.lane[c] == Lane::Active { ratio(c) } else { 0.0 });
            self.advance(&alpha, &beta);
            rz = new;
        }
    }

    /// Active lanes whose recurrence has gone as far as it is trusted.
    fn drifted(&self, trusted: &[f64; W]) -> [bool; W] {
        let enough = |c: usize| self.size[c] <= S::TRUST * S::TRUST * trusted[c];
        std::array::from_fn(|c| self.lane[c] == Lane::Active && enough(c))
    }

    /// Puts the true residual in the place of r. Drifted lanes break where it is not much smaller than the last time: then
    /// rounding is all that is left.
    fn correct_drift(&mut self, drifted: &[bool; W], trusted: &mut [f64; W]) {
        self.replace_residual();
        for c in (0..W).filter(|&c| drifted[c]) {
            if !(self.size[c] <= RESTART_GAIN * RESTART_GAIN * trusted[c]) {
                self.lane[c] = Lane::Broken;
            }
        }
        *trusted = self.size;
    }

    /// q = A p; returns p . q.
    fn multiply(&mut self) -> [f64; W] {
        let Force { workers, strips, sums, .. } = &mut self.force;
        let (isa, a, p) = (workers.isa, self.a, &*self.v.p);
        workers.run(strips, (&mut *self.v.q, Each(sums)), |_, rows, (q, sum)| {
            sum.set(isa.run(Multiply { a, rows, p, q }));
        });
        let [pq] = Sums::total(&sums[..strips.count()]);
        pq
    }

    /// r -= alpha q.
    fn step(&mut self, alpha: &[f64; W]) {
        let Force { workers, strips, sums, inverse } = &mut self.force;
        let (isa, q) = (workers.isa, &*self.v.q);
        workers.run(strips, (&mut *self.v.r, Each(sums)), |_, rows, (r, sum)| {
            sum.set(isa.run(Step { alpha, inverse: &inverse[rows.clone()], q: &q[rows], r }));
        });
        let norms = Sums::norms(&sums[..strips.count()]);
        self.measure(norms);
    }

    /// r . z and q . z.
    fn dots(&mut self) -> [[f64; W]; 2] {
        let Force { workers, strips, sums, .. } = &mut self.force;
        let (isa, r, q, z) = (workers.isa, &*self.v.r, &*self.v.q, &*self.v.z);
        workers.run(strips, Each(sums), |_, rows, sum| {
            sum.set(isa.run(Dots { r: &r[rows.clone()], q: &q[rows.clone()], z: &z[rows] }));
        });
        Sums::total(&sums[..strips.count()])
    }

    /// x += alpha p.
    fn follow(&mut self, alpha: &[f64; W]) {
        let Force { workers, strips, .. } = &mut self.force;
        let (isa, p) = (workers.isa, &*self.v.p);
        workers.run(strips, &mut *self.v.x, |_, rows, x| isa.run(Follow { alpha, p: &p[rows], x }));
    }

    /// x += alpha p, then p = z + beta p.
    fn advance(&mut self, alpha: &[f64; W], beta: &[f64; W]) {
        let Force { workers, strips, .. } = &mut self.force;
        let (isa, z) = (workers.isa, &*self.v.z);
        workers.run(strips, (&mut *self.v.p, &mut *self.v.x), |_, rows, (p, x)| {
            isa.run(Advance { alpha, beta, z: &z[rows], p, x });
        });
    }

    /// alpha = r.z / p.Ap (1 where stationary), 0 for lanes at rest. Lanes where A or M turns out not to be positive definite break here.
    fn step_lengths(&mut self, rz: &[f64; W], pq: &[f64; W]) -> [f64; W] {
        let mut alpha = [0.0; W];
        for c in 0..W {
            if self.lane[c] != Lane::Active {
                continue;
            }
            let length = if self.goal.method == Method::Stationary { 1.0 } else { rz[c] / pq[c] };
            if pq[c] > 0.0 && rz[c] > 0.0 && length.is_finite() {
                alpha[c] = length;
            } else {
                self.lane[c] = Lane::Broken;
            }
        }
        alpha
    }

    /// Notes progress. Where a residual rises after the best iterate, that iterate goes to the caller's x: it is still in
    /// x here, because x follows r by one step.
    fn keep_best(&mut self) {
        let mut rescue = [false; W];
        for c in 0..W {
            if self.size[c] < PROGRESS * PROGRESS * self.best[c] {
                (self.best[c], self.saved[c]) = (self.size[c], false);
                self.progress = self.iterations;
            } else if !self.saved[c] && self.lane[c] == Lane::Active {
                (rescue[c], self.saved[c]) = (true, true);
            }
        }
        if rescue.contains(&true) {
            self.write(&rescue);
        }
    }

    /// Lanes that have come far enough rest.
    fn rest(&mut self) {
        for c in 0..W {
            if self.lane[c] != Lane::Active {
                continue;
            }
            if self.reached(c, 1.0) {
                self.lane[c] = Lane::Resting;
            } else if !self.size[c].is_finite() {
                self.lane[c] = Lane::Broken;
            }
        }
    }

    /// The largest `square` over the lanes in use, as a root.
    fn worst(&self, square: impl Fn(usize) -> f64) -> f64 {
        let used = (0..W).filter(|&c| self.window.is_used(c));
        used.map(square).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a }).sqrt()
    }

    /// Writes the columns of `mask` to the caller's x.
    fn write(&mut self, mask: &[bool; W]) {
        for (x, &row) in self.v.x.iter().zip(self.a.rows()) {
            self.window.write(&mut self.out, row as usize, mask, x);
        }
    }

    /// Writes the solution. Where the goal was missed, a lane whose saved iterate has the smaller residual keeps that.
    fn finish(mut self, reached: bool) -> Result<Solved, SolveError> {
        let current = std::array::from_fn(|c| reached || !self.saved[c] || self.size[c] <= self.best[c]);
        self.write(&current);
        for c in 0..W {
            self.size[c] = if current[c] { self.size[c] } else { self.best[c] };
        }
        let (iterations, residual) = (self.iterations, self.worst(|c| self.size[c]));
        if reached {
            Ok(Solved { iterations: Some(iterations), residual: Some(residual), device_ns: None })
        } else {
            Err(SolveError::NotConverged { iterations, residual })
        }
    }
}
