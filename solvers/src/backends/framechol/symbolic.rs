//! Symbolic factorisation: elimination order, supernodes, their rows, and where every matrix entry goes.
use super::front::{BLOCK, FrontShape};
use super::supernodes::{Supernodes, children};
use super::tasks::Tasks;
use crate::ordering::{NONE, inverse};
use crate::sparse::SymmetricCsr;
use std::sync::Arc;

/// Everything about the factor that does not depend on values.
///
/// Elimination positions are grouped by parts: those of thread 0's subtrees, of thread 1's, ..., then the top of the
/// tree. Every part has its own *local* numbering of rows: first its own pivots, then the rows of the top. A thread so
/// works in one contiguous slab and never touches another thread's rows; its share of the top is a private copy. The
/// top itself is numbered like the end of thread 0's slab.
pub struct Symbolic {
    /// `order[k]` is the matrix row eliminated k-th.
    pub order: Arc<[u32]>,
    /// One part per thread, then the top where there is more than one thread.
    pub parts: Vec<Part>,
    /// Entries of L in its supernodal form without padding: pivot triangles and rectangles below.
    pub nonzeros: u64,
    /// Multiplications and additions of the numeric factorisation on that form.
    pub flops: u64,
}

/// The supernodes of some whole subtrees, or of the top of the tree, in postorder.
pub struct Part {
    /// First elimination position; the part's pivots follow on.
    pub first_position: u32,
    /// Local number of the first pivot.
    pub first_local: u32,
    /// One past the last local number: the length of the slab.
    pub slab: u32,
    /// Supernode s has the pivots `starts[s]..starts[s + 1]` (local); ascending, no gaps.
    pub starts: Vec<u32>,
    /// Supernode s has the rows `rows[row_starts[s]..row_starts[s + 1]]` below its pivots.
    pub row_starts: Vec<u32>,
    /// Local numbers, ascending within a supernode.
    pub rows: Vec<u32>,
    /// Parent supernode in the same part, [`NONE`] where there is none or where it belongs to the top.
    pub parent: Vec<u32>,
    /// Number of children in the same part.
    pub children: Vec<u32>,
    /// Top only: children of supernode s in the threads' parts, as (part, supernode).
    pub adopted: Vec<Vec<(u32, u32)>>,
    /// Matrix entries of supernode s: `entries[entry_starts[s]..entry_starts[s + 1]]`.
    pub entry_starts: Vec<u32>,
    /// (stored entry of the matrix, place in the front's panel).
    pub entries: Vec<(u32, u32)>,
    /// Stored entry of the diagonal of every pivot.
    pub diagonal: Vec<u32>,
}

impl Part {
    /// Number of supernodes.
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// Number of pivots.
    pub fn pivots(&self) -> usize {
        (self.starts[self.len()] - self.first_local) as usize
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let words = self.starts.len() + self.row_starts.len() + self.rows.len() + self.entry_starts.len();
        (4 * (words + self.parent.len() + self.children.len() + self.diagonal.len())
            + size_of_val(&self.entries[..])) as u64
    }

    /// Rows of supernode `s` below its pivots.
    pub fn rows(&self, s: usize) -> &[u32] {
        &self.rows[self.row_starts[s] as usize..self.row_starts[s + 1] as usize]
    }

    /// Size of the front of supernode `s`.
    pub fn shape(&self, s: usize) -> FrontShape {
        FrontShape {
            width: (self.starts[s + 1] - self.starts[s]) as usize,
            below: (self.row_starts[s + 1] - self.row_starts[s]) as usize,
        }
    }
}

impl Symbolic {
    /// Analyses the pattern of `matrix`, whose columns eliminated in (about) `order` are grouped in `groups`, for `threads`
    /// threads.
    ///
    /// The order in use, [`Symbolic::order`], is an equivalent one: same fill, subtrees together.
    pub fn new(matrix: &SymmetricCsr, groups: &Supernodes, order: &[u32], threads: usize) -> Self {
        let tasks = if threads == 1 {
            Tasks::serial(groups.len())
        } else {
            let cost: Vec<u64> = (0..groups.len()).map(|s| groups.cost(s)).collect();
            Tasks::balanced(&groups.parent, &cost, threads)
        };
        let numbering = Numbering::new(groups, &tasks, order);
        let structure = Structure::new(matrix, groups, &numbering);
        let parts = (0..numbering.parts.len())
            .map(|part| structure.part(part, groups, &tasks, &numbering))
            .collect::<Vec<_>>();
        let shapes = || parts.iter().flat_map(|p| (0..p.len()).map(|s| p.shape(s)));
        Self {
            nonzeros: shapes().map(|f| f.entries()).sum(),
            flops: shapes().map(|f| f.flops()).sum(),
            order: numbering.order.into(),
            parts,
        }
    }
}

