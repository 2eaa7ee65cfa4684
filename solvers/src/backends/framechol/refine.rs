//! `mixed`: a factor stored in f32, refined with residuals in f64 (J. H. Wilkinson, "Rounding Errors in Algebraic
//! Processes", 1963, section 3.4).
//!
//! Every pair of sweeps solves for the residual of the last one, so each gains the digits of the first: about five. The
//! residual is kept, not recomputed: r -= A d with the step d exact in f64, which costs one product and no copy of b.
//!
//! Two pairs are the rule, and for them no vector of f64 but the residual is written: the solution is the sum of two steps
//! in f32, formed where it is stored, and the product after the second pair only judges it.
use super::engine::{Engine, groups, power_of_two};
use super::gather::{Group, Output, Scatter, Source};
use super::method::{Answer, Method, Plan};
use super::panels::Reach;
use super::passes::{Judge, Product, Round, Sum};
use super::rows::Rows;
use super::sweep::{Backward, Forward, accumulate};
use super::symbolic::{Part, Symbolic};
use crate::aligned::Aligned;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::Isa;
use crate::lanes::{F32x4, F32x8, F64x4, F64x8, Shape};
use crate::ordering::inverse;
use crate::team::Team;
use std::ops::Range;

/// Most sweep pairs of a solve.
const MOST_PAIRS: u32 = 4;
/// Backward error at which refinement stops, where the class promises 5e-12. It is counted in the largest diagonal entry of
/// A; for a Laplacian the norm is twice that or more, so the true one is at most half as large.
const ENOUGH: f64 = 4e-12;
/// Relative size that the error after the last pair may have, estimated as the last step times the contraction seen: a
/// quarter of what the class promises (2e-9).
const SMALL: f64 = 5e-10;
/// Largest values of a right-hand side that is swept as it is. All residuals of a solve are scaled like the first, and the
/// fourth is 1e-15 of it: still far from where f32 loses digits, at 1e-38.
const COMFORTABLE: Range<f64> = 1e-8..1e8;
/// Rows that are converted together, in the first-level cache.
const CHUNK: usize = 512;

/// What a thread keeps for the refinement.
pub struct Refinement {
    /// b, then b - A x: own pivots; thread 0: also the rows of the top.
    residual: Aligned<f64>,
    /// The step before the last one, by local row as the slab. Holds the residual to sweep next while it is formed.
    other: Aligned<f32>,
    /// The sum of all steps but the last, from the third pair on.
    solution: Aligned<f64>,
    /// (A d)_i from the thread's own columns, for the rows of the top; longer for narrow groups, like all buffers.
    partial: Aligned<f64>,
    matrix: Rows,
    norms: Norms,
}

/// The solver with refinement.
pub struct Refined {
    engine: Engine<f32, Refinement>,
    top: Option<Rows>,
    /// The largest diagonal entry of A: a lower bound of its norm.
    norm: f64,
}

/// Largest absolute values, lane by lane.
#[derive(Clone, Copy, Default)]
pub struct Norms {
    pub residual: [f64; 8],
    pub solution: [f64; 8],
    pub step: [f64; 8],
}

impl Norms {
    fn join(mut self, other: &Self) -> Self {
        for c in 0..8 {
            self.residual[c] = larger(self.residual[c], other.residual[c]);
            self.solution[c] = larger(self.solution[c], other.solution[c]);
            self.step[c] = larger(self.step[c], other.step[c]);
        }
        self
    }

