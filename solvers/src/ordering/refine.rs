//! Fiduccia-Mattheyses refinement of a vertex separator.
//!
//! A move takes a vertex out of the separator to one side and pulls its neighbours on the other side in, so that
//! the separator keeps separating. All moves of a pass go to the same side, the best first, also where they make
//! things worse for a while: the separator advances as a front. In the end the best state seen is restored, and the
//! next pass goes the other way. After C. M. Fiduccia and R. M. Mattheyses, DAC 1982; vertex separators as in
//! C. Ashcraft and J. W. H. Liu, SIAM J. Matrix Anal. Appl. 19 (1998).
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

/// How strongly the cost of a separator rises with the imbalance of its sides; see [`Sizes::cost`].
const IMBALANCE: f64 = 1.0;
/// The larger side should hold at most this share of both sides.
const LARGEST_SIDE: f64 = 0.7;

impl Sizes {
    /// The cost to minimise: separator weight times (1 + IMBALANCE d^2), d = difference of the sides over their
    /// sum, plus what the larger side holds beyond its share (which makes that share a hard limit on large graphs).
    /// Sides of any size are welcome where no separator is needed.
    pub fn cost(&self) -> f64 {
        let [a, b, s] = self.0.map(|w| w as f64);
        let sum = a + b;
        let d = if sum > 0.0 { (a - b) / sum } else { 0.0 };
        let free = s == 0.0 && a > 0.0 && b > 0.0;
        let excess = if free { 0.0 } else { (a.max(b) - LARGEST_SIDE * sum).max(0.0) };
        // The half vertex ranks empty separators by their balance.
        (s + 0.5) * (1.0 + IMBALANCE * d * d) + excess
    }

    fn imbalance(&self) -> u64 {
        self.0[0].abs_diff(self.0[1])
    }

    /// Whether these sizes are better than others: by cost, then by balance.
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
    /// Weight of its neighbours on the side that pays for its move; [`MOVED`] when it has left the separator.
    pull: u32,
}

const MOVED: u32 = u32::MAX;

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
    /// Candidates by gain; entries that are no longer true stay until they come to the top.
    queue: BinaryHeap<u64>,
    /// All changes of the last call in order, a vertex possibly more than once.
    changes: Vec<Change>,
}

/// A pass ends after this many moves without improvement per separator vertex ...
const PATIENCE: f64 = 2.0;
/// ... but not before ...
const PATIENCE_LEAST: usize = 50;
/// ... and not after so many.
const PATIENCE_MOST: usize = 300;

impl Refiner {
    /// Improves the separator in up to `passes` passes to each side. `separator` holds its vertices; on return,
    /// those it has then. Returns the new sizes.
    pub fn refine<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        mut sizes: Sizes,
        passes: usize,
    ) -> Sizes {
        self.changes.clear();
        let mut side = usize::from(sizes.0[1] < sizes.0[0]);
        for pass in 0..2 * passes {
            let before = sizes;
            let patience =
                ((PATIENCE * separator.len() as f64) as usize).clamp(PATIENCE_LEAST, PATIENCE_MOST);
            sizes = self.pass(region, separator, sizes, side, patience, LARGEST_SIDE);
            if pass > 0 && !sizes.better_than(&before) {
                break;
            }
            side = 1 - side;
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
        self.changes.clear();
        self.pass(region, separator, sizes, 0, usize::MAX, LARGEST_SIDE)
    }

    /// The changes of the last call, in order; a vertex may appear more than once.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Moves vertices to `side` until `patience` moves have not improved on the best state or the side holds more
    /// than `share` of everything, then returns to the best state.
    fn pass<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        mut sizes: Sizes,
        side: usize,
        patience: usize,
        share: f64,
    ) -> Sizes {
        self.candidates.clear();
        self.queue.clear();
        for &v in separator.iter() {
            self.enter(region, side, v);
        }
        let most = (share * sizes.0.iter().sum::<u64>() as f64) as u64;
        let (mut best, mut kept, mut idle) = (sizes, self.changes.len(), 0);
        while idle < patience && (sizes.0[side] <= most || sizes.0[side] < sizes.0[1 - side]) {
            let Some(slot) = self.next_move(region.graph) else { break };
            self.apply(region, slot, side, &mut sizes);
            idle += 1;
            if sizes.better_than(&best) {
                (best, kept, idle) = (sizes, self.changes.len(), 0);
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

    /// Makes the separator vertex v a candidate for a move to `side`.
    fn enter<S: Split>(&mut self, region: &Region<'_, S>, side: usize, v: u32) {
        if region.slots[v as usize].load(Relaxed) != UNKNOWN {
            return; // listed twice
        }
        let mut pull = 0;
        for &w in region.graph.neighbours(v) {
            if region.side(w) == 1 - side {
                pull += region.graph.weight(w);
            }
        }
        let slot = self.candidates.len() as u32;
        region.slots[v as usize].store(slot, Relaxed);
        self.candidates.push(Candidate { vertex: v, pull });
        self.queue.push(self.key(region.graph, slot));
    }

    /// Queue entry: the gain of moving a candidate, then the candidate itself, the latest first.
    fn key(&self, graph: View<'_>, slot: u32) -> u64 {
        let candidate = &self.candidates[slot as usize];
        let gain = i64::from(graph.weight(candidate.vertex)) - i64::from(candidate.pull);
        (((gain + (1 << 32)) as u64) << 31) | u64::from(slot)
    }

    /// The move with the highest gain.
    fn next_move(&mut self, graph: View<'_>) -> Option<u32> {
        loop {
            let key = self.queue.pop()?;
            let slot = (key & 0x7FFF_FFFF) as u32;
            if self.candidates[slot as usize].pull != MOVED && key == self.key(graph, slot) {
                return Some(slot);
            }
        }
    }

    /// Moves a candidate to `side` and pulls its neighbours on the other side into the separator.
    fn apply<S: Split>(&mut self, region: &Region<'_, S>, slot: u32, side: usize, sizes: &mut Sizes) {
        let (graph, split) = (region.graph, &region.split);
        let v = self.candidates[slot as usize].vertex;
        self.candidates[slot as usize].pull = MOVED;
        let there = graph.neighbours(v).iter().map(|&w| region.label(w)).filter(|&l| split.side(l) == side);
        let label = split.label_on(side, there);
        self.relabel(region.labels, v, label);
        let weight = u64::from(graph.weight(v));
        sizes.0[2] -= weight;
        sizes.0[side] += weight;
        for &w in graph.neighbours(v) {
            if region.side(w) == 1 - side {
                self.pull_in(region, w, side);
                sizes.0[1 - side] -= u64::from(graph.weight(w));
                sizes.0[2] += u64::from(graph.weight(w));
            }
        }
    }

    /// Takes w from the side that pays into the separator: moves of its neighbours there become cheaper.
    fn pull_in<S: Split>(&mut self, region: &Region<'_, S>, w: u32, side: usize) {
        self.relabel(region.labels, w, region.split.own());
        let weight = region.graph.weight(w);
        for &x in region.graph.neighbours(w) {
            if region.side(x) == 2 {
                let slot = region.slots[x as usize].load(Relaxed);
                if slot != UNKNOWN {
                    self.candidates[slot as usize].pull -= weight;
                    self.queue.push(self.key(region.graph, slot));
                }
            }
        }
        self.enter(region, side, w);
    }

    fn relabel(&mut self, labels: &Labels, vertex: u32, after: u32) {
        let before = labels[vertex as usize].load(Relaxed);
        labels[vertex as usize].store(after, Relaxed);
        self.changes.push(Change { vertex, before, after });
    }
}
