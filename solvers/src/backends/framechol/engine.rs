//! The factor with its threads: who factors what, and the order of events in a frame.
//!
//! ```text
//! thread 0:  load, forward own subtrees |  sum up, top forward,  | backward own subtrees, store
//! thread 1:  load, forward own subtrees |  top backward, spread  | backward own subtrees, store
//!                                    (thread 0 alone)
//! ```
use super::gather::{Group, Output, Scatter, Source};
use super::numeric::{Breakdown, FactorPart, Workspace};
use super::panels::Panels;
use super::sweep::{Backward, Forward, accumulate};
use super::symbolic::{Part, Symbolic};
use crate::aligned::Aligned;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::Isa;
use crate::lanes::{Lanes, Shape};
use crate::team::Team;
use std::ops::Range;

/// What one thread owns. `E`: what a method keeps besides.
pub struct Share<T, E> {
    /// The thread's subtrees of the factor.
    pub panels: Panels<T>,
    work: Workspace,
    /// Vectors by local row: own pivots, then the rows of the top (thread 0: the real ones).
    pub slab: Aligned<T>,
    /// What the last factorisation said.
    outcome: Result<(), Breakdown>,
    /// Whether all that the last frame stored was finite.
    pub finite: bool,
    /// What a method keeps besides.
    pub extra: E,
}

/// The part of the tree above all subtrees.
struct Top<T> {
    panels: Panels<T>,
    work: Workspace,
}

/// A factored matrix that solves frames.
pub struct Engine<T, E> {
    /// Instruction set of all kernels.
    pub isa: Isa,
    /// Structure.
    pub symbolic: Symbolic,
    /// One per thread.
    pub shares: Vec<Share<T, E>>,
    top: Option<Top<T>>,
    /// As many threads as shares.
    pub team: Team,
    name: &'static str,
}

impl<T: Lanes, E: Send> Engine<T, E> {
    /// Room for the factor; nothing is factored yet. `lanes`: numbers per row of the slabs, 4 or 8.
    pub fn new(
        isa: Isa,
        symbolic: Symbolic,
        lanes: usize,
        name: &'static str,
        extra: impl Fn(&Part) -> E,
    ) -> Result<Self, PrepareError> {
        let threads = symbolic.threads();
        let shares = symbolic.parts[..threads].iter().map(|part| Share {
            panels: Panels::new(part),
            work: Workspace::new(part),
            slab: Aligned::new(lanes * part.slab as usize),
            outcome: Ok(()),
            finite: true,
            extra: extra(part),
        });
        let shares = shares.collect();
        let top = symbolic
            .parts
            .get(threads)
            .map(|part| Top { panels: Panels::new(part), work: Workspace::new(part) });
        let team = Team::new(threads).map_err(|error| PrepareError::Unsupported {
            what: format!("{threads} threads: the system refuses to start them ({error})"),
        })?;
        Ok(Self { isa, symbolic, shares, top, team, name })
    }

