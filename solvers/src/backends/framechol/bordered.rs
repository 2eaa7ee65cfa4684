//! Edited constraints by a bordered system over the factor at hand: no new factorisation for a few vertices.
//!
//! The factor belongs to a *base* set C of constraints. Let K be the inverse of L on the vertices free there, R the vertices
//! removed from C since, D those added. In the field u of the edited set, the values u_R are unknown again and a force f_D
//! holds each added vertex at its value:
//! ```text
//! u = u0 + W z,   u0 = -K L_(.,C-R) g,   W = K [-L_(.,R)  E_D],   z = (u_R, f_D)
//! ```
//! z follows from the equations of the rows R and from u_D = g_D: a dense system with one unknown per edited vertex, whose
//! matrix is quasi-definite. W costs a solve with as many columns as vertices were edited. A frame then is the usual sparse
//! solve for u0, that small system, and one pass over W.
//!
//! The small matrix is formed from W as computed, so an error in W never shows in the rows R and D, and in the other rows
//! no more than the backward error of the solves that made it. (Bordering: G. H. Golub and C. F. Van Loan, "Matrix
//! Computations", section 2.1.4; for a set of constraints that changes: P. E. Gill, W. Murray, M. A. Saunders and
//! M. H. Wright, "A Schur-complement method for sparse quadratic programming", 1987.)
use super::gather::{Group, Output, Source};
use super::lu::Lu;
use super::method::Method;
use super::panels::Reach;
use crate::aligned::zeros;
use crate::columns::Columns;
use crate::isa::{Features, Isa, Kernel, Real, multiply_add};
use crate::lanes::Shape;
use crate::sparse::SymmetricCsr;
use crate::team::Team;
use std::ops::Range;

/// Most edited vertices, dead columns included, before the edited set becomes a new base: two moves of ten. A frame reads
/// one number per vertex and column of W, and with more of them soon as many as of the factor.
pub const MOST_COLUMNS: usize = 40;
/// Columns that are solved for and stored together: one register of f64.
const LANES: usize = 4;
/// Pieces of the pass over W, so that threads can share it.
const PIECES: usize = 16;

/// How a vertex differs from the base.
enum Change {
    /// Free in the base, constrained now.
    Added,
    /// Constrained in the base, free now: its row of L, as (vertex, value), the diagonal included.
    Removed(Vec<(u32, f64)>),
}

impl Change {
    fn is_added(&self) -> bool {
        matches!(self, Self::Added)
    }
}

/// An edited vertex and its column of W.
struct Column {
    vertex: u32,
    change: Change,
    /// L_vv: forces are counted in units of it, and rows of L divided by it, so that the small matrix has numbers of one
    /// size whatever the units of L.
    diagonal: f64,
    /// Place of the column in the blocks: `LANES * block + lane`.
    slot: usize,
}

/// The edits since the last factorisation.
pub struct Border {
    /// Four columns of W each, one row per vertex.
    blocks: Vec<Vec<f64>>,
    /// Blocks of earlier edits, for new ones: fresh memory would cost a quarter of the solve that fills it.
    spare: Vec<Vec<f64>>,
    columns: Vec<Column>,
    lu: Lu,
    /// Room for the small right-hand side: one row per column.
    z: Vec<f64>,
    /// The same by slot, zero for dead columns.
    factors: Vec<f64>,
    max_columns: usize,
}

/// What an edit needs of its surroundings.
pub struct Base<'a, M> {
    /// The base's factor.
    pub method: &'a mut M,
    /// The full L.
    pub laplacian: &'a SymmetricCsr,
    /// Vertex eliminated k-th, and its inverse.
    pub order: &'a [u32],
    pub position: &'a [u32],
    /// Constraints of the base, ascending.
    pub fixed: &'a [u32],
}

impl Border {
    /// No edits; room for fields of `max_columns` columns.
    pub fn new(max_columns: usize) -> Self {
        let (blocks, spare, columns) = (Vec::new(), Vec::new(), Vec::new());
        let (z, factors) = (Vec::new(), Vec::new());
        Self { blocks, spare, columns, lu: Lu::default(), z, factors, max_columns }
    }

