//! What an elimination order costs: elimination tree, column counts of L, fill and flops.
//!
//! Everything here works on positions: k stands for the vertex `order[k]`, eliminated k-th. The elimination tree
//! and the postorder follow J. W. H. Liu, "The role of elimination trees in sparse factorization", SIAM J. Matrix
//! Anal. Appl. 11 (1990); the column counts follow J. R. Gilbert, E. G. Ng and B. W. Peyton, "An efficient algorithm
//! to compute row and column counts for sparse Cholesky factorization", ibid. 15 (1994).
use super::Graph;
use rayon::prelude::*;

/// Parent of a root in an elimination tree: no position.
pub const NONE: u32 = u32::MAX;

/// Size and work of the Cholesky factor L of a matrix with a given pattern and elimination order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fill {
    /// Stored entries of L, the diagonal included: the sum of the column counts c_k.
    pub entries: u64,
    /// Multiplications and additions of the numeric factorisation: the sum of c_k squared.
    pub flops: u128,
    /// Number of columns on the longest path of the elimination tree: the length of the serial chain.
    pub height: u32,
}

/// The permuted pattern by elimination position, from which every quantity of this file is computed.
pub struct Pattern {
    /// Position k has the neighbours `neighbours[starts[k]..starts[k + 1]]`.
    starts: Vec<u32>,
    /// Where the neighbours eliminated later begin; before them stand those eliminated earlier.
    middles: Vec<u32>,
    neighbours: Vec<u32>,
}

/// Positions whose neighbours one thread looks up at a time.
const PIECE: usize = 8192;

impl Pattern {
    /// The pattern of the matrix with rows and columns in elimination order. Cost: O(n + |E|), in parallel.
    ///
    /// # Panics
    /// If `order` is not a permutation of the vertices (an index out of range or a wrong length).
    pub fn new(graph: &Graph, order: &[u32]) -> Self {
        let position = inverse(order);
        assert_eq!(order.len(), graph.n(), "an elimination order names every vertex once");
        let mut starts = Vec::with_capacity(order.len() + 1);
        starts.push(0);
        let mut end = 0;
        starts.extend(order.iter().map(|&v| {
            end += graph.degree(v) as u32;
            end
        }));
        let (mut middles, mut neighbours) = (vec![0; order.len()], vec![0; graph.entries()]);
        let mut rest = &mut neighbours[..];
        let mut pieces = Vec::with_capacity(order.len().div_ceil(PIECE));
        for (piece, middles) in middles.chunks_mut(PIECE).enumerate() {
            let first = piece * PIECE;
            let (own, others) = rest.split_at_mut((starts[first + middles.len()] - starts[first]) as usize);
            rest = others;
            pieces.push((first, middles, own));
        }
        pieces.into_par_iter().for_each(|(first, middles, own)| {
            for (k, middle) in (first..).zip(middles) {
                let (mut earlier, mut later) = (starts[k] - starts[first], starts[k + 1] - starts[first]);
                for &w in graph.neighbours(order[k]) {
                    let at = position[w as usize];
                    // Earlier ones fill the range from its front, later ones from its back; no branch to guess.
                    let is_later = u32::from(at > k as u32);
                    later -= is_later;
                    own[if at > k as u32 { later } else { earlier } as usize] = at;
                    earlier += 1 - is_later;
                }
                *middle = starts[first] + earlier;
            }
        });
        Self { starts, middles, neighbours }
    }

    /// Number of positions.
    pub fn n(&self) -> usize {
        self.middles.len()
    }

    /// The neighbours of position k that are eliminated earlier, in no particular order.
    #[inline]
    fn earlier(&self, k: usize) -> &[u32] {
        &self.neighbours[self.starts[k] as usize..self.middles[k] as usize]
    }

    /// The neighbours of position k that are eliminated later, in no particular order.
    #[inline]
    pub fn later(&self, k: usize) -> &[u32] {
        &self.neighbours[self.middles[k] as usize..self.starts[k + 1] as usize]
    }

    /// The elimination tree: `parent[k]` is the row of the first off-diagonal entry of column k of L, [`NONE`] for
    /// a root. Always `parent[k] > k`. Cost: nearly O(n + |E|), by path compression.
    pub fn elimination_tree(&self) -> Vec<u32> {
        let n = self.n();
        let mut parent = vec![NONE; n];
        let mut ancestor = vec![NONE; n];
        for k in 0..n {
            for &j in self.earlier(k) {
                let mut at = j;
                while at != k as u32 {
                    let next = std::mem::replace(&mut ancestor[at as usize], k as u32);
                    if next == NONE {
                        parent[at as usize] = k as u32;
                        break;
                    }
                    at = next;
                }
            }
        }
        parent
    }

