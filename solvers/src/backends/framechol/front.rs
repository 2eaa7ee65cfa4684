//! Dense kernels on fronts: partial Cholesky factorisation in blocks of eight rows.
//!
//! A front is the dense lower triangle over the pivots of a supernode and its rows below. It is stored in two pieces:
//! - the **panel**, all rows x the pivot columns, as blocks of [`BLOCK`] rows: column after column, eight numbers each.
//!   Pivot rows are padded to whole blocks, so that the rows below start a block;
//! - the **update matrix**, rows below x rows below, its lower triangle in blocks of eight rows that end with their
//!   diagonal tile.
//!
//! Every kernel works on 8 x 8 tiles: eight vectors of eight doubles. The inner loop is one load of eight entries of A,
//! eight broadcasts of B and 64 multiply-adds.
use crate::isa::{Features, Isa, Kernel, multiply_add};
use crate::team::Team;
use std::ops::Range;

/// Rows per block: one AVX-512 register of doubles, two of AVX2, four of NEON.
pub const BLOCK: usize = 8;

/// Pieces of an update matrix, so that threads can share it.
const PIECES: usize = 16;

/// Threads that share the work on one front, and their instruction set.
pub struct Crew<'a> {
    /// The threads.
    pub team: &'a mut Team,
    /// What their kernels are compiled for.
    pub isa: Isa,
}

/// Eight columns of eight rows.
type Tile = [[f64; BLOCK]; BLOCK];

/// Size of a front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrontShape {
    /// Pivots w.
    pub width: usize,
    /// Rows below r.
    pub below: usize,
}

impl FrontShape {
    /// Blocks of the pivot rows.
    pub fn pivot_blocks(self) -> usize {
        self.width.div_ceil(BLOCK)
    }

    /// Blocks of the rows below.
    pub fn below_blocks(self) -> usize {
        self.below.div_ceil(BLOCK)
    }

    /// Length of the panel.
    pub fn panel_len(self) -> usize {
        (self.pivot_blocks() + self.below_blocks()) * self.width * BLOCK
    }

    /// Length of the update matrix.
    pub fn update_len(self) -> usize {
        update_block(self.below_blocks())
    }

    /// Place of row `slot` (pivot rows from 0, rows below from `BLOCK * pivot_blocks()`) and column `j` in the panel.
    pub fn panel_index(self, slot: usize, j: usize) -> usize {
        (slot / BLOCK * self.width + j) * BLOCK + slot % BLOCK
    }

    /// Entries of L: the pivot triangle and the rectangle below.
    pub fn entries(self) -> u64 {
        let (w, r) = (self.width as u64, self.below as u64);
        w * (w + 1) / 2 + w * r
    }

    /// Whether the front is worth more than one thread: a step for eight pivots then is some 20 microseconds of work, and
    /// handing it out costs one or two.
    pub fn is_large(self) -> bool {
        self.width * (self.width + self.below) > 40_000
    }

    /// Sum of the squared column counts: multiplications and additions of the factorisation.
    pub fn flops(self) -> u64 {
        (0..self.width as u64).map(|j| (j + 1 + self.below as u64).pow(2)).sum()
    }
}

/// Start of block row `b` in an update matrix: the tiles of the rows above, 1 + 2 + ... + b of them.
#[inline(always)]
pub fn update_block(b: usize) -> usize {
    b * (b + 1) / 2 * BLOCK * BLOCK
}

/// tile\[n\]\[i\] -= sum_k a\[k\]\[i\] b\[k\]\[n\] with a, b in blocks of eight rows. 128 flops and 128 bytes per k.
#[inline(always)]
fn subtract_product<F: Features>(tile: &mut Tile, a: &[f64], b: &[f64]) {
    let (a, b) = (a.as_chunks::<BLOCK>().0, b.as_chunks::<BLOCK>().0);
    if F::WIDE {
        subtract_columns::<F, 0, 8>(tile, a, b);
    } else {
        // Half a tile at a time: eight registers of four doubles.
        subtract_columns::<F, 0, 4>(tile, a, b);
        subtract_columns::<F, 4, 4>(tile, a, b);
    }
}

/// Columns FROM .. FROM + N of [`subtract_product`].
#[inline(always)]
fn subtract_columns<F: Features, const FROM: usize, const N: usize>(
    tile: &mut Tile,
    a: &[[f64; BLOCK]],
    b: &[[f64; BLOCK]],
) {
    let mut part: [[f64; BLOCK]; N] = std::array::from_fn(|n| tile[FROM + n]);
    for (a, b) in a.iter().zip(b) {
        for n in 0..N {
            for i in 0..BLOCK {
                part[n][i] = multiply_add::<F, f64>(-b[FROM + n], a[i], part[n][i]);
            }
        }
    }
    tile[FROM..FROM + N].copy_from_slice(&part);
}

