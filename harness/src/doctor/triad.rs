//! Memory bandwidth for 1 .. N threads, by the triad a_i = b_i + s c_i (McCalpin's STREAM).

use super::finding::Finding;
use std::hint::black_box;
use std::sync::Barrier;
use std::time::{Duration, Instant};

/// Bytes of each of the three arrays: with 192 MiB in all beyond the caches of most machines, small enough for any.
const BYTES: usize = 64 << 20;

/// Passes go on for this long at each number of threads.
const TIME: Duration = Duration::from_millis(250);

/// Gain of all threads over one below which a second thread does not help a solve that is bound by memory.
const GAIN: f64 = 1.2;

/// Numbers of threads that are tried: all up to 8, then powers of two, and the last.
pub fn thread_counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> = (1..=most.min(8)).collect();
    counts.extend(std::iter::successors(Some(16), |n| Some(n * 2)).take_while(|&n| n < most));
    if most > 8 {
        counts.push(most);
    }
    counts
}

/// Bytes per second of the best pass with that many threads: two arrays read, one written. None where memory for them
/// cannot be had.
pub fn triad(threads: usize, bytes: usize, time: Duration) -> Option<f64> {
    let words = bytes / 8;
    let array = |value: f64| -> Option<Vec<f64>> {
        let mut array: Vec<f64> = Vec::new();
        array.try_reserve_exact(words).ok()?;
        array.resize(words, value); // touched: real pages
        Some(array)
    };
    let (mut a, b, c) = (array(0.0)?, array(1.0)?, array(2.0)?);
    let share = words.div_ceil(threads.max(1)).max(1);
    let barrier = Barrier::new(a.chunks(share).len());
    let rates: Vec<f64> = std::thread::scope(|scope| {
        let parts = a.chunks_mut(share).zip(b.chunks(share)).zip(c.chunks(share));
        let barrier = &barrier;
        let workers: Vec<_> =
            parts.map(|((a, b), c)| scope.spawn(move || passes(a, b, c, barrier, time))).collect();
        workers.into_iter().filter_map(|worker| worker.join().ok()).collect()
    });
    black_box(&a);
    (!rates.is_empty()).then(|| rates.iter().sum())
}

/// Bytes per second of one thread's share over all passes after the first.
fn passes(a: &mut [f64], b: &[f64], c: &[f64], barrier: &Barrier, time: Duration) -> f64 {
    pass(a, b, c);
    barrier.wait();
    let begin = Instant::now();
    let mut count = 0u32;
    while begin.elapsed() < time {
        pass(black_box(&mut *a), black_box(b), black_box(c));
        count += 1;
    }
    3.0 * size_of_val(b) as f64 * f64::from(count) / begin.elapsed().as_secs_f64()
}

fn pass(a: &mut [f64], b: &[f64], c: &[f64]) {
    for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
        *a = b + 3.0 * c;
    }
}

/// Bandwidth by number of threads.
pub fn finding(most: usize) -> Finding {
    let rates: Vec<(usize, f64)> =
        thread_counts(most).into_iter().filter_map(|n| Some((n, triad(n, BYTES, TIME)?))).collect();
    let words: Vec<String> = rates.iter().map(|(n, rate)| format!("{n}: {:.1}", rate * 1e-9)).collect();
    let (Some(one), true) = (rates.first().map(|r| r.1), rates.len() > 1) else {
        let found = words.first().map_or_else(|| "unknown".to_owned(), |w| format!("GB/s by threads: {w}"));
        return Finding::info("memory bandwidth", found);
    };
    let best = rates.iter().map(|r| r.1).fold(0.0, f64::max);
    Finding::new(
        "memory bandwidth",
        Some(best > GAIN * one),
        format!("triad, GB/s by threads: {}", words.join(", ")),
        "more threads read memory no faster: large solves gain little from them; compare --threads 1 as well",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_counts_for_many_threads() {
        assert_eq!(thread_counts(1), [1]);
        assert_eq!(thread_counts(3), [1, 2, 3]);
        assert_eq!(thread_counts(96), [1, 2, 3, 4, 5, 6, 7, 8, 16, 32, 64, 96]);
        assert_eq!(thread_counts(16), [1, 2, 3, 4, 5, 6, 7, 8, 16]);
    }

    #[test]
    fn every_share_is_computed() {
        let (b, c) = (vec![1.0; 1001], vec![2.0; 1001]);
        let mut a = vec![0.0; 1001];
        pass(&mut a, &b, &c);
        assert!(a.iter().all(|&a| a == 7.0));
        let rate = triad(3, 8008, Duration::from_millis(2)).unwrap();
        assert!((1e7..1e13).contains(&rate), "{rate:e}");
    }
}
