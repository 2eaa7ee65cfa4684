//! Exact minimum degree for the small leaves of a dissection, on bit sets.
//!
//! A leaf of a hundred vertices and its neighbours outside fit a few machine words, so the filled graph is kept as
//! it is: elimination is an "or" of rows, a degree is a population count. No quotient graph, no approximation.
use super::Graph;
use super::coarsen::View;
use super::minimum_degree::minimum_degree_order;
use super::refine::{Labels, UNKNOWN};
use std::sync::atomic::Ordering::Relaxed;

/// Workspace for one leaf after the other.
#[derive(Default)]
pub(super) struct LeafOrderer {
    /// The neighbours of the leaf outside it, ascending.
    halo: Vec<u32>,
    /// W words per vertex of the leaf: its neighbours in the filled graph, the leaf's vertices first, then the halo.
    rows: Vec<u64>,
    /// Set bits per row; [`GONE`] for eliminated vertices.
    degrees: Vec<u16>,
    order: Vec<u32>,
}

/// Degree of an eliminated vertex: above every degree.
const GONE: u16 = u16::MAX;

impl LeafOrderer {
    /// Reorders `members`, the vertices of one leaf, by minimum degree. The degree counts the neighbours outside
    /// the leaf too (the *halo*: separator vertices, eliminated later), because L fills in their rows just the same.
    /// `index` holds [`UNKNOWN`] for the members, and again on return. Leaves that do not fit 512 bits (a dissection
    /// found nothing to cut) are ordered by the approximate minimum degree, without halo.
    pub fn order(&mut self, graph: View<'_>, members: &mut [u32], index: &Labels) {
        for (k, &v) in members.iter().enumerate() {
            index[v as usize].store(k as u32, Relaxed);
        }
        self.find_halo(graph, members, index);
        match (members.len() + self.halo.len()).div_ceil(64) {
            0..=1 => self.eliminate::<1>(graph, members, index),
            2 => self.eliminate::<2>(graph, members, index),
            3 => self.eliminate::<3>(graph, members, index),
            4 => self.eliminate::<4>(graph, members, index),
            5..=8 => self.eliminate::<8>(graph, members, index),
            _ => self.order = minimum_degree_order(&induced(graph, members, index)),
        }
        for &v in members.iter() {
            index[v as usize].store(UNKNOWN, Relaxed);
        }
        for k in &mut self.order {
            *k = members[*k as usize];
        }
        members.copy_from_slice(&self.order);
    }

    fn find_halo(&mut self, graph: View<'_>, members: &[u32], index: &Labels) {
        self.halo.clear();
        for &v in members {
            let outside = |&&w: &&u32| index[w as usize].load(Relaxed) == UNKNOWN;
            self.halo.extend(graph.neighbours(v).iter().filter(outside));
        }
        self.halo.sort_unstable();
        self.halo.dedup();
    }

    /// Minimum degree with rows of W words; `order` receives the positions of the members.
    fn eliminate<const W: usize>(&mut self, graph: View<'_>, members: &[u32], index: &Labels) {
        let n = members.len();
        self.rows.clear();
        self.rows.resize(n * W, 0);
        let (rows, _) = self.rows.as_chunks_mut::<W>();
        for (&v, row) in members.iter().zip(&mut *rows) {
            for &w in graph.neighbours(v) {
                let at = match index[w as usize].load(Relaxed) {
                    UNKNOWN => n + self.halo.binary_search(&w).expect("the halo holds every outer neighbour"),
                    inside => inside as usize,
                };
                row[at / 64] |= 1 << (at % 64);
            }
        }
        self.degrees.clear();
        self.degrees.extend(rows.iter().map(count));
        self.order.clear();
        while self.order.len() < n {
            let least = self.degrees.iter().copied().min().expect("vertices are left");
            let pivot = self.degrees.iter().position(|&d| d == least).expect("the minimum is there");
            self.order.push(pivot as u32);
            self.degrees[pivot] = GONE;
            let row = rows[pivot];
            for_each_below(&row, n, |k| {
                let own = &mut rows[k];
                for w in 0..W {
                    own[w] |= row[w];
                }
                clear(own, pivot);
                clear(own, k);
                self.degrees[k] = count(own);
            });
            // A neighbour whose row is now the pivot's would be next anyway; it fills nothing, so nothing is joined.
            let mut gone = [0; W];
            let mut left = least;
            for_each_below(&row, n, |k| {
                if self.degrees[k] + 1 == least {
                    gone[k / 64] |= 1 << (k % 64);
                    self.order.push(k as u32);
                    self.degrees[k] = GONE;
                    left -= 1;
                }
            });
            if left < least {
                for_each_below(&row, n, |k| {
                    if self.degrees[k] != GONE {
                        for w in 0..W {
                            rows[k][w] &= !gone[w];
                        }
                        self.degrees[k] -= least - left;
                    }
                });
            }
        }
    }
}

fn count<const W: usize>(row: &[u64; W]) -> u16 {
    row.iter().map(|word| word.count_ones()).sum::<u32>() as u16
}

fn clear<const W: usize>(row: &mut [u64; W], bit: usize) {
    row[bit / 64] &= !(1 << (bit % 64));
}

/// Calls `visit` for every set bit below n, ascending.
fn for_each_below<const W: usize>(row: &[u64; W], n: usize, mut visit: impl FnMut(usize)) {
    for word in 0..n.div_ceil(64) {
        let mut left = row[word];
        if n < 64 * (word + 1) {
            left &= (1 << (n % 64)) - 1;
        }
        while left != 0 {
            visit(64 * word + left.trailing_zeros() as usize);
            left &= left - 1;
        }
    }
}

/// The graph induced by the members, in their order.
fn induced(graph: View<'_>, members: &[u32], index: &Labels) -> Graph {
    Graph::from_edges(members.len(), || {
        members.iter().enumerate().flat_map(|(k, &v)| {
            let inside = graph.neighbours(v).iter().map(|&w| index[w as usize].load(Relaxed));
            inside.filter(move |&j| j != UNKNOWN && j > k as u32).map(move |j| (k as u32, j))
        })
    })
}
