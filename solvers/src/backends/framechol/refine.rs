//! `mixed`: a factor stored in f32, refined with residuals in f64 (J. H. Wilkinson, "Rounding Errors in Algebraic
//! Processes", 1963, section 3.4).
//!
//! Every pair of sweeps solves for the residual of the last one, so each gains the digits of the first: about five. The
//! residual is kept, not recomputed: r -= A d with the step d exact in f64, which costs one product and no copy of b.
use super::engine::{Engine, groups, power_of_two, store};
use super::gather::{Group, Output, Source};
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

/// Most sweep pairs of a solve.
const MOST_PAIRS: u32 = 4;
/// Backward error at which refinement stops, where the class promises 5e-12. It is counted in the largest diagonal entry of
/// A; for a Laplacian the norm is twice that or more, so the true one is at most half as large.
const ENOUGH: f64 = 4e-12;
/// Relative size that the error after the last pair may have, estimated as the last step times the contraction seen: a
/// quarter of what the class promises (2e-9).
const SMALL: f64 = 5e-10;

/// What a thread keeps for the refinement.
pub struct Refinement {
    residual: Aligned<f64>,
    solution: Aligned<f64>,
    matrix: Triangle,
    norms: Norms,
}

/// The solver with refinement.
pub struct Refined {
    engine: Engine<f32, Refinement>,
    top: Option<Triangle>,
    /// The largest diagonal entry of A: a lower bound of its norm.
    norm: f64,
}

/// The matrix entries of one part, the diagonal and later rows, by pivots in local numbers.
struct Triangle {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Where each value is found in the matrix.
    source: Vec<u32>,
}

