//! How a factored matrix answers a right-hand side: by one sweep pair, or by refined ones.
use super::engine::{Engine, groups, power_of_two};
use super::gather::{Group, Output, Source};
use super::panels::Reach;
use super::symbolic::Symbolic;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::Isa;
use crate::lanes::Lanes;
use crate::registry::Precision;
use crate::sparse::SymmetricCsr;
use crate::team::Team;
use std::sync::Arc;

/// What a method is made from.
pub struct Plan<'a> {
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Structure of the factor.
    pub symbolic: Symbolic,
    /// The matrix it was made for (its pattern counts).
    pub matrix: &'a SymmetricCsr,
    /// The most columns of a solve.
    pub max_columns: usize,
    /// Name of the ordering.
    pub ordering: &'static str,
}

impl Plan<'_> {
    /// Numbers per row of the slabs: one register of four columns, or of eight.
    pub fn lanes(&self) -> usize {
        if self.max_columns > 4 { 8 } else { 4 }
    }
}

/// A factored matrix and a way to solve with it.
pub trait Method: Send + Sized + 'static {
    /// Its class, and so the accuracy that it promises.
    const PRECISION: Precision;

    /// Allocates everything; nothing is factored yet.
    ///
    /// # Errors
    /// Where threads or memory cannot be had.
    fn new(plan: Plan<'_>) -> Result<Self, PrepareError>;

    /// Numeric factorisation.
    ///
    /// # Errors
    /// As [`crate::backend::Factor::update_values`], with rows of the matrix.
    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError>;

    /// Once, after the first factorisation of `matrix` with these values: finds out what its condition asks for.
    fn judge(&mut self, _matrix: &SymmetricCsr, _values: &[f64]) {}

    /// Columns that [`group`](Self::group) can take.
    fn widest(&self) -> usize;

    /// Row eliminated k-th.
    fn order(&self) -> Arc<[u32]>;

    /// Solves for some columns of `source`; position p of the elimination order goes to row `rows[p]` of `x`.
    fn group(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, group: Group) -> Answer;

    /// Solves for k columns, group by group.
    fn solve(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, k: usize) -> Answer {
        let mut all = Answer { finite: true, pairs: None };
        for group in groups(k, self.widest()) {
            let answer = self.group(source, rows, x, group);
            all = Answer { finite: all.finite && answer.finite, pairs: all.pairs.max(answer.pairs) };
        }
        all
    }

    /// Bytes held and moved.
    fn footprint(&self) -> Footprint;

    /// The panels that a right-hand side with these non-zero positions reaches in the forward sweep.
    fn reach(&self, positions: impl Iterator<Item = u32>) -> Reach;

    /// The threads of a frame and their instruction set, for what is done to a solution afterwards.
    fn team(&mut self) -> (&mut Team, Isa);
}

/// How a solve went.
#[derive(Clone, Copy)]
pub struct Answer {
    /// Whether the solution is finite.
    pub finite: bool,
    /// Sweep pairs, where there was a choice.
    pub pairs: Option<u32>,
}

/// One sweep pair in the factor's own numbers.
pub struct Single<T> {
    engine: Engine<T, ()>,
}

impl<T: Lanes> Method for Single<T> {
    const PRECISION: Precision = if size_of::<T>() == 8 { Precision::F64 } else { Precision::F32 };

    fn new(plan: Plan<'_>) -> Result<Self, PrepareError> {
        let lanes = plan.lanes();
        Ok(Self { engine: Engine::new(plan.isa, plan.symbolic, lanes, plan.ordering, |_| ())? })
    }

    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        self.engine.factorise(values)
    }

    fn widest(&self) -> usize {
        self.engine.widest()
    }

    fn order(&self) -> Arc<[u32]> {
        Arc::clone(&self.engine.symbolic.order)
    }

    fn group(&mut self, source: &impl Source, rows: &[u32], x: &Output<'_>, group: Group) -> Answer {
        let mut frame = |scale| {
            if group.count > 4 {
                self.engine.frame::<T::Eight>(source, scale, rows, x, group)
            } else {
                self.engine.frame::<T::Four>(source, scale, rows, x, group)
            }
        };
        let mut seen = frame(1.0);
        if seen.largest != 0.0 && !T::COMFORTABLE.contains(&seen.largest) {
            seen = frame(1.0 / power_of_two(seen.largest));
        }
        Answer { finite: seen.finite, pairs: None }
    }

    fn footprint(&self) -> Footprint {
        self.engine.footprint()
    }

    fn reach(&self, positions: impl Iterator<Item = u32>) -> Reach {
        self.engine.reach(positions)
    }

    fn team(&mut self) -> (&mut Team, Isa) {
        (&mut self.engine.team, self.engine.isa)
    }
}
