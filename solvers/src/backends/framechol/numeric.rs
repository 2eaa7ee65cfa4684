//! Numeric factorisation: multifrontal Cholesky over the supernodes of a part.
//!
//! Supernode after supernode in postorder: the front collects the matrix entries and the update matrices of the
//! children, its pivots are eliminated, the panel is packed for the sweeps, and the update matrix goes to the parent by
//! way of a stack (J. W. H. Liu, "The multifrontal method for sparse matrix solution", SIAM Review 34, 1992). All in f64;
//! all memory is allocated once.
use super::front::{BLOCK, Crew, FrontShape, factor_panel, update_block, update_rest};
use super::panels::STRIP;
use super::symbolic::Part;
use crate::aligned::zeros;
use crate::isa::{Features, Kernel};
use crate::ordering::NONE;

/// Memory of one thread's factorisation.
pub struct Workspace {
    panel: Vec<f64>,
    /// Update matrices that wait for the parent, in turn by level of the tree: a front is formed in one stack while its
    /// children wait on the other.
    stacks: [Vec<f64>; 2],
    /// Where the update matrix of each supernode lies.
    place: Vec<Place>,
    /// Supernodes whose update matrix waits for its parent.
    waiting: Vec<u32>,
    /// Front slot of every local row of the front at hand.
    slot: Vec<u32>,
    /// For each row of the child at hand: place of its row in panel and update matrix, and of its column.
    targets: Vec<Target>,
    /// Scratch for inverted pivot blocks.
    inverse: Vec<f64>,
}

/// A place on one of the stacks.
#[derive(Clone, Copy)]
struct Place {
    stack: usize,
    start: usize,
}

/// Where a row of a child goes in its parent's front.
#[derive(Clone, Copy, Default)]
struct Target {
    /// Place of (row, column 0) in the panel.
    panel: usize,
    /// Place of (row, column 0) in the update matrix; unused for a pivot.
    update: usize,
    /// Eight times its column, in the panel for a pivot, else in the update matrix.
    column: usize,
}

/// How the update matrices of a part lie on the stacks.
struct Stacks {
    /// Place of every supernode's.
    place: Vec<Place>,
    /// Numbers on each stack, at most.
    peak: [usize; 2],
    /// Matrices on both, at most.
    depth: usize,
}

/// Plays the factorisation through: a supernode enters its stack, its children leave the other one.
fn stacks(part: &Part) -> Stacks {
    let mut place = vec![Place { stack: 0, start: 0 }; part.len()];
    for s in (0..part.len()).rev() {
        if part.parent[s] != NONE {
            place[s].stack = 1 - place[part.parent[s] as usize].stack;
        }
    }
    let mut waiting: Vec<u32> = Vec::new();
    let (mut end, mut peak, mut depth) = ([0; 2], [0; 2], 0);
    for s in 0..part.len() {
        let stack = place[s].stack;
        place[s].start = end[stack];
        end[stack] += part.shape(s).update_len();
        peak[stack] = peak[stack].max(end[stack]);
        for _ in 0..part.children[s] {
            let child = waiting.pop().expect("children come before parents");
            end[1 - stack] = place[child as usize].start;
        }
        waiting.push(s as u32);
        depth = depth.max(waiting.len());
    }
    Stacks { place, peak, depth }
}

/// Elimination met a pivot that is not positive and finite.
#[derive(Clone, Copy, Debug)]
pub struct Breakdown {
    /// Elimination position.
    pub position: u32,
    /// The pivot.
    pub pivot: f64,
}

impl Workspace {
    /// Bytes of fronts and stack that [`new`](Self::new) will ask for.
    pub fn bytes_for(part: &Part) -> u64 {
        let panel = (0..part.len()).map(|s| part.shape(s).panel_len()).max().unwrap_or(0);
        8 * (panel + stacks(part).peak.iter().sum::<usize>()) as u64
    }

    /// Sizes everything for `part`.
    pub fn new(part: &Part) -> Self {
        let shapes = || (0..part.len()).map(|s| part.shape(s));
        let Stacks { place, peak, depth } = stacks(part);
        Self {
            panel: zeros(shapes().map(|f| f.panel_len()).max().unwrap_or(0)),
            stacks: peak.map(zeros),
            place,
            waiting: Vec::with_capacity(depth),
            slot: vec![0; part.slab as usize],
            targets: vec![Target::default(); shapes().map(|f| f.width + f.below).max().unwrap_or(0)],
            inverse: vec![0.0; STRIP * STRIP],
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let stacks: usize = self.stacks.iter().map(Vec::len).sum();
        let numbers = self.panel.len() + stacks + self.inverse.len();
        let places = size_of_val(&self.place[..]) + size_of_val(&self.targets[..]);
        (8 * numbers + places + 4 * (self.slot.len() + self.waiting.capacity())) as u64
    }

    /// The update matrix of supernode `s`, if it is still waiting.
    fn waiting_update(&self, part: &Part, s: usize) -> &[f64] {
        let Place { stack, start } = self.place[s];
        &self.stacks[stack][start..][..part.shape(s).update_len()]
    }
}

/// What takes the factor, supernode after supernode.
pub trait Store {
    /// Takes the factored panel of supernode `s`: L on its pivots and rows below. `scratch`: [`STRIP`]^2 numbers.
    /// `crew`: threads that may help.
    fn store<F: Features>(
        &mut self,
        s: usize,
        shape: FrontShape,
        panel: &[f64],
        scratch: &mut [f64],
        crew: Option<&mut Crew<'_>>,
    );
}

/// The factorisation of one part.
pub struct FactorPart<'a, S> {
    /// Its supernodes.
    pub part: &'a Part,
    /// Values of the matrix, by stored entry.
    pub values: &'a [f64],
    /// Factor of all values, a power of two.
    pub scale: f64,
    /// Parts whose roots hang below this one, with their workspaces; for the top.
    pub below: &'a (dyn Fn(usize) -> (&'a Part, &'a Workspace) + 'a),
    /// Memory.
    pub work: &'a mut Workspace,
    /// Where the factor goes.
    pub out: &'a mut S,
    /// Threads that may help with large fronts.
    pub crew: Option<Crew<'a>>,
}