/// Final numbers of groups and columns.
struct Numbering {
    /// Row eliminated k-th.
    order: Vec<u32>,
    /// Groups of every part in postorder.
    parts: Vec<Vec<u32>>,
    /// First position of every part, and n.
    starts: Vec<u32>,
    /// First position of every group.
    first: Vec<u32>,
    /// Index of every group within its part.
    index: Vec<u32>,
}

impl Numbering {
    fn new(groups: &Supernodes, tasks: &Tasks, order: &[u32]) -> Self {
        let count = if tasks.threads == 1 { 1 } else { tasks.threads + 1 };
        let mut parts = vec![Vec::new(); count];
        let mut index = vec![0; groups.len()];
        for s in lean_postorder(groups) {
            let part = &mut parts[tasks.part[s as usize] as usize];
            index[s as usize] = part.len() as u32;
            part.push(s);
        }
        let mut final_order = Vec::with_capacity(order.len());
        let (mut starts, mut first) = (Vec::new(), vec![0; groups.len()]);
        for part in &parts {
            starts.push(final_order.len() as u32);
            for &s in part {
                first[s as usize] = final_order.len() as u32;
                let own = groups.starts[s as usize] as usize..groups.starts[s as usize + 1] as usize;
                final_order.extend(groups.columns[own].iter().map(|&j| order[j as usize]));
            }
        }
        starts.push(final_order.len() as u32);
        Self { order: final_order, parts, starts, first, index }
    }

    /// Local number of position `k` in `part`.
    fn local(&self, part: usize, k: u32) -> u32 {
        let top = self.starts.len() - 2;
        let length = |p: usize| self.starts[p + 1] - self.starts[p];
        if part < top && k < self.starts[top] {
            k - self.starts[part]
        } else if part < top {
            k - self.starts[top] + length(part)
        } else if top == 0 {
            k
        } else {
            k - self.starts[top] + length(0)
        }
    }
}

/// A postorder in which the update matrices waiting on a stack take little room: of the children, the one comes first
/// that needs much room while it is worked on and leaves little (J. W. H. Liu, "On the storage requirement in the
/// out-of-core multifrontal method", ACM TOMS 12, 1986).
fn lean_postorder(groups: &Supernodes) -> Vec<u32> {
    let (starts, mut lists) = children(&groups.parent);
    let square = |x: u32| u64::from(x) * u64::from(x) / 2;
    let mut peak = vec![0_u64; groups.len()];
    for s in 0..groups.len() {
        let own = &mut lists[starts[s] as usize..starts[s + 1] as usize];
        own.sort_by_key(|&c| (std::cmp::Reverse(peak[c as usize] - square(groups.below[c as usize])), c));
        let (mut waiting, mut most) = (0, 0);
        for &c in own.iter() {
            most = most.max(waiting + peak[c as usize]);
            waiting += square(groups.below[c as usize]);
        }
        peak[s] = most.max(waiting + square(groups.width(s) + groups.below[s]));
    }
    let mut order = Vec::with_capacity(groups.len());
    let mut stack: Vec<u32> =
        (0..groups.len()).filter(|&s| groups.parent[s] == NONE).map(|s| s as u32).collect();
    // Parents before children, last child first: reversed, this is a postorder.
    while let Some(s) = stack.pop() {
        order.push(s);
        stack.extend(&lists[starts[s as usize] as usize..starts[s as usize + 1] as usize]);
    }
    order.reverse();
    order
}

/// Rows of all groups and entries of all columns, by elimination position.
struct Structure {
    /// Per group, its rows below the pivots: positions, ascending.
    rows: Vec<Vec<u32>>,
    /// Entries of the matrix by column: starts, then (row, stored entry).
    column_starts: Vec<u32>,
    entries: Vec<(u32, u32)>,
}

impl Structure {
    fn new(matrix: &SymmetricCsr, groups: &Supernodes, numbering: &Numbering) -> Self {
        let (column_starts, entries) = entries_by_column(matrix, &numbering.order);
        let (child_starts, child_lists) = children(&groups.parent);
        let mut rows: Vec<Vec<u32>> = vec![Vec::new(); groups.len()];
        let mut seen = vec![NONE; matrix.n()];
        for &s in numbering.parts.iter().flatten() {
            let first = numbering.first[s as usize];
            let end = first + groups.width(s as usize);
            let mut own = Vec::with_capacity(groups.below[s as usize] as usize);
            let mut add = |row: u32| {
                if row >= end && std::mem::replace(&mut seen[row as usize], s) != s {
                    own.push(row);
                }
            };
            let range = column_starts[first as usize] as usize..column_starts[end as usize] as usize;
            entries[range].iter().for_each(|&(row, _)| add(row));
            for &c in &child_lists[child_starts[s as usize] as usize..child_starts[s as usize + 1] as usize] {
                rows[c as usize].iter().for_each(|&row| add(row));
            }
            own.sort_unstable();
            debug_assert_eq!(own.len(), groups.below[s as usize] as usize, "group {s}");
            rows[s as usize] = own;
        }
        Self { rows, column_starts, entries }
    }

