//! What a sequence of frame times feels like: rate, slowest frames, stutters.

/// Frames per second at the median frame time.
pub fn frames_per_second(median_ns: u64) -> Option<f64> {
    (median_ns > 0).then(|| 1e9 / median_ns as f64)
}

/// "1% low": the frame rate of the slowest hundredth of the frames, averaged over them. Needs 100 frames.
pub fn low1_fps(samples: &[u64]) -> Option<f64> {
    let slowest = samples.len() / 100;
    if slowest == 0 {
        return None;
    }
    let mut sorted = samples.to_vec();
    sorted.sort_unstable();
    let tail = &sorted[sorted.len() - slowest..];
    let mean = tail.iter().map(|&t| t as f64).sum::<f64>() / slowest as f64;
    (mean > 0.0).then(|| 1e9 / mean)
}

/// Frames that the moving average looks back on.
const WINDOW: usize = 20;
/// A frame stutters when it takes this many times the average of the frames before it (CapFrameX's factor).
const STUTTER: f64 = 2.5;

/// Number of frames that take more than 2.5 times the average of the 20 before them.
pub fn stutters(samples: &[u64]) -> u64 {
    let stutters = |window: &&[u64]| {
        let (before, now) = window.split_at(WINDOW);
        let mean = before.iter().map(|&t| t as f64).sum::<f64>() / WINDOW as f64;
        now[0] as f64 > STUTTER * mean
    };
    samples.windows(WINDOW + 1).filter(stutters).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_slow_frame_in_two_hundred() {
        let mut samples = vec![10_000_000; 200];
        samples[150] = 40_000_000;
        assert_eq!(frames_per_second(10_000_000), Some(100.0));
        assert_eq!(low1_fps(&samples), Some(40.0)); // the two slowest: 40 and 10 ms
        assert_eq!(stutters(&samples), 1);
    }

    #[test]
    fn too_few_frames_say_nothing() {
        assert_eq!((low1_fps(&[1; 99]), stutters(&[1; 20]), frames_per_second(0)), (None, 0, None));
    }

    #[test]
    fn a_slow_drift_is_no_stutter() {
        let drift: Vec<u64> = (0..500).map(|i| 1_000_000 + 10_000 * i).collect();
        assert_eq!(stutters(&drift), 0);
    }
}
