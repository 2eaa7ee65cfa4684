//! From samples to the row.

use super::Running;
use crate::engine::task::Goal;
use crate::record::names::Status;
use crate::record::result::{Bandwidth, Cell, OpenLoop, Summary};
use crate::statistics::{binomial, frames};

impl Running<'_> {
    /// The row with what is known so far.
    pub fn row(&self) -> Cell {
        let mut cell = self.cell.clone();
        let summary = Summary::of(&self.samples);
        match self.task.goal {
            Goal::Solve(_) => cell.solve_ns = summary,
            Goal::Frames(_) => cell.frame_ns = summary,
        }
        let medians = self.steps.iter().map(|(step, samples)| (step.clone(), Summary::of(samples).p50));
        cell.steps_ns = medians.filter_map(|(step, p50)| Some((step, p50?))).collect();
        cell.frames_per_second = summary.p50.and_then(frames::frames_per_second);
        cell.low1_fps = frames::low1_fps(&self.samples);
        cell.stutters = (!self.samples.is_empty()).then(|| frames::stutters(&self.samples));
        cell.samples_ns = self.samples.clone();
        cell.allocations_per_frame =
            self.allocations.filter(|_| self.repetitions > 0).map(|a| a as f64 / self.repetitions as f64);
        cell.bandwidth = self.traffic(summary.p50);
        if cell.status == Status::Invalid {
            cell.without_times();
        }
        cell
    }

    fn traffic(&self, median: Option<u64>) -> Bandwidth {
        if matches!(&self.task.goal, Goal::Solve(solve) if solve.edits.is_some()) {
            return Bandwidth::default(); // an edit reads what a solve does not
        }
        let iterations = if self.iterative { self.cell.iterations.map(u64::from) } else { Some(1) };
        let bytes = self.bytes.zip(iterations).map(|(bytes, times)| bytes.saturating_mul(times));
        let rate = bytes.zip(median).filter(|&(_, ns)| ns > 0).map(|(bytes, ns)| bytes as f64 / ns as f64);
        let mut read: Vec<f64> = self.read_rates.clone();
        read.sort_by(f64::total_cmp);
        let read = read.get(read.len() / 2).map(|bytes_per_s| bytes_per_s * 1e-9);
        Bandwidth {
            bytes_per_solve: bytes,
            gb_per_s: rate, // bytes per nanosecond
            fraction_of_read: rate.zip(read).map(|(rate, read)| rate / read),
            read_gb_per_s: read,
        }
    }
}

/// One open-loop run; a miss is a latency above 1 / hz.
pub(super) fn open_loop(hz: f64, latencies: &[u64]) -> OpenLoop {
    let period = 1e9 / hz;
    let frames = latencies.len() as u64;
    let over = |limit: f64| latencies.iter().filter(|&&t| t as f64 > limit).count() as u64;
    let (misses, half_misses) = (over(period), over(0.5 * period));
    OpenLoop {
        hz,
        frames,
        misses,
        miss_upper95: binomial::upper_bound(misses, frames, 0.95),
        miss_lower95: binomial::lower_bound(misses, frames, 0.95),
        half_misses: Some(half_misses),
        half_upper95: Some(binomial::upper_bound(half_misses, frames, 0.95)),
        half_lower95: Some(binomial::lower_bound(half_misses, frames, 0.95)),
        latency_ns: Summary::of(latencies),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misses_are_latencies_over_the_period() {
        let run = open_loop(100.0, &[9_000_000, 10_000_000, 10_000_001, 30_000_000]);
        assert_eq!((run.frames, run.misses, run.half_misses), (4, 2, Some(4)));
        assert!(run.miss_lower95 < 0.5 && run.miss_upper95 > 0.5);
    }
}
