//! Fiduccia-Mattheyses refinement of a vertex separator.
//!
//! A move takes a vertex out of the separator to one side and pulls its neighbours on the other side in, so that
//! the separator keeps separating. Best moves first, also where they make things worse for a while; in the end the
//! best state seen is restored. After C. M. Fiduccia and R. M. Mattheyses, DAC 1982, in the form for vertex
//! separators of B. Hendrickson and E. Rothberg, SIAM J. Sci. Comput. 20 (1998).
use super::coarsen::View;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Vertices not known to the refiner.
pub(super) const UNKNOWN: u32 = u32::MAX;

/// One label per vertex, shared by threads that work on disjoint parts of the graph.
///
/// Every thread writes only labels of its own part, and no vertex of another part is a neighbour of it: relaxed
/// atomics are plain memory accesses here, and the result does not depend on the number of threads.
pub(super) type Labels = [AtomicU32];

/// How labels relate to the separator that is being refined.
pub(super) trait Split {
    /// 0 or 1: inside one of the sides; 2: in the separator; 3: outside.
    fn side(&self, label: u32) -> usize;
    /// The label of the separator.
    fn own(&self) -> u32;
    /// The label a separator vertex takes on when it moves to a side, from those of its neighbours there.
    fn label_on(&self, side: usize, neighbours: impl Iterator<Item = u32>) -> u32;
}

/// Sizes of both sides and the separator, in vertices of the finest graph.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes(pub [u64; 3]);

/// How much a separator vertex more is worth against balance; see [`Sizes::cost`].
const IMBALANCE: f64 = 1.0;
/// The larger side may hold at most this share of both sides (beyond, only an empty separator is accepted).
const LARGEST_SIDE: f64 = 0.8;

impl Sizes {
    /// The cost to minimise: separator weight times (1 + IMBALANCE d^2), d = difference of the sides over their
    /// sum; infinite for a separator that leaves one side too large.
    pub fn cost(&self) -> f64 {
        let [a, b, s] = self.0.map(|w| w as f64);
        let sum = a + b;
        if a == 0.0 || b == 0.0 || (s > 0.0 && a.max(b) > LARGEST_SIDE * sum) {
            return f64::INFINITY;
        }
        let d = (a - b) / sum;
        // The half vertex ranks empty separators by their balance.
        (s + 0.5) * (1.0 + IMBALANCE * d * d)
    }

    fn imbalance(&self) -> u64 {
        self.0[0].abs_diff(self.0[1])
    }

    pub fn better_than(&self, other: &Self) -> bool {
        let (mine, theirs) = (self.cost(), other.cost());
        mine < theirs || (mine == theirs && self.imbalance() < other.imbalance())
    }
}

/// The part of a graph in which a separator moves.
pub(super) struct Region<'a, S> {
    pub graph: View<'a>,
    /// One label per vertex.
    pub labels: &'a Labels,
    /// Workspace: [`UNKNOWN`] for every vertex of the region between calls.
    pub slots: &'a Labels,
    pub split: S,
}

impl<S: Split> Region<'_, S> {
    #[inline]
    fn label(&self, v: u32) -> u32 {
        self.labels[v as usize].load(Relaxed)
    }

    #[inline]
    fn side(&self, v: u32) -> usize {
        self.split.side(self.label(v))
    }
}

/// A vertex that is or was in the separator during this pass.
#[derive(Clone, Copy)]
struct Candidate {
    vertex: u32,
    /// Weight of its neighbours on side 0 and on side 1.
    beside: [u32; 2],
    /// Has left the separator in this pass: it will not leave again.
    moved: bool,
}

/// A vertex that took another label.
#[derive(Clone, Copy)]
pub(super) struct Change {
    pub vertex: u32,
    pub before: u32,
    pub after: u32,
}

/// Workspace of the refinement, reused from call to call.
#[derive(Default)]
pub(super) struct Refiner {
    candidates: Vec<Candidate>,
    /// Per side, the candidates by gain; entries that are no longer true stay until they come to the top.
    queues: [BinaryHeap<u64>; 2],
    /// The only side moves may go to, while a side is grown.
    only: Option<usize>,
    /// All changes of the last call in order, a vertex possibly more than once.
    changes: Vec<Change>,
}

/// A pass ends after this many moves without improvement per separator vertex ...
const PATIENCE: f64 = 2.0;
/// ... but not before and not after so many.
const PATIENCE_BOUNDS: (usize, usize) = (50, 300);

