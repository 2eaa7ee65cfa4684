//! Exact minimum degree for the small leaves of a dissection, on bit sets.
use super::Graph;
use super::coarsen::View;
use super::minimum_degree::minimum_degree_order;
use super::refine::{Labels, UNKNOWN};
use std::sync::atomic::Ordering::Relaxed;

/// Workspace for one leaf after the other.
#[derive(Default)]
pub(super) struct LeafOrderer {
    halo: Vec<u32>,
    degrees: Vec<u16>,
}

/// Most bits of a row: leaves with more vertices and neighbours go to the general minimum degree.
const MOST_BITS: usize = 512;

impl LeafOrderer {
    /// Reorders `members`, the vertices of one leaf, by minimum degree. The degree counts the neighbours outside
    /// the leaf too (the *halo*: separator vertices, eliminated later), because L fills in their rows just the same.
    /// `index` holds [`UNKNOWN`] for the members, and again on return.
    pub fn order(&mut self, graph: View<'_>, members: &mut [u32], index: &Labels) {
        for (k, &v) in members.iter().enumerate() {
            index[v as usize].store(k as u32, Relaxed);
        }
        let inside = |w: u32| index[w as usize].load(Relaxed);
        self.halo.clear();
        for &v in members.iter() {
            self.halo.extend(graph.neighbours(v).iter().filter(|&&w| inside(w) == UNKNOWN));
        }
        self.halo.sort_unstable();
        self.halo.dedup();
        let bits = members.len() + self.halo.len();
        let order = match bits {
            0..=128 => self.eliminate::<2>(graph, members, index),
            129..=192 => self.eliminate::<3>(graph, members, index),
            193..=256 => self.eliminate::<4>(graph, members, index),
            257..=MOST_BITS => self.eliminate::<8>(graph, members, index),
            _ => Self::general(graph, members, index),
        };
        for &v in members.iter() {
            index[v as usize].store(UNKNOWN, Relaxed);
        }
        members.copy_from_slice(&order);
    }

    fn general(graph: View<'_>, members: &[u32], index: &Labels) -> Vec<u32> {
        let inside = Graph::from_edges(members.len(), || {
            members.iter().enumerate().flat_map(|(k, &v)| {
                let later = graph.neighbours(v).iter().map(|&w| index[w as usize].load(Relaxed));
                later.filter(move |&j| j != UNKNOWN && j > k as u32).map(move |j| (k as u32, j))
            })
        });
        minimum_degree_order(&inside).into_iter().map(|k| members[k as usize]).collect()
    }

    fn eliminate<const W: usize>(&mut self, graph: View<'_>, members: &[u32], index: &Labels) -> Vec<u32> {
        let n = members.len();
        let mut rows = vec![[0_u64; W]; n];
        for (k, &v) in members.iter().enumerate() {
            for &w in graph.neighbours(v) {
                let at = match index[w as usize].load(Relaxed) {
                    UNKNOWN => n + self.halo.binary_search(&w).expect("collected above"),
                    inside => inside as usize,
                };
                rows[k][at / 64] |= 1 << (at % 64);
            }
        }
        let weight = |row: &[u64; W]| row.iter().map(|w| w.count_ones()).sum::<u32>() as u16;
        self.degrees.clear();
        self.degrees.extend(rows.iter().map(weight));
        let mut order = Vec::with_capacity(n);
        for _ in 0..n {
            let (mut pivot, mut least) = (0, u16::MAX);
            for (k, &d) in self.degrees.iter().enumerate() {
                if d < least {
                    (pivot, least) = (k, d);
                }
            }
            order.push(members[pivot]);
            self.degrees[pivot] = u16::MAX;
            let row = rows[pivot];
            for word in 0..n.div_ceil(64) {
                let mut left = row[word];
                while left != 0 {
                    let k = 64 * word + left.trailing_zeros() as usize;
                    left &= left - 1;
                    if k >= n {
                        break;
                    }
                    let own = &mut rows[k];
                    for w in 0..W {
                        own[w] |= row[w];
                    }
                    own[pivot / 64] &= !(1 << (pivot % 64));
                    own[k / 64] &= !(1 << (k % 64));
                    self.degrees[k] = weight(own);
                }
            }
        }
        order
    }
}
