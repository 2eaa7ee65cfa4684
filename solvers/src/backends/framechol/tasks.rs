//! Which thread works on which subtrees of the supernodal tree, and what is left for the top.
use super::supernodes::children;
use crate::ordering::NONE;
use std::collections::BinaryHeap;

/// Assignment of every node to a part: threads 0 to T - 1 own whole subtrees, part T is the top of the tree.
pub struct Tasks {
    /// Part of every node.
    pub part: Vec<u32>,
    /// Number of threads T.
    pub threads: usize,
}

/// Subtrees below this share of a thread's work are not split further: the top would grow for nothing.
const FINEST_SHARE: u64 = 16;
/// The most subtrees ever looked at for one thread.
const MOST_SUBTREES: usize = 32;

impl Tasks {
    /// Everything on one thread: no top.
    pub fn serial(nodes: usize) -> Self {
        Self { part: vec![0; nodes], threads: 1 }
    }

    /// Splits the tree from the top: the heaviest subtree is opened again and again, its root joins the top. Of all
    /// states on the way the one with the least critical path (top plus most loaded thread) is taken.
    pub fn balanced(parent: &[u32], weight: &[u64], threads: usize) -> Self {
        let nodes = parent.len();
        let mut subtree = weight.to_vec();
        for s in 0..nodes {
            if parent[s] != NONE {
                subtree[parent[s] as usize] += subtree[s];
            }
        }
        let total: u64 = weight.iter().sum();
        let (starts, lists) = children(parent);
        let mut open: BinaryHeap<(u64, u32)> =
            (0..nodes).filter(|&s| parent[s] == NONE).map(|s| (subtree[s], s as u32)).collect();
        let (mut top, mut top_weight) = (Vec::new(), 0);
        let mut best = (critical_path(&open, threads, 0), 0);
        while let Some(&(heaviest, s)) = open.peek() {
            let enough = top.len() >= MOST_SUBTREES * threads;
            if heaviest * FINEST_SHARE * threads as u64 <= total || enough {
                break;
            }
            open.pop();
            top.push(s);
            top_weight += weight[s as usize];
            let own = &lists[starts[s as usize] as usize..starts[s as usize + 1] as usize];
            open.extend(own.iter().map(|&c| (subtree[c as usize], c)));
            let path = critical_path(&open, threads, top_weight);
            if path < best.0 {
                best = (path, top.len());
            }
        }
        top.truncate(best.1);
        Self::assign(parent, &subtree, &top, threads)
    }

    /// Largest subtree first to the least loaded thread, then downwards to all nodes.
    fn assign(parent: &[u32], subtree: &[u64], top: &[u32], threads: usize) -> Self {
        let nodes = parent.len();
        let top_part = threads as u32;
        let mut part = vec![NONE; nodes];
        for &s in top {
            part[s as usize] = top_part;
        }
        let is_root =
            |s: usize| part[s] == NONE && (parent[s] == NONE || part[parent[s] as usize] == top_part);
        let mut roots: Vec<u32> = (0..nodes).filter(|&s| is_root(s)).map(|s| s as u32).collect();
        roots.sort_by_key(|&s| (std::cmp::Reverse(subtree[s as usize]), s));
        let mut load = vec![0; threads];
        for s in roots {
            let least = (0..threads).min_by_key(|&t| load[t]).expect("at least one thread");
            load[least] += subtree[s as usize];
            part[s as usize] = least as u32;
        }
        for s in (0..nodes).rev() {
            if part[s] == NONE {
                part[s] = part[parent[s] as usize];
            }
        }
        Self { part, threads }
    }
}

/// Weight of the top and of the most loaded thread when subtrees go, largest first, to the least loaded one.
fn critical_path(open: &BinaryHeap<(u64, u32)>, threads: usize, top: u64) -> u64 {
    let mut weights: Vec<u64> = open.iter().map(|e| e.0).collect();
    weights.sort_unstable_by(|a, b| b.cmp(a));
    let mut load = vec![0_u64; threads];
    for w in weights {
        *load.iter_mut().min().expect("at least one thread") += w;
    }
    top + load.into_iter().max().unwrap_or(0)
}