    /// Whether the base's constraints are in force.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Back to the base.
    pub fn clear(&mut self) {
        self.columns.clear();
        self.spare.append(&mut self.blocks);
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.blocks.iter().chain(&self.spare).map(|block| size_of_val(&block[..]) as u64).sum()
    }

    /// Bytes read in every frame.
    pub fn bytes_per_frame(&self) -> u64 {
        self.blocks.iter().map(|block| size_of_val(&block[..]) as u64).sum()
    }

    /// Brings the border to the constraints `set` (ascending). False: too many edits, or a solve that went wrong; the border
    /// is then of no use any more and the set wants a factorisation.
    pub fn reach<M: Method>(&mut self, base: &mut Base<'_, M>, set: &[u32]) -> bool {
        let (added, removed) = crate::workload::harmonic::difference(base.fixed, set);
        self.columns.retain(|c| {
            let list = if c.change.is_added() { &added } else { &removed };
            list.binary_search(&c.vertex).is_ok()
        });
        self.drop_dead_blocks();
        if added.is_empty() && removed.is_empty() {
            self.spare = Vec::new(); // edits that were taken back leave nothing behind
        }
        let known: Vec<u32> = self.columns.iter().map(|c| c.vertex).collect();
        let new = |list: Vec<u32>| list.into_iter().filter(|v| !known.contains(v)).collect::<Vec<_>>();
        let (added, removed) = (new(added), new(removed));
        let slots = (added.len() + removed.len()).next_multiple_of(LANES) + LANES * self.blocks.len();
        if slots > MOST_COLUMNS {
            return false;
        }
        let first = self.columns.len();
        let mut slot = LANES * self.blocks.len();
        let mut append = |vertex, change| {
            let diagonal = base.laplacian.diagonal(vertex as usize);
            self.columns.push(Column { vertex, change, diagonal, slot });
            slot += 1;
        };
        rows_of(base.laplacian, &removed)
            .into_iter()
            .zip(&removed)
            .for_each(|(row, &v)| append(v, Change::Removed(row)));
        added.iter().for_each(|&v| append(v, Change::Added));
        for from in (first..self.columns.len()).step_by(LANES) {
            let group = &self.columns[from..self.columns.len().min(from + LANES)];
            let mut block = self.spare.pop().unwrap_or_else(|| zeros(LANES * base.order.len()));
            let finite = solve(base, group, &mut block);
            self.blocks.push(block);
            if !finite {
                return false;
            }
        }
        self.z = vec![0.0; self.columns.len() * self.max_columns];
        self.factors = vec![0.0; LANES * self.blocks.len() * self.max_columns];
        self.factorise()
    }

    /// Forgets blocks without a column in use.
    fn drop_dead_blocks(&mut self) {
        for block in (0..self.blocks.len()).rev() {
            if !self.columns.iter().any(|c| c.slot / LANES == block) {
                self.spare.push(self.blocks.remove(block));
                let above = self.columns.iter_mut().filter(|c| c.slot / LANES > block);
                above.for_each(|c| c.slot -= LANES);
            }
        }
    }

    /// Forms and factors the small matrix: (W z)_D for the rows D, and for the rows R, divided by their
    /// diagonal entries, -L_(R,.) (W z + u_R).
    fn factorise(&mut self) -> bool {
        let m = self.columns.len();
        let mut matrix = vec![0.0; m * m];
        for (i, row) in self.columns.iter().enumerate() {
            for (j, column) in self.columns.iter().enumerate() {
                matrix[i * m + j] = match &row.change {
                    Change::Added => self.entry(row.vertex, column),
                    Change::Removed(l) => {
                        let sum: f64 = l.iter().map(|&(v, value)| value * self.entry(v, column)).sum();
                        -sum / row.diagonal
                    }
                };
            }
        }
        self.lu.factorise(matrix, m)
    }

