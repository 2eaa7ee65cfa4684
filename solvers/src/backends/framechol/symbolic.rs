//! Symbolic factorisation: elimination order, supernodes, their rows, and where every matrix entry goes.
use super::front::{BLOCK, FrontShape};
use super::supernodes::{Supernodes, children};
use super::tasks::Tasks;
use crate::ordering::{Graph, NONE, inverse};
use crate::sparse::SymmetricCsr;
use rayon::prelude::*;
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

/// `first`, and room for `others` more.
fn with_first(first: u32, others: usize) -> Vec<u32> {
    let mut list = Vec::with_capacity(others + 1);
    list.push(first);
    list
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
            + size_of_val(&self.entries[..])
            + size_of_val(&self.adopted[..])
            + self.adopted.iter().map(|children| 8 * children.capacity()).sum::<usize>()) as u64
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
    /// threads. `graph` is that of the matrix. Cost: O(n + |E| + rows of all groups, sorted), the parts in parallel.
    ///
    /// The order in use, [`Symbolic::order`], is an equivalent one: same fill, subtrees together.
    pub fn new(
        matrix: &SymmetricCsr,
        graph: &Graph,
        groups: &Supernodes,
        order: &[u32],
        threads: usize,
    ) -> Self {
        let tasks = if threads == 1 {
            Tasks::serial(groups.len())
        } else {
            let cost: Vec<u64> = (0..groups.len()).map(|s| groups.cost(s)).collect();
            Tasks::balanced(&groups.parent, &cost, threads)
        };
        let numbering = Numbering::new(groups, &tasks, order);
        let position = inverse(&numbering.order);
        let structure = Structure { matrix, graph, groups, tasks: &tasks, numbering: &numbering, position };
        let mut parts: Vec<Part> = if threads == 1 {
            vec![structure.part(0, &[])]
        } else {
            (0..threads).into_par_iter().map(|part| structure.part(part, &[])).collect()
        };
        if threads > 1 {
            parts.push(structure.part(threads, &parts));
        }
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

/// What the parts are cut from.
struct Structure<'a> {
    matrix: &'a SymmetricCsr,
    graph: &'a Graph,
    groups: &'a Supernodes,
    tasks: &'a Tasks,
    numbering: &'a Numbering,
    /// Final position of every matrix row.
    position: Vec<u32>,
}

/// A matrix entry of the supernode at hand.
struct Entry {
    /// Local number of its row.
    row: u32,
    /// Its column among the pivots.
    column: u32,
    /// Stored entry of the matrix.
    source: u32,
}

