//! Samples of one run in blocks: neighbours in time are alike, medians of long blocks hardly.

use super::autocorrelation::lag1;
use super::percentiles::median;

/// Blocks a run is cut into: enough for an interval of a ratio at 95% and 99%, few enough that each spans several rounds'
/// worth of drift.
const BLOCKS: usize = 10;

/// Above this lag-1 autocorrelation of the medians, blocks are joined in pairs: neighbours are not independent then.
const CORRELATED: f64 = 0.2;

/// Medians of ten (or, where those still follow each other, five) consecutive blocks of equal length; the samples themselves
/// where there are fewer.
pub fn block_medians(samples: &[u64]) -> Vec<f64> {
    let medians = cut(samples, BLOCKS);
    if lag1(&medians) > CORRELATED { cut(samples, BLOCKS / 2) } else { medians }
}

fn cut(samples: &[u64], blocks: usize) -> Vec<f64> {
    let blocks = blocks.min(samples.len());
    let block = |i: usize| {
        let mut part = samples[i * samples.len() / blocks..(i + 1) * samples.len() / blocks].to_vec();
        part.sort_unstable();
        median(&part).map(|t| t as f64)
    };
    (0..blocks).filter_map(block).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_consecutive_and_equal() {
        let alternating: Vec<u64> = (0..100).map(|i| if i / 10 % 2 == 0 { 10 } else { 20 }).collect();
        assert_eq!(block_medians(&alternating), [10.0, 20.0].repeat(5));
        assert_eq!(block_medians(&[5, 9, 5]), [5.0, 9.0, 5.0]);
        assert!(block_medians(&[]).is_empty());
    }

    #[test]
    fn drift_joins_blocks() {
        let drift: Vec<u64> = (0..100).collect();
        assert_eq!(block_medians(&drift).len(), 5);
    }
}
