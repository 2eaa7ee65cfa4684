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
use super::sweep::{Backward, Forward, accumulate};
use super::symbolic::{Part, Symbolic};
use crate::aligned::Aligned;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::{Features, Isa, Kernel, Real};
use crate::lanes::{F32x4, F32x8, F64x4, F64x8, Shape, Vector};
use crate::ordering::inverse;
use crate::sparse::SymmetricCsr;
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

/// Rows of the matrix in local numbers. A thread has the rows of its pivots, and of the rows of the top the entries in
/// its pivots' columns; the top has its own block.
struct Rows {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Where each value is found in the matrix.
    source: Vec<u32>,
}

impl Rows {
    fn new(symbolic: &Symbolic, part: usize, matrix: &SymmetricCsr, position: &[u32]) -> Self {
        let own = &symbolic.parts[part];
        let first = own.first_position;
        let top = symbolic.top_positions().start as u32;
        let is_top = part == symbolic.threads();
        // By local number, counted from the part's first.
        let local = |k: u32| if !is_top && k >= top { k - top + own.pivots() as u32 } else { k - first };
        let rows = if is_top { own.pivots() } else { own.slab as usize };
        // Entry (a, b) with a < b belongs to the part of a: found from either side of the stored triangle.
        let range = first..first + own.pivots() as u32;
        let visit = |each: &mut dyn FnMut(u32, u32, u32)| {
            for i in 0..matrix.n() {
                for entry in matrix.row_range(i) {
                    let (a, b) = (position[i], position[matrix.columns()[entry] as usize]);
                    let (a, b) = (a.min(b), a.max(b));
                    if range.contains(&a) {
                        each(local(a), local(b), entry as u32);
                        if a != b {
                            each(local(b), local(a), entry as u32);
                        }
                    }
                }
            }
        };
        let mut starts = vec![0_u32; rows + 1];
        visit(&mut |row, _, _| starts[row as usize + 1] += 1);
        for row in 0..rows {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); starts[rows] as usize];
        visit(&mut |row, column, entry| {
            entries[next[row as usize] as usize] = (column + own.first_local, entry);
            next[row as usize] += 1;
        });
        for row in starts.windows(2) {
            entries[row[0] as usize..row[1] as usize].sort_unstable();
        }
        let (columns, source): (Vec<u32>, Vec<u32>) = entries.into_iter().unzip();
        Self { values: vec![0.0; columns.len()], starts, columns, source }
    }

    fn update(&mut self, values: &[f64]) {
        for (value, &source) in self.values.iter_mut().zip(&self.source) {
            *value = values[source as usize];
        }
    }

    fn bytes(&self) -> u64 {
        self.bytes_read() + size_of_val(&self.source[..]) as u64
    }

    /// Bytes of one product.
    fn bytes_read(&self) -> u64 {
        (size_of_val(&self.starts[..]) + size_of_val(&self.columns[..]) + size_of_val(&self.values[..]))
            as u64
    }

    /// Row `i` of the matrix times `work`. Per entry: 12 bytes of matrix, a row of `work`, one multiply-add of K lanes.
    #[inline(always)]
    fn product<F: Features, S: Shape<T = f32>, W: Shape<T = f64>>(
        &self,
        i: usize,
        work: &[S::Row],
    ) -> W::Vector<F> {
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        let mut sum = W::Vector::<F>::zero();
        for (&column, &value) in self.columns[range.clone()].iter().zip(&self.values[range]) {
            let row = widen::<S, W>(&work[column as usize]);
            sum = sum.add_scaled(value, W::Vector::<F>::load(&row));
        }
        sum
    }
}

/// Largest absolute values, lane by lane.
#[derive(Clone, Copy, Default)]
struct Norms {
    residual: [f64; 8],
    solution: [f64; 8],
    step: [f64; 8],
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

/// work := scale * residual, rounded; most := max(most, |residual|).
struct Round<'a, S: Shape, W: Shape> {
    residual: &'a [W::Row],
    scale: f64,
    work: &'a mut [S::Row],
    most: &'a mut W::Row,
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Round<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let mut most = *self.most; // in a register
        for (work, residual) in self.work.iter_mut().zip(self.residual) {
            *work = narrow::<S, W>(residual, self.scale);
            keep_largest::<W>(&mut most, residual);
        }
        *self.most = most;
    }
}

/// out := the rows of the matrix from `first` on, times work.
struct Product<'a, S: Shape, W: Shape> {
    matrix: &'a Rows,
    first: usize,
    work: &'a [S::Row],
    out: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Product<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (i, out) in self.out.iter_mut().enumerate() {
            self.matrix.product::<F, S, W>(self.first + i, self.work).store(out);
        }
    }
}