    /// Number of entries of every column of L, the diagonal included, without forming L. `parent` is the
    /// elimination tree and `postorder` a [`postorder`] of it. Cost: nearly O(n + |E|).
    ///
    /// Column j of L has an entry in row i iff j lies in the *row subtree* of i: the part of the tree between i and
    /// the positions j with a matrix entry (i, j). The count of column j is therefore the number of row subtrees
    /// that hold j; a subtree is counted up the tree from its leaves, and taken off again where two paths meet.
    pub fn column_counts(&self, parent: &[u32], postorder: &[u32]) -> Vec<u32> {
        let n = self.n();
        let first = first_descendants(parent, postorder);
        let mut count = vec![0_i32; n]; // all partial sums lie within -2 n and n
        // Per row its latest leaf and that leaf's `first`; NONE before the first one.
        let mut latest = vec![(NONE, NONE); n];
        let mut set: Vec<u32> = (0..n as u32).collect(); // disjoint sets: finished subtrees under their root
        for &j in postorder {
            if first[j as usize].1 {
                count[j as usize] += 1;
            }
            if parent[j as usize] != NONE {
                count[parent[j as usize] as usize] -= 1;
            }
            for &i in self.later(j as usize) {
                let (leaf, seen) = latest[i as usize];
                if seen != NONE && first[j as usize].0 <= seen {
                    continue; // j is an ancestor of a known leaf, so not a leaf of this row subtree
                }
                count[j as usize] += 1;
                if leaf != NONE {
                    count[find(&mut set, leaf) as usize] -= 1;
                }
                latest[i as usize] = (j, first[j as usize].0);
            }
            if parent[j as usize] != NONE {
                set[j as usize] = parent[j as usize];
            }
        }
        for &j in postorder {
            if parent[j as usize] != NONE {
                count[parent[j as usize] as usize] += count[j as usize];
            }
        }
        count.into_iter().map(|c| c as u32).collect()
    }

    /// Entries, flops and tree height of L. Cost: nearly O(n + |E|).
    pub fn fill(&self) -> Fill {
        let parent = self.elimination_tree();
        let counts = self.column_counts(&parent, &postorder(&parent));
        let mut depth = vec![1_u32; parent.len()];
        for k in (0..parent.len()).rev().filter(|&k| parent[k] != NONE) {
            depth[k] = depth[parent[k] as usize] + 1;
        }
        Fill {
            entries: counts.iter().map(|&c| u64::from(c)).sum(),
            flops: counts.iter().map(|&c| u128::from(c) * u128::from(c)).sum(),
            height: depth.into_iter().max().unwrap_or(0),
        }
    }
}

/// The inverse permutation: `inverse(order)[order[k]] == k`.
///
/// # Panics
/// If `order` holds an index that is not below its length.
pub fn inverse(order: &[u32]) -> Vec<u32> {
    let mut position = vec![0; order.len()];
    for (k, &v) in order.iter().enumerate() {
        position[v as usize] = k as u32;
    }
    position
}

/// A postorder of a forest given by parents with `parent[k] > k`: children before parents, every subtree contiguous,
/// siblings ascending. Returns the nodes in that order. Cost: O(n).
pub fn postorder(parent: &[u32]) -> Vec<u32> {
    let n = parent.len();
    let mut size = vec![1_u32; n];
    for k in 0..n {
        if parent[k] != NONE {
            size[parent[k] as usize] += size[k];
        }
    }
    // From the last node down, each subtree takes the last free places of its parent's range.
    let mut end = vec![0_u32; n];
    let mut order = vec![0; n];
    let mut roots_end = n as u32;
    for k in (0..n).rev() {
        let free = if parent[k] == NONE { &mut roots_end } else { &mut end[parent[k] as usize] };
        let place = *free - 1;
        *free -= size[k];
        end[k] = place;
        order[place as usize] = k as u32;
    }
    order
}

/// Per node, the postorder rank of the first node of its subtree, and whether the node is a leaf.
fn first_descendants(parent: &[u32], postorder: &[u32]) -> Vec<(u32, bool)> {
    let mut first = vec![(NONE, true); parent.len()];
    for (rank, &j) in postorder.iter().enumerate() {
        if first[j as usize].0 == NONE {
            first[j as usize].0 = rank as u32;
        }
        if parent[j as usize] != NONE {
            let (own, up) = (first[j as usize].0, &mut first[parent[j as usize] as usize]);
            *up = (up.0.min(own), false);
        }
    }
    first
}

/// The root of the set of `at`, halving the path on the way.
fn find(set: &mut [u32], mut at: u32) -> u32 {
    while set[at as usize] != at {
        let up = set[set[at as usize] as usize];
        set[at as usize] = up;
        at = up;
    }
    at
}
