//! How times on a machine go wrong.

use super::recorded::Recording;
use crate::gate::couple::Side;
use crate::statistics::random::Random;

/// A kind of noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// Couples of a real A/A run, drawn in blocks of four, sides and signs at random.
    Recorded,
    /// Independent normal, 2.7% for a pair of one process each: 1.9% a process.
    Normal,
    /// The same, on a machine that becomes 30% slower from start to end.
    Drift,
    /// The same, and every head process meets a busy neighbour: 15% slower, and so is the control kernel beside it.
    OneSided,
    /// A busy neighbour all the time, for both sides: 4% a process, and for the control kernel; every couple counts as disturbed.
    Neighbour,
    /// One process in three is 8% slower, and 1% of normal noise: memory layout by chance.
    Bimodal,
    /// Normal noise of 2% a process, and one process in ten is slowed by 5 to 50%.
    HeavyTails,
    /// Noise of 2% that neighbouring processes share to 90%: slow waves over the machine.
    Waves,
}

impl Noise {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Recorded,
        Self::Normal,
        Self::Drift,
        Self::OneSided,
        Self::Neighbour,
        Self::Bimodal,
        Self::HeavyTails,
        Self::Waves,
    ];

    /// As in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recorded => "recorded A/A runs",
            Self::Normal => "normal, 2.7% a pair",
            Self::Drift => "the same + 30% drift",
            Self::OneSided => "the same + head contended",
            Self::Neighbour => "both sides contended",
            Self::Bimodal => "bimodal, 8% apart",
            Self::HeavyTails => "heavy tails",
            Self::Waves => "slow waves",
        }
    }
}

/// Noise of one process: logarithms by which its time and the control kernel's differ from a quiet machine's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disturbance {
    /// Of the process.
    pub time: f64,
    /// Of the control kernel around it.
    pub control: f64,
}

/// A source of noise with its memory.
pub struct Source<'a> {
    noise: Noise,
    recording: &'a Recording,
    random: Random,
    wave: f64,
    /// Where the recording is being read: cell, next couple, couples left of the block, and the couple's slots.
    cell: usize,
    next: usize,
    left: usize,
    slots: Vec<Disturbance>,
}

/// Normal noise of one process where a pair of two has 2.7%.
const PROCESS: f64 = 0.027 / std::f64::consts::SQRT_2;

/// Noise of the control kernel on a quiet machine.
const CONTROL: f64 = 0.004;

/// Couples of a recording that are drawn together: neighbours stay neighbours.
const BLOCK: usize = 4;

impl<'a> Source<'a> {
    /// A source.
    pub fn new(noise: Noise, recording: &'a Recording, seed: u64) -> Self {
        let random = Random::new(seed);
        Self { noise, recording, random, wave: 0.0, cell: 0, next: 0, left: 0, slots: Vec::new() }
    }

    /// Takes up another cell of the recording.
    pub fn change_cell(&mut self) {
        if self.noise == Noise::Recorded {
            self.cell = self.random.below(self.recording.cells.len());
            self.left = 0;
        }
    }

    /// Whether other processes take the machine.
    pub fn is_contended(&self) -> bool {
        self.noise == Noise::Neighbour
    }

    /// Begins a couple.
    pub fn begin_couple(&mut self) {
        if self.noise != Noise::Recorded {
            return;
        }
        let couples = &self.recording.cells[self.cell];
        if self.left == 0 {
            self.next = self.random.below(couples.len());
            self.left = BLOCK;
        }
        self.slots = couples[self.next % couples.len()].clone();
        if self.random.next_u64() >> 63 == 1 {
            // Base and head change places: both are the same program in a recording.
            let middle = self.slots.len() / 2;
            self.slots[..middle].reverse();
            self.slots[middle..].reverse();
        }
        self.next += 1;
        self.left -= 1;
    }

    /// The disturbance of slot `slot` of the couple, a process of `side`, when the share `at` of the time has passed.
    pub fn slot(&mut self, slot: usize, side: Side, at: f64) -> Disturbance {
        let (control, normal) = (CONTROL * self.random.normal(), PROCESS * self.random.normal());
        let chance = self.random.unit();
        match self.noise {
            Noise::Recorded => self.slots[slot % self.slots.len()],
            Noise::Normal => Disturbance { time: normal, control },
            Noise::Drift => {
                let drift = at * 1.3f64.ln();
                Disturbance { time: normal + drift, control: control + drift }
            }
            Noise::OneSided => {
                let busy = if side == Side::Head { 1.15f64.ln() } else { 0.0 };
                Disturbance { time: normal + busy, control: control + busy }
            }
            Noise::Neighbour => {
                Disturbance { time: 0.04 * self.random.normal(), control: 0.04 * self.random.normal() }
            }
            Noise::Bimodal => {
                let mode = if chance < 1.0 / 3.0 { 1.08f64.ln() } else { 0.0 };
                Disturbance { time: 0.01 * self.random.normal() + mode, control }
            }
            Noise::HeavyTails => {
                let spike = if chance < 0.1 { (1.05 + 4.5 * chance).ln() } else { 0.0 };
                Disturbance { time: 0.02 * self.random.normal() + spike, control }
            }
            Noise::Waves => {
                /// What a process shares with the one before; the rest keeps the size at 2%.
                const SHARED: f64 = 0.9;
                self.wave = SHARED * self.wave + 0.02 * (1.0 - SHARED * SHARED).sqrt() * self.random.normal();
                Disturbance { time: self.wave, control: control + 0.5 * self.wave }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_what_they_say() {
        let recording = Recording::built_in();
        let spread = |noise: Noise| {
            let mut source = Source::new(noise, &recording, 3);
            let times: Vec<f64> = (0..20_000).map(|_| source.slot(0, Side::Base, 0.0).time).collect();
            let mean = times.iter().sum::<f64>() / times.len() as f64;
            (times.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / times.len() as f64).sqrt()
        };
        assert!((spread(Noise::Normal) - 0.0191).abs() < 4e-4);
        assert!((spread(Noise::Bimodal) - 0.0376).abs() < 1e-3); // 0.077 sqrt(2 / 9), and 0.01
        assert!((spread(Noise::Waves) - 0.02).abs() < 2e-3);
        assert!(spread(Noise::HeavyTails) > 0.05);
    }
}
