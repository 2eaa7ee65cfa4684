//! Reads the clock at phase boundaries.

use crate::engine::protocol::Prepared;
use lapsolve::backend::Phase;
use std::time::Instant;

/// Sums the time of each phase of a preparation. A phase lasts until the next one begins; what comes before the first
/// announcement counts to that first one, so that nothing is lost.
pub struct PhaseClock {
    since: Instant,
    current: Option<Phase>,
    totals: Prepared,
}

impl Default for PhaseClock {
    fn default() -> Self {
        Self { since: Instant::now(), current: None, totals: Prepared::default() }
    }
}

impl PhaseClock {
    /// Starts anew; the totals stay.
    pub fn restart(&mut self) {
        self.current = None;
        self.since = Instant::now();
    }

    /// `phase` begins.
    pub fn begin(&mut self, phase: Phase) {
        if self.current.is_some() {
            self.stop();
        }
        self.current = Some(phase);
    }

    /// The preparation is over. One without announcements is all numeric.
    pub fn stop(&mut self) {
        let now = Instant::now();
        let total = match self.current.unwrap_or(Phase::Numeric) {
            Phase::Order => &mut self.totals.order_ns,
            Phase::Symbolic => &mut self.totals.symbolic_ns,
            Phase::Numeric => &mut self.totals.numeric_ns,
            Phase::Upload => &mut self.totals.upload_ns,
        };
        *total = Some(total.unwrap_or(0) + nanoseconds(now - self.since));
        self.since = now;
        self.current = None;
    }

    /// The totals so far.
    pub fn phases(&self) -> Prepared {
        self.totals
    }
}

/// Whole nanoseconds; 584 years fit.
pub fn nanoseconds(duration: std::time::Duration) -> u64 {
    duration.as_nanos() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_add_up_to_the_whole() {
        let start = Instant::now();
        let mut clock = PhaseClock::default();
        for phase in [Phase::Order, Phase::Numeric, Phase::Order] {
            clock.begin(phase);
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        clock.stop();
        let whole = nanoseconds(start.elapsed());
        let Prepared { order_ns: Some(order), numeric_ns: Some(numeric), symbolic_ns: None, upload_ns: None } =
            clock.phases()
        else {
            panic!("{:?}", clock.phases())
        };
        assert!(order >= 4_000_000 && numeric >= 2_000_000 && order + numeric <= whole);
    }
}
