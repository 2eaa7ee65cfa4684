//! Eight rows of vectors in registers: what a sweep holds of a panel while it walks over its pivots.
//!
//! The plain tile has one register per row and broadcasts every matrix entry. Where a row fills half a register
//! (four f32 under AVX2), [`x86::Pairs`] has two rows in each: half the multiplications, and one load of eight
//! entries in place of eight broadcasts.
use crate::isa::{Real, prefetch};
use crate::lanes::Vector;

/// Rows of a tile.
pub const ROWS: usize = 8;

/// Eight rows of K numbers of type T each, in registers.
pub trait Tile: Copy {
    /// The numbers.
    type T: Real;
    /// A row in memory: `[T; K]`.
    type Row: Copy + Default;
    /// The rows of `from` with the numbers `rows`, less `base`.
    fn gather(rows: &[u32; ROWS], base: u32, from: &[Self::Row]) -> Self;
    /// Back to where [`gather`](Self::gather) took them from.
    fn scatter(self, rows: &[u32; ROWS], base: u32, into: &mut [Self::Row]);
    /// Rows -= M y: row i -= sum_p m\[p\]\[i\] y\[p\] for the pivots p that m has; y may have more.
    fn sub_product(&mut self, m: &[[Self::T; ROWS]], y: &[Self::Row]);
    /// x -= M^T rows: x\[p\] -= sum_i m\[p\]\[i\] row i for the pivots p that m has; x may have more.
    fn sub_transposed(&self, m: &[[Self::T; ROWS]], x: &mut [Self::Row]);
}

/// How far before their use entries of M are asked for, in bytes. One core keeps more lines on their way from memory into
/// the second-level cache than its own loads can wait for; hardware prefetchers lose the stream at every panel's end in the
/// backward sweep, which goes down through memory.
const AHEAD: isize = 4096;

/// Asks for the entries that come 4 KiB after `m` (`sign` 1) or before it (-1).
#[inline(always)]
pub fn ask<T>(m: &T, sign: isize) {
    prefetch(m, sign * AHEAD);
}

/// One register per row.
#[derive(Clone, Copy)]
pub struct Plain<V>([V; ROWS]);

impl<V: Vector> Tile for Plain<V> {
    type T = V::T;
    type Row = V::Row;

    // Plain loops: a closure handed to `array::map` would not be compiled with the vectors.
    #[inline(always)]
    fn gather(rows: &[u32; ROWS], base: u32, from: &[V::Row]) -> Self {
        let mut tile = [V::zero(); ROWS];
        for i in 0..ROWS {
            tile[i] = V::load(&from[(rows[i] - base) as usize]);
        }
        Self(tile)
    }

    #[inline(always)]
    fn scatter(self, rows: &[u32; ROWS], base: u32, into: &mut [V::Row]) {
        for i in 0..ROWS {
            self.0[i].store(&mut into[(rows[i] - base) as usize]);
        }
    }

    #[inline(always)]
    fn sub_product(&mut self, m: &[[V::T; ROWS]], y: &[V::Row]) {
        for (m, y) in m.iter().zip(y) {
            ask(m, 1);
            let y = V::load(y);
            for i in 0..ROWS {
                self.0[i] = self.0[i].sub_scaled(m[i], y);
            }
        }
    }