    /// Cuts out one part, in its local numbers.
    fn part(&self, part: usize, groups: &Supernodes, tasks: &Tasks, numbering: &Numbering) -> Part {
        let own = &numbering.parts[part];
        let first_position = numbering.starts[part];
        let local = |k: u32| numbering.local(part, k);
        let is_top = tasks.threads > 1 && part == tasks.threads;
        let mut out = Part {
            first_position,
            first_local: local(first_position),
            slab: local(numbering.order.len() as u32),
            starts: vec![local(first_position)],
            row_starts: vec![0],
            rows: Vec::with_capacity(own.iter().map(|&s| self.rows[s as usize].len()).sum()),
            parent: Vec::with_capacity(own.len()),
            children: vec![0; own.len()],
            adopted: if is_top { vec![Vec::new(); own.len()] } else { Vec::new() },
            entry_starts: vec![0],
            entries: Vec::new(),
            diagonal: Vec::new(),
        };
        let mut front_row = vec![0; numbering.order.len()];
        for (i, &s) in own.iter().enumerate() {
            let s = s as usize;
            let (first, width) = (numbering.first[s], groups.width(s));
            out.starts.push(local(first) + width);
            out.rows.extend(self.rows[s].iter().map(|&k| local(k)));
            out.row_starts.push(out.rows.len() as u32);
            let parent = groups.parent[s];
            let inside = parent != NONE && tasks.part[parent as usize] as usize == part;
            out.parent.push(if inside { numbering.index[parent as usize] } else { NONE });
            if inside {
                out.children[numbering.index[parent as usize] as usize] += 1;
            }
            self.place_entries(s, first, width, &mut front_row, &mut out);
            debug_assert_eq!(out.shape(i).below, self.rows[s].len());
        }
        if is_top {
            adopt(&mut out, groups, tasks, numbering);
        }
        out
    }

    /// Where the matrix entries of group `s` go in its panel.
    fn place_entries(&self, s: usize, first: u32, width: u32, front_row: &mut [u32], out: &mut Part) {
        for (i, &row) in self.rows[s].iter().enumerate() {
            front_row[row as usize] = i as u32;
        }
        let shape = FrontShape { width: width as usize, below: self.rows[s].len() };
        for j in 0..width {
            let column = (first + j) as usize;
            let range = self.column_starts[column] as usize..self.column_starts[column + 1] as usize;
            for &(row, source) in &self.entries[range] {
                if row as usize == column {
                    out.diagonal.push(source);
                }
                let slot = if row < first + width {
                    (row - first) as usize
                } else {
                    shape.pivot_blocks() * BLOCK + front_row[row as usize] as usize
                };
                out.entries.push((source, shape.panel_index(slot, j as usize) as u32));
            }
        }
        out.entry_starts.push(out.entries.len() as u32);
    }
}

/// Records which supernodes of the threads' parts have their parent in the top.
fn adopt(top: &mut Part, groups: &Supernodes, tasks: &Tasks, numbering: &Numbering) {
    for s in 0..groups.len() {
        let (part, parent) = (tasks.part[s] as usize, groups.parent[s]);
        if part < tasks.threads && parent != NONE && tasks.part[parent as usize] as usize == tasks.threads {
            top.adopted[numbering.index[parent as usize] as usize].push((part as u32, numbering.index[s]));
        }
    }
}

/// The lower triangle of the permuted matrix by columns: starts, and (row position, stored entry) in each column.
fn entries_by_column(matrix: &SymmetricCsr, order: &[u32]) -> (Vec<u32>, Vec<(u32, u32)>) {
    let n = matrix.n();
    let position = inverse(order);
    let mut starts = vec![0_u32; n + 1];
    for i in 0..n {
        for &j in matrix.row(i).0 {
            starts[position[i].min(position[j as usize]) as usize + 1] += 1;
        }
    }
    for k in 0..n {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut entries = vec![(0, 0); matrix.stored()];
    for i in 0..n {
        for entry in matrix.row_range(i) {
            let (a, b) = (position[i], position[matrix.columns()[entry] as usize]);
            let slot = &mut next[a.min(b) as usize];
            entries[*slot as usize] = (a.max(b), entry as u32);
            *slot += 1;
        }
    }
    (starts, entries)
}