    /// Numeric factorisation: every thread its subtrees, then the top. `values` by stored entry of the matrix.
    pub fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        let Self { isa, symbolic, shares, top, team, .. } = self;
        let parts = &symbolic.parts;
        team.for_each(shares, |t, share| {
            let Share { work, panels: out, .. } = share;
            share.outcome =
                isa.run(FactorPart { part: &parts[t], values, below: &|_| unreachable!(), work, out });
        });
        let mut outcome = shares.iter().try_for_each(|share| share.outcome);
        if let (Ok(()), Some(top)) = (outcome, top) {
            let below = |t: usize| (&parts[t], &shares[t].work);
            let part = &parts[parts.len() - 1];
            let Top { panels: out, work } = top;
            outcome = isa.run(FactorPart { part, values, below: &below, work, out });
        }
        outcome.map_err(|Breakdown { position, pivot }| {
            let row = symbolic.order[position as usize] as usize;
            if pivot.is_finite() {
                PrepareError::NotPositiveDefinite { row }
            } else {
                PrepareError::NonFinite { row }
            }
        })
    }

    /// A group of columns in one sweep pair: loads from `source`, stores to rows `rows[k]` of `x` for elimination
    /// position k. Returns whether the solution is finite.
    pub fn frame<S: Shape<T = T>>(
        &mut self,
        source: &impl Source,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> bool {
        let Self { isa, symbolic, shares, team, .. } = self;
        team.for_each(shares, |t, share| {
            let (part, work) = (&symbolic.parts[t], S::rows(&mut share.slab));
            let own = symbolic.positions(t);
            let (pivots, top) = work[..part.slab as usize].split_at_mut(part.pivots());
            source.load::<S>(*isa, own, group, pivots);
            if t == 0 {
                source.load::<S>(*isa, symbolic.top_positions(), group, top);
            } else {
                top.fill(S::Row::default());
            }
            isa.run(Forward::<S> { panels: &share.panels, active: source.active(t), work });
        });
        self.sweep_top::<S>(source.active(self.shares.len()));
        let Self { isa, symbolic, shares, team, .. } = self;
        team.for_each(shares, |t, share| {
            let (part, work) = (&symbolic.parts[t], S::rows(&mut share.slab));
            isa.run(Backward::<S> { panels: &share.panels, work });
            let (pivots, top) = work[..part.slab as usize].split_at(part.pivots());
            let own = &rows[symbolic.positions(t)];
            // SAFETY: `rows` names every row once, and the positions of the threads and of the top are disjoint.
            share.finite = isa.run(unsafe { Scatter::<S>::new(own, x, group, pivots) });
            if t == 0 {
                let own = &rows[symbolic.top_positions()];
                // SAFETY: as above.
                share.finite &= isa.run(unsafe { Scatter::<S>::new(own, x, group, top) });
            }
        });
        self.shares.iter().all(|share| share.finite)
    }

    /// Adds the threads' updates of the top rows, sweeps the top both ways and gives every thread the result.
    pub fn sweep_top<S: Shape<T = T>>(&mut self, active: Option<&[u32]>) {
        let Self { isa, symbolic, shares, top: Some(top), .. } = self else { return };
        let (first, others) = shares.split_first_mut().expect("at least one thread");
        let rows = |part: &Part| part.pivots()..part.slab as usize;
        let slab = S::rows(&mut first.slab);
        for (share, part) in others.iter_mut().zip(&symbolic.parts[1..]) {
            accumulate::<S>(&mut slab[rows(&symbolic.parts[0])], &S::rows(&mut share.slab)[rows(part)]);
        }
        isa.run(Forward::<S> { panels: &top.panels, active, work: slab });
        isa.run(Backward::<S> { panels: &top.panels, work: slab });
        for (share, part) in others.iter_mut().zip(&symbolic.parts[1..]) {
            S::rows(&mut share.slab)[rows(part)].copy_from_slice(&slab[rows(&symbolic.parts[0])]);
        }
    }

    /// Columns that one frame can take.
    pub fn widest(&self) -> usize {
        self.shares[0].slab.len() / self.symbolic.parts[0].slab as usize
    }

    /// Bytes held and moved.
    pub fn footprint(&self) -> Footprint {
        let tops = || self.top.iter();
        let panels = || self.shares.iter().map(|s| &s.panels).chain(tops().map(|t| &t.panels));
        let works = || self.shares.iter().map(|s| &s.work).chain(tops().map(|t| &t.work));
        let factor: u64 = panels().map(Panels::bytes).sum();
        let slabs: u64 = self.shares.iter().map(|s| size_of_val(&s.slab[..]) as u64).sum();
        let work: u64 = works().map(Workspace::bytes).sum();
        Footprint {
            host_bytes: Some(factor + slabs + work + self.symbolic.bytes()),
            device_bytes: None,
            factor_nonzeros: Some(self.symbolic.nonzeros),
            factor_bytes: Some(factor),
            bytes_per_solve: Some(panels().map(Panels::bytes_per_solve).sum()),
            factor_flops: Some(self.symbolic.flops),
            ordering: Some(self.name),
        }
    }
}

/// Splits k columns into groups of at most `widest` and runs `frame` on each; false if any of them says so.
pub fn in_groups(k: usize, widest: usize, mut frame: impl FnMut(Group) -> bool) -> bool {
    let groups = (0..k).step_by(widest).map(|from| Group { from, count: widest.min(k - from) });
    groups.fold(true, |good, group| frame(group) && good)
}

impl Symbolic {
    /// Number of threads.
    pub fn threads(&self) -> usize {
        if self.parts.len() == 1 { 1 } else { self.parts.len() - 1 }
    }

    /// Elimination positions of thread `t`.
    pub fn positions(&self, t: usize) -> Range<usize> {
        let first = self.parts[t].first_position as usize;
        first..first + self.parts[t].pivots()
    }

    /// Elimination positions of the top.
    pub fn top_positions(&self) -> Range<usize> {
        match self.parts.get(self.threads()) {
            Some(top) => top.first_position as usize..self.order.len(),
            None => self.order.len()..self.order.len(),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.order[..]) as u64 + self.parts.iter().map(Part::bytes).sum::<u64>()
    }
}
