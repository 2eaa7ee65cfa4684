//! The factor as the sweeps read it: packed panels.
//!
//! A supernode is cut into strips of at most [`STRIP`] pivots; each strip is a **panel**. With S the Schur complement of
//! the strip's pivots (its pivot block when its turn comes) and F the rows below, a panel holds the two matrices of the
//! block factorisation A = (I + M) S (I + M)^T:
//! - `diagonal`: X with S^-1 = X^T X, the inverse of the Cholesky factor of S: a triangle, read once per solve (X^T X
//!   itself would be a square, and S x = y would only be solved to the condition of S, not to its root);
//! - `values`: M = F S^-1, rows below x width, read once by each sweep.
//!
//! So neither sweep ever waits for a triangular solve; both are products with dense blocks. Rows come in blocks of eight,
//! each block column after column, eight numbers per column; a last block of t < 8 rows has t numbers per column, so
//! that nothing is padded.
use super::front::{BLOCK, Crew, FrontShape, invert_pivots, multiply_by_inverse, update_block};
use super::numeric::Store;
use super::symbolic::Part;
use crate::aligned::zeros;
use crate::isa::{Features, Kernel, Real};

/// Most pivots of a panel. Wider ones read no fewer bytes, cost width^3 to invert, and lose accuracy when stored in f32.
pub const STRIP: usize = 64;

/// Place and size of one panel.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    /// Local number of the first pivot; the others follow.
    pub first: u32,
    /// Number of pivots.
    pub width: u32,
    /// Start of its rows below in [`Panels::rows`].
    pub rows: u32,
    /// Number of rows below.
    pub below: u32,
    /// Start in [`Panels::values`].
    pub values: usize,
    /// Start in [`Panels::diagonal`].
    pub diagonal: usize,
}

impl Panel {
    /// Its range in [`Panels::rows`].
    #[inline(always)]
    pub fn rows(&self) -> std::ops::Range<usize> {
        self.rows as usize..(self.rows + self.below) as usize
    }

    /// Its range in [`Panels::values`].
    #[inline(always)]
    pub fn values(&self) -> std::ops::Range<usize> {
        self.values..self.values + self.width as usize * self.below as usize
    }

    /// Its range in [`Panels::diagonal`].
    #[inline(always)]
    pub fn diagonal(&self) -> std::ops::Range<usize> {
        self.diagonal..self.diagonal + triangle_len(self.width as usize)
    }
}

/// Panels on the paths from some rows to the roots, per part: ascending.
pub struct Reach {
    /// For every thread, then for the top.
    pub panels: Vec<Vec<u32>>,
    /// Bytes of all other panels, which a forward sweep along the paths does not read.
    pub skipped_bytes: u64,
}

/// The panels of one part in elimination order, with numbers in T.
pub struct Panels<T> {
    /// Every panel, children before parents.
    pub list: Vec<Panel>,
    /// Rows below, panel after panel, as local numbers.
    pub rows: Vec<u32>,
    /// M of every panel.
    pub values: Vec<T>,
    /// X of every panel.
    pub diagonal: Vec<T>,
    /// Panels of supernode s: `list[starts[s]..starts[s + 1]]`.
    starts: Vec<u32>,
}