    /// Whether every column is good enough, given the norms before the last pair, the norm of A and that of the right-hand
    /// side.
    fn suffice(&self, before: &Self, norm: f64, right_hand_side: &[f64; 8]) -> bool {
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
fn larger(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

impl Method for Refined {
    fn new(plan: Plan<'_>) -> Result<Self, PrepareError> {
        let lanes = plan.lanes();
        let position = inverse(&plan.symbolic.order);
        let rows = |p: usize| Rows::new(&plan.symbolic, p, plan.matrix, &position);
        let threads = plan.symbolic.threads();
        let mut matrices: Vec<Rows> = (0..plan.symbolic.parts.len()).map(rows).collect();
        let top = (matrices.len() > threads).then(|| matrices.pop()).flatten();
        let mut matrices = matrices.into_iter();
        let extra = |part: &Part| Refinement {
            residual: Aligned::new(lanes * part.slab as usize),
            other: Aligned::new(lanes * part.slab as usize),
            solution: Aligned::new(lanes * part.slab as usize),
            partial: Aligned::new(lanes * (part.slab as usize - part.pivots())),
            matrix: matrices.next().expect("one block of rows per thread"),
            norms: Norms::default(),
        };
        Ok(Self {
            engine: Engine::new(plan.isa, plan.symbolic, lanes, plan.ordering, extra)?,
            top,
            norm: 0.0,
        })
    }

    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        self.engine.factorise(values)?;
        self.engine.team.for_each(&mut self.engine.shares, |_, share| share.extra.matrix.update(values));
        self.top.iter_mut().for_each(|top| top.update(values));
        self.norm = self.engine.symbolic.largest_pivot(values);
        Ok(())
    }

    fn solve(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, k: usize) -> Answer {
        let mut answer = Answer { finite: true, pairs: Some(0) };
        for group in groups(k, self.engine.widest()) {
            let (finite, pairs) = if group.count > 4 {
                self.refine::<F32x8, F64x8>(source, rows, x, group)
            } else {
                self.refine::<F32x4, F64x4>(source, rows, x, group)
            };
            answer.finite &= finite;
            answer.pairs = answer.pairs.max(Some(pairs));
        }
        answer
    }

    fn footprint(&self) -> Footprint {
        let mut footprint = self.engine.footprint();
        let extras = || self.engine.shares.iter().map(|s| &s.extra);
        let numbers = |e: &Refinement| 8 * (e.residual.len() + e.solution.len() + e.partial.len());
        let vectors: usize = extras().map(|e| numbers(e) + 4 * e.other.len()).sum();
        let matrices = || extras().map(|e| &e.matrix).chain(&self.top);
        let held = vectors as u64 + matrices().map(Rows::bytes).sum::<u64>();
        let product: u64 = matrices().map(Rows::bytes_read).sum();
        footprint.host_bytes = footprint.host_bytes.map(|bytes| bytes + held);
        // Two pairs, and the matrix once after each.
        footprint.bytes_per_solve = footprint.bytes_per_solve.map(|bytes| 2 * (bytes + product));
        footprint
    }

    fn reach(&self, positions: impl Iterator<Item = u32>) -> Reach {
        self.engine.reach(positions)
    }

    fn team(&mut self) -> (&mut Team, Isa) {
        (&mut self.engine.team, self.engine.isa)
    }
}

impl Refined {
    /// A group of columns. Returns whether the solution is finite, and the number of sweep pairs.
    fn refine<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        source: &impl Source,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> (bool, u32) {
        let right_hand_side = self.load::<S, W>(source, group);
        let largest = right_hand_side.iter().copied().fold(0.0, larger);
        let scale = if COMFORTABLE.contains(&largest) { 1.0 } else { 1.0 / power_of_two(largest) };
        if scale != 1.0 {
            self.round::<S, W>(scale);
        }
        let step = self.engine.scale / scale;
        self.pair::<S>(|part| source.active(part));
        let mut norms = self.judge::<S, W>(1, step, Some(scale));
        for pairs in 2.. {
            // Residuals are dense, whatever the right-hand side was.
            self.pair::<S>(|_| None);
            let before = norms;
            norms = self.judge::<S, W>(pairs, step, None);
            if pairs == MOST_PAIRS || norms.suffice(&before, self.norm, &right_hand_side) {
                return (self.store::<S, W>(pairs, step, rows, x, group), pairs);
            }
            self.judge::<S, W>(pairs, step, Some(scale));
        }
        unreachable!("pairs are counted up to MOST_PAIRS")
    }

    /// residual := b, and rounded to the slab. Returns max |b| in every lane.
    fn load<S: Shape<T = f32>, W: Shape<T = f64>>(&mut self, source: &impl Source, group: Group) -> [f64; 8] {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let part = &symbolic.parts[t];
            let residual = &mut W::rows(&mut share.extra.residual)[..part.slab as usize];
            let work = &mut S::rows(&mut share.slab)[..part.slab as usize];
            let (pivots, top) = residual.split_at_mut(part.pivots());
            let (work, work_top) = work.split_at_mut(part.pivots());
            let mut most = W::Row::default();
            let mut load = |positions: Range<usize>, rows: &mut [W::Row], work: &mut [S::Row]| {
                let chunks = rows.chunks_mut(CHUNK).zip(work.chunks_mut(CHUNK));
                for (from, (rows, work)) in positions.step_by(CHUNK).zip(chunks) {
                    source.load::<W>(*isa, from..from + rows.len(), group, 1.0, rows);
                    isa.run(Round::<S, W> { residual: rows, scale: 1.0, work, most: &mut most });
                }
            };
            load(symbolic.positions(t), pivots, work);
            if t == 0 {
                load(symbolic.top_positions(), top, work_top);
            } else {
                work_top.fill(S::Row::default());
            }
            share.extra.norms = Norms::default();
            share.extra.norms.residual[..W::K].copy_from_slice(most.as_ref());
        });
        let norms = shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms));
        norms.residual
    }

    /// The slab := `scale` times the residual.
    fn round<S: Shape<T = f32>, W: Shape<T = f64>>(&mut self, scale: f64) {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let rows = symbolic.own_rows(t);
            let residual = &W::rows(&mut share.extra.residual)[..rows];
            let work = &mut S::rows(&mut share.slab)[..rows];
            isa.run(Round::<S, W> { residual, scale, work, most: &mut W::Row::default() });
        });
    }

    /// One sweep pair on what the slabs hold.
    fn pair<'a, S: Shape<T = f32>>(&mut self, active: impl Fn(usize) -> Option<&'a [u32]> + Sync) {
        let Engine { isa, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let work = S::rows(&mut share.slab);
            isa.run(Forward::<S> { panels: &share.panels, active: active(t), work });
        });
        let threads = shares.len();
        self.engine.sweep_top::<S>(active(threads));
        let Engine { isa, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |_, share| {
            let work = S::rows(&mut share.slab);
            isa.run(Backward::<S> { panels: &share.panels, work });
        });
    }

    /// Residual, solution and step after the pair of this number, whose result the slabs hold in units of `unit`: their
    /// norms. With a scale the residual is also kept, and becomes the next pair's right-hand side, times that scale.
    fn judge<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        pairs: u32,
        unit: f64,
        keep: Option<f64>,
    ) -> Norms {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let pivots = symbolic.parts[t].pivots();
            let work = &*S::rows(&mut share.slab);
            let Refinement { residual, other, solution, partial, matrix, norms } = &mut share.extra;
            // Buffers are made for the widest group and have more rows for a narrow one.
            let out = &mut W::rows(partial)[..symbolic.parts[t].slab as usize - pivots];
            isa.run(Product::<S, W> { matrix, first: pivots, work, out });
            *norms = isa.run(Judge::<S, W> {
                matrix,
                rows: 0..pivots,
                more: &[],
                work,
                unit,
                pairs,
                keep,
                residual: W::rows(residual),
                other: S::rows(other),
                solution: W::rows(solution),
            });
        });
        let norms = self.judge_top::<S, W>(pairs, unit, keep);
        if keep.is_some() {
            let Engine { symbolic, shares, .. } = &mut self.engine;
            for (t, share) in shares.iter_mut().enumerate() {
                std::mem::swap(&mut share.slab, &mut share.extra.other);
                S::rows(&mut share.slab)[symbolic.own_rows(t)..].fill(S::Row::default());
            }
        }
        norms
    }

    /// Finishes what [`judge`](Self::judge) began: sums up the threads' shares of the top's rows, adds the top's own
    /// entries. Returns the norms over all rows.
    fn judge_top<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        pairs: u32,
        unit: f64,
        keep: Option<f64>,
    ) -> Norms {
        let Engine { isa, symbolic, shares, .. } = &mut self.engine;
        let norms = shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms));
        let Some(matrix) = &self.top else { return norms };
        let (first, others) = shares.split_first_mut().expect("at least one thread");
        let work = &*S::rows(&mut first.slab);
        let Refinement { residual, other, solution, partial, .. } = &mut first.extra;
        let partial = W::rows(partial);
        for share in others {
            accumulate::<W>(partial, W::rows(&mut share.extra.partial));
        }
        norms.join(&isa.run(Judge::<S, W> {
            matrix,
            rows: symbolic.parts[0].pivots()..symbolic.parts[0].slab as usize,
            more: partial,
            work,
            unit,
            pairs,
            keep,
            residual: W::rows(residual),
            other: S::rows(other),
            solution: W::rows(solution),
        }))
    }

    /// Stores the solution after the pair of this number. Returns whether it is finite.
    fn store<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        pairs: u32,
        unit: f64,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> bool {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let work = &*S::rows(&mut share.slab);
            let Refinement { other, solution, .. } = &mut share.extra;
            let (other, solution) = (&*S::rows(other), &*W::rows(solution));
            let mut sums = [W::Row::default(); CHUNK];
            let mut put = |positions: Range<usize>, first: usize| {
                let mut finite = true;
                for from in positions.clone().step_by(CHUNK) {
                    let own = from..positions.end.min(from + CHUNK);
                    let first = first + (from - positions.start);
                    let sums = &mut sums[..own.len()];
                    isa.run(Sum::<S, W> { first, work, unit, pairs, other, solution, sums });
                    // SAFETY: `rows` names every row at most once, and every thread stores other positions.
                    finite &= isa.run(unsafe { Scatter::<W>::new(&rows[own], x, group, 1.0, sums) });
                }
                finite
            };
            share.seen.finite = put(symbolic.positions(t), 0)
                && (t > 0 || put(symbolic.top_positions(), symbolic.parts[0].pivots()));
        });
        shares.iter().all(|share| share.seen.finite)
    }
}

impl Symbolic {
    /// Rows of the slab of thread `t` that are not copies of another's: its pivots, for thread 0 also the top.
    fn own_rows(&self, t: usize) -> usize {
        if t == 0 { self.parts[0].slab as usize } else { self.parts[t].pivots() }
    }
}
