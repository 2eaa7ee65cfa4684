//! `mixed`: a factor stored in f32, refined with residuals in f64 (J. H. Wilkinson, "Rounding Errors in Algebraic
//! Processes", 1963, section 3.4).
//!
//! Every pair of sweeps solves for the residual of the last one, so each gains the digits of the first: about five.
//!
//! Two pairs are the rule, and for them no vector of f64 is kept: the residual b - A d is formed row by row from b, gathered
//! anew, and the step d, and rounded at once; the solution is the sum of two steps in f32, formed where it is stored. The residual that the second pair leaves is not computed but bounded: both pairs use
//! one factor, so the backward error of the first, which its residual shows, holds for the second as well. Only where that
//! bound does not reach is there another product, and by it a third pair.
use super::engine::{Engine, load, power_of_two};
use super::gather::{Group, Output, Scatter, Source};
use super::method::{Answer, Method, Plan};
use super::norms::{Norms, larger};
use super::panels::Reach;
use super::passes::{CHUNK, Judge, Judged, Product, Sum};
use super::rows::Rows;
use super::sweep::{Backward, Forward, accumulate};
use super::symbolic::{Part, Symbolic};
use crate::aligned::Aligned;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::Isa;
use crate::lanes::{F32x4, F32x8, F64x4, F64x8, Shape};
use crate::ordering::inverse;
use crate::registry::Precision;
use crate::team::Team;
use std::ops::Range;
use std::sync::Arc;

/// Most sweep pairs of a solve.
const MOST_PAIRS: u32 = 4;
/// Largest values of a right-hand side that is swept as it is. All residuals of a solve are scaled like the first, and the
/// fourth is 1e-15 of it: still far from where f32 loses digits, at 1e-38.
const COMFORTABLE: Range<f64> = 1e-8..1e8;

/// What a thread keeps for the refinement.
pub struct Refinement {
    /// The step before the last one, by local row as the slab. Holds the residual to sweep next while it is formed.
    other: Aligned<f32>,
    /// The sum of the steps, from the residual after the second pair on, by local row.
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

impl Method for Refined {
    const PRECISION: Precision = Precision::Mixed;

