//! Coarsening: small connected patches of vertices become the vertices of a smaller graph.
use super::fill::NONE;
use rayon::prelude::*;
use std::ops::Range;

/// A graph with vertex weights, by reference: what bisection and refinement read.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    /// n + 1 positions in `neighbours`.
    pub starts: &'a [u32],
    /// Neighbour lists in any order, without loops and repetitions.
    pub neighbours: &'a [u32],
    /// Per vertex, how many vertices of the finest graph it stands for; empty where each stands for itself.
    pub weights: &'a [u32],
}

impl<'a> View<'a> {
    pub fn n(&self) -> usize {
        self.starts.len() - 1
    }

    #[inline]
    pub fn neighbours(&self, v: u32) -> &'a [u32] {
        &self.neighbours[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }

    #[inline]
    pub fn weight(&self, v: u32) -> u32 {
        if self.weights.is_empty() { 1 } else { self.weights[v as usize] }
    }
}

/// One level of the hierarchy.
#[derive(Default)]
pub(super) struct Level {
    pub starts: Vec<u32>,
    pub neighbours: Vec<u32>,
    pub weights: Vec<u32>,
    /// Per list entry, the number of finest edges it stands for.
    pub edge_weights: Vec<u32>,
    /// Per vertex of the next finer graph, the patch (vertex of this graph) it belongs to.
    pub patch: Vec<u32>,
}

impl Level {
    pub fn view(&self) -> View<'_> {
        View { starts: &self.starts, neighbours: &self.neighbours, weights: &self.weights }
    }
}

/// A patch takes no further vertex beyond this many times the average weight of its vertices: about a star of a
/// triangle mesh (a vertex and its six neighbours), so that patches stay round and of similar size.
pub(super) const PATCH_SIZE: u64 = 4;

/// The next coarser level of `fine`. `edge_weights` is empty where every edge counts 1. Cost: O(n + |E|).
pub(super) fn coarsen(fine: View<'_>, edge_weights: &[u32], patch_size: u64, visit: &[u32]) -> Level {
    let (patch, count) = patches(fine, edge_weights, patch_size, visit);
    contract(fine, edge_weights, patch, count)
}

/// Partitions the vertices into connected patches: each free vertex takes its free neighbours; one without any
/// joins the neighbouring patch with which it shares most edges, unless that is full. Returns the patch of each
/// vertex and the number of patches.
fn patches(fine: View<'_>, edge_weights: &[u32], patch_size: u64, visit: &[u32]) -> (Vec<u32>, usize) {
    let total: u64 = (0..fine.n() as u32).map(|v| u64::from(fine.weight(v))).sum();
    let limit = (patch_size * total).div_ceil(fine.n().max(1) as u64);
    let mut patch = vec![NONE; fine.n()];
    let mut sizes: Vec<u64> = Vec::new();
    let mut free: Vec<(u32, u32)> = Vec::new();
    for k in 0..fine.n() as u32 {
        let v = visit.get(k as usize).copied().unwrap_or(k);
        if patch[v as usize] != NONE {
            continue;
        }
        let id = sizes.len() as u32;
        let own = u64::from(fine.weight(v));
        let mut size = own;
        free.clear();
        for at in fine.starts[v as usize] as usize..fine.starts[v as usize + 1] as usize {
            let w = fine.neighbours[at];
            if patch[w as usize] == NONE {
                free.push((edge_weights.get(at).copied().unwrap_or(1), w));
            }
        }
        if !edge_weights.is_empty() {
            free.sort_by(|a, b| {
                (u64::from(b.0) * u64::from(fine.weight(a.1)))
                    .cmp(&(u64::from(a.0) * u64::from(fine.weight(b.1))))
            });
        }
        for &(_, w) in &free {
            let grown = size + u64::from(fine.weight(w));
            if patch[w as usize] == NONE && grown <= limit {
                patch[w as usize] = id;
                size = grown;
            }
        }
        if size == own
            && let Some(host) =
                host(fine, edge_weights, &patch, v).filter(|&p| sizes[p as usize] + own <= limit)
        {
            patch[v as usize] = host;
            sizes[host as usize] += own;
            continue;
        }
        patch[v as usize] = id;
        sizes.push(size);
    }
    (patch, sizes.len())
}

/// The neighbouring patch that shares most edges with v.
fn host(fine: View<'_>, edge_weights: &[u32], patch: &[u32], v: u32) -> Option<u32> {
    let range = fine.starts[v as usize] as usize..fine.starts[v as usize + 1] as usize;
    let mut best: Option<(u32, u32)> = None;
    for at in range.clone() {
        let p = patch[fine.neighbours[at] as usize];
        if p == NONE {
            continue;
        }
        let shared = range
            .clone()
            .filter(|&b| patch[fine.neighbours[b] as usize] == p)
            .map(|b| edge_weights.get(b).copied().unwrap_or(1))
            .sum();
        if best.is_none_or(|(most, _)| shared > most) {
            best = Some((shared, p));
        }
    }
    best.map(|(_, p)| p)
}

/// Patches that one thread contracts at a time; smaller graphs are not worth a second thread.
const PIECE: usize = 4096;

/// The graph of the patches, with summed vertex and edge weights.
fn contract(fine: View<'_>, edge_weights: &[u32], patch: Vec<u32>, count: usize) -> Level {
    let (first, members) = group(&patch, count);
    let rows = |patches: Range<usize>| {
        let mut level = Level::default();
        let mut entry_of = vec![NONE; count]; // where the current patch lists this neighbour
        for p in patches {
            let row = level.neighbours.len();
            let mut weight = 0;
            for &v in &members[first[p] as usize..first[p + 1] as usize] {
                weight += fine.weight(v);
                for at in fine.starts[v as usize] as usize..fine.starts[v as usize + 1] as usize {
                    let q = patch[fine.neighbours[at] as usize];
                    if q as usize == p {
                        continue;
                    }
                    let edge = edge_weights.get(at).copied().unwrap_or(1);
                    let known = entry_of[q as usize];
                    if known != NONE && known as usize >= row {
                        level.edge_weights[known as usize] += edge;
                    } else {
                        entry_of[q as usize] = level.neighbours.len() as u32;
                        level.neighbours.push(q);
                        level.edge_weights.push(edge);
                    }
                }
            }
            level.weights.push(weight);
            level.starts.push(level.neighbours.len() as u32);
        }
        level
    };
    let pieces: Vec<Level> = if count <= PIECE {
        vec![rows(0..count)]
    } else {
        let starts = (0..count.div_ceil(PIECE)).into_par_iter();
        starts.map(|piece| rows(piece * PIECE..count.min((piece + 1) * PIECE))).collect()
    };
    let mut level = Level { starts: Vec::with_capacity(count + 1), patch, ..Level::default() };
    level.starts.push(0);
    for piece in pieces {
        let shift = level.neighbours.len() as u32;
        level.starts.extend(piece.starts.iter().map(|start| start + shift));
        level.neighbours.extend(piece.neighbours);
        level.edge_weights.extend(piece.edge_weights);
        level.weights.extend(piece.weights);
    }
    level
}

/// The items of every group, by counting sort: items of group g are `members[first[g]..first[g + 1]]`, ascending.
pub(super) fn group(group_of: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0_u32; count + 1];
    for &g in group_of {
        first[g as usize + 1] += 1;
    }
    for g in 0..count {
        first[g + 1] += first[g];
    }
    let mut next = first.clone();
    let mut members = vec![0; group_of.len()];
    for (item, &g) in group_of.iter().enumerate() {
        members[next[g as usize] as usize] = item as u32;
        next[g as usize] += 1;
    }
    (first, members)
}
