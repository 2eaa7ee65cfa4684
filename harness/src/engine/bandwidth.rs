//! Read bandwidth of this machine at a given size and number of threads: the roof of every solve.
//!
//! A steady solve streams its factor once forwards and once backwards and does two flops per number, so the best it can do
//! is to read at this rate. Here too every second pass goes backwards, so that the end of one pass, still in a cache, is the
//! start of the next, and pages are huge where the system has them. Measured between the rounds at the factor's own size, so that a factor that fits a cache is
//! held against the cache.

use lapsolve::aligned::advise_huge_pages;
use std::hint::black_box;
use std::sync::Barrier;
use std::time::{Duration, Instant};

/// Reading goes on for at least this long: several scheduler ticks, so that one interruption does not decide.
const LEAST: Duration = Duration::from_millis(15);

/// Smallest and largest size that is measured: one page per thread at least, and no more than fits beside the cells.
const SIZES: std::ops::RangeInclusive<u64> = 4_096..=(1 << 30);

/// Bytes per second that `threads` threads read together from a block of about `bytes` bytes, each its own share again and
/// again. `None` where memory for the block cannot be had.
pub fn read_bandwidth(bytes: u64, threads: usize) -> Option<f64> {
    let words = (bytes.clamp(*SIZES.start(), *SIZES.end()) / 8) as usize;
    let mut block: Vec<u64> = Vec::new();
    block.try_reserve_exact(words).ok()?;
    advise_huge_pages(block.spare_capacity_mut());
    block.extend((0..words as u64).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15))); // touched: real pages
    let share = words.div_ceil(threads.max(1));
    let shares: Vec<&[u64]> = block.chunks(share).collect();
    let barrier = Barrier::new(shares.len());
    let rates = std::thread::scope(|scope| {
        let readers: Vec<_> =
            shares.iter().map(|share| scope.spawn(|| read_repeatedly(share, &barrier))).collect();
        readers.into_iter().map(|reader| reader.join().unwrap_or(0.0)).sum::<f64>()
    });
    (rates > 0.0).then_some(rates)
}

/// Bytes per second of one thread: a warm-up pass, then passes to and fro until [`LEAST`] is over.
fn read_repeatedly(share: &[u64], barrier: &Barrier) -> f64 {
    black_box(sum(share, false));
    barrier.wait();
    let begin = Instant::now();
    let mut passes = 0u32;
    while begin.elapsed() < LEAST {
        passes += 1;
        black_box(sum(black_box(share), passes % 2 == 1));
    }
    size_of_val(share) as f64 * f64::from(passes) / begin.elapsed().as_secs_f64()
}

/// Wrapping sum with 32 independent accumulators: enough vector registers in flight that loads, not additions, bound it.
/// 8 bytes and one addition per number.
fn sum(words: &[u64], backwards: bool) -> u64 {
    const LANES: usize = 32;
    let mut lanes = [0u64; LANES];
    let mut add = |block: &[u64; LANES]| {
        for (lane, word) in lanes.iter_mut().zip(block) {
            *lane = lane.wrapping_add(*word);
        }
    };
    let (blocks, rest) = words.as_chunks::<LANES>();
    if backwards {
        blocks.iter().rev().for_each(&mut add);
    } else {
        blocks.iter().for_each(&mut add);
    }
    lanes.iter().chain(rest).fold(0, |sum, word| sum.wrapping_add(*word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_is_read() {
        let words: Vec<u64> = (0..1003).collect();
        for backwards in [false, true] {
            assert_eq!(sum(&words, backwards), 1003 * 1002 / 2);
        }
    }

    #[test]
    fn a_rate_of_this_world() {
        for threads in [1, 2] {
            let rate = read_bandwidth(1 << 20, threads).unwrap();
            assert!((1e8..1e13).contains(&rate), "{rate:e} bytes per second");
        }
    }
}
