//! `framechol-f64` and `framechol-mixed` on ill-conditioned systems: one more step of refinement, with a residual in twice
//! the precision.
//!
//! A backward stable solve loses digits in proportion to Skeel's condition number || |A^-1| |A| || (R. D. Skeel, "Scaling for
//! numerical stability in Gaussian elimination", J. ACM 26, 1979). Slivers make it large: clusters of stiff rows that hang on
//! weak ones. A residual in f64 would not help, it has the same rounding errors; in twice the precision one step gives all
//! digits back (N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., section 12.1).
//!
//! Whether a system needs that is found out once, when it is prepared; one that does not pays nothing in a frame.
use super::gather::{Dense, Group, Output, Scatter, Source};
use super::method::{Answer, Method, Plan};
use super::panels::Reach;
use crate::backend::Footprint;
use crate::columns::Columns;
use crate::error::PrepareError;
use crate::isa::{Features, Isa, Kernel};
use crate::lanes::{F64x4, F64x8, Shape};
use crate::limits::Limits;
use crate::registry::{Accuracy, Precision};
use crate::residual::{two_product, two_sum};
use crate::sparse::SymmetricCsr;
use crate::team::Team;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Part of the promised forward error that a trial solve may have; from there on every solve is refined. The bound by the
/// condition number is far above most errors (a thousand times on well-shaped meshes of 300 thousand triangles), so where it
/// does not suffice the error is measured.
const TOLERATED: f64 = 0.1;

/// A method, or that and a step of refinement where the system asks for it.
pub struct Careful<M> {
    single: M,
    refinement: Option<Refinement>,
}

impl<M: Method> Method for Careful<M> {
    const PRECISION: Precision = M::PRECISION;

    fn new(plan: Plan<'_>) -> Result<Self, PrepareError> {
        Ok(Self { single: M::new(plan)?, refinement: None })
    }

    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        self.single.factorise(values)?;
        if let Some(refinement) = &mut self.refinement {
            refinement.update(values);
        }
        Ok(())
    }

    /// The condition number of a matrix without positive entries off its diagonal, and nearly so that of any Laplacian, is
    /// the largest entry of A^-1 (2 diag A): one solve. Where it is large, that solve is the trial.
    fn judge(&mut self, matrix: &SymmetricCsr, values: &[f64]) {
        let n = matrix.n();
        let order = self.single.order();
        let diagonal: Vec<f64> =
            matrix.row_starts()[..n].iter().map(|&at| 2.0 * values[at as usize]).collect();
        let source = Dense { order: &order, block: Columns::new(&diagonal, n, 1) };
        let (mut once, mut refined) = (vec![0.0; n], vec![0.0; n]);
        self.single.solve(&source, &order, &Output::new(&mut Columns::new(&mut once, n, 1)), 1);
        let condition = largest(once.iter().copied());
        let promised = Limits::of(M::PRECISION, Accuracy::Direct, 0.0).poisson;
        // Condition numbers up to this one cannot break the promise.
        if condition <= promised / f64::EPSILON {
            return;
        }
        self.refinement = Some(Refinement::new(matrix, values, &order, self.single.widest()));
        self.solve(&source, &order, &Output::new(&mut Columns::new(&mut refined, n, 1)), 1);
        let error = largest(once.iter().zip(&refined).map(|(a, b)| a - b));
        if error <= TOLERATED * promised * condition {
            self.refinement = None;
        }
    }

    fn widest(&self) -> usize {
        self.single.widest()
    }

    fn order(&self) -> Arc<[u32]> {
        self.single.order()
    }

    fn group(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, group: Group) -> Answer {
        let Self { single, refinement: Some(refinement) } = self else {
            return self.single.group(source, rows, x, group);
        };
        if group.count > 4 {
            refinement.solve::<F64x8>(single, source, rows, x, group)
        } else {
            refinement.solve::<F64x4>(single, source, rows, x, group)
        }
    }

    fn footprint(&self) -> Footprint {
        let mut footprint = self.single.footprint();
        if let Some(refinement) = &self.refinement {
            footprint.host_bytes = footprint.host_bytes.map(|bytes| bytes + refinement.bytes());
            footprint.bytes_per_solve =
                footprint.bytes_per_solve.map(|bytes| 2 * bytes + refinement.bytes_read());
        }
        footprint
    }

    fn reach(&self, positions: impl Iterator<Item = u32>) -> Reach {
        self.single.reach(positions)
    }

    fn team(&mut self) -> (&mut Team, Isa) {
        self.single.team()
    }
}

/// The largest absolute value; NaN where there is one.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |most, v| if v.abs() <= most { most } else { v.abs() })
}

/// What a refined solve needs, all in elimination order. Vectors have one row of K numbers per position, K = 4 or 8.
struct Refinement {
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Where each value is found in the matrix.
    source: Vec<u32>,
    /// 0, 1, 2, ...: the elimination order in itself.
    identity: Vec<u32>,
    /// b, then b - A x.
    residual: Vec<f64>,
    solution: Vec<f64>,
    step: Vec<f64>,
}

