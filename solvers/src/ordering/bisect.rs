//! Recursive bisection of one domain of a coarse graph: initial separators.
use super::coarsen::View;
use super::refine::{Labels, Refiner, Region, Sizes, Split, UNKNOWN};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// When a domain is cut further.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// A domain of at most this weight (in finest vertices) is a leaf.
    pub leaf_weight: u64,
    /// A domain of at most this many vertices is left to a finer level.
    pub least_vertices: usize,
}

/// The children of every node of a small tree; node 0 is the root.
pub(super) type Children = Vec<Option<[u32; 2]>>;

/// Passes of refinement after each growth.
const PASSES: usize = 3;

/// Workspace for the recursive bisection of one domain after the other.
#[derive(Default)]
pub(super) struct Bisector {
    refiner: Refiner,
    // The domain as a graph of its own.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
    weights: Vec<u32>,
    labels: Vec<AtomicU32>,
    slots: Vec<AtomicU32>,
    // Breadth-first search, the separator at work, and the best state so far.
    queue: Vec<u32>,
    separator: Vec<u32>,
    best: Vec<u32>,
}

/// A separator between two plain labels.
#[derive(Clone, Copy)]
struct Three {
    own: u32,
    sides: [u32; 2],
}

impl Split for Three {
    #[inline]
    fn side(&self, label: u32) -> usize {
        if label == self.sides[0] {
            0
        } else if label == self.sides[1] {
            1
        } else if label == self.own {
            2
        } else {
            3
        }
    }

    fn own(&self) -> u32 {
        self.own
    }

    fn label_on(&self, side: usize, _: impl Iterator<Item = u32>) -> u32 {
        self.sides[side]
    }
}

impl Bisector {
    /// Cuts the domain `members` of `graph` until its parts are within the limits. Returns the tree of cuts and,
    /// per member, the tree node it belongs to. `index` holds [`UNKNOWN`] for the members, and again on return.
    pub fn dissect(
        &mut self,
        graph: View<'_>,
        members: &[u32],
        index: &Labels,
        limits: Limits,
    ) -> (Children, Vec<u32>) {
        self.extract(graph, members, index);
        let mut tree = vec![None];
        let mut part: Vec<u32> = (0..members.len() as u32).collect();
        self.cut(&mut part, 0, &mut tree, limits);
        (tree, self.labels.iter().map(|l| l.load(Relaxed)).collect())
    }

    /// Copies the graph induced by the members, in their order.
    fn extract(&mut self, graph: View<'_>, members: &[u32], index: &Labels) {
        for (k, &v) in members.iter().enumerate() {
            index[v as usize].store(k as u32, Relaxed);
        }
        self.starts.clear();
        self.neighbours.clear();
        self.weights.clear();
        self.starts.push(0);
        for &v in members {
            let inside = graph.neighbours(v).iter().map(|&w| index[w as usize].load(Relaxed));
            self.neighbours.extend(inside.filter(|&k| k != UNKNOWN));
            self.starts.push(self.neighbours.len() as u32);
            self.weights.push(graph.weight(v));
        }
        for &v in members {
            index[v as usize].store(UNKNOWN, Relaxed);
        }
        self.labels.clear();
        self.labels.resize_with(members.len(), || AtomicU32::new(0));
        self.slots.clear();
        self.slots.resize_with(members.len(), || AtomicU32::new(UNKNOWN));
    }

    /// Cuts one part, whose vertices all bear the label `own`, and then what it fell into.
    fn cut(&mut self, part: &mut [u32], own: u32, tree: &mut Children, limits: Limits) {
        let weight: u64 = part.iter().map(|&v| u64::from(self.weights[v as usize])).sum();
        if weight <= limits.leaf_weight || part.len() <= limits.least_vertices.max(1) {
            return;
        }
        let split = Three { own, sides: [tree.len() as u32, tree.len() as u32 + 1] };
        if !self.bisect(part, &split, weight) {
            self.set_all(part, own);
            return;
        }
        tree[own as usize] = Some(split.sides);
        tree.extend([None, None]);
        let first = self.partition(part, split.sides[0]);
        let (left, rest) = part.split_at_mut(first);
        let second = self.partition(rest, split.sides[1]);
        self.cut(left, split.sides[0], tree, limits);
        self.cut(&mut rest[..second], split.sides[1], tree, limits);
    }

