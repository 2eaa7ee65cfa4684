//! The factor as the device reads it: tiles of eight lanes, one table for each sweep.
//!
//! With X the inverse of the Cholesky factor of a block's pivots (S^-1 = X^T X) and M = F S^-1 for its rows below, the
//! sweeps are products with [X; -M] and [X^T, -M^T]: nothing in a block waits for a substitution. A tile holds some rows of
//! one of these matrices, R of them per lane: row 8 r + lane of the tile is the r-th of its lane. With W numbers in 16 bytes, row
//! (r, lane) and column k stand at `((k / W * R + r) * 8 + lane) * W + k % W`. Columns are padded with zeros to whole steps of
//! eight; X is triangular, so its tiles start or end at the diagonal.
use super::blocks::{Blocks, LANES};
use crate::backends::framechol::front::{Crew, FrontShape, invert_pivots, multiply_by_inverse};
use crate::backends::framechol::numeric::Store;
use crate::backends::framechol::symbolic::Part;
use crate::backends::vulkan::device::Access;
use crate::isa::{Features, Real};

/// Columns that a kernel works on at a time: one per lane, so that lanes may read a vector each and hand them round.
const STEP: usize = LANES;

/// How lanes share a tile. Chosen for every level of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Rows per lane: many share the reading of the vectors, few waste less where blocks are small.
    pub rows: usize,
    /// Groups of lanes that share the columns, a power of two: many end sooner, which counts where a level has less work
    /// than the device has lanes.
    pub ways: usize,
}

/// Shapes that kernels are compiled for. A software device does everything one after the other and wants few reads; a GPU waits
/// for memory, and many lanes wait at the same time.
pub fn shapes(access: Access) -> [Shape; 3] {
    match access {
        Access::Texel => [1, 2, 4].map(|rows| Shape { rows, ways: 1 }),
        Access::Storage => [2, 8, 32].map(|ways| Shape { rows: 1, ways }),
    }
}

/// Bits of a header word that hold the columns; the rest holds the number of rows less one.
pub const COLUMN_BITS: u32 = 27;

/// A tile of the forward sweep: rows of [X; -M] times y.
pub type ForwardTile = [u32; 4];
/// A tile of the backward sweep: rows of X^T times X y, and of -M^T times the solution above.
pub type BackwardTile = [u32; 8];

/// Headers of all tiles, level by level, and the size of their numbers.
pub struct Tiles {
    /// (slot of column 0, columns and rows, offset in units of 16 bytes, front element of row 0).
    pub forward: Vec<ForwardTile>,
    /// First forward tile of every level.
    pub forward_levels: Vec<u32>,
    /// (front element of column 0 of X^T, its columns and rows, offset, slot of row 0, start in `below`, columns of M^T,
    /// 0, 0).
    pub backward: Vec<BackwardTile>,
    /// First backward tile of every level.
    pub backward_levels: Vec<u32>,
    /// Numbers of the forward table.
    pub forward_len: usize,
    /// Numbers of the backward table.
    pub backward_len: usize,
    /// First number of every block in both tables.
    place: Vec<(usize, usize)>,
    /// How every block is cut.
    cut: Vec<Cut>,
    /// How lanes share every level's tiles.
    pub shapes: Vec<Shape>,
}

/// How a block is cut into tiles.
#[derive(Clone, Copy)]
struct Cut {
    width: usize,
    below: usize,
    /// Rows of a tile.
    height: usize,
    /// Numbers in 16 bytes.
    pack: usize,
    /// Whether the forward sweep reaches the block; otherwise X y is zero and only M^T is stored.
    reached: bool,
}

impl Cut {
    /// Tiles of the forward sweep.
    fn forward(self) -> usize {
        if self.reached { (self.width + self.below).div_ceil(self.height) } else { 0 }
    }

    /// Tiles of the backward sweep.
    fn backward(self) -> usize {
        self.width.div_ceil(self.height)
    }

    /// Columns of forward tile `b`: X ends at the diagonal.
    fn forward_columns(self, b: usize) -> usize {
        self.width.min((b + 1) * self.height)
    }

    /// Columns of backward tile `b`: those of X^T from the diagonal on, and those of M^T.
    fn backward_columns(self, b: usize) -> (usize, usize) {
        (if self.reached { self.width - b * self.height } else { 0 }, self.below)
    }

    /// As many columns as are stored for `columns`.
    fn padded(columns: usize) -> usize {
        columns.next_multiple_of(STEP)
    }