impl Refiner {
    /// Improves the separator in up to `passes` passes. `separator` holds its vertices; on return, those it has then.
    /// Returns the new sizes.
    pub fn refine<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        mut sizes: Sizes,
        passes: usize,
    ) -> Sizes {
        self.only = None;
        self.changes.clear();
        for _ in 0..passes {
            let before = sizes;
            sizes = self.pass(region, separator, sizes);
            if !sizes.better_than(&before) {
                break;
            }
        }
        sizes
    }

    /// Grows side 0 from the separator into side 1 and keeps the best state seen.
    pub fn grow<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        sizes: Sizes,
    ) -> Sizes {
        self.only = Some(0);
        self.changes.clear();
        self.pass(region, separator, sizes)
    }

    /// The changes of the last call, in order; a vertex may appear more than once.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    fn pass<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        mut sizes: Sizes,
    ) -> Sizes {
        self.candidates.clear();
        self.queues.iter_mut().for_each(BinaryHeap::clear);
        for &v in separator.iter() {
            self.enter(region, v);
        }
        let patience =
            ((PATIENCE * separator.len() as f64) as usize).clamp(PATIENCE_BOUNDS.0, PATIENCE_BOUNDS.1);
        let (mut best, mut kept, mut idle) = (sizes, self.changes.len(), 0);
        while self.only.is_some() || idle < patience {
            let Some((slot, side)) = self.next_move(region, &sizes) else { break };
            self.apply(region, slot, side, &mut sizes);
            idle += 1;
            if sizes.better_than(&best) {
                (best, kept, idle) = (sizes, self.changes.len(), 0);
            }
            if self.only.is_some() && sizes.0[0] as f64 > LARGEST_SIDE * (sizes.0[0] + sizes.0[1]) as f64 {
                break;
            }
        }
        for change in self.changes.drain(kept..).rev() {
            region.labels[change.vertex as usize].store(change.before, Relaxed);
        }
        separator.clear();
        for candidate in &self.candidates {
            region.slots[candidate.vertex as usize].store(UNKNOWN, Relaxed);
            if region.label(candidate.vertex) == region.split.own() {
                separator.push(candidate.vertex);
            }
        }
        best
    }

    /// Makes the separator vertex v a candidate for moves.
    fn enter<S: Split>(&mut self, region: &Region<'_, S>, v: u32) {
        if region.slots[v as usize].load(Relaxed) != UNKNOWN {
            return;
        }
        let mut beside = [0; 4];
        for &w in region.graph.neighbours(v) {
            beside[region.side(w)] += region.graph.weight(w);
        }
        let slot = self.candidates.len() as u32;
        region.slots[v as usize].store(slot, Relaxed);
        self.candidates.push(Candidate { vertex: v, beside: [beside[0], beside[1]], moved: false });
        for side in 0..2 {
            if self.only.is_none_or(|o| o == side) {
                self.queues[side].push(self.key(region.graph, slot, side));
            }
        }
    }

    /// Queue entry: the gain of moving a candidate to a side, then the candidate itself, the latest first.
    fn key(&self, graph: View<'_>, slot: u32, side: usize) -> u64 {
        let candidate = &self.candidates[slot as usize];
        let gain = i64::from(graph.weight(candidate.vertex)) - i64::from(candidate.beside[1 - side]);
        (((gain + (1 << 31)) as u64) << 32) | u64::from(slot)
    }

    /// The best move: highest gain, then towards the smaller side; only to the smaller side where the larger one
    /// may not grow.
    fn next_move<S>(&mut self, region: &Region<'_, S>, sizes: &Sizes) -> Option<(u32, usize)> {
        let smaller = usize::from(sizes.0[1] < sizes.0[0]);
        let full = sizes.0[1 - smaller] as f64 > LARGEST_SIDE * (sizes.0[0] + sizes.0[1]) as f64;
        let mut best: Option<(u64, usize)> = None;
        for side in [smaller, 1 - smaller] {
            let allowed = self.only.map_or(!full || side == smaller, |o| o == side);
            let top = allowed.then(|| self.valid_top(region.graph, side)).flatten();
            if let Some(key) = top.filter(|key| best.is_none_or(|(top, _)| key >> 32 > top >> 32)) {
                best = Some((key, side));
            }
        }
        let (key, side) = best?;
        self.queues[side].pop();
        Some((key as u32, side))
    }

    /// The top of a queue after its outdated entries are gone.
    fn valid_top(&mut self, graph: View<'_>, side: usize) -> Option<u64> {
        loop {
            let key = *self.queues[side].peek()?;
            if !self.candidates[key as u32 as usize].moved && key == self.key(graph, key as u32, side) {
                return Some(key);
            }
            self.queues[side].pop();
        }
    }

    /// Moves a candidate to a side and pulls its neighbours on the other side into the separator.
    fn apply<S: Split>(&mut self, region: &Region<'_, S>, slot: u32, side: usize, sizes: &mut Sizes) {
        let (graph, split) = (region.graph, &region.split);
        let v = self.candidates[slot as usize].vertex;
        self.candidates[slot as usize].moved = true;
        let there = graph.neighbours(v).iter().map(|&w| region.label(w)).filter(|&l| split.side(l) == side);
        let label = split.label_on(side, there);
        self.relabel(region.labels, v, label);
        let weight = graph.weight(v);
        sizes.0[2] -= u64::from(weight);
        sizes.0[side] += u64::from(weight);
        for &w in graph.neighbours(v) {
            let at = region.side(w);
            if at == 2 {
                self.adjust(region, w, side, weight as i32);
            } else if at == 1 - side {
                let pulled = graph.weight(w);
                sizes.0[1 - side] -= u64::from(pulled);
                sizes.0[2] += u64::from(pulled);
                self.relabel(region.labels, w, split.own());
                for &x in graph.neighbours(w) {
                    if region.side(x) == 2 {
                        self.adjust(region, x, 1 - side, -(pulled as i32));
                    }
                }
                self.enter(region, w);
            }
        }
    }

    /// The neighbours of a separator vertex on `side` weigh `change` more: its gain towards the other side sinks.
    fn adjust<S>(&mut self, region: &Region<'_, S>, v: u32, side: usize, change: i32) {
        let slot = region.slots[v as usize].load(Relaxed);
        if slot == UNKNOWN {
            return;
        }
        let candidate = &mut self.candidates[slot as usize];
        candidate.beside[side] = candidate.beside[side].wrapping_add_signed(change);
        let towards = 1 - side;
        if !candidate.moved && self.only.is_none_or(|o| o == towards) {
            self.queues[towards].push(self.key(region.graph, slot, towards));
        }
    }

    fn relabel(&mut self, labels: &Labels, vertex: u32, after: u32) {
        let before = labels[vertex as usize].load(Relaxed);
        labels[vertex as usize].store(after, Relaxed);
        self.changes.push(Change { vertex, before, after });
    }
}
