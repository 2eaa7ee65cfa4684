//! The two sweeps: what a frame consists of.
//!
//! With the panels' matrices M and S^-1 (see [`super::panels`]) and y the permuted right-hand side:
//! - forward, panel after panel: y_rows -= M y_pivots, then y_pivots := S^-1 y_pivots;
//! - backward, in reverse: y_pivots -= M^T y_rows.
//!
//! A vector entry is an array of K numbers, the K columns of a vertex: one register. An entry of M is broadcast to it.
//! Per entry of M and sweep: one multiply-add of K lanes and 8 (f64) or 4 (f32) bytes streamed; per row of a panel 4 bytes
//! of index and one load (and store) of K numbers, from cache.
use super::front::BLOCK;
use super::panels::{Panel, Panels, STRIP};
use crate::isa::{Features, Kernel, Real, multiply_add};

/// The forward sweep over all panels.
pub struct Forward<'a, T, const K: usize> {
    /// The factor.
    pub panels: &'a Panels<T>,
    /// In: right-hand side by local number. Out: S^-1 y on the pivots, updates on the rows of the top.
    pub work: &'a mut [[T; K]],
}

impl<T: Real, const K: usize> Kernel for Forward<'_, T, K> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for panel in &self.panels.list {
            forward::<F, T, K>(self.panels, panel, self.work);
        }
    }
}

/// The backward sweep over all panels.
pub struct Backward<'a, T, const K: usize> {
    /// The factor.
    pub panels: &'a Panels<T>,
    /// In: what [`Forward`] left, with the solution on the rows of the top. Out: the solution.
    pub work: &'a mut [[T; K]],
}

impl<T: Real, const K: usize> Kernel for Backward<'_, T, K> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        for panel in self.panels.list.iter().rev() {
            backward::<F, T, K>(self.panels, panel, self.work);
        }
    }
}

#[inline(always)]
fn add_product<F: Features, T: Real, const K: usize>(sum: &mut [T; K], l: T, y: &[T; K]) {
    for c in 0..K {
        sum[c] = multiply_add::<F, T>(l, y[c], sum[c]);
    }
}

/// y_rows -= M y_pivots; y_pivots := S^-1 y_pivots.
#[inline(always)]
fn forward<F: Features, T: Real, const K: usize>(panels: &Panels<T>, panel: &Panel, work: &mut [[T; K]]) {
    let (first, width) = (panel.first as usize, panel.width as usize);
    let mut buffer = [[T::default(); K]; STRIP];
    let y = &mut buffer[..width];
    for (y, w) in y.iter_mut().zip(&work[first..first + width]) {
        *y = w.map(|v| -v);
    }
    let (blocks, tail) = panels.rows[panel.rows()].as_chunks::<BLOCK>();
    let (values, tail_values) = panels.values[panel.values()].split_at(blocks.len() * BLOCK * width);
    for (rows, m) in blocks.iter().zip(values.chunks_exact(BLOCK * width)) {
        let mut sum = rows.map(|row| work[row as usize]);
        multiply::<F, T, K, BLOCK>(&mut sum, m, y);
        for (row, sum) in rows.iter().zip(&sum) {
            work[*row as usize] = *sum;
        }
    }
    macro_rules! tails {
        ($($t:literal)*) => {
            match tail.len() {
                $($t => {
                    let rows: &[u32; $t] = tail.try_into().expect("matched length");
                    let mut sum = rows.map(|row| work[row as usize]);
                    multiply::<F, T, K, $t>(&mut sum, tail_values, y);
                    for (row, sum) in rows.iter().zip(&sum) {
                        work[*row as usize] = *sum;
                    }
                })*
                _ => {}
            }
        };
    }
    tails!(1 2 3 4 5 6 7);
    let inverse = &panels.diagonal[panel.diagonal()];
    let (blocks, tail) = work[first..first + width].as_chunks_mut::<BLOCK>();
    let (values, tail_values) = inverse.split_at(blocks.len() * BLOCK * width);
    for (out, m) in blocks.iter_mut().zip(values.chunks_exact(BLOCK * width)) {
        let mut sum = [[T::default(); K]; BLOCK];
        multiply::<F, T, K, BLOCK>(&mut sum, m, y);
        for (out, sum) in out.iter_mut().zip(&sum) {
            *out = sum.map(|v| -v);
        }
    }
    macro_rules! tails {
        ($($t:literal)*) => {
            match tail.len() {
                $($t => {
                    let mut sum = [[T::default(); K]; $t];
                    multiply::<F, T, K, $t>(&mut sum, tail_values, y);
                    for (out, sum) in tail.iter_mut().zip(&sum) {
                        *out = sum.map(|v| -v);
                    }
                })*
                _ => {}
            }
        };
    }
    tails!(1 2 3 4 5 6 7);
}

/// sum[i] += sum_j m[j][i] y[j] for R rows stored column after column.
#[inline(always)]
fn multiply<F: Features, T: Real, const K: usize, const R: usize>(
    sum: &mut [[T; K]; R],
    m: &[T],
    y: &[[T; K]],
) {
    for (m, y) in m.as_chunks::<R>().0.iter().zip(y) {
        for i in 0..R {
            add_product::<F, T, K>(&mut sum[i], m[i], y);
        }
    }
}

/// y_pivots -= M^T y_rows.
#[inline(always)]
fn backward<F: Features, T: Real, const K: usize>(panels: &Panels<T>, panel: &Panel, work: &mut [[T; K]]) {
    let (first, width) = (panel.first as usize, panel.width as usize);
    let mut buffer = [[T::default(); K]; STRIP];
    let x = &mut buffer[..width];
    x.copy_from_slice(&work[first..first + width]);
    let (blocks, tail) = panels.rows[panel.rows()].as_chunks::<BLOCK>();
    let (values, tail_values) = panels.values[panel.values()].split_at(blocks.len() * BLOCK * width);
    for (rows, m) in blocks.iter().zip(values.chunks_exact(BLOCK * width)) {
        let y = rows.map(|row| work[row as usize].map(|v| -v));
        multiply_transposed::<F, T, K, BLOCK>(x, m, &y);
    }
    macro_rules! tails {
        ($($t:literal)*) => {
            match tail.len() {
                $($t => {
                    let rows: &[u32; $t] = tail.try_into().expect("matched length");
                    let y = rows.map(|row| work[row as usize].map(|v| -v));
                    multiply_transposed::<F, T, K, $t>(x, tail_values, &y);
                })*
                _ => {}
            }
        };
    }
    tails!(1 2 3 4 5 6 7);
    work[first..first + width].copy_from_slice(x);
}

/// x[j] += sum_i m[j][i] y[i] for R rows stored column after column.
#[inline(always)]
fn multiply_transposed<F: Features, T: Real, const K: usize, const R: usize>(
    x: &mut [[T; K]],
    m: &[T],
    y: &[[T; K]; R],
) {
    for (m, x) in m.as_chunks::<R>().0.iter().zip(x) {
        for i in 0..R {
            add_product::<F, T, K>(x, m[i], &y[i]);
        }
    }
}
