//! The noise floor: how far two measurements of the same thing lie apart on this machine, now (an A/A comparison).

use super::finding::Finding;
use crate::choose::answer::Track;
use crate::choose::model::{PROBE_BACKEND, PROBE_MESH};
use crate::choose::question::Question;
use crate::engine::cell::Running;
use crate::engine::settings::Settings;
use crate::engine::solver::Solver;
use crate::engine::source::Name;
use crate::record::result::Cell;
use crate::statistics::percentiles::median;
use anyhow::Context;
use lapsolve::registry::Entry;
use std::time::{Duration, Instant};

/// Solves of one process before the other has its turn.
const SLICE: Duration = Duration::from_millis(40);

/// Half of the couples further apart than this, and differences of 5% need many couples.
const QUIET: f64 = 0.02;

/// What an A/A comparison shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Couples of slices.
    pub couples: usize,
    /// Half of the couples differ by no more than this (a relative difference of medians).
    pub typical: f64,
    /// Nineteen of twenty do.
    pub p95: f64,
    /// Median over the couples of b / a, less 1: what stays where a difference of two identical processes should be none.
    pub bias: f64,
}

impl Noise {
    /// From couples of medians (a, b). None without any.
    pub fn of(couples: &[(f64, f64)]) -> Option<Self> {
        let mut logs: Vec<f64> =
            couples.iter().map(|(a, b)| (b / a).ln()).filter(|d| d.is_finite()).collect();
        logs.sort_by(f64::total_cmp);
        let mut sizes: Vec<f64> = logs.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let rank = |share: f64| ((share * sizes.len() as f64).ceil() as usize).max(1) - 1;
        Some(Self {
            couples: sizes.len(),
            typical: sizes.get(rank(0.5))?.exp_m1(),
            p95: sizes.get(rank(0.95))?.exp_m1(),
            bias: logs[logs.len() / 2].exp_m1(),
        })
    }
}

/// Two processes of one backend take turns (A B, B A, A B ..) for `time`, through the engine, every answer checked.
///
/// # Errors
/// Where the cells cannot be set up or fail.
pub fn measure(question: &Question, backends: &[Entry], time: Duration) -> anyhow::Result<Noise> {
    let source = Name::Mesh(PROBE_MESH.to_owned()).load(0)?;
    let track = Track::new(question, &source, backends, &mut |_| {})?;
    let settings =
        Settings { cell_time: SLICE, rounds: 1, open_loop_time: Duration::ZERO, ..Settings::default() };
    let solver = Solver::BuiltIn(*lapsolve::registry::find(PROBE_BACKEND).context("no backend to measure")?);
    let threads = question.threads();
    let mut cells =
        [0, 1].map(|index| Running::new(&track.task, &source, &solver, threads, &settings, index));
    cells.iter_mut().for_each(Running::begin);
    let (begin, mut couples) = (Instant::now(), Vec::new());
    while begin.elapsed() < time || couples.is_empty() {
        let order = if couples.len().is_multiple_of(2) { [0, 1] } else { [1, 0] };
        let mut medians = [0.0; 2];
        for i in order {
            let before = cells[i].row().samples_ns.len();
            cells[i].round();
            let row = cells[i].row();
            medians[i] = slice_median(&row, before).with_context(|| {
                format!("{}: {}", row.status, row.reason.clone().unwrap_or_else(|| "no samples".into()))
            })?;
        }
        couples.push((medians[0], medians[1]));
    }
    Noise::of(&couples).context("no couples")
}

fn slice_median(row: &Cell, from: usize) -> Option<f64> {
    let mut slice = row.samples_ns.get(from..)?.to_vec();
    slice.sort_unstable();
    median(&slice).map(|t| t as f64)
}

/// The finding of such a comparison, or why there is none.
pub fn finding(noise: anyhow::Result<Noise>) -> Finding {
    match noise {
        Ok(Noise { couples, typical, p95, bias }) => Finding::new(
            "noise floor",
            Some(typical <= QUIET),
            format!(
                "A/A: half of {couples} couples within {:.1}%, 19 of 20 within {:.1}%, bias {:+.2}%",
                100.0 * typical,
                100.0 * p95,
                100.0 * bias
            ),
            "single differences of that size mean nothing here; quiet the machine, or compare interleaved with many couples",
        ),
        Err(error) => Finding::info("noise floor", format!("not measured: {error:#}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn couples_that_agree_have_no_noise() {
        let noise = Noise::of(&[(1.0, 1.0), (2.0, 2.0)]).unwrap();
        assert_eq!((noise.typical, noise.p95, noise.bias), (0.0, 0.0, 0.0));
        assert_eq!(Noise::of(&[]), None);
        assert_eq!(Noise::of(&[(0.0, 1.0)]), None);
    }

    #[test]
    fn differences_either_way_are_noise_and_one_way_is_bias() {
        let noise = Noise::of(&[(1.0, 1.1), (1.1, 1.0), (1.0, 1.0)]).unwrap();
        assert!((noise.typical - 0.1).abs() < 1e-12 && noise.bias.abs() < 1e-12, "{noise:?}");
        let biased = Noise::of(&[(1.0, 1.1), (1.0, 1.1), (1.0, 1.1)]).unwrap();
        assert!((biased.bias - 0.1).abs() < 1e-12 && finding(Ok(biased)).good == Some(false));
    }
}