    /// Rows of tile `b` of a table with `rows` rows.
    fn rows(self, rows: usize, b: usize) -> usize {
        self.height.min(rows - b * self.height)
    }

    /// Rows of columns that both sweeps read, zeros included, and tiles: what a level's number of rows per lane is chosen by.
    fn work(self) -> (usize, usize) {
        let forward: usize = (0..self.forward()).map(|b| Self::padded(self.forward_columns(b))).sum();
        let columns = |b| {
            let (own, above) = self.backward_columns(b);
            Self::padded(own) + Self::padded(above)
        };
        let backward: usize = (0..self.backward()).map(columns).sum();
        (forward + backward, self.forward() + self.backward())
    }
}

impl Tiles {
    /// Lays out the tables for numbers of which `pack` fill 16 bytes.
    pub fn new(part: &Part, blocks: &Blocks, pack: usize, access: Access) -> Self {
        let mut out = Self {
            forward: Vec::new(),
            forward_levels: vec![0],
            backward: Vec::new(),
            backward_levels: vec![0],
            forward_len: 0,
            backward_len: 0,
            shapes: Vec::new(),
            place: vec![(0, 0); part.len()],
            cut: vec![Cut { width: 0, below: 0, height: LANES, pack, reached: true }; part.len()],
        };
        for l in 0..blocks.levels() {
            let cuts = |shape: Shape| {
                blocks.level(l).iter().map(move |&s| cut(part, blocks, s as usize, shape, pack))
            };
            let shape = best_shape(cuts, access);
            out.shapes.push(shape);
            for (&s, cut) in blocks.level(l).iter().zip(cuts(shape)) {
                out.add(s as usize, cut, blocks);
            }
            out.forward_levels.push(out.forward.len() as u32);
            out.backward_levels.push(out.backward.len() as u32);
        }
        out
    }

    fn add(&mut self, s: usize, cut: Cut, blocks: &Blocks) {
        let (slot, front) = (blocks.slot[s], blocks.front[s]);
        (self.place[s], self.cut[s]) = ((self.forward_len, self.backward_len), cut);
        let word = |columns: usize, rows: usize| columns as u32 | ((rows - 1) as u32) << COLUMN_BITS;
        for b in 0..cut.forward() {
            let columns = cut.forward_columns(b);
            let rows = cut.rows(cut.width + cut.below, b);
            let offset = (self.forward_len / cut.pack) as u32;
            self.forward.push([slot, word(columns, rows), offset, front + (b * cut.height) as u32]);
            self.forward_len += Cut::padded(columns) * cut.height;
        }
        for b in 0..cut.backward() {
            let (own, above) = cut.backward_columns(b);
            let first = (b * cut.height) as u32;
            let offset = (self.backward_len / cut.pack) as u32;
            let word = word(own, cut.rows(cut.width, b));
            let below = blocks.below_starts[s];
            let header = [front + first, word, offset, slot + first, below, cut.below as u32, 0, 0];
            self.backward.push(header);
            self.backward_len += (Cut::padded(own) + Cut::padded(above)) * cut.height;
        }
    }

    /// Bytes of the headers.
    pub fn header_bytes(&self) -> u64 {
        (size_of_val(&self.forward[..]) + size_of_val(&self.backward[..])) as u64
    }
}

/// Writes the tiles of every block as the factorisation finishes it.
pub struct TileStore<'a, T> {
    /// Shapes.
    pub tiles: &'a Tiles,
    /// The forward table.
    pub forward: &'a mut [T],
    /// The backward table.
    pub backward: &'a mut [T],
    /// Scratch: -X in blocks of eight columns.
    pub inverse: &'a mut Vec<f64>,
    /// Scratch: [X; -M], row after row.
    pub dense: &'a mut Vec<f64>,
}

impl<T: Real> Store for TileStore<'_, T> {
    #[inline(always)]
    fn store<F: Features>(
        &mut self,
        s: usize,
        shape: FrontShape,
        panel: &[f64],
        _: &mut [f64],
        _: Option<&mut Crew<'_>>,
    ) {
        self.fill_dense::<F>(shape, panel);
        let (cut, (mut forward, mut backward)) = (self.tiles.cut[s], self.tiles.place[s]);
        let (w, r) = (shape.width, shape.below);
        for b in 0..cut.forward() {
            let columns = cut.forward_columns(b);
            let to = &mut self.forward[forward..forward + Cut::padded(columns) * cut.height];
            to.fill(T::default());
            for row in 0..cut.rows(w + r, b) {
                let values = &self.dense[(b * cut.height + row) * w..][..columns];
                put(to, cut, row, 0, values.iter().copied());
            }
            forward += to.len();
        }
        for b in 0..cut.backward() {
            let (own, above) = cut.backward_columns(b);
            let (own, above) = (Cut::padded(own), Cut::padded(above));
            let first = b * cut.height;
            let to = &mut self.backward[backward..backward + (own + above) * cut.height];
            to.fill(T::default());
            for row in 0..cut.rows(w, b) {
                let column = |rows: std::ops::Range<usize>| rows.map(|k| self.dense[k * w + first + row]);
                put(to, cut, row, 0, column(if own > 0 { first..w } else { w..w }));
                put(to, cut, row, own, column(w..w + r));
            }
            backward += to.len();
        }
    }
}