/// Loads the `columns.len() / 8` columns of a tile; the others are zero.
#[inline(always)]
fn load(columns: &[f64]) -> Tile {
    let mut tile = [[0.0; BLOCK]; BLOCK];
    for (column, from) in tile.iter_mut().zip(columns.as_chunks::<BLOCK>().0) {
        *column = *from;
    }
    tile
}

#[inline(always)]
fn store(tile: &Tile, columns: &mut [f64]) {
    for (column, to) in tile.iter().zip(columns.as_chunks_mut::<BLOCK>().0) {
        *to = *column;
    }
}

/// Cholesky factorisation of the leading `count` x `count` part of a tile, lower triangle; column j of L replaces
/// column j. The rest of the diagonal becomes 1. `Err(j)`: pivot j is not positive.
#[inline(always)]
fn factor_tile<F: Features>(tile: &mut Tile, count: usize) -> Result<(), (usize, f64)> {
    for j in 0..count {
        let pivot = tile[j][j];
        if !(pivot > 0.0 && pivot < f64::INFINITY) {
            return Err((j, pivot));
        }
        let scale = 1.0 / pivot.sqrt();
        for i in 0..BLOCK {
            tile[j][i] *= scale;
        }
        for n in j + 1..count {
            let factor = -tile[j][n];
            for i in 0..BLOCK {
                tile[n][i] = multiply_add::<F, f64>(factor, tile[j][i], tile[n][i]);
            }
        }
    }
    for j in count..BLOCK {
        tile[j] = [0.0; BLOCK];
        tile[j][j] = 1.0;
    }
    Ok(())
}

/// Rows of the inverse of a lower triangular tile: inverse\[k\]\[j\], zero for j > k.
#[inline(always)]
fn invert_tile<F: Features>(l: &Tile) -> Tile {
    let mut inverse = [[0.0; BLOCK]; BLOCK];
    for k in 0..BLOCK {
        let mut row = [0.0; BLOCK];
        row[k] = 1.0;
        for m in 0..k {
            for j in 0..BLOCK {
                row[j] = multiply_add::<F, f64>(-l[m][k], inverse[m][j], row[j]);
            }
        }
        let scale = 1.0 / l[k][k];
        inverse[k] = row.map(|x| x * scale);
    }
    inverse
}

/// tile := tile L^-T with the rows of L^-1 in `inverse`: column n of the result is sum_m tile\[m\] inverse\[n\]\[m\].
#[inline(always)]
fn solve_tile<F: Features>(tile: &Tile, inverse: &Tile) -> Tile {
    let mut out = [[0.0; BLOCK]; BLOCK];
    for n in 0..BLOCK {
        for m in 0..=n {
            for i in 0..BLOCK {
                out[n][i] = multiply_add::<F, f64>(inverse[n][m], tile[m][i], out[n][i]);
            }
        }
    }
    out
}

/// Factors the pivot columns of a front in place: the panel holds columns of A and of the children's updates, and then
/// those of L. `Err((j, pivot))`: pivot j of the front is not positive, or not finite.
///
/// Left-looking by blocks of eight columns: w^2 (r + w / 3) multiply-adds, the panel is read w / 16 times.
#[inline(always)]
pub fn factor_panel<F: Features>(
    shape: FrontShape,
    panel: &mut [f64],
    mut crew: Option<&mut Crew<'_>>,
) -> Result<(), (usize, f64)> {
    let w = shape.width;
    let block_len = w * BLOCK;
    for c in 0..shape.pivot_blocks() {
        let (from, count) = (c * BLOCK, BLOCK.min(w - c * BLOCK));
        let (above, rest) = panel.split_at_mut((c + 1) * block_len);
        let diagonal = &mut above[c * block_len..];
        let (done, own) = diagonal.split_at_mut(from * BLOCK);
        let own = &mut own[..count * BLOCK];
        let mut tile = load(own);
        subtract_product::<F>(&mut tile, done, done);
        factor_tile::<F>(&mut tile, count).map_err(|(j, pivot)| (from + j, pivot))?;
        store(&tile, own);
        let (inverse, columns) = (&invert_tile::<F>(&tile), from..from + count);
        if let Some(Crew { team, isa }) = &mut crew {
            team.for_each_run(rest, block_len, |_, rows| {
                isa.run(Eliminate { rows, block_len, columns: columns.clone(), done, inverse });
            });
        } else {
            Eliminate { rows: rest, block_len, columns, done, inverse }.run::<F>();
        }
    }
    Ok(())
}

