//! The two sweeps: what a frame consists of.
//!
//! With the panels' matrices M and X, S^-1 = X^T X (see [`super::panels`]) and y the permuted right-hand side:
//! - forward, panel after panel: y_rows -= M y_pivots, then y_pivots := X^T (X y_pivots);
//! - backward, in reverse: y_pivots -= M^T y_rows.
//!
//! A vector entry holds K numbers, the columns of a vertex, in one register; an entry of M is broadcast to it. Per entry
//! of M and sweep: one multiply-add of K lanes and 8 (f64) or 4 (f32) bytes streamed. Per row of a panel: 4 bytes of
//! index, one load (and in the forward sweep one store) of K numbers, mostly from cache. Per block of eight rows and
//! pivot: one load (and in the backward sweep one store) of K numbers from the first cache.
use super::front::{BLOCK, update_block};
use super::panels::{Panel, Panels, STRIP};
use crate::isa::{Features, Kernel};
use crate::lanes::{Shape, Vector};
use crate::tile::{Tile, ask};

/// The forward sweep over all panels.
pub struct Forward<'a, S: Shape> {
    /// The factor.
    pub panels: &'a Panels<S::T>,
    /// Panels to visit, ascending; all where `None`. The pivots of the others must be zero.
    pub active: Option<&'a [u32]>,
    /// In: right-hand side by local number. Out: S^-1 y on the pivots, updates on the rows of the top.
    pub work: &'a mut [S::Row],
}

impl<S: Shape> Kernel for Forward<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        match self.active {
            None => {
                for panel in &self.panels.list {
                    forward::<S::Vector<F>>(self.panels, panel, self.work);
                }
            }
            Some(active) => {
                for &at in active {
                    forward::<S::Vector<F>>(self.panels, &self.panels.list[at as usize], self.work);
                }
            }
        }
    }
}

/// The backward sweep over all panels.
pub struct Backward<'a, S: Shape> {
    /// The factor.
    pub panels: &'a Panels<S::T>,
    /// In: what [`Forward`] left, with the solution on the rows of the top. Out: the solution.
    pub work: &'a mut [S::Row],
}

impl<S: Shape> Kernel for Backward<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for panel in self.panels.list.iter().rev() {
            backward::<S::Vector<F>>(self.panels, panel, self.work);
        }
    }
}

/// Runs `$body` with the constant `$r` equal to `$length`, for 1 to 7 rows.
macro_rules! with_length {
    ($length:expr, $r:ident, $body:block) => {
        with_length!(@ $length, $r, $body, 1 2 3 4 5 6 7)
    };
    (@ $length:expr, $r:ident, $body:block, $($n:literal)*) => {
        match $length {
            $($n => { const $r: usize = $n; $body })*
            _ => {}
        }
    };
}

/// y_rows -= M y_pivots; y_pivots := X^T (X y_pivots).
#[inline(always)]
fn forward<V: Vector>(panels: &Panels<V::T>, panel: &Panel, work: &mut [V::Row]) {
    let (first, width) = (panel.first as usize, panel.width as usize);
    // Rows below have larger numbers than pivots.
    let (own, rest) = work.split_at_mut(first + width);
    let own = &mut own[first..];
    let base = (first + width) as u32;
    let (blocks, tail) = panels.rows[panel.rows()].as_chunks::<BLOCK>();
    let (m, tail_m) = panels.values[panel.values()].split_at(blocks.len() * BLOCK * width);
    for (rows, m) in blocks.iter().zip(m.chunks_exact(BLOCK * width)) {
        let mut tile = V::Tile::gather(rows, base, rest);
        tile.sub_product(m.as_chunks().0, own);
        tile.scatter(rows, base, rest);
    }
    with_length!(tail.len(), R, {
        subtract_product::<V, R>(tail.first_chunk().expect("R rows"), tail_m, own, base, rest);
    });
    let inverse = &panels.diagonal[panel.diagonal()];
    match width {
        0..BLOCK => with_length!(width, W, { multiply_in_place::<V, W>(inverse, own) }),
        _ => multiply_pivots::<V>(inverse, own),
    }
}

/// The rows of a block. A plain loop: a closure handed to `array::map` would not be compiled with the vectors.
#[inline(always)]
fn load_rows<V: Vector, const R: usize>(rows: &[u32; R], base: u32, rest: &[V::Row]) -> [V; R] {
    let mut y = [V::zero(); R];
    for i in 0..R {
        y[i] = V::load(&rest[(rows[i] - base) as usize]);
    }
    y
}

/// y_rows -= M y for one block of R rows; `rest` starts at row `base`.
#[inline(always)]
fn subtract_product<V: Vector, const R: usize>(
    rows: &[u32; R],
    m: &[V::T],
    y: &[V::Row],
    base: u32,
    rest: &mut [V::Row],
) {
    let mut sum = load_rows::<V, R>(rows, base, rest);
    for (m, y) in m.as_chunks::<R>().0.iter().zip(y) {
        ask(m, 1);
        let y = V::load(y);
        for i in 0..R {
            sum[i] = sum[i].sub_scaled(m[i], y);
        }
    }
    for i in 0..R {
        sum[i].store(&mut rest[(rows[i] - base) as usize]);
    }
}