    /// How u at vertex v depends on the unknown of a column: its row of W, where u_R itself is the unknown at R.
    fn entry(&self, v: u32, column: &Column) -> f64 {
        if v == column.vertex && !column.change.is_added() {
            return 1.0;
        }
        self.blocks[column.slot / LANES][LANES * v as usize + column.slot % LANES]
    }

    /// Turns u0 in `field`, which holds g at the constraints kept and zero at those removed, into u. `value(v)`: the row of
    /// g at an added vertex. Returns whether all went well.
    pub fn correct<'g>(
        &mut self,
        team: &mut Team,
        isa: Isa,
        field: &mut Columns<&mut [f64]>,
        value: impl Fn(u32) -> &'g [f64],
    ) -> bool {
        let k = field.k();
        let m = self.columns.len();
        if self.z.len() < m * k {
            self.z.resize(m * k, 0.0);
            self.factors.resize(LANES * self.blocks.len() * k, 0.0);
        }
        for (column, z) in self.columns.iter().zip(self.z.chunks_exact_mut(k)) {
            match &column.change {
                Change::Added => {
                    let own = field.row(column.vertex as usize);
                    z.iter_mut().zip(value(column.vertex)).zip(own).for_each(|((z, g), u)| *z = g - u);
                }
                Change::Removed(l) => {
                    z.fill(0.0);
                    for &(v, value) in l {
                        let value = value / column.diagonal;
                        z.iter_mut().zip(field.row(v as usize)).for_each(|(z, u)| *z += value * u);
                    }
                }
            }
        }
        self.lu.solve(&mut self.z[..m * k], k);
        let factors = &mut self.factors[..LANES * self.blocks.len() * k];
        factors.fill(0.0);
        for (column, z) in self.columns.iter().zip(self.z.chunks_exact(k)) {
            factors[column.slot * k..][..k].copy_from_slice(z);
        }
        add_columns(team, isa, &self.blocks, factors, field);
        for (column, z) in self.columns.iter().zip(self.z.chunks_exact(k)) {
            let row = field.row_mut(column.vertex as usize);
            match column.change {
                Change::Added => row.copy_from_slice(value(column.vertex)),
                Change::Removed(_) => row.copy_from_slice(z),
            }
        }
        self.z[..m * k].iter().all(|z| z.is_finite())
    }
}

/// The whole rows of `vertices` (ascending) in a symmetric matrix of which the upper triangle is stored. One pass over it.
fn rows_of(matrix: &SymmetricCsr, vertices: &[u32]) -> Vec<Vec<(u32, f64)>> {
    let mut rows = vec![Vec::new(); vertices.len()];
    if vertices.is_empty() {
        return rows;
    }
    let mut index = vec![u32::MAX; matrix.n()];
    vertices.iter().zip(0..).for_each(|(&v, at)| index[v as usize] = at);
    for i in 0..matrix.n() {
        let (columns, values) = matrix.row(i);
        let own = index[i];
        for (&j, &value) in columns.iter().zip(values) {
            if own != u32::MAX {
                rows[own as usize].push((j, value));
            }
            let other = index[j as usize];
            if other != u32::MAX && j as usize != i {
                rows[other as usize].push((i as u32, value));
            }
        }
    }
    rows
}

/// Writes K times the border's columns of `group` to `block`: n x LANES, zero at the base's constraints and in lanes without a
/// column. Returns whether all of it is finite.
fn solve<M: Method>(base: &mut Base<'_, M>, group: &[Column], block: &mut [f64]) -> bool {
    let mut entries = Vec::new();
    for (lane, column) in group.iter().enumerate() {
        match &column.change {
            Change::Added => {
                entries.push((base.position[column.vertex as usize], lane as u32, column.diagonal));
            }
            Change::Removed(l) => {
                let free = l.iter().filter(|(v, _)| base.fixed.binary_search(v).is_err());
                entries.extend(free.map(|&(v, value)| (base.position[v as usize], lane as u32, -value)));
            }
        }
    }
    entries.sort_by_key(|e| (e.0, e.1));
    let reach = base.method.reach(entries.iter().map(|e| e.0));
    let n = base.order.len();
    let mut out = Columns::new(block, n, LANES);
    let source = Sparse { entries: &entries, reach: &reach };
    base.method.solve(&source, base.order, &Output::new(&mut out), LANES).finite
}

