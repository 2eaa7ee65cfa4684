//! Fiduccia-Mattheyses refinement of a vertex separator.
//!
//! A move takes a vertex out of the separator to one side and pulls its neighbours on the other side in, so that
//! the separator keeps separating. All moves of a pass go to the same side, the best first, also where they make
//! things worse for a while: the separator advances as a front. In the end the best state seen is restored, and the
//! next pass goes the other way. After C. M. Fiduccia and R. M. Mattheyses, DAC 1982; vertex separators as in
//! C. Ashcraft and J. W. H. Liu, SIAM J. Matrix Anal. Appl. 19 (1998).
use super::coarsen::View;
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
    /// Weight of its neighbours on the side that pays for its move.
    pull: u32,
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
    queue: GainQueue,
    /// All changes of the last call in order, a vertex possibly more than once.
    changes: Vec<Change>,
}

/// A pass ends after this many moves per separator vertex without improvement. On regular meshes a separator can
/// wander over plateaus for ever: 8 instead of 2 doubles the time on an icosphere for one percent of fill.
const PATIENCE: usize = 2;
/// It also ends when the separator weighs this many of its average vertices more than the best one: from there a
/// pass hardly ever comes back, and most moves would be spent there.
const SLACK: f64 = 2.0;

/// When a pass gives up.
#[derive(Clone, Copy)]
struct Bounds {
    /// Moves since the best state.
    idle: usize,
    /// Weight of the separator above that of the best state.
    slack: u64,
}

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
            let average = sizes.0[2] as f64 / separator.len().max(1) as f64;
            let bounds = Bounds { idle: PATIENCE * separator.len(), slack: (SLACK * average) as u64 };
            sizes = self.pass(region, separator, sizes, side, bounds);
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
        self.pass(region, separator, sizes, 0, Bounds { idle: usize::MAX, slack: u64::MAX / 2 })
    }

    /// The changes of the last call, in order; a vertex may appear more than once.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Moves vertices to `side` until the bounds are reached or the side has become too large, then returns to the
    /// best state.
    fn pass<S: Split>(
        &mut self,
        region: &Region<'_, S>,
        separator: &mut Vec<u32>,
        mut sizes: Sizes,
        side: usize,
        bounds: Bounds,
    ) -> Sizes {
        self.candidates.clear();
        self.queue.clear(region.graph, separator);
        for &v in separator.iter() {
            self.enter(region, side, v);
        }
        let most = (LARGEST_SIDE * sizes.0.iter().sum::<u64>() as f64) as u64;
        let first = self.changes.len();
        let (mut best, mut kept, mut idle) = (sizes, first, 0);
        let mut best_cost = best.cost();
        while idle < bounds.idle
            && sizes.0[2] <= best.0[2] + bounds.slack
            && (sizes.0[side] <= most || sizes.0[side] < sizes.0[1 - side])
        {
            let Some(slot) = self.queue.pop() else { break };
            self.apply(region, slot, side, &mut sizes);
            idle += 1;
            let cost = sizes.cost();
            if cost < best_cost || (cost == best_cost && sizes.imbalance() < best.imbalance()) {
                (best, best_cost, kept, idle) = (sizes, cost, self.changes.len(), 0);
            }
        }
        for change in self.changes.drain(kept..).rev() {
            region.labels[change.vertex as usize].store(change.before, Relaxed);
        }
        self.settle(region, first);
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
            pull += if region.side(w) == 1 - side { region.graph.weight(w) } else { 0 };
        }
        self.list(region, v, pull);
    }

    /// Appends a candidate.
    fn list<S: Split>(&mut self, region: &Region<'_, S>, v: u32, pull: u32) {
        let slot = self.candidates.len() as u32;
        region.slots[v as usize].store(slot, Relaxed);
        self.candidates.push(Candidate { vertex: v, pull });
        self.queue.push(gain(region.graph, v, pull));
    }

    /// Moves a candidate to `side` and pulls its neighbours on the other side into the separator. The new label is
    /// that of the whole side for now.
    fn apply<S: Split>(&mut self, region: &Region<'_, S>, slot: u32, side: usize, sizes: &mut Sizes) {
        let graph = region.graph;
        let v = self.candidates[slot as usize].vertex;
        self.relabel(region.labels, v, region.split.label_on(side, std::iter::empty()));
        let weight = u64::from(graph.weight(v));
        sizes.0[2] -= weight;
        sizes.0[side] += weight;
        if self.candidates[slot as usize].pull == 0 {
            return;
        }
        for &w in graph.neighbours(v) {
            if region.side(w) == 1 - side {
                self.pull_in(region, w, side);
                sizes.0[1 - side] -= u64::from(graph.weight(w));
                sizes.0[2] += u64::from(graph.weight(w));
            }
        }
    }

    /// Takes w from the side that pays into the separator: moves of its neighbours there become cheaper, and it becomes a
    /// candidate itself.
    fn pull_in<S: Split>(&mut self, region: &Region<'_, S>, w: u32, side: usize) {
        self.relabel(region.labels, w, region.split.own());
        let weight = region.graph.weight(w);
        let mut pull = 0;
        for &x in region.graph.neighbours(w) {
            let label = region.label(x);
            if region.split.side(label) == 1 - side {
                pull += region.graph.weight(x);
            } else if label == region.split.own() {
                let slot = region.slots[x as usize].load(Relaxed);
                if slot != UNKNOWN {
                    let candidate = &mut self.candidates[slot as usize];
                    candidate.pull -= weight;
                    self.queue.update(slot, gain(region.graph, x, candidate.pull));
                }
            }
        }
        self.list(region, w, pull);
    }

    fn relabel(&mut self, labels: &Labels, vertex: u32, after: u32) {
        let before = labels[vertex as usize].load(Relaxed);
        labels[vertex as usize].store(after, Relaxed);
        self.changes.push(Change { vertex, before, after });
    }

    /// Gives the vertices that have left the separator since change number `first` their final labels, in the order
    /// in which they left.
    fn settle<S: Split>(&mut self, region: &Region<'_, S>, first: usize) {
        let (labels, split) = (region.labels, &region.split);
        for change in self.changes[first..].iter().filter(|c| c.before == split.own()) {
            labels[change.vertex as usize].store(split.own(), Relaxed);
        }
        for change in self.changes[first..].iter_mut().filter(|c| c.before == split.own()) {
            let side = split.side(change.after);
            let around = region.graph.neighbours(change.vertex).iter().map(|&w| region.label(w));
            change.after = split.label_on(side, around.filter(|&l| split.side(l) == side));
            labels[change.vertex as usize].store(change.after, Relaxed);
        }
    }
}