    fn new(plan: Plan<'_>) -> Result<Self, PrepareError> {
        let lanes = plan.lanes();
        let position = inverse(&plan.symbolic.order);
        let rows = |p: usize| Rows::new(&plan.symbolic, p, plan.matrix, &position);
        let threads = plan.symbolic.threads();
        let mut matrices: Vec<Rows> = (0..plan.symbolic.parts.len()).map(rows).collect();
        let top = (matrices.len() > threads).then(|| matrices.pop()).flatten();
        let mut matrices = matrices.into_iter();
        let extra = |part: &Part| Refinement {
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

    fn widest(&self) -> usize {
        self.engine.widest()
    }

    fn order(&self) -> Arc<[u32]> {
        Arc::clone(&self.engine.symbolic.order)
    }

    fn group(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, group: Group) -> Answer {
        if group.count > 4 {
            self.refine::<F32x8, F64x8>(source, rows, x, group)
        } else {
            self.refine::<F32x4, F64x4>(source, rows, x, group)
        }
    }

    fn footprint(&self) -> Footprint {
        let mut footprint = self.engine.footprint();
        let extras = || self.engine.shares.iter().map(|s| &s.extra);
        let numbers = |e: &Refinement| 8 * (e.solution.len() + e.partial.len());
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
    /// A group of columns.
    fn refine<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        source: &impl Source,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> Answer {
        let right_hand_side = self.load::<S>(source, group, 1.0);
        let largest = right_hand_side.iter().copied().fold(0.0, larger);
        let scale = if COMFORTABLE.contains(&largest) { 1.0 } else { 1.0 / power_of_two(largest) };
        if scale != 1.0 {
            self.load::<S>(source, group, scale);
        }
        let step = self.engine.scale / scale;
        self.pair::<S>(|part| source.active(part));
        let mut before = self.judge::<S, W>(source, group, 1, step, scale);
        let loss = before.backward_error(self.norm, &right_hand_side);
        for pairs in 2.. {
            // Residuals are dense, whatever the right-hand side was.
            self.pair::<S>(|_| None);
            let (finite, mut norms) = self.store::<S, W>(pairs, step, rows, x, group);
            norms.expect_residual(&before, self.norm, &loss);
            if pairs == MOST_PAIRS || norms.suffice(&before, self.norm, &right_hand_side) {
                return Answer { finite, pairs: Some(pairs) };
            }
            norms = self.judge::<S, W>(source, group, pairs, step, scale);
            if norms.suffice(&before, self.norm, &right_hand_side) {
                return Answer { finite, pairs: Some(pairs) };
            }
            before = norms;
        }
        unreachable!("pairs are counted up to MOST_PAIRS")
    }

    /// The slab := `scale` times b, rounded. Returns max |b| in every lane.
    fn load<S: Shape<T = f32>>(&mut self, source: &impl Source, group: Group, scale: f64) -> [f64; 8] {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let work = S::rows(&mut share.slab);
            let residual = load::<S>(*isa, symbolic, t, source, work, group, scale);
            share.extra.norms = Norms { residual, ..Norms::default() };
        });
        shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms)).residual
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
    /// norms. The residual, times `scale`, becomes the next pair's right-hand side.
    fn judge<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        source: &impl Source,
        group: Group,
        pairs: u32,
        unit: f64,
        scale: f64,
    ) -> Norms {
        if pairs > 1 {
            self.add_step(pairs, unit);
        }
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let (pivots, slab) = (symbolic.parts[t].pivots(), symbolic.parts[t].slab as usize);
            let step = &*S::rows(&mut share.slab);
            let Refinement { other, solution, partial, matrix, norms } = &mut share.extra;
            let (matrix, solution) = (&*matrix, &*W::rows(solution));
            // Buffers are made for the widest group and have more rows for a narrow one.
            let out = &mut W::rows(partial)[..slab - pivots];
            let judged = Judged {
                isa: *isa,
                source,
                group,
                positions: symbolic.positions(t),
                matrix,
                first: 0,
                more: &[],
                step,
                step_unit: unit,
                scale,
                next: S::rows(other),
            };
            *norms = if pairs == 1 {
                isa.run(Product::<S, W> { matrix, first: pivots, x: step, out });
                isa.run(Judge::<_, S, S, W> { judged, x: step, unit })
            } else {
                isa.run(Product::<W, W> { matrix, first: pivots, x: solution, out });
                isa.run(Judge::<_, W, S, W> { judged, x: solution, unit: 1.0 })
            };
        });
        let norms = self.judge_top::<S, W>(source, group, pairs, unit, scale);
        let Engine { symbolic, shares, .. } = &mut self.engine;
        for (t, share) in shares.iter_mut().enumerate() {
            std::mem::swap(&mut share.slab, &mut share.extra.other);
            S::rows(&mut share.slab)[symbolic.own_rows(t)..].fill(S::Row::default());
        }
        norms
    }

    /// solution := the sum of the steps after the pair of this number.
    fn add_step(&mut self, pairs: u32, unit: f64) {
        let Engine { shares, team, .. } = &mut self.engine;
        team.for_each(shares, |_, share| {
            let Refinement { other, solution, .. } = &mut share.extra;
            for (x, (step, first)) in solution.iter_mut().zip(share.slab.iter().zip(other.iter())) {
                let before = if pairs == 2 { unit * f64::from(*first) } else { *x };
                *x = before + unit * f64::from(*step);
            }
        });
    }

    /// Finishes what [`judge`](Self::judge) began: sums up the threads' shares of the top's rows, adds the top's own
    /// entries. Returns the norms over all rows.
    fn judge_top<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        source: &impl Source,
        group: Group,
        pairs: u32,
        unit: f64,
        scale: f64,
    ) -> Norms {
        let Engine { isa, symbolic, shares, .. } = &mut self.engine;
        let norms = shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms));
        let Some(matrix) = &self.top else { return norms };
        let (first, others) = shares.split_first_mut().expect("at least one thread");
        let step = &*S::rows(&mut first.slab);
        let Refinement { other, solution, partial, .. } = &mut first.extra;
        let (partial, solution) = (W::rows(partial), &*W::rows(solution));
        for share in others {
            accumulate::<W>(partial, W::rows(&mut share.extra.partial));
        }
        let judged = Judged {
            isa: *isa,
            source,
            group,
            positions: symbolic.top_positions(),
            matrix,
            first: symbolic.parts[0].pivots(),
            more: partial,
            step,
            step_unit: unit,
            scale,
            next: S::rows(other),
        };
        norms.join(&if pairs == 1 {
            isa.run(Judge::<_, S, S, W> { judged, x: step, unit })
        } else {
            isa.run(Judge::<_, W, S, W> { judged, x: solution, unit: 1.0 })
        })
    }

    /// Stores the solution after the pair of this number. Returns whether it is finite, and the norms of solution and step.
    fn store<S: Shape<T = f32>, W: Shape<T = f64>>(
        &mut self,
        pairs: u32,
        unit: f64,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> (bool, Norms) {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let work = &*S::rows(&mut share.slab);
            let Refinement { other, solution, norms, .. } = &mut share.extra;
            let (other, solution) = (&*S::rows(other), &*W::rows(solution));
            let mut sums = [W::Row::default(); CHUNK];
            *norms = Norms::default();
            let mut put = |positions: Range<usize>, first: usize| {
                let mut finite = true;
                for from in positions.clone().step_by(CHUNK) {
                    let own = from..positions.end.min(from + CHUNK);
                    let first = first + (from - positions.start);
                    let sums = &mut sums[..own.len()];
                    isa.run(Sum::<S, W> { first, work, unit, pairs, other, solution, sums, norms });
                    // SAFETY: `rows` names every row at most once, and every thread stores other positions.
                    finite &= isa.run(unsafe { Scatter::<W>::new(&rows[own.start..], x, group, 1.0, sums) });
                }
                finite
            };
            share.seen.finite = put(symbolic.positions(t), 0)
                && (t > 0 || put(symbolic.top_positions(), symbolic.parts[0].pivots()));
        });
        let norms = shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms));
        (shares.iter().all(|share| share.seen.finite), norms)
    }
}

impl Symbolic {
    /// Rows of the slab of thread `t` that are not copies of another's: its pivots, for thread 0 also the top.
    fn own_rows(&self, t: usize) -> usize {
        if t == 0 { self.parts[0].slab as usize } else { self.parts[t].pivots() }
    }
}
