//! Whether a child's clock can be believed: what it claims against what passed here.

use crate::engine::session::Failure;
use crate::record::names::Status;
use std::time::Duration;

/// The share of the time that passed which claims must explain. Honest children explain nearly all of it: what is left is
/// reading the right-hand side and writing the solution. A quarter leaves room for slow disks and busy machines.
const LEAST_SHARE: f64 = 0.25;

/// Exchange of one request that is never held against a child: arrays of a few megabytes through the page cache.
const EXCHANGE: Duration = Duration::from_millis(20);

/// Claims below this in all are not judged: there is nothing to gain by them.
const LEAST_PASSED: Duration = Duration::from_millis(200);

/// Requests so far: the time that passed, and the time that the child says its repetitions took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ledger {
    passed: Duration,
    claimed: Duration,
}

impl Ledger {
    /// Enters one request; `claimed` counts repetitions that were not timed like those that were.
    pub fn enter(&mut self, passed: Duration, claimed: Duration) {
        self.passed += passed.saturating_sub(EXCHANGE);
        self.claimed += claimed;
    }

    /// # Errors
    /// `invalid` where most of the time is not accounted for: the child leaves work out of its samples.
    pub fn judge(&self) -> Result<(), Failure> {
        if self.passed < LEAST_PASSED || self.claimed >= self.passed.mul_f64(LEAST_SHARE) {
            return Ok(());
        }
        let reason = format!(
            "its samples add up to {:.1?} of the {:.1?} that it took: its clock leaves most of the work out",
            self.claimed, self.passed
        );
        Err(Failure::new(Status::Invalid, reason))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(passed_ms: u64, claimed_ms: u64, requests: u32) -> bool {
        let mut ledger = Ledger::default();
        for _ in 0..requests {
            ledger.enter(Duration::from_millis(passed_ms), Duration::from_millis(claimed_ms));
        }
        ledger.judge().is_ok()
    }

    #[test]
    fn honest_clocks_pass_and_flattering_ones_do_not() {
        assert!(judged(100, 95, 10) && judged(100, 30, 10));
        assert!(judged(19, 0, 1000), "exchange alone is nobody's fault");
        assert!(judged(150, 0, 1), "too little to judge");
        assert!(!judged(100, 10, 10));
    }
}
