//! Supernodes: groups of columns of L that are stored and processed as one dense block.
//!
//! Columns whose patterns are nested without gaps form *chains* of the elimination tree and are grouped at no cost
//! (C. Ashcraft and R. Grimes, "The influence of relaxed supernode partitions on the multifrontal method", ACM TOMS 15,
//! 1989, for this and the relaxation). Small groups are then merged with their parents wherever the stored zeros cost
//! less than what the sweeps spend on a group and on each of its rows, whatever its width.
use crate::ordering::{Graph, NONE, Pattern, postorder};

/// What a sweep pair spends on a group of `width` columns and `below` rows, in units of one stored entry.
///
/// Entries: `width * below` in each sweep, and the `width^2` entries of the inverted pivot block once. The two constants
/// were chosen by counting: on meshes of 50 and 306 thousand triangles the sweeps' instructions are within 1% of their
/// minimum from (4, 80) to (8, 160), while the factor grows by 11%.
fn sweep_cost(width: u64, below: u64) -> u64 {
    /// Reading an index, loading and storing the vector of a row: as long as about two entries, in each sweep.
    const PER_ROW: u64 = 4;
    /// Branch mispredictions and start-up of the loops over a group, both sweeps.
    const PER_GROUP: u64 = 80;
    width * width + 2 * width * below + PER_ROW * below + PER_GROUP
}

/// The tree of column groups of L under an elimination order.
pub struct Supernodes {
    /// Columns (positions of the elimination order) of all groups, group after group, ascending within a group.
    pub columns: Vec<u32>,
    /// Group s owns `columns[starts[s]..starts[s + 1]]`; groups stand in a topological order, children first.
    pub starts: Vec<u32>,
    /// Number of rows of L below the columns of each group.
    pub below: Vec<u32>,
    /// Number of matrix entries on and below the diagonal in the columns of each group.
    pub entries: Vec<u32>,
    /// Parent group, larger than the group itself; [`NONE`] for a root.
    pub parent: Vec<u32>,
}

impl Supernodes {
    /// Groups the columns of the factor of `graph` eliminated in `order`. Cost: nearly O(n + |E|).
    pub fn new(graph: &Graph, order: &[u32]) -> Self {
        Self::with_cost(graph, order, sweep_cost)
    }

    /// As [`new`](Self::new), for sweeps that spend `cost(width, below)` on a group.
    pub fn with_cost(graph: &Graph, order: &[u32], cost: impl Fn(u64, u64) -> u64 + Copy) -> Self {
        let pattern = Pattern::new(graph, order);
        let parent = pattern.elimination_tree();
        let counts = pattern.column_counts(&parent, &postorder(&parent));
        let mut groups = Chains::new(&parent, &counts);
        groups.relax(cost);
        groups.finish(&pattern)
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// Number of columns of group `s`.
    pub fn width(&self, s: usize) -> u32 {
        self.starts[s + 1] - self.starts[s]
    }

    /// Sweep cost of the whole factor in stored entries.
    pub fn total_cost(&self) -> u64 {
        (0..self.len()).map(|s| self.cost(s)).sum()
    }

    /// Sweep cost of group `s` in stored entries: the weight of a task.
    pub fn cost(&self, s: usize) -> u64 {
        sweep_cost(u64::from(self.width(s)), u64::from(self.below[s]))
    }
}

/// Groups under construction; a merged group points to the one that swallowed it.
struct Chains {
    /// Chain of every column.
    chain: Vec<u32>,
    width: Vec<u32>,
    below: Vec<u32>,
    parent: Vec<u32>,
    into: Vec<u32>,
}

impl Chains {
    /// A column continues the chain of a child whose pattern is its own plus the child.
    fn new(parent: &[u32], counts: &[u32]) -> Self {
        let n = parent.len();
        let mut continued = vec![NONE; n]; // per column, the child whose chain it continues
        for j in 0..n {
            let p = parent[j];
            if p != NONE && counts[j] == counts[p as usize] + 1 {
                continued[p as usize] = j as u32;
            }
        }
        let is_top = |j: usize| parent[j] == NONE || continued[parent[j] as usize] != j as u32;
        let mut chain = vec![0; n];
        let (mut width, mut below, mut parents) = (Vec::new(), Vec::new(), Vec::new());
        let mut next = (0..n).filter(|&j| is_top(j)).count() as u32;
        let chains = next as usize;
        // From the roots down, numbers fall: parents get larger numbers than their children.
        for j in (0..n).rev() {
            if is_top(j) {
                next -= 1;
                chain[j] = next;
                width.push(1);
                below.push(counts[j] - 1);
                parents.push(if parent[j] == NONE { NONE } else { chain[parent[j] as usize] });
            } else {
                chain[j] = chain[parent[j] as usize];
                width[chains - 1 - chain[j] as usize] += 1;
            }
        }
        width.reverse();
        below.reverse();
        parents.reverse();
        Self { chain, width, below, parent: parents, into: (0..chains as u32).collect() }
    }