    // In two sums per pivot, which halves the chain of dependent additions.
    #[inline(always)]
    fn sub_transposed(&self, m: &[[V::T; ROWS]], x: &mut [V::Row]) {
        for (m, x) in m.iter().zip(x) {
            ask(m, -1);
            let mut sums = [V::load(x), V::zero()];
            for i in 0..ROWS {
                sums[i % 2] = sums[i % 2].sub_scaled(m[i], self.0[i]);
            }
            sums[0].add(sums[1]).store(x);
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub mod x86 {
    //! The tile of four f32 per row for AVX2 with FMA.
    use super::{ROWS, Tile, ask};
    use std::arch::x86_64::{
        __m256, _mm_add_ps, _mm_loadu_ps, _mm_storeu_ps, _mm_sub_ps, _mm256_add_ps, _mm256_blend_ps,
        _mm256_broadcast_ps, _mm256_castps128_ps256, _mm256_castps256_ps128, _mm256_extractf128_ps,
        _mm256_fmadd_ps, _mm256_fnmadd_ps, _mm256_insertf128_ps, _mm256_loadu_ps, _mm256_mul_ps,
        _mm256_permute_ps, _mm256_permute2f128_ps, _mm256_setzero_ps, _mm256_storeu_ps, _mm256_sub_ps,
    };

    /// Rows i and i + 4 in register i. Eight entries are then one load, and the two that belong to a register are spread
    /// over it by one permutation within its halves: per eight entries four multiply-adds, four permutations, one load.
    #[derive(Clone, Copy)]
    pub struct Pairs([__m256; 4]);

    /// Entry i of the lower half of `$m` in all lanes of the lower half, entry i of the upper half in all of the upper.
    macro_rules! spread {
        ($m:expr, $i:literal) => {
            _mm256_permute_ps::<{ 0b0101_0101 * $i }>($m)
        };
    }

    // SAFETY (all blocks): named only by `Features` whose kernels `Isa::run` enters after it has seen AVX2 and FMA on this
    // machine; every pointer comes from a reference to as many numbers as are read or written.
    impl Tile for Pairs {
        type T = f32;
        type Row = [f32; 4];

        #[inline(always)]
        fn gather(rows: &[u32; ROWS], base: u32, from: &[[f32; 4]]) -> Self {
            let row = |i: usize| from[(rows[i] - base) as usize].as_ptr();
            // SAFETY: see above.
            let mut tile = [unsafe { _mm256_setzero_ps() }; 4];
            for i in 0..4 {
                let (low, high) = (row(i), row(i + 4));
                // SAFETY: see above.
                tile[i] = unsafe {
                    _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(_mm_loadu_ps(low)), _mm_loadu_ps(high))
                };
            }
            Self(tile)
        }

        #[inline(always)]
        fn scatter(self, rows: &[u32; ROWS], base: u32, into: &mut [[f32; 4]]) {
            for i in 0..4 {
                let low = into[(rows[i] - base) as usize].as_mut_ptr();
                // SAFETY: see above.
                unsafe { _mm_storeu_ps(low, _mm256_castps256_ps128(self.0[i])) };
                let high = into[(rows[i + 4] - base) as usize].as_mut_ptr();
                // SAFETY: see above.
                unsafe { _mm_storeu_ps(high, _mm256_extractf128_ps::<1>(self.0[i])) };
            }
        }

        #[inline(always)]
        fn sub_product(&mut self, m: &[[f32; ROWS]], y: &[[f32; 4]]) {
            let y = &y[..m.len()];
            let (twos, last) = m.as_chunks::<2>();
            let (y_twos, y_last) = y.as_chunks::<2>();
            // Odd pivots in sums of their own: with four registers the chain of dependent additions would set the pace.
            // SAFETY: see above.
            let mut odd = Self([unsafe { _mm256_setzero_ps() }; 4]);
            for (m, y) in twos.iter().zip(y_twos) {
                ask(m, 1);
                self.sub_scaled(&m[0], &y[0]);
                odd.sub_scaled(&m[1], &y[1]);
            }
            for i in 0..4 {
                // SAFETY: see above.
                self.0[i] = unsafe { _mm256_add_ps(self.0[i], odd.0[i]) };
            }
            if let ([m], [y]) = (last, y_last) {
                self.sub_scaled(m, y);
            }
        }

        #[inline(always)]
        fn sub_transposed(&self, m: &[[f32; ROWS]], x: &mut [[f32; 4]]) {
            let (twos, last) = m.as_chunks::<2>();
            let (x_twos, x_last) = x[..m.len()].as_chunks_mut::<2>();
            for (m, x) in twos.iter().zip(x_twos) {
                ask(m, -1);
                let (a, b) = (self.halves(&m[0]), self.halves(&m[1]));
                let x = x.as_flattened_mut().as_mut_ptr();
                // SAFETY: see above; x is eight numbers.
                unsafe {
                    // [a's low half, b's high half] + [a's high half, b's low half]
                    let sum =
                        _mm256_add_ps(_mm256_blend_ps::<0xf0>(a, b), _mm256_permute2f128_ps::<0x21>(a, b));
                    _mm256_storeu_ps(x, _mm256_sub_ps(_mm256_loadu_ps(x), sum));
                }
            }
            if let ([m], [x]) = (last, x_last) {
                let a = self.halves(m);
                // SAFETY: see above.
                unsafe {
                    let sum = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
                    _mm_storeu_ps(x.as_mut_ptr(), _mm_sub_ps(_mm_loadu_ps(x.as_ptr()), sum));
                }
            }
        }
    }

    impl Pairs {
        /// Row i -= m\[i\] y.
        #[inline(always)]
        fn sub_scaled(&mut self, m: &[f32; ROWS], y: &[f32; 4]) {
            let t = &mut self.0;
            // SAFETY: see above.
            unsafe {
                let m = _mm256_loadu_ps(m.as_ptr());
                let low = _mm_loadu_ps(y.as_ptr());
                let y = _mm256_broadcast_ps(&low);
                t[0] = _mm256_fnmadd_ps(spread!(m, 0), y, t[0]);
                t[1] = _mm256_fnmadd_ps(spread!(m, 1), y, t[1]);
                t[2] = _mm256_fnmadd_ps(spread!(m, 2), y, t[2]);
                t[3] = _mm256_fnmadd_ps(spread!(m, 3), y, t[3]);
            }
        }

        /// sum_i m\[i\] row i over the first four rows in the low half, over the others in the high half.
        #[inline(always)]
        fn halves(&self, m: &[f32; ROWS]) -> __m256 {
            let t = &self.0;
            // SAFETY: see above.
            unsafe {
                let m = _mm256_loadu_ps(m.as_ptr());
                let a = _mm256_mul_ps(spread!(m, 0), t[0]);
                let b = _mm256_mul_ps(spread!(m, 1), t[1]);
                let a = _mm256_fmadd_ps(spread!(m, 2), t[2], a);
                let b = _mm256_fmadd_ps(spread!(m, 3), t[3], b);
                _mm256_add_ps(a, b)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::{Features, Isa, Kernel};
    use crate::lanes::{F32x4, F32x8, F64x4, F64x8, Shape};
    use std::marker::PhantomData;

    /// Small integers: every order of summation gives the same result.
    fn number<T: Real>(seed: usize) -> T {
        T::from_f64((seed * 7919 % 17) as f64 - 8.0)
    }

    struct Both<S>(usize, PhantomData<S>);

    impl<S: Shape> Kernel for Both<S> {
        type Output = ();

        fn run<F: Features>(self) {
            type TileOf<S, F> = <<S as Shape>::Vector<F> as Vector>::Tile;
            let pivots = self.0;
            let m: Vec<[S::T; ROWS]> =
                (0..pivots).map(|p| std::array::from_fn(|i| number(3 * p + 5 * i + 1))).collect();
            let row = |seed: usize| {
                let mut row = S::Row::default();
                row.as_mut().iter_mut().enumerate().for_each(|(c, v)| *v = number(seed + 11 * c));
                row
            };
            let rows: [u32; ROWS] = [12, 10, 17, 19, 11, 30, 21, 13];
            let base = 10;
            // One pivot more than the matrix has, which must stay as it is.
            let y: Vec<S::Row> = (0..=pivots).map(|p| row(p + 2)).collect();
            let start: Vec<S::Row> = (0..21).map(|r| row(4 * r)).collect();

            let mut after = start.clone();
            let mut tile = TileOf::<S, F>::gather(&rows, base, &after);
            tile.sub_product(&m, &y);
            tile.scatter(&rows, base, &mut after);
            let mut x = y.clone();
            TileOf::<S, F>::gather(&rows, base, &start).sub_transposed(&m, &mut x);

            let (mut expected, mut expected_x) = (start.clone(), y.clone());
            for (p, m) in m.iter().enumerate() {
                for (i, &r) in rows.iter().enumerate() {
                    let at = (r - base) as usize;
                    for c in 0..S::K {
                        let value =
                            expected[at].as_ref()[c].to_f64() - m[i].to_f64() * y[p].as_ref()[c].to_f64();
                        expected[at].as_mut()[c] = S::T::from_f64(value);
                        let value = expected_x[p].as_ref()[c].to_f64()
                            - m[i].to_f64() * start[at].as_ref()[c].to_f64();
                        expected_x[p].as_mut()[c] = S::T::from_f64(value);
                    }
                }
            }
            let numbers = |rows: &[S::Row]| rows.iter().flat_map(|r| r.as_ref().to_vec()).collect::<Vec<_>>();
            assert_eq!(numbers(&after), numbers(&expected), "{pivots} pivots, M y");
            assert_eq!(numbers(&x), numbers(&expected_x), "{pivots} pivots, M^T rows");
        }
    }

    #[test]
    fn tiles_of_all_instruction_sets_are_products_with_the_matrix() {
        for isa in Isa::available() {
            for pivots in 0..8 {
                isa.run(Both::<F64x4>(pivots, PhantomData));
                isa.run(Both::<F64x8>(pivots, PhantomData));
                isa.run(Both::<F32x4>(pivots, PhantomData));
                isa.run(Both::<F32x8>(pivots, PhantomData));
            }
        }
    }
}
