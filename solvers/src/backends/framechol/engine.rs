//! The factor with its threads: who factors what, and the order of events in a frame.
//!
//! ```text
//! thread 0:  load, forward own subtrees |  sum up, top forward,  | backward own subtrees, store
//! thread 1:  load, forward own subtrees |  top backward, spread  | backward own subtrees, store
//!                                    (thread 0 alone)
//! ```
use super::front::Crew;
use super::gather::{Group, Output, Scatter, Source};
use super::numeric::{Breakdown, FactorPart, Workspace};
use super::panels::{Panels, Reach};
use super::sweep::{Backward, Forward, accumulate};
use super::symbolic::{Part, Symbolic};
use crate::aligned::Aligned;
use crate::backend::Footprint;
use crate::error::PrepareError;
use crate::isa::Isa;
use crate::lanes::{Lanes, Shape};
use crate::team::Team;
use std::ops::Range;

/// What went through a frame: facts that decide whether its result can be used.
#[derive(Clone, Copy)]
pub struct Seen {
    /// Whether the whole solution is finite.
    pub finite: bool,
    /// Largest absolute value of the right-hand side.
    pub largest: f64,
}

/// What one thread owns. `E`: what a method keeps besides.
pub struct Share<T, E> {
    /// The thread's subtrees of the factor.
    pub panels: Panels<T>,
    work: Workspace,
    /// Vectors by local row: own pivots, then the rows of the top (thread 0: the real ones).
    pub slab: Aligned<T>,
    /// What the last factorisation said.
    outcome: Result<(), Breakdown>,
    /// What the last frame saw.
    pub seen: Seen,
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
    /// The factor is that of this power of two times the matrix, whose largest diagonal entry so is about 1.
    pub scale: f64,
    name: &'static str,
}