/// A sparse right-hand side.
struct Sparse<'a> {
    /// (position, column, value), ascending.
    entries: &'a [(u32, u32, f64)],
    reach: &'a Reach,
}

impl Source for Sparse<'_> {
    fn load<S: Shape>(
        &self,
        _: Isa,
        range: Range<usize>,
        group: Group,
        scale: f64,
        work: &mut [S::Row],
    ) -> [f64; 8] {
        work.fill(S::Row::default());
        let start = self.entries.partition_point(|e| (e.0 as usize) < range.start);
        let own = self.entries[start..].iter().take_while(|e| (e.0 as usize) < range.end);
        let mut largest = [0.0_f64; 8];
        for &(position, column, value) in own {
            if let Some(lane) = (column as usize).checked_sub(group.from).filter(|&lane| lane < group.count) {
                work[position as usize - range.start].as_mut()[lane] += S::T::from_f64(value * scale);
                largest[lane] = largest[lane].max(value.abs());
            }
        }
        largest
    }

    fn active(&self, part: usize) -> Option<&[u32]> {
        self.reach.panels.get(part).map(|panels| &panels[..])
    }
}

/// field += W z, in pieces of rows that the team shares. Streams W once: 8 bytes and k multiply-adds per number.
fn add_columns(
    team: &mut Team,
    isa: Isa,
    blocks: &[Vec<f64>],
    factors: &[f64],
    field: &mut Columns<&mut [f64]>,
) {
    let (n, k) = (field.n(), field.k());
    let rows = n.div_ceil(PIECES).max(1);
    let mut rest = field.data_mut().chunks_mut(rows * k);
    let mut pieces: [Option<&mut [f64]>; PIECES] = std::array::from_fn(|_| rest.next());
    team.for_each(&mut pieces, |piece, field| {
        if let Some(field) = field {
            isa.run(AddColumns { blocks, factors, first: piece * rows, field, k });
        }
    });
}

/// Some rows of the field, from row `first` on.
struct AddColumns<'a> {
    blocks: &'a [Vec<f64>],
    /// z, one row per column of the blocks.
    factors: &'a [f64],
    first: usize,
    field: &'a mut [f64],
    k: usize,
}

impl Kernel for AddColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { blocks, factors, first, field, k } = self;
        for (b, block) in blocks.iter().enumerate() {
            let z = &factors[b * LANES * k..(b + 1) * LANES * k];
            let w = block[first * LANES..].as_chunks::<LANES>().0;
            match k {
                1 => add_block::<F, 1>(w, z, field),
                3 => add_block::<F, 3>(w, z, field),
                4 => add_block::<F, 4>(w, z, field),
                _ => add_columns_one_by_one::<F>(w, z, field, k),
            }
        }
    }
}

#[inline(always)]
fn add_block<F: Features, const K: usize>(w: &[[f64; LANES]], z: &[f64], field: &mut [f64]) {
    let mut factors = [[0.0; K]; LANES];
    for (factor, z) in factors.iter_mut().zip(z.as_chunks::<K>().0) {
        *factor = *z;
    }
    for (u, w) in field.as_chunks_mut::<K>().0.iter_mut().zip(w) {
        for j in 0..LANES {
            for c in 0..K {
                u[c] = multiply_add::<F, f64>(w[j], factors[j][c], u[c]);
            }
        }
    }
}

#[inline(always)]
fn add_columns_one_by_one<F: Features>(w: &[[f64; LANES]], z: &[f64], field: &mut [f64], k: usize) {
    for (u, w) in field.chunks_exact_mut(k).zip(w) {
        for j in 0..LANES {
            for c in 0..k {
                u[c] = multiply_add::<F, f64>(w[j], z[j * k + c], u[c]);
            }
        }
    }
}