    fn set_all(&self, part: &[u32], label: u32) {
        for &v in part {
            self.labels[v as usize].store(label, Relaxed);
        }
    }

    /// Brings the vertices with this label to the front, in their order, and returns their number.
    fn partition(&mut self, part: &mut [u32], label: u32) -> usize {
        self.queue.clear();
        let mut count = 0;
        for at in 0..part.len() {
            let v = part[at];
            if self.labels[v as usize].load(Relaxed) == label {
                part[count] = v;
                count += 1;
            } else {
                self.queue.push(v);
            }
        }
        part[count..].copy_from_slice(&self.queue);
        count
    }

    /// Finds a separator of a part and labels it; `false` if none is worth having.
    fn bisect(&mut self, part: &[u32], split: &Three, weight: u64) -> bool {
        self.set_all(part, split.sides[1]);
        let reached = self.search(part[0], split.sides[1]);
        if reached < part.len() {
            self.pack_components(part, split);
            return true;
        }
        let mut best: Option<Sizes> = None;
        let mut seed = *self.queue.last().expect("the search starts with a vertex");
        for attempt in 0..TRIES {
            self.set_all(part, split.sides[1]);
            if attempt > 0 {
                self.search(seed, split.sides[1]);
                seed = *self.queue.last().expect("the search starts with a vertex");
            }
            let sizes = self.attempt(seed, split, weight);
            if best.is_none_or(|b| sizes.better_than(&b)) {
                best = Some(sizes);
                self.best.clear();
                self.best.extend(part.iter().map(|&v| self.labels[v as usize].load(Relaxed)));
            }
            if attempt == 1 {
                // Across the first two cuts: from an end of the separator.
                if let Some(&v) = self.separator.first() {
                    seed = v;
                }
            }
        }
        for (&v, &label) in part.iter().zip(&self.best) {
            self.labels[v as usize].store(label, Relaxed);
        }
        best.is_some_and(|b| b.cost().is_finite() && 2 * b.0[2] < weight)
    }

    /// Grows a side from the seed and refines.
    fn attempt(&mut self, seed: u32, split: &Three, weight: u64) -> Sizes {
        self.labels[seed as usize].store(split.own, Relaxed);
        self.separator.clear();
        self.separator.push(seed);
        let own = u64::from(self.weights[seed as usize]);
        let sizes = Sizes([0, weight - own, own]);
        let graph = View { starts: &self.starts, neighbours: &self.neighbours, weights: &self.weights };
        let region = Region { graph, labels: &self.labels, slots: &self.slots, split: *split };
        let sizes = self.refiner.grow(&region, &mut self.separator, sizes);
        self.refiner.refine(&region, &mut self.separator, sizes, PASSES)
    }

    /// Breadth-first search from v among the vertices with a label; `queue` receives them in order of distance.
    fn search(&mut self, v: u32, label: u32) -> usize {
        self.queue.clear();
        self.queue.push(v);
        self.slots[v as usize].store(0, Relaxed);
        let mut at = 0;
        while at < self.queue.len() {
            let v = self.queue[at];
            at += 1;
            let range = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            for &w in &self.neighbours[range] {
                let free = self.slots[w as usize].load(Relaxed) == UNKNOWN;
                if free && self.labels[w as usize].load(Relaxed) == label {
                    self.slots[w as usize].store(0, Relaxed);
                    self.queue.push(w);
                }
            }
        }
        for &v in &self.queue {
            self.slots[v as usize].store(UNKNOWN, Relaxed);
        }
        self.queue.len()
    }

    /// Distributes the components of a part over the two sides, each to the lighter one: no separator is needed.
    fn pack_components(&mut self, part: &[u32], split: &Three) {
        let mut sides = [0_u64; 2];
        self.set_all(part, split.own);
        for &v in part {
            if self.labels[v as usize].load(Relaxed) != split.own {
                continue;
            }
            self.search(v, split.own);
            let side = usize::from(sides[1] < sides[0]);
            for &w in &self.queue {
                self.labels[w as usize].store(split.sides[side], Relaxed);
                sides[side] += u64::from(self.weights[w as usize]);
            }
        }
    }
}

/// Seeds tried per cut.
const TRIES: usize = 3;