impl Triangle {
    fn new(symbolic: &Symbolic, part: usize, matrix: &SymmetricCsr, position: &[u32]) -> Self {
        let own = &symbolic.parts[part];
        let first = own.first_position as usize;
        let top = symbolic.top_positions().start as u32;
        let local = |k: u32| {
            if part < symbolic.threads() && k >= top {
                k - top + own.pivots() as u32
            } else {
                k - own.first_position + own.first_local
            }
        };
        // Entry (a, b) with a < b belongs to the row eliminated at a: found from either side of the stored triangle.
        let range = first as u32..(first + own.pivots()) as u32;
        let visit = |each: &mut dyn FnMut(usize, u32, u32)| {
            for i in 0..matrix.n() {
                for entry in matrix.row_range(i) {
                    let (a, b) = (position[i], position[matrix.columns()[entry] as usize]);
                    if range.contains(&a.min(b)) {
                        each(a.min(b) as usize - first, local(a.max(b)), entry as u32);
                    }
                }
            }
        };
        let mut starts = vec![0_u32; own.pivots() + 1];
        visit(&mut |row, _, _| starts[row + 1] += 1);
        for row in 0..own.pivots() {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); starts[own.pivots()] as usize];
        visit(&mut |row, column, entry| {
            entries[next[row] as usize] = (column, entry);
            next[row] += 1;
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
        (4 * self.starts.len() + 16 * self.columns.len()) as u64
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
}

/// The larger of the two; a NaN is larger than anything.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

fn largest(lanes: &[f64; 8]) -> f64 {
    lanes.iter().copied().fold(0.0, larger)
}

impl Method for Refined {
    fn new(plan: Plan<'_>) -> Result<Self, PrepareError> {
        let lanes = plan.lanes();
        let position = inverse(&plan.symbolic.order);
        let triangle = |p: usize| Triangle::new(&plan.symbolic, p, plan.matrix, &position);
        let threads = plan.symbolic.threads();
        let mut triangles: Vec<Triangle> = (0..plan.symbolic.parts.len()).map(triangle).collect();
        let top = (triangles.len() > threads).then(|| triangles.pop()).flatten();
        let mut triangles = triangles.into_iter();
        let extra = |part: &Part| Refinement {
            residual: Aligned::new(lanes * part.slab as usize),
            solution: Aligned::new(lanes * part.slab as usize),
            matrix: triangles.next().expect("one triangle per thread"),
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
        let extras = self.engine.shares.iter().map(|s| &s.extra);
        let vectors: u64 = extras.clone().map(|e| 8 * (e.residual.len() + e.solution.len()) as u64).sum();
        let matrix: u64 = extras.map(|e| &e.matrix).chain(&self.top).map(Triangle::bytes).sum();
        footprint.host_bytes = footprint.host_bytes.map(|bytes| bytes + vectors + matrix);
        // Two pairs, and the matrix once after each.
        footprint.bytes_per_solve = footprint.bytes_per_solve.map(|bytes| 2 * (bytes + matrix));
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
        let right_hand_side = self.start::<W>(source, group);
        let mut residual = right_hand_side;
        let (mut pairs, mut last_step) = (0, 0.0);
        // Later pairs work on dense residuals.
        while residual > 0.0 && residual < f64::INFINITY && pairs < MOST_PAIRS {
            let sparse = pairs == 0;
            let scale = 1.0 / power_of_two(residual);
            self.pair::<S, W>(source, sparse, scale);
            let norms = self.finish_top::<S, W>(scale);
            pairs += 1;
            residual = largest(&norms.residual);
            let (step, solution) = (largest(&norms.step), largest(&norms.solution));
            let backward = residual / (self.norm * solution + right_hand_side);
            let contraction = if pairs == 1 { 1.0 } else { step / last_step };
            last_step = step;
            if pairs >= 2 && backward <= ENOUGH && contraction * step <= SMALL * solution {
                break;
            }
        }
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let (part, solution) = (&symbolic.parts[t], W::rows(&mut share.extra.solution));
            // SAFETY: `rows` names every row at most once.
            share.seen.finite = unsafe { store::<W>(*isa, symbolic, t, part, solution, rows, x, group, 1.0) };
        });
        (shares.iter().all(|share| share.seen.finite) && residual.is_finite(), pairs)
    }

    /// residual := b, solution := 0. Returns max |b|.
    fn start<W: Shape<T = f64>>(&mut self, source: &impl Source, group: Group) -> f64 {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let part = &symbolic.parts[t];
            let residual = &mut W::rows(&mut share.extra.residual)[..part.slab as usize];
            let (pivots, top) = residual.split_at_mut(part.pivots());
            let mut largest = source.load::<W>(*isa, symbolic.positions(t), group, 1.0, pivots);
            if t == 0 {
                largest = largest.max(source.load::<W>(*isa, symbolic.top_positions(), group, 1.0, top));
            } else {
                top.fill(W::Row::default());
            }
            share.seen.largest = largest;
            W::rows(&mut share.extra.solution)[..part.slab as usize].fill(W::Row::default());
        });
        shares.iter().fold(0.0, |most, share| share.seen.largest.max(most))
    }

    /// One sweep pair on `scale` times the residual, rounded. `sparse`: the right-hand side is still the source's.
    fn pair<S: Shape<T = f32>, W: Shape<T = f64>>(&mut self, source: &impl Source, sparse: bool, scale: f64) {
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        let active = |part: usize| if sparse { source.active(part) } else { None };
        team.for_each(shares, |t, share| {
            let part = &symbolic.parts[t];
            let work = S::rows(&mut share.slab);
            let residual = &W::rows(&mut share.extra.residual)[..part.slab as usize];
            isa.run(Round::<S, W> { residual, scale, work });
            isa.run(Forward::<S> { panels: &share.panels, active: active(t), work });
        });
        let threads = shares.len();
        self.engine.sweep_top::<S>(active(threads));
        let scale = self.engine.scale / scale;
        let Engine { isa, symbolic, shares, team, .. } = &mut self.engine;
        team.for_each(shares, |t, share| {
            let (part, work) = (&symbolic.parts[t], S::rows(&mut share.slab));
            isa.run(Backward::<S> { panels: &share.panels, work });
            let Refinement { residual, solution, matrix, norms } = &mut share.extra;
            let (residual, solution) = (W::rows(residual), W::rows(solution));
            *norms = isa.run(Advance::<S, W> {
                matrix,
                first: part.first_local as usize,
                work,
                scale,
                residual,
                solution,
            });
        });
    }

    /// Finishes what [`pair`](Self::pair) began: sums up the threads' shares of the top's residual, subtracts the top's own
    /// entries. Returns the norms over all rows.
    fn finish_top<S: Shape<T = f32>, W: Shape<T = f64>>(&mut self, scale: f64) -> Norms {
        let scale = self.engine.scale / scale;
        let Engine { isa, symbolic, shares, .. } = &mut self.engine;
        let norms = shares.iter().fold(Norms::default(), |all, share| all.join(&share.extra.norms));
        let Some(matrix) = &self.top else { return norms };
        let rows = |part: &Part| part.pivots()..part.slab as usize;
        let (first, others) = shares.split_first_mut().expect("at least one thread");
        let Refinement { residual, solution, .. } = &mut first.extra;
        let (residual, solution) = (W::rows(residual), W::rows(solution));
        for (share, part) in others.iter_mut().zip(&symbolic.parts[1..]) {
            let part_of_top = &mut W::rows(&mut share.extra.residual)[rows(part)];
            accumulate::<W>(&mut residual[rows(&symbolic.parts[0])], part_of_top);
            part_of_top.fill(W::Row::default());
        }
        let (first, work) = (symbolic.parts[0].pivots(), S::rows(&mut first.slab));
        norms.join(&isa.run(Advance::<S, W> { matrix, first, work, scale, residual, solution }))
    }
}

