//! A machine that only exists as noise: times without running anything.

use super::noise::Source;
use crate::gate::bench::{Bench, Fault};
use crate::gate::couple::Side;
use crate::gate::couple::{Couple, Slot, order};
use std::time::Duration;

/// Time of a simulated process: what a default cell takes.
const PROCESS: Duration = Duration::from_millis(200);

/// A simulated machine.
pub struct Machine<'a> {
    /// Noise of each case.
    pub sources: Vec<Source<'a>>,
    /// ln(head / base) of each case, the truth.
    pub effects: Vec<f64>,
    /// Time for the whole run; drift is relative to it.
    pub budget: Duration,
    /// The clock.
    pub now: Duration,
}

impl Bench for Machine<'_> {
    fn elapsed(&self) -> Duration {
        self.now
    }

    fn couple(&mut self, case: usize, round: usize, with_copy: bool) -> Result<Couple, Fault> {
        let source = &mut self.sources[case];
        source.begin_couple();
        let contended = source.is_contended();
        let slots = order(round, with_copy).into_iter().enumerate().map(|(i, side)| {
            self.now += PROCESS;
            let at = self.now.as_secs_f64() / self.budget.as_secs_f64();
            let noise = source.slot(i, side, at);
            let effect = if side == Side::Head { self.effects[case] } else { 0.0 };
            Slot {
                side,
                times_ns: vec![1e6 * (effect + noise.time).exp()],
                control_ns: 1e6 * noise.control.exp(),
            }
        });
        Ok(Couple { slots: slots.collect(), contended })
    }
}