    /// Merges children into parents, bottom up, where that lowers the sweep cost.
    fn relax(&mut self, cost: impl Fn(u64, u64) -> u64 + Copy) {
        let (starts, children) = children(&self.parent);
        let mut candidates = Vec::new();
        for p in 0..self.width.len() {
            candidates.clear();
            let own = &children[starts[p] as usize..starts[p + 1] as usize];
            candidates.extend(own.iter().map(|&c| (self.gain(c, p, cost), c)));
            candidates.sort_unstable_by_key(|&(gain, c)| (std::cmp::Reverse(gain), c));
            for &(_, c) in &candidates {
                if self.gain(c, p, cost) > 0 {
                    self.width[p] += self.width[c as usize];
                    self.into[c as usize] = p as u32;
                }
            }
        }
    }

    /// How much cheaper the sweeps get when group `c` is merged into its parent `p`.
    fn gain(&self, c: u32, p: usize, cost: impl Fn(u64, u64) -> u64 + Copy) -> i64 {
        let of = |width: u32, below: u32| cost(u64::from(width), u64::from(below)) as i64;
        let (wc, rc) = (self.width[c as usize], self.below[c as usize]);
        let (wp, rp) = (self.width[p], self.below[p]);
        of(wc, rc) + of(wp, rp) - of(wc + wp, rp)
    }

    /// Renumbers the surviving groups and lists their columns.
    fn finish(mut self, pattern: &Pattern) -> Supernodes {
        let chains = self.into.len();
        // Parents have larger numbers, so from the top down every target is resolved already.
        for c in (0..chains).rev() {
            self.into[c] = self.into[self.into[c] as usize];
        }
        let mut number = vec![NONE; chains];
        let mut groups = 0;
        for c in 0..chains {
            if self.into[c] == c as u32 {
                number[c] = groups;
                groups += 1;
            }
        }
        let group_of = |chain: u32| number[self.into[chain as usize] as usize];
        let (mut starts, mut below, mut parent) = (vec![0], Vec::new(), Vec::new());
        for c in (0..chains).filter(|&c| self.into[c] == c as u32) {
            starts.push(starts[starts.len() - 1] + self.width[c]);
            below.push(self.below[c]);
            parent.push(if self.parent[c] == NONE { NONE } else { group_of(self.parent[c]) });
        }
        let mut next: Vec<u32> = starts[..groups as usize].to_vec();
        let (mut columns, mut entries) = (vec![0; self.chain.len()], vec![0; groups as usize]);
        for (j, &chain) in self.chain.iter().enumerate() {
            let group = group_of(chain) as usize;
            columns[next[group] as usize] = j as u32;
            next[group] += 1;
            entries[group] += 1 + pattern.later(j).len() as u32;
        }
        Supernodes { columns, starts, below, entries, parent }
    }
}

/// Children of every node of a forest given by parents, ascending: starts and lists.
pub fn children(parent: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0; parent.len() + 1];
    for &p in parent.iter().filter(|&&p| p != NONE) {
        starts[p as usize + 1] += 1;
    }
    for k in 0..parent.len() {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut lists = vec![0; starts[parent.len()] as usize];
    for (c, &p) in parent.iter().enumerate().filter(|(_, p)| **p != NONE) {
        lists[next[p as usize] as usize] = c as u32;
        next[p as usize] += 1;
    }
    (starts, lists)
}