/// The norms of residual - A d, x + d and d, with d = unit * work and x the sum of the steps before; with `keep` these are
/// stored, and the residual times it becomes `other`.
///
/// Per row of K columns: [`Rows::product`]; 8 K bytes of residual and 4 K of each step read, with `keep` 12 K written.
struct Judge<'a, S: Shape, W: Shape> {
    matrix: &'a Rows,
    /// Local numbers of the matrix's first rows.
    rows: Range<usize>,
    /// What others add to A work, row by row; or nothing.
    more: &'a [W::Row],
    work: &'a [S::Row],
    unit: f64,
    pairs: u32,
    keep: Option<f64>,
    residual: &'a mut [W::Row],
    other: &'a mut [S::Row],
    solution: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Judge<'_, S, W> {
    type Output = Norms;

    #[inline(always)]
    fn run<F: Features>(self) -> Norms {
        let Self { matrix, rows, more, work, unit, pairs, keep, residual, other, solution } = self;
        let mut most = [W::Row::default(); 3];
        for (i, row) in rows.enumerate() {
            let mut product = matrix.product::<F, S, W>(i, work);
            if let Some(more) = more.get(i) {
                product = product.add(W::Vector::<F>::load(more));
            }
            let (mut left, mut step, mut sum) = (W::Row::default(), W::Row::default(), W::Row::default());
            W::Vector::<F>::load(&residual[row]).sub_scaled(unit, product).store(&mut left);
            let last = scaled::<F, S, W>(&work[row], unit);
            last.store(&mut step);
            before::<F, S, W>(pairs, row, other, unit, solution).add(last).store(&mut sum);
            keep_largest::<W>(&mut most[0], &left);
            keep_largest::<W>(&mut most[1], &sum);
            keep_largest::<W>(&mut most[2], &step);
            if let Some(scale) = keep {
                residual[row] = left;
                other[row] = narrow::<S, W>(&left, scale);
                if pairs > 1 {
                    solution[row] = sum;
                }
            }
        }
        let mut norms = Norms::default();
        for c in 0..W::K {
            norms.residual[c] = most[0].as_ref()[c];
            norms.solution[c] = most[1].as_ref()[c];
            norms.step[c] = most[2].as_ref()[c];
        }
        norms
    }
}

/// sums\[i\] := the solution in local row first + i after the pair of this number.
struct Sum<'a, S: Shape, W: Shape> {
    first: usize,
    work: &'a [S::Row],
    unit: f64,
    pairs: u32,
    other: &'a [S::Row],
    solution: &'a [W::Row],
    sums: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Sum<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { first, work, unit, pairs, other, solution, sums } = self;
        for (i, sum) in sums.iter_mut().enumerate() {
            let row = first + i;
            let last = scaled::<F, S, W>(&work[row], unit);
            before::<F, S, W>(pairs, row, other, unit, solution).add(last).store(sum);
        }
    }
}

/// The sum of the steps before the pair of this number.
#[inline(always)]
fn before<F: Features, S: Shape<T = f32>, W: Shape<T = f64>>(
    pairs: u32,
    row: usize,
    other: &[S::Row],
    unit: f64,
    solution: &[W::Row],
) -> W::Vector<F> {
    match pairs {
        1 => W::Vector::<F>::zero(),
        2 => scaled::<F, S, W>(&other[row], unit),
        _ => W::Vector::<F>::load(&solution[row]),
    }
}

/// most := max(most, |row|) in every lane: one instruction each. A NaN is passed over; the store of the solution sees it.
#[inline(always)]
fn keep_largest<W: Shape<T = f64>>(most: &mut W::Row, row: &W::Row) {
    for (most, value) in most.as_mut().iter_mut().zip(row.as_ref()) {
        let size = value.abs();
        *most = if size > *most { size } else { *most };
    }
}

/// unit * row in f64.
#[inline(always)]
fn scaled<F: Features, S: Shape<T = f32>, W: Shape<T = f64>>(row: &S::Row, unit: f64) -> W::Vector<F> {
    W::Vector::<F>::zero().add_scaled(unit, W::Vector::<F>::load(&widen::<S, W>(row)))
}

/// The row in f64.
#[inline(always)]
fn widen<S: Shape<T = f32>, W: Shape<T = f64>>(row: &S::Row) -> W::Row {
    let mut out = W::Row::default();
    for c in 0..S::K {
        out.as_mut()[c] = row.as_ref()[c].to_f64();
    }
    out
}

/// scale * row, rounded.
#[inline(always)]
fn narrow<S: Shape<T = f32>, W: Shape<T = f64>>(row: &W::Row, scale: f64) -> S::Row {
    let mut out = S::Row::default();
    for c in 0..S::K {
        out.as_mut()[c] = f32::from_f64(row.as_ref()[c] * scale);
    }
    out
}