impl Structure<'_> {
    /// One part, in its local numbers. The top needs those `below` it.
    fn part(&self, part: usize, below: &[Part]) -> Part {
        let Self { groups, numbering, .. } = self;
        let own = &numbering.parts[part];
        let first_position = numbering.starts[part];
        let local = |k: u32| numbering.local(part, k);
        let mut out = Part {
            first_position,
            first_local: local(first_position),
            slab: local(numbering.order.len() as u32),
            starts: with_first(local(first_position), own.len()),
            row_starts: with_first(0, own.len()),
            rows: Vec::with_capacity(own.iter().map(|&s| groups.below[s as usize] as usize).sum()),
            parent: Vec::with_capacity(own.len()),
            children: vec![0; own.len()],
            adopted: if below.is_empty() { Vec::new() } else { vec![Vec::new(); own.len()] },
            entry_starts: with_first(0, own.len()),
            entries: Vec::with_capacity(own.iter().map(|&s| groups.entries[s as usize] as usize).sum()),
            diagonal: Vec::with_capacity((numbering.starts[part + 1] - first_position) as usize),
        };
        self.relate(part, &mut out);
        let mut room =
            Room { seen: vec![NONE; out.slab as usize], slot: vec![0; out.slab as usize], ..Room::default() };
        for (i, &s) in own.iter().enumerate() {
            let first = out.starts[i];
            out.starts.push(first + groups.width(s as usize));
            self.collect_entries(
                part,
                numbering.first[s as usize],
                groups.width(s as usize),
                &mut room.entries,
            );
            room.collect_rows(i, &mut out, below);
            debug_assert_eq!(out.shape(i).below, groups.below[s as usize] as usize, "group {s}");
            room.place_entries(i, &mut out);
        }
        out
    }

    /// Parents and children of the part's supernodes.
    fn relate(&self, part: usize, out: &mut Part) {
        let Self { groups, tasks, numbering, .. } = self;
        for &s in &numbering.parts[part] {
            let parent = groups.parent[s as usize];
            let inside = parent != NONE && tasks.part[parent as usize] as usize == part;
            out.parent.push(if inside { numbering.index[parent as usize] } else { NONE });
            if inside {
                out.children[numbering.index[parent as usize] as usize] += 1;
            }
        }
        if !out.adopted.is_empty() {
            adopt(out, groups, tasks, numbering);
        }
    }

    /// The entries of the lower triangle in `width` columns from position `first` on.
    fn collect_entries(&self, part: usize, first: u32, width: u32, out: &mut Vec<Entry>) {
        out.clear();
        let local = |k: u32| self.numbering.local(part, k);
        for column in 0..width {
            let k = first + column;
            let v = self.numbering.order[k as usize];
            let (start, columns) = (self.matrix.row_starts()[v as usize], self.matrix.row(v as usize).0);
            out.push(Entry { row: local(k), column, source: start });
            let neighbours = self.graph.neighbours(v);
            // The row of v holds v and then the neighbours that follow it; the others hold v in their rows.
            let (before, after) = neighbours.split_at(neighbours.len() + 1 - columns.len());
            for (source, &w) in (start + 1..).zip(after) {
                let row = self.position[w as usize];
                if row > k {
                    out.push(Entry { row: local(row), column, source });
                }
            }
            for &w in before {
                let row = self.position[w as usize];
                if row > k {
                    let at = self.matrix.row(w as usize).0.iter().position(|&j| j == v).expect("an edge");
                    let source = self.matrix.row_starts()[w as usize] + at as u32;
                    out.push(Entry { row: local(row), column, source });
                }
            }
        }
    }
}

/// Workspace for one supernode after the other.
#[derive(Default)]
struct Room {
    entries: Vec<Entry>,
    /// Per local row, the last supernode that has it.
    seen: Vec<u32>,
    /// Per local row, its place among the rows below of the supernode at hand.
    slot: Vec<u32>,
    /// Supernodes that wait for their parent.
    waiting: Vec<u32>,
}

impl Room {
    /// Appends the rows of supernode `s` below its pivots: those of its entries and of its children.
    fn collect_rows(&mut self, s: usize, out: &mut Part, below: &[Part]) {
        let (start, end) = (out.rows.len(), out.starts[s + 1]);
        let seen = &mut self.seen;
        let mut is_new =
            |row: u32| row >= end && std::mem::replace(&mut seen[row as usize], s as u32) != s as u32;
        out.rows.extend(self.entries.iter().map(|entry| entry.row).filter(|&row| is_new(row)));
        for _ in 0..out.children[s] {
            let child = self.waiting.pop().expect("children come before parents") as usize;
            for at in out.row_starts[child] as usize..out.row_starts[child + 1] as usize {
                let row = out.rows[at];
                if is_new(row) {
                    out.rows.push(row);
                }
            }
        }
        for &(part, child) in out.adopted.get(s).map_or(&[][..], |list| &list[..]) {
            let other = &below[part as usize];
            // A root's rows all belong to the top, which both parts number consecutively.
            let rows =
                other.rows(child as usize).iter().map(|row| row - other.pivots() as u32 + out.first_local);
            out.rows.extend(rows.filter(|&row| is_new(row)));
        }
        out.rows[start..].sort_unstable();
        out.row_starts.push(out.rows.len() as u32);
        self.waiting.push(s as u32);
    }

    /// Where the matrix entries of supernode `s` go in its panel.
    fn place_entries(&mut self, s: usize, out: &mut Part) {
        let (first, end, shape) = (out.starts[s], out.starts[s + 1], out.shape(s));
        let base = (shape.pivot_blocks() * BLOCK) as u32;
        for (slot, &row) in (base..).zip(out.rows(s)) {
            self.slot[row as usize] = slot;
        }
        for entry in &self.entries {
            if entry.row == first + entry.column {
                out.diagonal.push(entry.source);
            }
            let slot = if entry.row < end { entry.row - first } else { self.slot[entry.row as usize] };
            out.entries.push((entry.source, shape.panel_index(slot as usize, entry.column as usize) as u32));
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