/// y := X^T (X y) for W pivots, W < 8: all of X y fits the registers, and X is read again from the first cache.
#[inline(always)]
fn multiply_in_place<V: Vector, const W: usize>(x: &[V::T], y: &mut [V::Row]) {
    let columns = x.as_chunks::<W>().0;
    let mut sum = [V::zero(); W];
    for (x, y) in columns.iter().zip(&*y) {
        ask(x, 1);
        let y = V::load(y);
        for i in 0..W {
            sum[i] = sum[i].add_scaled(x[i], y);
        }
    }
    for (x, y) in columns.iter().zip(y) {
        dot::<V, W>(x, &sum, V::zero()).store(y);
    }
}

/// start + sum_i x\[i\] y\[i\]; two sums halve the chain of dependent additions.
#[inline(always)]
fn dot<V: Vector, const R: usize>(x: &[V::T; R], y: &[V; R], start: V) -> V {
    let mut sums = [start, V::zero()];
    for i in 0..R {
        sums[i % 2] = sums[i % 2].add_scaled(x[i], y[i]);
    }
    sums[0].add(sums[1])
}

/// y := X^T (X y) for eight pivots or more. Tiles subtract, so the product in between has its sign turned.
#[inline(always)]
fn multiply_pivots<V: Vector>(x: &[V::T], y: &mut [V::Row]) {
    let mut buffer = [V::Row::default(); STRIP];
    let product = &mut buffer[..y.len()];
    let (blocks, tail) = product.as_chunks_mut::<BLOCK>();
    let tail_x = &x[update_block(blocks.len())..];
    for (b, out) in blocks.iter_mut().enumerate() {
        let mut tile = V::Tile::gather(&FIRST, 0, &*out);
        tile.sub_product(x[update_block(b)..update_block(b + 1)].as_chunks().0, y);
        tile.scatter(&FIRST, 0, out);
    }
    with_length!(tail.len(), R, {
        multiply_rows::<V, R>(tail_x, y, tail.first_chunk_mut().expect("R rows"));
    });
    y.fill(V::Row::default());
    for (b, rows) in blocks.iter().enumerate() {
        let tile = V::Tile::gather(&FIRST, 0, rows);
        tile.sub_transposed(x[update_block(b)..update_block(b + 1)].as_chunks().0, y);
    }
    with_length!(tail.len(), R, {
        add_transposed::<V, R>(tail_x, tail.first_chunk().expect("R rows"), y);
    });
}

/// The numbers of a tile's rows that lie one after another.
const FIRST: [u32; BLOCK] = [0, 1, 2, 3, 4, 5, 6, 7];

/// y += m^T rows for the columns that m has.
#[inline(always)]
fn add_transposed<V: Vector, const R: usize>(m: &[V::T], rows: &[V::Row; R], y: &mut [V::Row]) {
    let mut sum = [V::zero(); R];
    for i in 0..R {
        sum[i] = V::load(&rows[i]);
    }
    for (m, y) in m.as_chunks::<R>().0.iter().zip(y) {
        dot::<V, R>(m, &sum, V::load(y)).store(y);
    }
}

/// out := m y for R rows.
#[inline(always)]
fn multiply_rows<V: Vector, const R: usize>(m: &[V::T], y: &[V::Row], out: &mut [V::Row; R]) {
    let mut sum = [V::zero(); R];
    for (m, y) in m.as_chunks::<R>().0.iter().zip(y) {
        ask(m, 1);
        let y = V::load(y);
        for i in 0..R {
            sum[i] = sum[i].add_scaled(m[i], y);
        }
    }
    for i in 0..R {
        sum[i].store(&mut out[i]);
    }
}

/// y_pivots -= M^T y_rows.
#[inline(always)]
fn backward<V: Vector>(panels: &Panels<V::T>, panel: &Panel, work: &mut [V::Row]) {
    let (first, width) = (panel.first as usize, panel.width as usize);
    let (own, rest) = work.split_at_mut(first + width);
    let own = &mut own[first..];
    let base = (first + width) as u32;
    let (blocks, tail) = panels.rows[panel.rows()].as_chunks::<BLOCK>();
    let (m, tail_m) = panels.values[panel.values()].split_at(blocks.len() * BLOCK * width);
    // The last block first: panels and blocks then come in one descending stream.
    with_length!(tail.len(), R, {
        subtract_transposed::<V, R>(tail.first_chunk().expect("R rows"), tail_m, own, base, rest);
    });
    for (rows, m) in blocks.iter().zip(m.chunks_exact(BLOCK * width)).rev() {
        let tile = V::Tile::gather(rows, base, rest);
        tile.sub_transposed(m.as_chunks().0, own);
    }
}

/// x -= M^T y_rows for one block of R rows. Two sums per pivot halve the chain of dependent additions.
#[inline(always)]
fn subtract_transposed<V: Vector, const R: usize>(
    rows: &[u32; R],
    m: &[V::T],
    x: &mut [V::Row],
    base: u32,
    rest: &[V::Row],
) {
    let y = load_rows::<V, R>(rows, base, rest);
    for (m, x) in m.as_chunks::<R>().0.iter().zip(x) {
        ask(m, -1);
        let mut sums = [V::load(x), V::zero()];
        for i in 0..R {
            sums[i % 2] = sums[i % 2].sub_scaled(m[i], y[i]);
        }
        sums[0].add(sums[1]).store(x);
    }
}

/// into += from, row by row.
pub fn accumulate<S: Shape>(into: &mut [S::Row], from: &[S::Row]) {
    for (into, from) in into.iter_mut().zip(from) {
        into.as_mut().iter_mut().zip(from.as_ref()).for_each(|(a, &b)| *a += b);
    }
}