impl<T: Lanes, E: Send> Engine<T, E> {
    /// Room for the factor; nothing is factored yet. `lanes`: numbers per row of the slabs, 4 or 8.
    pub fn new(
        isa: Isa,
        symbolic: Symbolic,
        lanes: usize,
        name: &'static str,
        mut extra: impl FnMut(&Part) -> E,
    ) -> Result<Self, PrepareError> {
        let threads = symbolic.threads();
        let bytes =
            symbolic.parts.iter().map(|part| Panels::<T>::bytes_for(part) + Workspace::bytes_for(part)).sum();
        // Asked for in one piece and given back at once: an allocation that fails later would end the process.
        Vec::<u8>::new()
            .try_reserve_exact(usize::try_from(bytes).unwrap_or(usize::MAX))
            .map_err(|_| PrepareError::OutOfMemory { bytes })?;
        let shares = symbolic.parts[..threads].iter().map(|part| Share {
            panels: Panels::new(part),
            work: Workspace::new(part),
            slab: Aligned::new(lanes * part.slab as usize),
            outcome: Ok(()),
            seen: Seen { finite: true, largest: 0.0 },
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
        Ok(Self { isa, symbolic, shares, top, team, scale: 1.0, name })
    }

    /// Numeric factorisation: every thread its subtrees, then the top. `values` by stored entry of the matrix.
    pub fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        self.scale = 1.0 / power_of_two(self.symbolic.largest_pivot(values));
        let Self { isa, symbolic, shares, top, team, scale, .. } = self;
        let (parts, scale) = (&symbolic.parts, *scale);
        team.for_each(shares, |t, share| {
            let Share { work, panels: out, .. } = share;
            share.outcome = isa.run(FactorPart {
                part: &parts[t],
                values,
                scale,
                below: &|_| unreachable!("subtrees are closed"),
                work,
                out,
                crew: None,
            });
        });
        let mut outcome = shares.iter().try_for_each(|share| share.outcome);
        if let (Ok(()), Some(top)) = (outcome, top) {
            let below = |t: usize| (&parts[t], &shares[t].work);
            let part = &parts[parts.len() - 1];
            let Top { panels: out, work } = top;
            let crew = Some(Crew { team, isa: *isa });
            outcome = isa.run(FactorPart { part, values, scale, below: &below, work, out, crew });
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

    /// A group of columns in one sweep pair: loads from `source` times `scale`, a power of two, and stores to rows
    /// `rows[k]` of `x` for elimination position k.
    pub fn frame<S: Shape<T = T>>(
        &mut self,
        source: &impl Source,
        scale: f64,
        rows: &[u32],
        x: &Output<'_>,
        group: Group,
    ) -> Seen {
        let Self { isa, symbolic, shares, team, .. } = self;
        team.for_each(shares, |t, share| {
            let work = S::rows(&mut share.slab);
            let largest = load::<S>(*isa, symbolic, t, source, work, group, scale);
            share.seen.largest = largest.into_iter().fold(0.0, f64::max);
            isa.run(Forward::<S> { panels: &share.panels, active: source.active(t), work });
        });
        let threads = shares.len();
        self.sweep_top::<S>(source.active(threads));
        let scale = self.scale / scale;
        let Self { isa, symbolic, shares, team, .. } = self;
        team.for_each(shares, |t, share| {
            let (part, work) = (&symbolic.parts[t], S::rows(&mut share.slab));
            isa.run(Backward::<S> { panels: &share.panels, work });
            // SAFETY: `rows` names every row at most once, and the positions of threads and top are disjoint.
            share.seen.finite = unsafe { store::<S>(*isa, symbolic, t, part, work, rows, x, group, scale) };
        });
        shares.iter().fold(Seen { finite: true, largest: 0.0 }, |all, share| Seen {
            finite: all.finite && share.seen.finite,
            largest: all.largest.max(share.seen.largest),
        })
    }

    /// Adds the threads' updates of the top rows, sweeps the top both ways and gives every thread the result.
    pub fn sweep_top<S: Shape<T = T>>(&mut self, active: Option<&[u32]>) {
        let Self { isa, symbolic, shares, top, .. } = self;
        let Some(top) = top else { return };
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

    /// The panels that a right-hand side with non-zeros at `positions` reaches.
    pub fn reach(&self, positions: impl Iterator<Item = u32>) -> Reach {
        let symbolic = &self.symbolic;
        let positions: Vec<u32> = positions.collect();
        let first_of_top = symbolic.top_positions().start as u32;
        let mut top_rows: Vec<u32> = positions.iter().copied().filter(|&p| p >= first_of_top).collect();
        let mut panels = Vec::new();
        for (t, share) in self.shares.iter().enumerate() {
            let (own, pivots) = (symbolic.positions(t), symbolic.parts[t].pivots() as u32);
            let rows =
                positions.iter().filter(|p| own.contains(&(**p as usize))).map(|p| p - own.start as u32);
            let mut leave = Vec::new();
            panels.push(share.panels.reach(rows, &mut leave));
            top_rows.extend(leave.into_iter().map(|row| row - pivots + first_of_top));
        }
        if let Some(top) = &self.top {
            let first_local = symbolic.parts[self.shares.len()].first_local;
            let rows = top_rows.into_iter().map(|p| p - first_of_top + first_local);
            panels.push(top.panels.reach(rows, &mut Vec::new()));
        }
        let all = self.shares.iter().map(|s| &s.panels).chain(self.top.iter().map(|t| &t.panels));
        let skipped = all.zip(&panels).map(|(all, active)| all.bytes() - all.forward_bytes(active));
        Reach { skipped_bytes: skipped.sum(), panels }
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
            host_bytes: Some(
                panels().map(Panels::bytes_held).sum::<u64>() + slabs + work + self.symbolic.bytes(),
            ),
            factor_nonzeros: Some(self.symbolic.nonzeros),
            factor_bytes: Some(factor),
            bytes_per_solve: Some(panels().map(Panels::bytes_per_solve).sum()),
            factor_flops: Some(self.symbolic.flops),
            ordering: Some(self.name),
            ..Footprint::default()
        }
    }
}

/// Loads the rows of thread `t`, and for thread 0 those of the top, which are zero for the others. Returns the largest
/// absolute value of every column.
pub fn load<S: Shape>(
    isa: Isa,
    symbolic: &Symbolic,
    t: usize,
    source: &impl Source,
    work: &mut [S::Row],
    group: Group,
    scale: f64,
) -> [f64; 8] {
    let part = &symbolic.parts[t];
    let (pivots, top) = work[..part.slab as usize].split_at_mut(part.pivots());
    let mut largest = source.load::<S>(isa, symbolic.positions(t), group, scale, pivots);
    if t == 0 {
        let above = source.load::<S>(isa, symbolic.top_positions(), group, scale, top);
        largest.iter_mut().zip(above).for_each(|(a, b)| *a = a.max(b));
    } else {
        top.fill(S::Row::default());
    }
    largest
}

/// Stores the rows of thread `t`, and for thread 0 those of the top. Returns whether they are finite.
///
/// # Safety
/// No row occurs in `rows` twice.
pub unsafe fn store<S: Shape>(
    isa: Isa,
    symbolic: &Symbolic,
    t: usize,
    part: &Part,
    work: &[S::Row],
    rows: &[u32],
    x: &Output<'_>,
    group: Group,
    scale: f64,
) -> bool {
    let (pivots, top) = work[..part.slab as usize].split_at(part.pivots());
    let own = &rows[symbolic.positions(t)];
    // SAFETY: every thread stores other positions, hence other rows.
    let finite = isa.run(unsafe { Scatter::<S>::new(own, x, group, scale, pivots) });
    if t > 0 {
        return finite;
    }
    let own = &rows[symbolic.top_positions()];
    // SAFETY: as above.
    isa.run(unsafe { Scatter::<S>::new(own, x, group, scale, top) }) && finite
}

/// The power of two next to a positive finite number, at most a factor of two below; 1 for others.
pub fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    if x.is_normal() && x > 0.0 { f64::from_bits(x.to_bits() & EXPONENT) } else { 1.0 }
}

/// Splits k columns into groups of at most `widest`.
pub fn groups(k: usize, widest: usize) -> impl Iterator<Item = Group> {
    (0..k).step_by(widest).map(move |from| Group { from, count: widest.min(k - from) })
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

    /// The largest diagonal entry of the matrix.
    pub fn largest_pivot(&self, values: &[f64]) -> f64 {
        let diagonals = self.parts.iter().flat_map(|part| &part.diagonal);
        diagonals.fold(0.0, |most, &entry| values[entry as usize].max(most))
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.order[..]) as u64 + self.parts.iter().map(Part::bytes).sum::<u64>()
    }
}