/// How much lighter the separator becomes when v leaves it and neighbours of weight `pull` come in.
fn gain(graph: View<'_>, v: u32, pull: u32) -> f32 {
    graph.weight(v) as f32 - pull as f32
}

/// Number of gain classes: the bits of a word.
const CLASSES: usize = 64;
/// The class of gain 0: gains are small or negative.
const ZERO_CLASS: f32 = 48.0;
/// Gain classes per average weight of a separator vertex; with equal weights every gain has a class of its own.
const RESOLUTION: f32 = 4.0;
const NONE: u32 = u32::MAX;

/// Candidates by class of gain: doubly linked lists, the latest first, and one bit per list that is not empty.
#[derive(Default)]
struct GainQueue {
    filled: u64,
    heads: Vec<u32>,
    /// Per candidate: class, next, previous.
    links: Vec<(u32, u32, u32)>,
    /// Classes per unit of gain.
    scale: f32,
}

impl GainQueue {
    /// Empties the queue and adapts the classes to the weights of the separator.
    fn clear(&mut self, graph: View<'_>, separator: &[u32]) {
        let weight: u64 = separator.iter().map(|&v| u64::from(graph.weight(v))).sum();
        self.scale = RESOLUTION * separator.len() as f32 / weight.max(1) as f32;
        self.filled = 0;
        self.heads.clear();
        self.heads.resize(CLASSES, NONE);
        self.links.clear();
    }

    fn class(&self, gain: f32) -> u32 {
        (ZERO_CLASS + gain * self.scale).clamp(0.0, (CLASSES - 1) as f32) as u32
    }

    /// Adds the next candidate.
    fn push(&mut self, gain: f32) {
        let slot = self.links.len() as u32;
        self.links.push((0, NONE, NONE));
        self.link(slot, self.class(gain));
    }

    fn link(&mut self, slot: u32, class: u32) {
        let head = std::mem::replace(&mut self.heads[class as usize], slot);
        if head != NONE {
            self.links[head as usize].2 = slot;
        }
        self.links[slot as usize] = (class, head, NONE);
        self.filled |= 1 << class;
    }

    fn unlink(&mut self, slot: u32) {
        let (class, next, previous) = self.links[slot as usize];
        if next != NONE {
            self.links[next as usize].2 = previous;
        }
        if previous != NONE {
            self.links[previous as usize].1 = next;
        } else {
            self.heads[class as usize] = next;
            self.filled &= !(u64::from(next == NONE) << class);
        }
    }

    /// Files a candidate under its new gain.
    fn update(&mut self, slot: u32, gain: f32) {
        let class = self.class(gain);
        if class != self.links[slot as usize].0 {
            self.unlink(slot);
            self.link(slot, class);
        }
    }

    /// Takes a candidate of the highest class.
    fn pop(&mut self) -> Option<u32> {
        let class = 63_u32.checked_sub(self.filled.leading_zeros())?;
        let slot = self.heads[class as usize];
        self.unlink(slot);
        Some(slot)
    }
}