impl<T: Real> Panels<T> {
    /// Room for the factor of `part`, all zero.
    pub fn new(part: &Part) -> Self {
        let (mut list, mut rows, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        let (mut values, mut diagonal) = (0, 0);
        for s in 0..part.len() {
            let (first, end) = (part.starts[s], part.starts[s + 1]);
            for (from, width) in strips(part.shape(s).width) {
                let start = first + from as u32;
                let row_start = rows.len() as u32;
                rows.extend(start + width as u32..end);
                rows.extend_from_slice(part.rows(s));
                let below = rows.len() as u32 - row_start;
                list.push(Panel {
                    first: start,
                    width: width as u32,
                    rows: row_start,
                    below,
                    values,
                    diagonal,
                });
                values += width * below as usize;
                diagonal += triangle_len(width);
            }
            starts.push(list.len() as u32);
        }
        list.shrink_to_fit(); // lists that grew hold up to twice what they need
        rows.shrink_to_fit();
        starts.shrink_to_fit();
        let (values, diagonal) = (zeros(values), zeros(diagonal));
        Self { list, rows, values, diagonal, starts }
    }

    /// Bytes of numbers that [`new`](Self::new) will ask for.
    pub fn bytes_for(part: &Part) -> u64 {
        let entries = |s: usize| {
            let FrontShape { width, below } = part.shape(s);
            let strips = strips(width)
                .map(|(from, strip)| strip * (width - from - strip + below) + triangle_len(strip));
            strips.sum::<usize>()
        };
        (0..part.len()).map(|s| (entries(s) * size_of::<T>()) as u64).sum()
    }

    /// Panels on the paths from the pivots `rows` (local numbers) upwards, within the part. Rows of the top that they reach
    /// are appended to `leave`.
    pub fn reach(&self, rows: impl Iterator<Item = u32>, leave: &mut Vec<u32>) -> Vec<u32> {
        let of = |row: u32| self.list.partition_point(|p| p.first + p.width <= row);
        let mut reached = vec![false; self.list.len() + 1]; // the last one stands for the top
        rows.for_each(|row| reached[of(row)] = true);
        for at in 0..self.list.len() {
            // The first row below is the parent's pivot; the others lie on its path.
            if let (true, Some(&parent)) = (reached[at], self.rows[self.list[at].rows()].first()) {
                let parent = of(parent);
                reached[parent] = true;
                if parent == self.list.len() {
                    leave.extend_from_slice(&self.rows[self.list[at].rows()]);
                }
            }
        }
        (0..self.list.len() as u32).filter(|&at| reached[at as usize]).collect()
    }

    /// Bytes that are held: what a sweep reads, and where the supernodes start.
    pub fn bytes_held(&self) -> u64 {
        self.bytes() + size_of_val(&self.starts[..]) as u64
    }

    /// Bytes of the panels: numbers, row indices and headers.
    pub fn bytes(&self) -> u64 {
        let numbers = size_of_val(&self.values[..]) + size_of_val(&self.diagonal[..]);
        (numbers + size_of_val(&self.rows[..]) + size_of_val(&self.list[..])) as u64
    }

    /// Bytes that a forward sweep over the panels `active` alone reads.
    pub fn forward_bytes(&self, active: &[u32]) -> u64 {
        let bytes = |panel: &Panel| {
            size_of::<T>() * (panel.values().len() + panel.diagonal().len())
                + size_of::<u32>() * panel.rows().len()
                + size_of::<Panel>()
        };
        active.iter().map(|&at| bytes(&self.list[at as usize]) as u64).sum()
    }

    /// Bytes that a forward and a backward sweep read: everything twice, X once.
    pub fn bytes_per_solve(&self) -> u64 {
        2 * self.bytes() - size_of_val(&self.diagonal[..]) as u64
    }
}

/// Strips that threads pack at a time; a front with more of them takes several rounds.
const ROUND: usize = 16;

impl<T: Real> Store for Panels<T> {
    #[inline(always)]
    fn store<F: Features>(
        &mut self,
        s: usize,
        shape: FrontShape,
        panel: &[f64],
        x: &mut [f64],
        crew: Option<&mut Crew<'_>>,
    ) {
        let strips = &self.list[self.starts[s] as usize..self.starts[s + 1] as usize];
        let first = strips[0];
        let mut values = &mut self.values[first.values..];
        let mut diagonal = &mut self.diagonal[first.diagonal..];
        let mut pack = |strip: &Panel| {
            let (own, rest) = std::mem::take(&mut values).split_at_mut(strip.values().len());
            values = rest;
            let (inverse, rest) = std::mem::take(&mut diagonal).split_at_mut(strip.diagonal().len());
            diagonal = rest;
            let (from, width) = ((strip.first - first.first) as usize, strip.width as usize);
            Pack { shape, panel, from, width, values: own, diagonal: inverse }
        };
        let Some(Crew { team, isa }) = crew else {
            return strips.iter().for_each(|strip| pack(strip).run_in::<F>(x));
        };
        for round in strips.chunks(ROUND) {
            let mut packs: [_; ROUND] = std::array::from_fn(|at| round.get(at).map(&mut pack));
            team.for_each(&mut packs, |_, pack| {
                if let Some(pack) = pack.take() {
                    isa.run(pack);
                }
            });
        }
    }
}

/// Turns one strip of a factored panel into X and M.
struct Pack<'a, T> {
    shape: FrontShape,
    panel: &'a [f64],
    /// First pivot.
    from: usize,
    /// Number of pivots.
    width: usize,
    values: &'a mut [T],
    diagonal: &'a mut [T],
}

