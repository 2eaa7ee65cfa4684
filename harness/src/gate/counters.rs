//! What has no noise: fill, flops, bytes, dispatches, allocations, iterations. Any increase fails until the committed
//! baseline is updated in the same change.

use crate::file;
use crate::record::result::Cell;
use anyhow::Context;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The counters of one case. `None` where the backend does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Counters {
    /// Entries of the factor, or of all levels of a preconditioner.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor_nonzeros: Option<u64>,
    /// Flops of the numeric factorisation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor_flops: Option<u64>,
    /// Bytes of the factor as stored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor_bytes: Option<u64>,
    /// Bytes on a device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device_bytes: Option<u64>,
    /// Programs started on a device in one solve or frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dispatches: Option<u64>,
    /// Allocations in one steady solve or frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allocations_per_frame: Option<f64>,
    /// Iterations of a solve, the largest over the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u64>,
}

/// Baselines of many cases, by name: the committed file.
pub type Baseline = BTreeMap<String, Counters>;

/// A counter that is not what it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Change {
    /// The case.
    pub case: String,
    /// Name of the counter.
    pub counter: String,
    /// Before.
    pub before: f64,
    /// Now.
    pub now: f64,
    /// What it is held against.
    pub against: Reference,
    /// Whether that fails the gate.
    pub fails: bool,
}

/// What a counter is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The committed file.
    Baseline,
    /// The base program, in the same job.
    Base,
}

/// The counter that moves with the instruction set: a committed number of another machine says little, so it must also have
/// grown against the base program.
const ITERATIONS: &str = "iterations";

impl Counters {
    /// The counters in the row of a process.
    pub fn of(row: &Cell) -> Self {
        Self {
            factor_nonzeros: row.factor.nonzeros,
            factor_flops: row.factor.flops,
            factor_bytes: row.factor.bytes,
            device_bytes: row.factor.device_bytes,
            dispatches: row.factor.dispatches,
            allocations_per_frame: row.allocations_per_frame,
            iterations: row.iterations.map(u64::from),
        }
    }

    /// As f64, which holds counts up to 2^53 exactly.
    fn named(&self) -> [(&'static str, Option<f64>); 7] {
        let count = |n: Option<u64>| n.map(|n| n as f64);
        [
            ("factor_nonzeros", count(self.factor_nonzeros)),
            ("factor_flops", count(self.factor_flops)),
            ("factor_bytes", count(self.factor_bytes)),
            ("device_bytes", count(self.device_bytes)),
            ("dispatches", count(self.dispatches)),
            ("allocations_per_frame", self.allocations_per_frame),
            (ITERATIONS, count(self.iterations)),
        ]
    }
}

/// What changed in `case`. Against the committed numbers, where there are some, an increase fails, iterations only if they grew
/// against the base program as well. Without committed numbers a change against the base program is told and does not fail:
/// there would be no file in which to accept it.
pub fn changes(
    case: &str,
    head: &Counters,
    base: Option<&Counters>,
    baseline: Option<&Counters>,
) -> Vec<Change> {
    let absent = Counters::default();
    let (of_base, committed) = (base.unwrap_or(&absent).named(), baseline.unwrap_or(&absent).named());
    let mut changes = Vec::new();
    for (((counter, now), (_, of_base)), (_, committed)) in
        head.named().into_iter().zip(of_base).zip(committed)
    {
        let Some(now) = now else { continue };
        let (before, against) = match (committed, of_base) {
            (Some(committed), _) => (committed, Reference::Baseline),
            (None, Some(of_base)) => (of_base, Reference::Base),
            (None, None) => continue,
        };
        let grew_here = counter != ITERATIONS || of_base.is_none_or(|of_base| now > of_base);
        let fails = against == Reference::Baseline && now > before && grew_here;
        let worth_telling = counter != ITERATIONS || of_base.is_none_or(|of_base| now != of_base);
        if now != before && (fails || worth_telling) {
            changes.push(Change {
                case: case.to_owned(),
                counter: counter.to_owned(),
                before,
                now,
                against,
                fails,
            });
        }
    }
    changes
}

/// Reads a baseline; `None` where there is no such file.
///
/// # Errors
/// Where there is one that cannot be read.
pub fn read(path: &Path) -> anyhow::Result<Option<Baseline>> {
    if !path.exists() {
        return Ok(None);
    }
    let baseline = serde_json::from_slice(&file::read(path)?).with_context(|| {
        format!("{}: not a file of counters; remake it with --update-baseline", path.display())
    })?;
    Ok(Some(baseline))
}

/// Puts `counters` into the baseline at `path`; cases that were not measured stay as they are.
///
/// # Errors
/// Where the file cannot be read or written.
pub fn update(path: &Path, counters: &Baseline) -> anyhow::Result<()> {
    let mut baseline = read(path)?.unwrap_or_default();
    baseline.extend(counters.iter().map(|(case, counters)| (case.clone(), *counters)));
    let text = serde_json::to_string_pretty(&baseline)? + "\n";
    Ok(file::write_atomically(path, |out| out.write_all(text.as_bytes()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counters(nonzeros: u64, iterations: u64) -> Counters {
        Counters { factor_nonzeros: Some(nonzeros), iterations: Some(iterations), ..Counters::default() }
    }

    fn fails(head: Counters, base: Counters, baseline: Option<Counters>) -> Vec<bool> {
        changes("c", &head, Some(&base), baseline.as_ref()).iter().map(|change| change.fails).collect()
    }

    #[test]
    fn any_increase_against_the_committed_number_fails() {
        let base = counters(100, 10);
        assert_eq!(fails(counters(101, 10), base, Some(base)), [true]);
        assert_eq!(fails(counters(99, 10), base, Some(base)), [false]); // told: the baseline may be lowered
        assert_eq!(fails(counters(100, 10), base, Some(base)), [false; 0]);
        assert_eq!(fails(counters(101, 10), base, Some(counters(101, 10))), [false; 0]);
    }

    #[test]
    fn iterations_must_have_grown_here_too() {
        let committed = Some(counters(1, 10));
        assert_eq!(fails(counters(1, 11), counters(1, 11), committed), [false; 0]);
        assert_eq!(fails(counters(1, 12), counters(1, 11), committed), [true]);
        assert_eq!(fails(counters(1, 12), counters(1, 11), Some(counters(1, 12))), [false; 0]);
    }

    #[test]
    fn without_a_baseline_changes_are_only_told() {
        assert_eq!(fails(counters(2, 3), counters(1, 2), None), [false, false]);
    }

    #[test]
    fn updates_keep_other_cases() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("counters.json");
        assert_eq!(read(&path).unwrap(), None);
        update(&path, &Baseline::from([("a".into(), counters(1, 1))])).unwrap();
        update(&path, &Baseline::from([("b".into(), counters(2, 2))])).unwrap();
        let both = read(&path).unwrap().unwrap();
        assert_eq!(both["a"], counters(1, 1));
        assert_eq!(both["b"], counters(2, 2));
        std::fs::write(&path, "[]").unwrap();
        assert!(format!("{:#}", read(&path).unwrap_err()).contains("--update-baseline"));
    }
}
