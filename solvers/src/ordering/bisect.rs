//! Recursive bisection of one domain of a coarse graph: initial separators.
use super::coarsen::{Level, View, coarsen};
use super::refine::{Labels, Refiner, Region, Sizes, Split, UNKNOWN};
use rayon::prelude::*;
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

/// Passes of refinement to each side, after each growth and on each level.
const PASSES: usize = 4;
/// Multilevel bisections tried on a part of more than [`LARGE`] vertices: its separator is among the few that
/// dominate the fill, and such parts are few.
const RUNS_LARGE: u64 = 4;
/// See [`RUNS_LARGE`]. Such parts also keep more than one thread busy.
const LARGE: usize = 400;
/// Vertices joined per step of the small multilevel scheme: pairs.
const PAIR: u64 = 3;
/// Seeds from which a separator is grown on the coarsest graph of the small multilevel scheme.
const TRIES: usize = 1;
/// Vertices of that coarsest graph, at most (unless coarsening stalls).
const SMALLEST: usize = 100;

/// The sides and the separator of a bisection, as labels.
#[derive(Clone, Copy)]
struct Two;

const SEPARATOR: u32 = 2;

impl Split for Two {
    #[inline]
    fn side(&self, label: u32) -> usize {
        label as usize
    }

    fn own(&self) -> u32 {
        SEPARATOR
    }

    fn label_on(&self, side: usize, _: impl Iterator<Item = u32>) -> u32 {
        side as u32
    }
}

/// Workspace for the recursive bisection of one domain after the other.
#[derive(Default)]
pub(super) struct Bisector {
    refiner: Refiner,
    labels: Vec<AtomicU32>,
    slots: Vec<AtomicU32>,
    queue: Vec<u32>,
    separator: Vec<u32>,
    random: u64,
}

/// The tree of a part of n vertices that stays whole.
fn uncut(n: usize) -> (Children, Vec<u32>) {
    (vec![None], vec![0; n])
}

impl Bisector {
    /// Cuts the domain `members` of `graph` until its parts are within the limits. Returns the tree of cuts and,
    /// per member, the tree node it belongs to. `index` holds [`UNKNOWN`] for the members, and again on return.
    pub fn dissect(
        &mut self,
        graph: View<'_>,
        edge_weights: &[u32],
        members: &[u32],
        index: &Labels,
        limits: Limits,
    ) -> (Children, Vec<u32>) {
        let level = extract(graph, edge_weights, members, index);
        self.cut(&level, limits)
    }

    /// Cuts a part, and what it falls into. Returns the tree of cuts, the part being node 0, and the node of every vertex.
    fn cut(&mut self, part: &Level, limits: Limits) -> (Children, Vec<u32>) {
        let Some(labels) = self.best_cut(part) else { return uncut(part.weights.len()) };
        let inside = [0, 1].map(|side| {
            (0..labels.len() as u32).filter(|&v| labels[v as usize] == side).collect::<Vec<u32>>()
        });
        let parts = inside.each_ref().map(|inside| {
            let weight: u64 = inside.iter().map(|&v| u64::from(part.weights[v as usize])).sum();
            (weight > limits.leaf_weight && inside.len() > limits.least_vertices.max(1))
                .then(|| extract(part.view(), &part.edge_weights, inside, &self.slots))
        });
        let down = |bisector: &mut Self, side: usize| {
            parts[side].as_ref().map_or_else(|| uncut(inside[side].len()), |part| bisector.cut(part, limits))
        };
        let trees = if labels.len() > LARGE {
            let (first, second) = rayon::join(|| down(self, 0), || down(&mut Self::default(), 1));
            [first, second]
        } else {
            [down(self, 0), down(self, 1)]
        };
        let second = 1 + trees[0].0.len() as u32;
        let mut tree = vec![Some([1, second])];
        let mut nodes = vec![0; labels.len()];
        for ((children, local), (inside, base)) in trees.into_iter().zip(inside.iter().zip([1, second])) {
            tree.extend(children.into_iter().map(|pair| pair.map(|pair| pair.map(|node| base + node))));
            inside.iter().zip(local).for_each(|(&v, node)| nodes[v as usize] = base + node);
        }
        (tree, nodes)
    }

    /// The best of several cuts, as labels; `None` if none is worth having.
    fn best_cut(&mut self, level: &Level) -> Option<Vec<u32>> {
        self.reset(level.view().n());
        if let Some(labels) = self.pack_components(level.view()) {
            return Some(labels);
        }
        let found = if level.view().n() > LARGE {
            let runs: Vec<_> =
                (0..RUNS_LARGE).into_par_iter().map(|run| Self::default().run(level, run)).collect();
            let better = |best: (Sizes, Vec<u32>), next: (Sizes, Vec<u32>)| {
                if next.0.better_than(&best.0) { next } else { best }
            };
            runs.into_iter().reduce(better).expect("at least one run")
        } else {
            self.run(level, 0)
        };
        let weight: u64 = level.weights.iter().map(|&w| u64::from(w)).sum();
        let (Sizes([a, b, separator]), labels) = found;
        (a > 0 && b > 0 && 2 * separator < weight).then_some(labels)
    }

    /// One multilevel bisection; every run visits the vertices in another order.
    fn run(&mut self, level: &Level, run: u64) -> (Sizes, Vec<u32>) {
        self.random = 0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(2 * run + 1);
        self.multilevel(level)
    }

