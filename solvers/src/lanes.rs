//! Small vectors of K numbers, one register each: the columns of one vertex.
//!
//! A kernel is written once for any [`Vector`]; [`crate::isa::Features`] says which type stands for K numbers under each
//! instruction set. The portable one is a plain array.
use crate::isa::{Features, Real, multiply_add};
use crate::tile::{Plain, Tile};
use std::marker::PhantomData;

/// K numbers that are computed with together.
pub trait Vector: Copy {
    /// The numbers.
    type T: Real;
    /// Where they lie in memory: `[T; K]`.
    type Row: Copy + Default + AsRef<[Self::T]> + AsMut<[Self::T]> + Send + Sync;
    /// Eight rows of a panel in registers.
    type Tile: Tile<T = Self::T, Row = Self::Row>;
    /// K zeros.
    fn zero() -> Self;
    /// From memory.
    fn load(row: &Self::Row) -> Self;
    /// To memory.
    fn store(self, row: &mut Self::Row);
    /// self + other.
    fn add(self, other: Self) -> Self;
    /// self + l * y, fused where that is fast.
    fn add_scaled(self, l: Self::T, y: Self) -> Self;
    /// self - l * y, fused where that is fast.
    fn sub_scaled(self, l: Self::T, y: Self) -> Self;
}

/// A number type and a K, for which every instruction set has a [`Vector`].
pub trait Shape: 'static {
    /// The numbers.
    type T: Real;
    /// `[T; K]`.
    type Row: Copy + Default + AsRef<[Self::T]> + AsMut<[Self::T]> + Send + Sync;
    /// K.
    const K: usize;
    /// The vector under the features F.
    type Vector<F: Features>: Vector<T = Self::T, Row = Self::Row>;
    /// A buffer as rows of K numbers; a rest shorter than K is left out.
    fn rows(buffer: &mut [Self::T]) -> &mut [Self::Row];
}

macro_rules! shape {
    ($name:ident, $t:ty, $k:literal, $what:literal) => {
        #[doc = $what]
        pub struct $name;
        impl Shape for $name {
            type T = $t;
            type Row = [$t; $k];
            const K: usize = $k;
            type Vector<F: Features> = F::$name;
            fn rows(buffer: &mut [$t]) -> &mut [[$t; $k]] {
                buffer.as_chunks_mut().0
            }
        }
    };
}
shape!(F64x4, f64, 4, "Four f64.");
shape!(F64x8, f64, 8, "Eight f64.");
shape!(F32x4, f32, 4, "Four f32.");
shape!(F32x8, f32, 8, "Eight f32.");

/// A number type with the shapes that sweeps use.
pub trait Lanes: Real {
    /// Up to four columns.
    type Four: Shape<T = Self>;
    /// Up to eight columns.
    type Eight: Shape<T = Self>;
    /// Magnitudes of a right-hand side that neither overflow nor lose digits to underflow on their way through a solve.
    const COMFORTABLE: std::ops::Range<f64>;
}
impl Lanes for f64 {
    const COMFORTABLE: std::ops::Range<f64> = 1e-200..1e200;
    type Four = F64x4;
    type Eight = F64x8;
}
impl Lanes for f32 {
    const COMFORTABLE: std::ops::Range<f64> = 1e-18..1e18;
    type Four = F32x4;
    type Eight = F32x8;
}

/// A vector as an array: on aarch64 its operations are NEON's, on x86-64 SSE2's.
pub struct Array<T, const K: usize, F>([T; K], PhantomData<F>);

impl<T: Copy, const K: usize, F> Clone for Array<T, K, F> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}
impl<T: Copy, const K: usize, F> Copy for Array<T, K, F> {}

macro_rules! array_vector {
    ($k:literal) => {
        impl<T: Real, F: Features> Vector for Array<T, $k, F> {
            type T = T;
            type Row = [T; $k];
            type Tile = Plain<Self>;
            #[inline(always)]
            fn zero() -> Self {
                Self([T::default(); $k], PhantomData)
            }
            #[inline(always)]
            fn load(row: &[T; $k]) -> Self {
                Self(*row, PhantomData)
            }
            #[inline(always)]
            fn store(self, row: &mut [T; $k]) {
                *row = self.0;
            }
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self(std::array::from_fn(|c| self.0[c] + other.0[c]), PhantomData)
            }
            #[inline(always)]
            fn add_scaled(self, l: T, y: Self) -> Self {
                Self(std::array::from_fn(|c| multiply_add::<F, T>(l, y.0[c], self.0[c])), PhantomData)
            }
            #[inline(always)]
            fn sub_scaled(self, l: T, y: Self) -> Self {
                Self(std::array::from_fn(|c| multiply_add::<F, T>(-l, y.0[c], self.0[c])), PhantomData)
            }
        }
    };
}
array_vector!(4);
array_vector!(8);