impl Refinement {
    fn new(matrix: &SymmetricCsr, values: &[f64], order: &[u32], lanes: usize) -> Self {
        let (permuted, stored) = matrix.permuted(order);
        let rows = permuted.full_pattern();
        let n = order.len();
        let mut new = Self {
            source: rows.source.iter().map(|&at| stored[at as usize]).collect(),
            values: vec![0.0; rows.columns.len()],
            starts: rows.starts,
            columns: rows.columns,
            identity: (0..n as u32).collect(),
            residual: vec![0.0; n * lanes],
            solution: vec![0.0; n * lanes],
            step: vec![0.0; n * lanes],
        };
        new.update(values);
        new
    }

    fn update(&mut self, values: &[f64]) {
        for (value, &source) in self.values.iter_mut().zip(&self.source) {
            *value = values[source as usize];
        }
    }

    fn bytes(&self) -> u64 {
        let vectors = self.residual.len() + self.solution.len() + self.step.len();
        self.bytes_read() + (4 * (self.source.len() + self.identity.len()) + 8 * vectors) as u64
    }

    /// Bytes of the matrix.
    fn bytes_read(&self) -> u64 {
        (4 * (self.starts.len() + self.columns.len()) + 8 * self.values.len()) as u64
    }

    /// x := A^-1 b, then x += A^-1 (b - A x).
    fn solve<S: Shape<T = f64>>(
        &mut self,
        single: &mut impl Method,
        source: &impl Source,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> Answer {
        let Self { starts, columns, values, identity, residual, solution, step, .. } = self;
        let n = identity.len();
        let own = Group { from: 0, count: group.count };
        // Lanes without a column must stay finite.
        [&mut *solution, &mut *step].into_iter().for_each(|block| block.fill(0.0));
        let first =
            single.group(&Shifted { source, by: group.from }, identity, &Output::rows(solution, S::K), own);
        let (team, isa) = single.team();
        let (starts, columns, values) = (&starts[..], &columns[..], &values[..]);
        let rest = &mut S::rows(residual)[..n];
        source.load::<S>(isa, 0..n, group, 1.0, rest);
        let at = &S::rows(solution)[..n];
        team.for_each_run(rest, 1, |range, rest| {
            isa.run(Subtract::<S> { starts, columns, values, first: range.start, x: at, rest });
        });
        let dense = Dense { order: identity, block: Columns::new(&residual[..n * S::K], n, S::K) };
        let second = single.group(&dense, identity, &Output::rows(step, S::K), own);
        let (team, isa) = single.team();
        let steps = &S::rows(step)[..n];
        let finite = AtomicBool::new(true);
        team.for_each_run(&mut S::rows(solution)[..n], 1, |range, sums| {
            for (sum, step) in sums.iter_mut().zip(&steps[range.clone()]) {
                sum.as_mut().iter_mut().zip(step.as_ref()).for_each(|(x, d)| *x += d);
            }
            // SAFETY: `rows` names every row at most once, and every thread stores other positions.
            if !isa.run(unsafe { Scatter::<S>::new(&rows[range], x, group, 1.0, sums) }) {
                finite.store(false, Relaxed);
            }
        });
        let pairs = first.pairs.zip(second.pairs).map(|(a, b)| a + b);
        Answer { finite: finite.into_inner(), pairs }
    }
}

/// Columns from `by` on as columns from 0 on.
struct Shifted<'a, R> {
    source: &'a R,
    by: usize,
}

impl<R: Source> Source for Shifted<'_, R> {
    fn load<S: Shape>(
        &self,
        isa: Isa,
        range: Range<usize>,
        group: Group,
        scale: f64,
        work: &mut [S::Row],
    ) -> [f64; 8] {
        self.source.load::<S>(isa, range, Group { from: self.by + group.from, ..group }, scale, work)
    }

    fn active(&self, part: usize) -> Option<&[u32]> {
        self.source.active(part)
    }
}

/// rest -= A x for the rows from `first` on, each number rounded once from a sum in twice the precision.
struct Subtract<'a, S: Shape> {
    starts: &'a [u32],
    columns: &'a [u32],
    values: &'a [f64],
    first: usize,
    x: &'a [S::Row],
    rest: &'a mut [S::Row],
}

impl<S: Shape<T = f64>> Kernel for Subtract<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { starts, columns, values, first, x, rest } = self;
        for (row, rest) in (first..).zip(rest) {
            let (mut high, mut low) = (*rest, S::Row::default());
            let range = starts[row] as usize..starts[row + 1] as usize;
            for (&j, &a) in columns[range.clone()].iter().zip(&values[range]) {
                let x = x[j as usize].as_ref();
                let (high, low) = (high.as_mut(), low.as_mut());
                for c in 0..S::K {
                    let product = -a * x[c];
                    let rounding =
                        if F::FMA { (-a).mul_add(x[c], -product) } else { two_product(-a, x[c]).1 };
                    let (sum, carry) = two_sum(high[c], product);
                    high[c] = sum;
                    low[c] += carry + rounding;
                }
            }
            rest.as_mut()
                .iter_mut()
                .zip(high.as_ref().iter().zip(low.as_ref()))
                .for_each(|(r, (h, l))| *r = h + l);
        }
    }
}