/// work := scale * residual, rounded.
struct Round<'a, S: Shape, W: Shape> {
    residual: &'a [W::Row],
    scale: f64,
    work: &'a mut [S::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Round<'_, S, W> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for (work, residual) in self.work.iter_mut().zip(self.residual) {
            for c in 0..S::K {
                work.as_mut()[c] = f32::from_f64(residual.as_ref()[c] * self.scale);
            }
        }
    }
}

/// solution += d, residual -= A d for the entries of one part, with d = scale * work. Returns the norms of its pivots.
///
/// Per entry: 12 bytes of matrix, two multiply-adds of K lanes.
struct Advance<'a, S: Shape, W: Shape> {
    matrix: &'a Triangle,
    /// Local number of the first pivot.
    first: usize,
    work: &'a [S::Row],
    scale: f64,
    residual: &'a mut [W::Row],
    solution: &'a mut [W::Row],
}

impl<S: Shape<T = f32>, W: Shape<T = f64>> Kernel for Advance<'_, S, W> {
    type Output = Norms;

    #[inline(always)]
    fn run<F: Features>(self) -> Norms {
        let Self { matrix, first, work, scale, residual, solution } = self;
        let mut most = [W::Row::default(); 3];
        for (i, range) in matrix.starts.windows(2).enumerate() {
            let range = range[0] as usize..range[1] as usize;
            let own = widen::<S, W>(&work[first + i], scale);
            let step = W::Vector::<F>::load(&own);
            let mut sum = W::Vector::<F>::load(&residual[first + i]);
            let (columns, values) = (&matrix.columns[range.clone()], &matrix.values[range]);
            // The diagonal comes first.
            sum = sum.sub_scaled(values[0], step);
            for (&column, &value) in columns[1..].iter().zip(&values[1..]) {
                let other = widen::<S, W>(&work[column as usize], scale);
                sum = sum.sub_scaled(value, W::Vector::<F>::load(&other));
                let row = &mut residual[column as usize];
                W::Vector::<F>::load(row).sub_scaled(value, step).store(row);
            }
            sum.store(&mut residual[first + i]);
            let row = &mut solution[first + i];
            W::Vector::<F>::load(row).add(step).store(row);
            keep_largest::<W>(&mut most[0], &residual[first + i]);
            keep_largest::<W>(&mut most[1], &solution[first + i]);
            keep_largest::<W>(&mut most[2], &own);
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

/// most := max(most, |row|) in every lane: one instruction each. A NaN is passed over; the store of the solution sees it.
#[inline(always)]
fn keep_largest<W: Shape<T = f64>>(most: &mut W::Row, row: &W::Row) {
    for (most, value) in most.as_mut().iter_mut().zip(row.as_ref()) {
        let size = value.abs();
        *most = if size > *most { size } else { *most };
    }
}

/// scale * row in f64.
#[inline(always)]
fn widen<S: Shape<T = f32>, W: Shape<T = f64>>(row: &S::Row, scale: f64) -> W::Row {
    let mut out = W::Row::default();
    for c in 0..S::K {
        out.as_mut()[c] = row.as_ref()[c].to_f64() * scale;
    }
    out
}
