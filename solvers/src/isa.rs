//! Run-time choice of the instruction set: one kernel text, compiled once for each.
//!
//! Kernels are plain safe Rust over small arrays and [`crate::lanes`]s, compiled once per instruction set. On aarch64 NEON
//! is part of the base architecture, so the portable compilation is the NEON one.
use crate::error::Unavailable;
use crate::lanes::{Array, Vector};

/// Overrides the choice; see [`Isa::from_environment`].
const VARIABLE: &str = "LAPSOLVE_ISA";

/// An instruction set that this machine has and kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// What the target guarantees: SSE2 on x86-64, NEON on aarch64.
    Portable,
    /// AVX2 and FMA: 256-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 F, VL, DQ and BW: 512-bit vectors and 32 registers.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// What a kernel may count on, known while it is compiled.
pub trait Features: Sized + 'static {
    /// Whether `mul_add` is one instruction; elsewhere it is a slow library call.
    const FMA: bool;
    /// Whether 16 registers of 8 doubles fit: decides how large tiles of dense kernels are.
    const WIDE: bool;
    /// Four f64.
    type F64x4: Vector<T = f64, Row = [f64; 4]>;
    /// Eight f64.
    type F64x8: Vector<T = f64, Row = [f64; 8]>;
    /// Four f32.
    type F32x4: Vector<T = f32, Row = [f32; 4]>;
    /// Eight f32.
    type F32x8: Vector<T = f32, Row = [f32; 8]>;
}

/// A computation to be compiled for every instruction set.
///
/// `run` must be `#[inline(always)]`, and so must everything it calls that is to use the vectors.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Runs under the features `F`.
    fn run<F: Features>(self) -> Self::Output;
}

/// a * b + c, fused where that is fast.
#[inline(always)]
pub fn multiply_add<F: Features, T: Real>(a: T, b: T, c: T) -> T {
    if F::FMA { a.fused(b, c) } else { a * b + c }
}

/// f32 or f64.
pub trait Real:
    Copy
    + Default
    + Send
    + Sync
    + PartialEq
    + std::fmt::Debug
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Neg<Output = Self>
    + std::ops::AddAssign
    + 'static
{
    /// Rounds to this type.
    fn from_f64(x: f64) -> Self;
    /// Exact.
    fn to_f64(self) -> f64;
    /// self * b + c with one rounding.
    fn fused(self, b: Self, c: Self) -> Self;
}

macro_rules! real {
    ($t:ty) => {
        impl Real for $t {
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn fused(self, b: Self, c: Self) -> Self {
                self.mul_add(b, c)
            }
        }
    };
}
real!(f32);
real!(f64);

/// Asks for the cache line `ahead` bytes after `at` (before it, where negative), into the second-level cache.
/// The place may lie outside of every buffer: a hint never faults. Nothing on other machines than x86-64.
#[inline(always)]
pub fn prefetch<T>(at: &T, ahead: isize) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        let place = std::ptr::from_ref(at).cast::<i8>().wrapping_offset(ahead);
        // SAFETY: a prefetch reads nothing that a program can see, and takes any address.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(place) };
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = (at, ahead);
}

/// How many rows ahead a loop that jumps between rows asks for them. A frame streams its factor between two visits of a
/// vector, so the rows come from memory: with 160 rather than 24 a solve of 306 thousand triangles took 7 (f64) to 10% (f32)
/// less time on a Zen 3. 160 rows of three f64 are an eighth of the first-level cache.
pub const ROWS_AHEAD: usize = 160;

/// Asks for the cache line of a place that is about to be read or written, into the first-level cache. Any address may be
/// given, as in [`prefetch`].
#[inline(always)]
pub fn prefetch_near<T>(at: *const T) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing that a program can see, and takes any address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) };
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = at;
}

struct Base;
impl Features for Base {
    const FMA: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));
    const WIDE: bool = false;
    type F64x4 = Array<f64, 4, Self>;
    type F64x8 = Array<f64, 8, Self>;
    type F32x4 = Array<f32, 4, Self>;
    type F32x8 = Array<f32, 8, Self>;
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Features, Kernel};
    use crate::lanes::x86;

    pub struct WithAvx2;
    impl Features for WithAvx2 {
        const FMA: bool = true;
        const WIDE: bool = false;
        type F64x4 = x86::Ymm64;
        type F64x8 = x86::TwoYmm64;
        type F32x4 = x86::Xmm32;
        type F32x8 = x86::Ymm32;
    }

    pub struct WithAvx512;
    impl Features for WithAvx512 {
        const FMA: bool = true;
        const WIDE: bool = true;
        type F64x4 = x86::Ymm64;
        type F64x8 = x86::Zmm64;
        type F32x4 = x86::Xmm32;
        type F32x8 = x86::Ymm32;
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<WithAvx2>()
    }

    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
    pub fn avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<WithAvx512>()
    }
}

impl Isa {
    /// Every instruction set that this machine has, the best one last.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut sets = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Self::Avx2);
                let avx512 = is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw");
                if avx512 {
                    sets.push(Self::Avx512);
                }
            }
        }
        sets
    }

    /// The best instruction set of this machine.
    pub fn best() -> Self {
        *Self::available().last().expect("the portable set is always there")
    }

    /// The one that the environment variable `LAPSOLVE_ISA` names (`portable`, `avx2`, `avx512`): to measure on one machine
    /// what another would do. Without it, or empty, the best.
    ///
    /// # Errors
    /// Where this machine does not have it.
    pub fn from_environment() -> Result<Self, Unavailable> {
        match std::env::var_os(VARIABLE) {
            Some(name) if !name.is_empty() => Self::named(&name.to_string_lossy()),
            _ => Ok(Self::best()),
        }
    }

    fn named(name: &str) -> Result<Self, Unavailable> {
        let available = Self::available();
        available.iter().copied().find(|isa| isa.name() == name).ok_or_else(|| {
            let names: Vec<&str> = available.iter().map(|isa| isa.name()).collect();
            Unavailable {
                what: format!("{VARIABLE}={name}: not an instruction set of this machine"),
                how_to_get_it: format!("use one of {}, or unset it", names.join(", ")),
            }
        })
    }

    /// Its name, for records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable if cfg!(target_arch = "aarch64") => "neon",
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "avx512",
        }
    }

    /// Runs `kernel` compiled for this instruction set.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<Base>(),
            // SAFETY: `Avx2` and `Avx512` come from `available`, which has seen their features on this machine.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { x86::avx2(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { x86::avx512(kernel) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instruction_sets_are_found_by_their_names_and_others_refused() {
        for isa in Isa::available() {
            assert_eq!(Isa::named(isa.name()), Ok(isa));
        }
        let refusal = Isa::named("avx1024").expect_err("there is none");
        assert!(refusal.how_to_get_it.contains(Isa::best().name()), "{refusal}");
    }
}