    fn next_random(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random
    }

    fn multilevel(&mut self, level: &Level) -> (Sizes, Vec<u32>) {
        let view = level.view();
        if view.n() > SMALLEST {
            let mut visit: Vec<u32> = (0..view.n() as u32).collect();
            for i in (1..visit.len()).rev() {
                let j = (self.next_random() % (i as u64 + 1)) as usize;
                visit.swap(i, j);
            }
            let coarse = coarsen(view, &level.edge_weights, PAIR, &visit);
            if coarse.weights.len() * 10 < view.n() * 9 {
                let (sizes, labels) = self.multilevel(&coarse);
                self.reset(view.n());
                self.separator.clear();
                for v in 0..view.n() {
                    let label = labels[coarse.patch[v] as usize];
                    self.labels[v].store(label, Relaxed);
                    if label == SEPARATOR {
                        self.separator.push(v as u32);
                    }
                }
                let region = Region { graph: view, labels: &self.labels, slots: &self.slots, split: Two };
                let sizes = self.refiner.refine(&region, &mut self.separator, sizes, PASSES);
                return (sizes, self.plain(view.n()));
            }
        }
        self.grow(view)
    }

    fn plain(&self, n: usize) -> Vec<u32> {
        self.labels[..n].iter().map(|l| l.load(Relaxed)).collect()
    }

    fn reset(&mut self, n: usize) {
        if self.labels.len() < n {
            self.labels.resize_with(n, || AtomicU32::new(0));
            self.slots.resize_with(n, || AtomicU32::new(UNKNOWN));
        }
    }

    /// Separators grown from several seeds; the best.
    fn grow(&mut self, view: View<'_>) -> (Sizes, Vec<u32>) {
        self.reset(view.n());
        let weight: u64 = view.weights.iter().map(|&w| u64::from(w)).sum();
        let mut best: Option<(Sizes, Vec<u32>)> = None;
        for _ in 0..TRIES {
            for label in &self.labels[..view.n()] {
                label.store(1, Relaxed);
            }
            let from = (self.next_random() % view.n() as u64) as u32;
            let seed = self.farthest(view, from);
            self.labels[seed as usize].store(SEPARATOR, Relaxed);
            self.separator.clear();
            self.separator.push(seed);
            let own = u64::from(view.weight(seed));
            let region = Region { graph: view, labels: &self.labels, slots: &self.slots, split: Two };
            let sizes = self.refiner.grow(&region, &mut self.separator, Sizes([0, weight - own, own]));
            let sizes = self.refiner.refine(&region, &mut self.separator, sizes, PASSES);
            if best.as_ref().is_none_or(|b| sizes.better_than(&b.0)) {
                best = Some((sizes, self.plain(view.n())));
            }
        }
        best.expect("at least one try")
    }

    /// The vertex reached last in a breadth-first search.
    fn farthest(&mut self, view: View<'_>, from: u32) -> u32 {
        self.queue.clear();
        self.queue.push(from);
        self.slots[from as usize].store(0, Relaxed);
        let mut at = 0;
        while at < self.queue.len() {
            for &w in view.neighbours(self.queue[at]) {
                if self.slots[w as usize].load(Relaxed) == UNKNOWN {
                    self.slots[w as usize].store(0, Relaxed);
                    self.queue.push(w);
                }
            }
            at += 1;
        }
        for &v in &self.queue {
            self.slots[v as usize].store(UNKNOWN, Relaxed);
        }
        self.queue[at - 1]
    }

    /// Distributes the components of a disconnected graph over the two sides, each to the lighter one: no separator
    /// is needed. `None` if the graph is connected.
    fn pack_components(&mut self, view: View<'_>) -> Option<Vec<u32>> {
        const FREE: u32 = 3;
        let mut labels = vec![FREE; view.n()];
        let mut sides = [0_u64; 2];
        for v in 0..view.n() as u32 {
            if labels[v as usize] != FREE {
                continue;
            }
            let side = u32::from(sides[1] < sides[0]);
            self.queue.clear();
            self.queue.push(v);
            labels[v as usize] = side;
            let mut at = 0;
            while at < self.queue.len() {
                let v = self.queue[at];
                at += 1;
                sides[side as usize] += u64::from(view.weight(v));
                for &w in view.neighbours(v) {
                    if labels[w as usize] == FREE {
                        labels[w as usize] = side;
                        self.queue.push(w);
                    }
                }
            }
            if self.queue.len() == view.n() {
                return None;
            }
        }
        Some(labels)
    }
}

/// Copies the graph induced by the members, in their order.
fn extract(graph: View<'_>, edge_weights: &[u32], members: &[u32], index: &Labels) -> Level {
    for (k, &v) in members.iter().enumerate() {
        index[v as usize].store(k as u32, Relaxed);
    }
    let mut level = Level::default();
    level.starts.push(0);
    for &v in members {
        for at in graph.starts[v as usize] as usize..graph.starts[v as usize + 1] as usize {
            let k = index[graph.neighbours[at] as usize].load(Relaxed);
            if k != UNKNOWN {
                level.neighbours.push(k);
                level.edge_weights.push(edge_weights.get(at).copied().unwrap_or(1));
            }
        }
        level.starts.push(level.neighbours.len() as u32);
        level.weights.push(graph.weight(v));
    }
    for &v in members {
        index[v as usize].store(UNKNOWN, Relaxed);
    }
    level
}