#[cfg(target_arch = "x86_64")]
pub mod x86 {
    //! Registers of AVX2 with FMA, and of AVX-512.
    use super::Vector;
    use crate::tile::Plain;
    use crate::tile::x86::Pairs;
    use std::arch::x86_64::{
        __m128, __m256, __m256d, __m512d, _mm_add_ps, _mm_fmadd_ps, _mm_fnmadd_ps, _mm_loadu_ps, _mm_set1_ps,
        _mm_setzero_ps, _mm_storeu_ps, _mm256_add_pd, _mm256_add_ps, _mm256_fmadd_pd, _mm256_fmadd_ps,
        _mm256_fnmadd_pd, _mm256_fnmadd_ps, _mm256_loadu_pd, _mm256_loadu_ps, _mm256_set1_pd, _mm256_set1_ps,
        _mm256_setzero_pd, _mm256_setzero_ps, _mm256_storeu_pd, _mm256_storeu_ps, _mm512_add_pd,
        _mm512_fmadd_pd, _mm512_fnmadd_pd, _mm512_loadu_pd, _mm512_set1_pd, _mm512_setzero_pd,
        _mm512_storeu_pd,
    };

    macro_rules! register {
        ($name:ident, $register:ty, $tile:ty, $t:ty, $k:literal, $zero:ident, $load:ident, $store:ident, $add:ident, $set:ident, $fma:ident, $fnma:ident) => {
            /// One register; only named by the [`Features`](crate::isa::Features) that have it.
            #[derive(Clone, Copy)]
            pub struct $name($register);
            // SAFETY (all blocks): these types are named only by `Features` whose kernels `Isa::run` enters after it has
            // seen the instruction set on this machine; `Row` has the length and validity that load and store need.
            impl Vector for $name {
                type T = $t;
                type Row = [$t; $k];
                type Tile = $tile;
                #[inline(always)]
                fn zero() -> Self {
                    // SAFETY: see above.
                    Self(unsafe { $zero() })
                }
                #[inline(always)]
                fn load(row: &[$t; $k]) -> Self {
                    // SAFETY: see above.
                    Self(unsafe { $load(row.as_ptr()) })
                }
                #[inline(always)]
                fn store(self, row: &mut [$t; $k]) {
                    // SAFETY: see above.
                    unsafe { $store(row.as_mut_ptr(), self.0) }
                }
                #[inline(always)]
                fn add(self, other: Self) -> Self {
                    // SAFETY: see above.
                    Self(unsafe { $add(self.0, other.0) })
                }
                #[inline(always)]
                fn add_scaled(self, l: $t, y: Self) -> Self {
                    // SAFETY: see above.
                    Self(unsafe { $fma($set(l), y.0, self.0) })
                }
                #[inline(always)]
                fn sub_scaled(self, l: $t, y: Self) -> Self {
                    // SAFETY: see above.
                    Self(unsafe { $fnma($set(l), y.0, self.0) })
                }
            }
        };
    }
    register!(
        Ymm64,
        __m256d,
        Plain<Ymm64>,
        f64,
        4,
        _mm256_setzero_pd,
        _mm256_loadu_pd,
        _mm256_storeu_pd,
        _mm256_add_pd,
        _mm256_set1_pd,
        _mm256_fmadd_pd,
        _mm256_fnmadd_pd
    );
    register!(
        Zmm64,
        __m512d,
        Plain<Zmm64>,
        f64,
        8,
        _mm512_setzero_pd,
        _mm512_loadu_pd,
        _mm512_storeu_pd,
        _mm512_add_pd,
        _mm512_set1_pd,
        _mm512_fmadd_pd,
        _mm512_fnmadd_pd
    );
    register!(
        Xmm32,
        __m128,
        Pairs,
        f32,
        4,
        _mm_setzero_ps,
        _mm_loadu_ps,
        _mm_storeu_ps,
        _mm_add_ps,
        _mm_set1_ps,
        _mm_fmadd_ps,
        _mm_fnmadd_ps
    );
    register!(
        Ymm32,
        __m256,
        Plain<Ymm32>,
        f32,
        8,
        _mm256_setzero_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_set1_ps,
        _mm256_fmadd_ps,
        _mm256_fnmadd_ps
    );

    /// Eight f64 in two registers of AVX2.
    #[derive(Clone, Copy)]
    pub struct TwoYmm64(Ymm64, Ymm64);
    impl Vector for TwoYmm64 {
        type T = f64;
        type Row = [f64; 8];
        type Tile = Plain<Self>;
        #[inline(always)]
        fn zero() -> Self {
            Self(Ymm64::zero(), Ymm64::zero())
        }
        #[inline(always)]
        fn load(row: &[f64; 8]) -> Self {
            let (halves, _) = row.as_chunks::<4>();
            Self(Ymm64::load(&halves[0]), Ymm64::load(&halves[1]))
        }
        #[inline(always)]
        fn store(self, row: &mut [f64; 8]) {
            let (halves, _) = row.as_chunks_mut::<4>();
            self.0.store(&mut halves[0]);
            self.1.store(&mut halves[1]);
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(self.0.add(other.0), self.1.add(other.1))
        }
        #[inline(always)]
        fn add_scaled(self, l: f64, y: Self) -> Self {
            Self(self.0.add_scaled(l, y.0), self.1.add_scaled(l, y.1))
        }
        #[inline(always)]
        fn sub_scaled(self, l: f64, y: Self) -> Self {
            Self(self.0.sub_scaled(l, y.0), self.1.sub_scaled(l, y.1))
        }
    }
}
