//! Whether a cell keeps a frame rate: the one rule behind every sentence "interactive at R Hz".
//!
//! A frame is late when its latency, counted from the scheduled start, exceeds the solver's share of 1 / R. The rate is
//! met when the 95% Clopper-Pearson bound says that at most 1% of the frames are late; the p99 of the sample is then
//! within the share too. The whole period belongs to the solver alone; half of it is what an application leaves that
//! also has to draw.

use super::names::Status;
use super::result::{Cell, OpenLoop};
use std::fmt;

/// Largest share of late frames of a cell that is said to keep a rate.
pub const LATE: f64 = 0.01;

/// The solver's part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// All of 1 / R: the solver alone.
    Whole,
    /// Half of it.
    Half,
}

/// Whether a cell keeps a rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// With 95% confidence at most 1% of its frames are late.
    Met,
    /// With 95% confidence more are.
    Missed,
    /// The frames do not decide it, or there are none.
    Undecided,
}

impl Rate {
    /// The verdict on one open-loop run.
    pub fn of(run: Option<&OpenLoop>, share: Share) -> Self {
        let Some(run) = run.filter(|run| run.frames > 0) else { return Rate::Undecided };
        let (upper, lower) = match share {
            Share::Whole => (Some(run.miss_upper95), Some(run.miss_lower95)),
            Share::Half => (run.half_upper95, run.half_lower95),
        };
        if upper.is_some_and(|upper| upper <= LATE) {
            Rate::Met
        } else if lower.is_some_and(|lower| lower > LATE) {
            Rate::Missed
        } else {
            Rate::Undecided
        }
    }

    /// The verdict on a cell at `hz` starts per second; a cell that is not ok has none.
    pub fn of_cell(cell: &Cell, hz: f64, share: Share) -> Self {
        let run = cell.open_loop.iter().find(|run| run.hz == hz);
        Self::of(run.filter(|_| cell.status == Status::Ok), share)
    }

    /// In a word.
    pub fn name(self) -> &'static str {
        match self {
            Rate::Met => "met",
            Rate::Missed => "missed",
            Rate::Undecided => "undecided",
        }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::binomial;

    fn run(misses: u64, half: u64, frames: u64) -> OpenLoop {
        OpenLoop {
            hz: 60.0,
            frames,
            misses,
            miss_upper95: binomial::upper_bound(misses, frames, 0.95),
            miss_lower95: binomial::lower_bound(misses, frames, 0.95),
            half_misses: Some(half),
            half_upper95: Some(binomial::upper_bound(half, frames, 0.95)),
            half_lower95: Some(binomial::lower_bound(half, frames, 0.95)),
            ..OpenLoop::default()
        }
    }

    #[test]
    fn rates_are_met_missed_or_undecided() {
        let whole = |misses, frames| Rate::of(Some(&run(misses, 0, frames)), Share::Whole);
        assert_eq!(whole(0, 299), Rate::Met);
        assert_eq!(whole(0, 298), Rate::Undecided);
        assert_eq!(whole(1, 600), Rate::Met);
        assert_eq!(whole(30, 600), Rate::Missed);
        assert_eq!(whole(0, 0), Rate::Undecided);
        assert_eq!(Rate::of(None, Share::Whole), Rate::Undecided);
    }

    #[test]
    fn half_of_a_frame_is_judged_by_itself() {
        let run = run(0, 200, 600);
        assert_eq!(
            (Rate::of(Some(&run), Share::Whole), Rate::of(Some(&run), Share::Half)),
            (Rate::Met, Rate::Missed)
        );
        let older = OpenLoop { half_upper95: None, half_lower95: None, ..run };
        assert_eq!(Rate::of(Some(&older), Share::Half), Rate::Undecided);
    }

    #[test]
    fn only_valid_cells_keep_a_rate() {
        let cell = Cell { status: Status::Ok, open_loop: vec![run(0, 0, 300)], ..Cell::default() };
        assert_eq!(Rate::of_cell(&cell, 60.0, Share::Whole), Rate::Met);
        assert_eq!(Rate::of_cell(&cell, 90.0, Share::Whole), Rate::Undecided);
        let invalid = Cell { status: Status::Invalid, ..cell };
        assert_eq!(Rate::of_cell(&invalid, 60.0, Share::Whole), Rate::Undecided);
    }
}
