//! Noise as it was: the couples of a gate run of two identical programs.

use super::noise::Disturbance;
use crate::gate::couple::{Couple, Side};
use crate::gate::report::GateReport;
use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Disturbances of every slot of every couple of every cell, around the cell's median.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Cell, couple, slot (four: two mirrored pairs).
    pub cells: Vec<Vec<Vec<Disturbance>>>,
}

/// The file: times and control times in nanoseconds, `[[time, control] x 4]` for each couple of each cell.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Raw {
    made_on: String,
    cells: Vec<RawCell>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct RawCell {
    name: String,
    couples: Vec<[[f64; 2]; 4]>,
}

/// Fewest couples of a cell that is worth drawing from.
const FEWEST: usize = 10;

impl Recording {
    /// The recording that comes with the program: A/A runs on a shared two-core virtual machine.
    pub fn built_in() -> Self {
        let raw: Raw = serde_json::from_str(include_str!("recorded.json")).expect("checked by a test");
        Self::of(&raw)
    }

    /// From a file that `gate --noise-out` wrote.
    ///
    /// # Errors
    /// Where it cannot be read or holds no cell of ten couples.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let raw: Raw = serde_json::from_slice(&crate::file::read(path)?)
            .with_context(|| format!("{}: not a file of `gate --noise-out`", path.display()))?;
        let positive = |x: &f64| x.is_finite() && *x > 0.0;
        if !raw.cells.iter().flat_map(|cell| cell.couples.as_flattened().as_flattened()).all(positive) {
            bail!("{}: a time is not positive", path.display());
        }
        let recording = Self::of(&raw);
        if recording.cells.is_empty() {
            bail!("{}: no cell of {FEWEST} couples; give the gate more time (--time-budget)", path.display());
        }
        Ok(recording)
    }

    fn of(raw: &Raw) -> Self {
        let cells = raw.cells.iter().filter(|cell| cell.couples.len() >= FEWEST).map(|cell| {
            let median = |which: usize| {
                let mut logs: Vec<f64> = cell.couples.iter().flatten().map(|slot| slot[which].ln()).collect();
                logs.sort_by(f64::total_cmp);
                logs[logs.len() / 2]
            };
            let centre = [median(0), median(1)];
            let disturbance = |slot: &[f64; 2]| Disturbance {
                time: slot[0].ln() - centre[0],
                control: slot[1].ln() - centre[1],
            };
            cell.couples.iter().map(|couple| couple.iter().map(disturbance).collect()).collect()
        });
        Self { cells: cells.collect() }
    }
}

impl Raw {
    /// Base and head slots of all couples, those of the copy left out.
    fn of(report: &GateReport) -> Self {
        let info = &report.environment.info;
        let cpu = report.environment.fingerprint.cpu.clone().unwrap_or_default();
        let mut cells = Vec::new();
        for case in &report.cases {
            for (measure, name) in case.measures.iter().enumerate() {
                let couples = case.couples.iter().filter_map(|couple| four(couple, measure)).collect();
                cells.push(RawCell { name: format!("{}/{name}", case.name), couples });
            }
        }
        Self { made_on: format!("{}, {cpu}", info.time), cells }
    }
}

fn four(couple: &Couple, measure: usize) -> Option<[[f64; 2]; 4]> {
    let own = couple.slots.iter().filter(|slot| slot.side != Side::Copy);
    let slots: Vec<[f64; 2]> = own.map(|slot| [slot.times_ns[measure], slot.control_ns]).collect();
    slots.try_into().ok()
}

/// The noise of a run of two identical programs, for [`Recording::read`].
///
/// # Errors
/// None in practice: plain data.
pub fn of_report(report: &GateReport) -> serde_json::Result<String> {
    Ok(serde_json::to_string(&Raw::of(report))? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_recording_is_whole() {
        let recording = Recording::built_in();
        assert!(recording.cells.len() >= 4);
        for cell in &recording.cells {
            assert!(cell.len() >= FEWEST && cell.iter().all(|couple| couple.len() == 4));
            let all = cell.iter().flatten();
            assert!(all.clone().all(|slot| slot.time.is_finite() && slot.control.is_finite()));
            assert!(all.clone().any(|slot| slot.time != 0.0));
        }
    }
}