/// Some block columns of the rows below a factored diagonal tile: columns := (columns - rows done^T) L^-T.
struct Eliminate<'a> {
    rows: &'a mut [f64],
    block_len: usize,
    columns: Range<usize>,
    done: &'a [f64],
    inverse: &'a Tile,
}

impl Kernel for Eliminate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { rows, block_len, columns, done, inverse } = self;
        for row in rows.chunks_exact_mut(block_len) {
            let (left, own) = row.split_at_mut(columns.start * BLOCK);
            let own = &mut own[..columns.len() * BLOCK];
            let mut tile = load(own);
            subtract_product::<F>(&mut tile, left, done);
            store(&solve_tile::<F>(&tile, inverse), own);
        }
    }
}

/// update -= L21 L21^T, lower triangle, with L21 the rows below in `panel`. w r^2 / 2 multiply-adds.
#[inline(always)]
pub fn update_rest<F: Features>(
    shape: FrontShape,
    panel: &[f64],
    update: &mut [f64],
    crew: Option<&mut Crew<'_>>,
) {
    let block_len = shape.width * BLOCK;
    let (below, blocks) = (&panel[shape.pivot_blocks() * block_len..], shape.below_blocks());
    let Some(Crew { team, isa }) = crew else {
        return Update { below, block_len, rows: 0..blocks, update }.run::<F>();
    };
    let mut rest = update;
    let mut first = 0;
    // Rows of a triangle in pieces of equal area.
    let mut pieces: [_; PIECES] = std::array::from_fn(|piece| {
        let end = (blocks as f64 * ((piece + 1) as f64 / PIECES as f64).sqrt()).round() as usize;
        let (own, others) = std::mem::take(&mut rest).split_at_mut(update_block(end) - update_block(first));
        rest = others;
        (std::mem::replace(&mut first, end)..end, own)
    });
    team.for_each(&mut pieces, |_, (rows, update)| {
        isa.run(Update { below, block_len, rows: rows.clone(), update });
    });
}

/// Some block rows of [`update_rest`]; `update` begins with the first of them.
struct Update<'a> {
    below: &'a [f64],
    block_len: usize,
    rows: Range<usize>,
    update: &'a mut [f64],
}

impl Kernel for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { below, block_len, rows, update } = self;
        let mut tiles = update.chunks_exact_mut(BLOCK * BLOCK);
        for b in rows {
            let a = &below[b * block_len..(b + 1) * block_len];
            for (b, own) in below.chunks_exact(block_len).zip(tiles.by_ref().take(b + 1)) {
                let mut tile = load(own);
                subtract_product::<F>(&mut tile, a, b);
                store(&tile, own);
            }
        }
    }
}

/// The negated inverse -X of a lower triangular pivot block of `width` columns from column `from` on, X L = I.
///
/// `x` holds blocks of eight *columns* of X: x[(c * width + k) * 8 + i] = -X\[k\][8 c + i]. Row k of X is
/// (e_k - sum_{m < k} L\[k\]\[m\] X\[m\]) / L\[k\]\[k\]: w^3 / 6 multiply-adds, eight columns at a time.
#[inline(always)]
pub fn invert_pivots<F: Features>(
    shape: FrontShape,
    panel: &[f64],
    from: usize,
    width: usize,
    x: &mut [f64],
) {
    for c in 0..width.div_ceil(BLOCK) {
        let columns = x[c * width * BLOCK..(c + 1) * width * BLOCK].as_chunks_mut::<BLOCK>().0;
        columns[..c * BLOCK].fill([0.0; BLOCK]);
        for k in c * BLOCK..width {
            let entry = |m: usize| panel[shape.panel_index(from + k, from + m)];
            let mut row = [0.0; BLOCK];
            if k < (c + 1) * BLOCK {
                row[k - c * BLOCK] = -1.0;
            }
            for m in c * BLOCK..k {
                let l = -entry(m);
                for i in 0..BLOCK {
                    row[i] = multiply_add::<F, f64>(l, columns[m][i], row[i]);
                }
            }
            let scale = 1.0 / entry(k);
            columns[k] = row.map(|v| v * scale);
        }
    }
}

/// Columns 8 c .. 8 c + 8 of L X for one block of rows of L (`rows`: its columns of the pivot block, eight rows each),
/// with x from [`invert_pivots`].
#[inline(always)]
pub fn multiply_by_inverse<F: Features>(rows: &[f64], x: &[f64], width: usize, c: usize) -> Tile {
    let mut tile = [[0.0; BLOCK]; BLOCK];
    let skip = c * BLOCK * BLOCK; // X is lower triangular
    subtract_product::<F>(
        &mut tile,
        &rows[skip..width * BLOCK],
        &x[c * width * BLOCK + skip..(c + 1) * width * BLOCK],
    );
    tile
}