impl<S: Store> Kernel for FactorPart<'_, S> {
    type Output = Result<(), Breakdown>;

    #[inline(always)]
    fn run<F: Features>(self) -> Self::Output {
        let Self { part, values, scale, below, work, out, mut crew } = self;
        work.waiting.clear();
        for s in 0..part.len() {
            work.assemble(part, s, values, scale);
            work.add_children(part, s, below);
            let shape = part.shape(s);
            let mut crew = crew.as_mut().filter(|_| shape.is_large());
            let panel = &mut work.panel[..shape.panel_len()];
            let outcome = factor_panel::<F>(shape, panel, crew.as_deref_mut());
            outcome.map_err(|(j, pivot)| Breakdown {
                position: part.first_position + (part.starts[s] - part.first_local) + j as u32,
                pivot,
            })?;
            let Place { stack, start } = work.place[s];
            let update = &mut work.stacks[stack][start..][..shape.update_len()];
            update_rest::<F>(shape, panel, update, crew.as_deref_mut());
            work.waiting.push(s as u32);
            out.store::<F>(s, shape, panel, &mut work.inverse, crew);
        }
        Ok(())
    }
}

impl Workspace {
    /// Clears the front of supernode `s`, enters its matrix entries and numbers its rows.
    fn assemble(&mut self, part: &Part, s: usize, values: &[f64], scale: f64) {
        let shape = part.shape(s);
        self.panel[..shape.panel_len()].fill(0.0);
        let Place { stack, start } = self.place[s];
        self.stacks[stack][start..][..shape.update_len()].fill(0.0);
        for &(source, place) in
            &part.entries[part.entry_starts[s] as usize..part.entry_starts[s + 1] as usize]
        {
            self.panel[place as usize] = scale * values[source as usize];
        }
        for (slot, row) in (part.starts[s]..part.starts[s + 1]).enumerate() {
            self.slot[row as usize] = slot as u32;
        }
        let base = (shape.pivot_blocks() * BLOCK) as u32;
        for (slot, &row) in part.rows(s).iter().enumerate() {
            self.slot[row as usize] = base + slot as u32;
        }
    }

    /// Adds the update matrices of all children of `s`.
    fn add_children<'a>(&mut self, part: &Part, s: usize, below: &dyn Fn(usize) -> (&'a Part, &'a Self)) {
        let Place { stack, start } = self.place[s];
        for _ in 0..part.children[s] {
            let c = self.waiting.pop().expect("children come before parents") as usize;
            let rows = part.rows(c);
            let pivots = self.aim(part, s, rows, 0);
            let (child, len) = (self.place[c].start, part.shape(c).update_len());
            let Self { panel, stacks: [even, odd], targets, .. } = self;
            let (others, own) = if stack == 0 { (odd, even) } else { (even, odd) };
            let child = &others[child..child + len];
            add_update(child, &targets[..rows.len()], pivots, panel, &mut own[start..]);
        }
        for &(from, c) in part.adopted.get(s).map_or(&[][..], |list| &list[..]) {
            let (other, work) = below(from as usize);
            let rows = other.rows(c as usize);
            // A root's rows all belong to the top, which both parts number consecutively.
            let shift = part.first_local.wrapping_sub(other.pivots() as u32);
            let pivots = self.aim(part, s, rows, shift);
            let child = work.waiting_update(other, c as usize);
            let own = &mut self.stacks[stack][start..];
            add_update(child, &self.targets[..rows.len()], pivots, &mut self.panel, own);
        }
    }

    /// Finds the targets of a child's rows (local number: `row + shift`, wrapping) in the front of `s`; returns how many
    /// of them are pivots there. Rows ascend, so these come first.
    fn aim(&mut self, part: &Part, s: usize, rows: &[u32], shift: u32) -> usize {
        let shape = part.shape(s);
        let base = shape.pivot_blocks() * BLOCK;
        let mut pivots = 0;
        for (target, &row) in self.targets.iter_mut().zip(rows) {
            let slot = self.slot[row.wrapping_add(shift) as usize] as usize;
            let panel = shape.panel_index(slot, 0);
            *target = if slot < base {
                pivots += 1;
                Target { panel, update: 0, column: BLOCK * slot }
            } else {
                let row = slot - base;
                Target { panel, update: update_block(row / BLOCK) + row % BLOCK, column: BLOCK * row }
            };
        }
        pivots
    }
}

/// Adds the lower triangle of a child's update matrix to its parent's front; the first `pivots` rows are pivots there.
fn add_update(from: &[f64], targets: &[Target], pivots: usize, panel: &mut [f64], update: &mut [f64]) {
    for (b, rows) in targets.chunks(BLOCK).enumerate() {
        let columns = from[update_block(b)..].as_chunks::<BLOCK>().0;
        for (j, column) in columns[..b * BLOCK + rows.len()].iter().enumerate() {
            let start = j.saturating_sub(b * BLOCK); // the diagonal tile counts from its diagonal on
            let to = targets[j].column;
            if j < pivots {
                for (row, v) in rows[start..].iter().zip(&column[start..]) {
                    panel[row.panel + to] += v;
                }
            } else {
                for (row, v) in rows[start..].iter().zip(&column[start..]) {
                    update[row.update + to] += v;
                }
            }
        }
    }
}