/// Writes one row of a tile from column `from` on.
#[inline(always)]
fn put<T: Real>(tile: &mut [T], cut: Cut, row: usize, from: usize, values: impl Iterator<Item = f64>) {
    for (k, v) in (from..).zip(values) {
        tile[(k / cut.pack * cut.height + row) * cut.pack + k % cut.pack] = T::from_f64(v);
    }
}

/// The tiles of block `s`.
fn cut(part: &Part, blocks: &Blocks, s: usize, shape: Shape, pack: usize) -> Cut {
    let FrontShape { width, below, .. } = part.shape(s);
    Cut { width, below, height: LANES * shape.rows, pack, reached: blocks.reached[s] }
}

/// The best shape for a level whose blocks are cut by `cuts`.
fn best_shape<C: Iterator<Item = Cut>>(cuts: impl Fn(Shape) -> C, access: Access) -> Shape {
    let shapes = shapes(access);
    match access {
        Access::Texel => shapes.into_iter().min_by_key(|&shape| software_time(cuts(shape), shape.rows)),
        Access::Storage => {
            // A few steps per lane; the widest block decides when the level ends.
            let steps = |cut: Cut| cut.width.div_ceil(STEP) + cut.below.div_ceil(STEP);
            let steps = cuts(shapes[0]).map(steps).max().unwrap_or(1);
            shapes.into_iter().find(|shape| steps <= STEPS_PER_LANE * shape.ways).or(shapes.last().copied())
        }
    }
    .expect("some shape")
}

/// Steps of a lane that a GPU's level should not exceed: the loads of one are under way together, so each adds a memory
/// latency.
const STEPS_PER_LANE: usize = 3;

/// Nanoseconds that a level's tiles take on lavapipe: per column the reading of the vectors and as many products as rows; per
/// tile its start.
fn software_time(cuts: impl Iterator<Item = Cut>, rows: usize) -> usize {
    const READ: usize = 5;
    const ROW: usize = 8;
    const TILE: usize = 100;
    let of = |cut: Cut| {
        let (columns, tiles) = cut.work();
        columns * (READ + ROW * rows) + tiles * TILE
    };
    cuts.map(of).sum()
}

impl<T: Real> TileStore<'_, T> {
    /// dense := [X; -M] of a factored panel.
    #[inline(always)]
    fn fill_dense<F: Features>(&mut self, shape: FrontShape, panel: &[f64]) {
        let (w, r) = (shape.width, shape.below);
        let x = &mut self.inverse[..w.div_ceil(LANES) * w * LANES];
        invert_pivots::<F>(shape, panel, 0, w, x);
        for k in 0..w {
            for j in 0..w {
                let entry = -x[(j / LANES * w + k) * LANES + j % LANES];
                self.dense[k * w + j] = if j > k { 0.0 } else { entry };
            }
        }
        for b in 0..r.div_ceil(LANES) {
            let block = &panel[(shape.pivot_blocks() + b) * w * LANES..][..w * LANES];
            for c in 0..w.div_ceil(LANES) {
                let tile = multiply_by_inverse::<F>(block, x, w, c);
                for j in 0..LANES.min(w - c * LANES) {
                    for i in 0..LANES.min(r - b * LANES) {
                        self.dense[(w + b * LANES + i) * w + c * LANES + j] = -tile[j][i];
                    }
                }
            }
        }
    }
}

/// Sizes of the scratch of [`TileStore`]: inverse and dense.
pub fn scratch(part: &Part) -> (usize, usize) {
    let shapes = || (0..part.len()).map(|s| part.shape(s));
    let inverse = shapes().map(|f| f.width.next_multiple_of(LANES) * f.width).max().unwrap_or(0);
    (inverse, shapes().map(|f| (f.width + f.below) * f.width).max().unwrap_or(0))
}
