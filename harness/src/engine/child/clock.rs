//! Reads the clock at phase boundaries.

use crate::engine::protocol::Prepared;
use lapsolve::backend::{FrameStep, Phase};
use std::collections::BTreeMap;
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

/// Times of the steps of frames, one sample per frame. Reads the clock five times a frame, allocates nothing meanwhile.
pub struct StepClock {
    since: Instant,
    current: Option<FrameStep>,
    frame: [u64; FrameStep::ALL.len()],
    samples: [Vec<u64>; FrameStep::ALL.len()],
}

impl StepClock {
    /// Room for `frames` samples of each step.
    pub fn new(frames: usize) -> Self {
        let samples = std::array::from_fn(|_| Vec::with_capacity(frames));
        Self { since: Instant::now(), current: None, frame: [0; FrameStep::ALL.len()], samples }
    }

    /// A frame begins.
    pub fn start(&mut self, now: Instant) {
        (self.since, self.current, self.frame) = (now, None, [0; FrameStep::ALL.len()]);
    }

    /// `step` begins; what comes before the first one counts to it.
    pub fn begin(&mut self, step: FrameStep) {
        if self.current.is_some() {
            self.end(Instant::now());
        }
        self.current = Some(step);
    }

    /// The frame is over; it is kept if it `counts` and had steps.
    pub fn stop(&mut self, now: Instant, counts: bool) {
        self.end(now);
        if counts && self.frame.iter().any(|&ns| ns > 0) {
            self.samples.iter_mut().zip(self.frame).for_each(|(samples, ns)| samples.push(ns));
        }
    }

    fn end(&mut self, now: Instant) {
        if let Some(step) = self.current.take() {
            self.frame[step as usize] += nanoseconds(now - self.since);
            self.since = now;
        }
    }

    /// Samples by the name of the step; none if no frame had steps.
    pub fn into_samples(self) -> BTreeMap<String, Vec<u64>> {
        let named = FrameStep::ALL.iter().map(|step| step.name().to_owned()).zip(self.samples);
        named.filter(|(_, samples)| !samples.is_empty()).collect()
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
    fn steps_add_up_to_the_frame_and_warm_up_does_not_count() {
        let mut clock = StepClock::new(2);
        for k in 0..2 {
            let start = Instant::now();
            clock.start(start);
            for step in [FrameStep::Marks, FrameStep::Field] {
                clock.begin(step);
                std::thread::sleep(std::time::Duration::from_millis(2));
            }
            let end = Instant::now();
            clock.stop(end, k == 1);
            let whole = nanoseconds(end - start);
            assert!(clock.frame[0] >= 2_000_000 && clock.frame[1] >= 2_000_000);
            assert_eq!(clock.frame.iter().sum::<u64>(), whole);
        }
        let samples = clock.into_samples();
        assert_eq!((samples["marks"].len(), samples["placement"][0]), (1, 0));
    }

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
        let Prepared { order_ns: Some(order), numeric_ns: Some(numeric), symbolic_ns: None, .. } =
            clock.phases()
        else {
            panic!("{:?}", clock.phases())
        };
        assert!(order >= 4_000_000 && numeric >= 2_000_000 && order + numeric <= whole);
    }
}