impl<T: Real> Pack<'_, T> {
    /// `x`: room for [`STRIP`]^2 numbers.
    #[inline(always)]
    fn run_in<F: Features>(self, x: &mut [f64]) {
        let Self { shape, panel, from, width, values, diagonal } = self;
        invert_pivots::<F>(shape, panel, from, width, x);
        store_inverse::<T>(x, width, diagonal);
        store_below::<F, T>(shape, panel, from, width, x, values);
    }
}

impl<T: Real> Kernel for Pack<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        self.run_in::<F>(&mut [0.0; STRIP * STRIP]);
    }
}

/// Cuts `width` pivots into nearly equal strips, all but the last a multiple of [`BLOCK`]: (first pivot, width) each.
fn strips(width: usize) -> impl Iterator<Item = (usize, usize)> {
    let count = width.div_ceil(STRIP);
    let step = width.div_ceil(count).next_multiple_of(BLOCK);
    (0..count)
        .map(move |i| (i * step, step))
        .filter(move |s| s.0 < width)
        .map(move |(from, step)| (from, step.min(width - from)))
}

/// Numbers of a stored triangle X: rows in blocks of eight, each with the columns up to its diagonal tile.
pub fn triangle_len(width: usize) -> usize {
    update_block(width / BLOCK) + width % BLOCK * width
}

/// Writes X, the inverse of the pivot block of L, from its negative in `x`.
#[inline(always)]
fn store_inverse<T: Real>(x: &[f64], width: usize, out: &mut [T]) {
    for b in 0..width.div_ceil(BLOCK) {
        let lanes = BLOCK.min(width - b * BLOCK);
        let rows = &mut out[update_block(b)..];
        for j in 0..width.min((b + 1) * BLOCK) {
            let column = &x[(j / BLOCK * width + b * BLOCK) * BLOCK + j % BLOCK..];
            for i in 0..lanes {
                let entry = if b * BLOCK + i < j { 0.0 } else { -column[i * BLOCK] };
                rows[j * lanes + i] = T::from_f64(entry);
            }
        }
    }
}

/// Writes M = L21 X for the rows below the strip: the supernode's later pivots, then its rows below.
#[inline(always)]
fn store_below<F: Features, T: Real>(
    shape: FrontShape,
    panel: &[f64],
    from: usize,
    width: usize,
    x: &[f64],
    out: &mut [T],
) {
    let rows = out.len() / width;
    let block_len = shape.width * BLOCK;
    let end = from + width;
    let mut row = 0; // first row of the block at hand among the strip's rows
    for b in end.div_ceil(BLOCK)..shape.pivot_blocks() + shape.below_blocks() {
        let last =
            if b < shape.pivot_blocks() { shape.width } else { shape.pivot_blocks() * BLOCK + shape.below };
        let lanes = BLOCK.min(last - b * BLOCK);
        let l = &panel[b * block_len + from * BLOCK..][..width * BLOCK];
        // But after a pivot block that is not full, blocks of rows here are blocks of rows there.
        let same = row % BLOCK == 0 && lanes == BLOCK.min(rows - row);
        for c in 0..width.div_ceil(BLOCK) {
            let tile = multiply_by_inverse::<F>(l, x, width, c);
            let columns = c * BLOCK..width.min((c + 1) * BLOCK);
            if same && lanes == BLOCK {
                let place =
                    &mut out[(row * width + columns.start * BLOCK)..(row * width + columns.end * BLOCK)];
                for (out, column) in place.as_chunks_mut::<BLOCK>().0.iter_mut().zip(&tile) {
                    for i in 0..BLOCK {
                        out[i] = T::from_f64(column[i]);
                    }
                }
            } else if same {
                let place =
                    &mut out[(row * width + columns.start * lanes)..(row * width + columns.end * lanes)];
                for (out, column) in place.chunks_exact_mut(lanes).zip(&tile) {
                    out.iter_mut().zip(column).for_each(|(out, &v)| *out = T::from_f64(v));
                }
            } else {
                for (j, column) in columns.zip(&tile) {
                    put(out, rows, width, row, j, &column[..lanes]);
                }
            }
        }
        row += lanes;
    }
    debug_assert_eq!(row, rows);
}

/// Writes consecutive rows of column `j`, from `row` on, into blocks of eight rows.
#[inline(always)]
fn put<T: Real>(out: &mut [T], rows: usize, width: usize, row: usize, j: usize, column: &[f64]) {
    for (i, &v) in column.iter().enumerate() {
        let (block, lane) = ((row + i) / BLOCK, (row + i) % BLOCK);
        let lanes = BLOCK.min(rows - block * BLOCK);
        out[block * BLOCK * width + j * lanes + lane] = T::from_f64(v);
    }
}
