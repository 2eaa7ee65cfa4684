//! Outlier windows of a captured sequence, and angles without wrap-around.

use super::{SmoothingError, check_finite};
use crate::columns::Columns;
use std::ops::Range;

/// When a window of frames is an outlier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierRule {
    /// Frames of a window (>= 2). Short ones remove little beside the fault, long ones have steadier variances.
    pub window: usize,
    /// Largest variance of a window that stays, the mean over the columns, in squared units of the angles; `None`:
    /// [`OutlierRule::SPARE`] times the median over the windows.
    pub threshold: Option<f64>,
}

impl OutlierRule {
    /// How often the median variance a window may have by itself: a captured motion has windows of rest and of haste, and a
    /// fault is an order of magnitude beyond them.
    pub const SPARE: f64 = 20.0;
}

impl Default for OutlierRule {
    /// Windows of five frames: a sixth of a second of a depth camera.
    fn default() -> Self {
        Self { window: 5, threshold: None }
    }
}

/// What was found and removed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// Removed frames, one range per window, ascending; they hold interpolated angles now.
    pub removed: Vec<Range<usize>>,
    /// Variance of every window, the mean over the columns.
    pub variances: Vec<f64>,
    /// The largest variance that stayed in force.
    pub threshold: f64,
}

impl Outliers {
    /// Number of removed frames.
    pub fn frames(&self) -> usize {
        self.removed.iter().map(Range::len).sum()
    }
}

/// Removes outlier windows, unwraps what stays, and interpolates the gaps linearly (at the ends: with the next angle
/// that stayed), in place. Faults are removed first, because one wild frame can make everything after it wrap wrongly.
///
/// `periods[c]` is the period of column c in its unit (360 or 2 pi); infinite for columns that do not wrap, such as a
/// root's coordinates, whose squared unit then counts in the mean variance as it is.
///
/// # Errors
/// [`SmoothingError::NonFinite`], [`SmoothingError::Window`], [`SmoothingError::AllOutliers`]; the angles are then as they
/// were.
///
/// # Panics
/// If there is not one period per column.
pub fn clean(
    mut angles: Columns<&mut [f64]>,
    periods: &[f64],
    rule: &OutlierRule,
) -> Result<Outliers, SmoothingError> {
    assert_eq!(periods.len(), angles.k(), "periods: one per column");
    check_finite(angles.view())?;
    if rule.window < 2 {
        return Err(SmoothingError::Window { window: rule.window });
    }
    let windows = windows(angles.n(), rule.window);
    let variances: Vec<f64> =
        windows.iter().map(|window| variance(angles.view(), periods, window.clone())).collect();
    let threshold = rule.threshold.unwrap_or_else(|| OutlierRule::SPARE * median(&variances));
    let wild: Vec<bool> = variances.iter().map(|&v| v > threshold).collect();
    let removed = displaced(angles.view(), periods, &windows, wild, threshold);
    if !removed.is_empty() && removed.len() == windows.len() {
        return Err(SmoothingError::AllOutliers { windows: windows.len(), threshold });
    }
    let mut kept = vec![true; angles.n()];
    removed.iter().for_each(|window| kept[window.clone()].fill(false));
    let frames: Vec<usize> = (0..angles.n()).filter(|&f| kept[f]).collect();
    for pair in frames.windows(2) {
        follow(angles.reborrow(), periods, pair[0], pair[1]);
        interpolate(angles.reborrow(), pair[0], pair[1]);
    }
    if let (Some(&first), Some(&last)) = (frames.first(), frames.last()) {
        (0..first).for_each(|f| copy(angles.reborrow(), first, f));
        (last + 1..angles.n()).for_each(|f| copy(angles.reborrow(), last, f));
    }
    Ok(Outliers { removed, variances, threshold })
}

/// Most windows in a row that are taken for a fault by where they are: with windows of a sixth of a second, two thirds.
const MOST_DISPLACED: usize = 4;

/// The windows that are `wild`, and those between two breaks that lie elsewhere, though they are calm in themselves: a tracker
/// that takes one limb for another for a moment. A break is a wild window, or a step between two others, seen as a window
/// half in each that varies by more than `threshold`; a short run between two breaks is removed where its mean
/// squared distance from the straight line between the frames before and behind exceeds `threshold`, too.
fn displaced(
    angles: Columns<&[f64]>,
    periods: &[f64],
    windows: &[Range<usize>],
    mut wild: Vec<bool>,
    threshold: f64,
) -> Vec<Range<usize>> {
    let steps = |i: usize| {
        let (a, b) = (&windows[i], &windows[i + 1]);
        variance(angles, periods, a.start + a.len().div_ceil(2)..b.start + b.len().div_ceil(2)) > threshold
    };
    let calm: Vec<usize> = (0..windows.len()).filter(|&i| !wild[i]).collect();
    let runs: Vec<&[usize]> = calm.chunk_by(|&i, &j| j == i + 1 && !steps(i)).collect();
    let ends = |run: &[usize]| (windows[run[0]].start, windows[run[run.len() - 1]].end - 1);
    let mut before = runs.first().map_or(0, |run| ends(run).1);
    for (k, run) in runs.iter().enumerate().skip(1) {
        let (first, last) = ends(run);
        let off =
            |after: usize| distance_from_line(angles, periods, [before, after], first..last + 1) > threshold;
        match runs.get(k + 1) {
            Some(next) if run.len() <= MOST_DISPLACED && off(ends(next).0) => {
                run.iter().for_each(|&i| wild[i] = true);
            }
            _ => before = last,
        }
    }
    windows.iter().zip(wild).filter(|(_, wild)| *wild).map(|(window, _)| window.clone()).collect()
}

/// Mean over the columns and `frames` of the squared distance from the straight line between two other frames.
fn distance_from_line(
    angles: Columns<&[f64]>,
    periods: &[f64],
    [from, to]: [usize; 2],
    frames: Range<usize>,
) -> f64 {
    let count = (frames.len() * angles.k()) as f64;
    let squared = |f: usize, c: usize| {
        let t = (f - from) as f64 / (to - from) as f64;
        let begin = angles.row(from)[c];
        let line = begin + t * (nearest(angles.row(to)[c], begin, periods[c]) - begin);
        (nearest(angles.row(f)[c], line, periods[c]) - line).powi(2)
    };
    frames.flat_map(|f| (0..angles.k()).map(move |c| (f, c))).map(|(f, c)| squared(f, c)).sum::<f64>() / count
}

/// Adds whole periods so that no angle differs from the one before by more than half a period, in place, column by column.
///
/// # Panics
/// If there is not one period per column.
pub fn unwrap(mut angles: Columns<&mut [f64]>, periods: &[f64]) {
    assert_eq!(periods.len(), angles.k(), "periods: one per column");
    (1..angles.n()).for_each(|f| follow(angles.reborrow(), periods, f - 1, f));
}

/// `angle` plus the whole periods that bring it nearest to `before`.
fn nearest(angle: f64, before: f64, period: f64) -> f64 {
    if period.is_finite() && period > 0.0 {
        angle - period * ((angle - before) / period).round()
    } else {
        angle
    }
}

fn follow(mut angles: Columns<&mut [f64]>, periods: &[f64], before: usize, frame: usize) {
    for (c, &period) in periods.iter().enumerate() {
        let at_before = angles.row(before)[c];
        let angle = &mut angles.row_mut(frame)[c];
        *angle = nearest(*angle, at_before, period);
    }
}

/// The frames between two on the straight line.
fn interpolate(mut angles: Columns<&mut [f64]>, from: usize, to: usize) {
    for frame in from + 1..to {
        let t = (frame - from) as f64 / (to - from) as f64;
        for c in 0..angles.k() {
            angles.row_mut(frame)[c] = (1.0 - t) * angles.row(from)[c] + t * angles.row(to)[c];
        }
    }
}

fn copy(mut angles: Columns<&mut [f64]>, from: usize, to: usize) {
    let k = angles.k();
    angles.data_mut().copy_within(from * k..(from + 1) * k, to * k);
}

/// Consecutive windows; a last one of a single frame joins the one before.
fn windows(frames: usize, length: usize) -> Vec<Range<usize>> {
    let mut windows: Vec<Range<usize>> =
        (0..frames).step_by(length).map(|first| first..frames.min(first + length)).collect();
    if windows.len() > 1 && windows.last().is_some_and(|window| window.len() < 2) {
        windows.pop();
        windows.last_mut().expect("more than one").end = frames;
    }
    windows
}

/// Mean over the columns of the variance within a window, which is unwrapped by itself: a passage over the period
/// is no fault.
fn variance(angles: Columns<&[f64]>, periods: &[f64], window: Range<usize>) -> f64 {
    let count = window.len() as f64;
    let of_column = |c: usize| {
        let mut before = angles.row(window.start)[c];
        let unwrapped: Vec<f64> = window
            .clone()
            .map(|f| {
                before = nearest(angles.row(f)[c], before, periods[c]);
                before
            })
            .collect();
        let mean = unwrapped.iter().sum::<f64>() / count;
        unwrapped.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count
    };
    (0..angles.k()).map(of_column).sum::<f64>() / angles.k() as f64
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURN: f64 = std::f64::consts::TAU;

    /// Two angles over 60 frames: one turns three times and comes wrapped into [-pi, pi), one swings.
    fn true_angles() -> Vec<f64> {
        (0..60).map(f64::from).flat_map(|f| [0.05 * f * TURN, (0.2 * f).sin()]).collect()
    }

    fn wrapped(angles: &[f64]) -> Vec<f64> {
        angles.iter().map(|x| x - TURN * (x / TURN).round()).collect()
    }

    #[test]
    fn unwrapping_restores_whole_turns() {
        let expected = true_angles();
        let mut angles = wrapped(&expected);
        unwrap(Columns::new(&mut angles[..], 60, 2), &[TURN; 2]);
        assert!(angles.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12));
        let mut angles = wrapped(&expected);
        let before = angles.clone();
        unwrap(Columns::new(&mut angles[..], 60, 2), &[f64::INFINITY; 2]);
        assert_eq!(angles, before);
    }

    #[test]
    fn wild_windows_are_interpolated_and_do_not_shift_what_follows() {
        let expected = true_angles();
        let mut angles = wrapped(&expected);
        for f in 20..25 {
            angles[2 * f + 1] += if f % 2 == 0 { 9.0 } else { -8.0 };
            angles[2 * f] = (f as f64 * 77.0).sin() * 3.0;
        }
        let rule = OutlierRule { window: 5, threshold: Some(4.0) };
        let found =
            clean(Columns::new(&mut angles[..], 60, 2), &[TURN, f64::INFINITY], &rule).expect("some stay");
        assert_eq!((found.removed.first(), found.removed.len(), found.frames()), (Some(&(20..25)), 1, 5));
        for f in 0..60 {
            let limit = if (20..25).contains(&f) { 0.4 } else { 1e-12 };
            for c in 0..2 {
                let error = (angles[2 * f + c] - expected[2 * f + c]).abs();
                assert!(error < limit, "frame {f}, column {c}: {error}");
            }
        }
        assert!((angles[44] - expected[44]).abs() < 1e-9, "a steady turn is interpolated exactly");
    }

    #[test]
    fn calm_windows_elsewhere_are_removed_and_lasting_changes_stay() {
        // (first frame, length) of a step aside and back: on the grid of windows, off it, several windows long.
        for (first, length) in [(20, 5), (22, 5), (23, 12), (15, 20)] {
            let mut angles: Vec<f64> = (0..120).flat_map(|f| [0.02 * f64::from(f % 60), 0.0]).collect();
            (first..first + length).for_each(|f| angles[2 * f] += 1.5);
            let found = clean(Columns::new(&mut angles[..], 120, 2), &[TURN; 2], &OutlierRule::default())
                .expect("some stay");
            assert!(found.frames() <= length + 8, "{first} {length}: {:?}", found.removed);
            let worst = (0..60).map(|f| (angles[2 * f] - 0.02 * f as f64).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-9, "{first} {length}: {worst}");
        }
        // Half a motion elsewhere is a new pose.
        let mut angles: Vec<f64> = (0..60).map(|f| f64::from(f / 30)).collect();
        let found = clean(Columns::new(&mut angles[..], 60, 1), &[TURN], &OutlierRule::default());
        assert!(found.expect("some stay").removed.is_empty());
        assert_eq!((angles[29], angles[30]), (0.0, 1.0));
    }

    #[test]
    fn the_ends_are_held_and_the_own_threshold_finds_faults() {
        let mut angles: Vec<f64> = (0..41).map(|f| 0.01 * f64::from(f)).collect();
        angles[0] = 50.0;
        angles[40] = -50.0; // in the last window, which has 6 frames: a window of one joins it
        let found = clean(Columns::new(&mut angles[..], 41, 1), &[f64::INFINITY], &OutlierRule::default());
        assert_eq!(found.expect("some stay").removed, [0..5, 35..41]);
        assert!(angles[..5].iter().all(|&x| x == 0.05) && angles[35..].iter().all(|&x| x == 0.34));
        let rest = vec![1.0; 12];
        let mut still = rest.clone();
        let found =
            clean(Columns::new(&mut still[..], 12, 1), &[TURN], &OutlierRule::default()).expect("kept");
        assert!(found.removed.is_empty() && still == rest);
    }

    #[test]
    fn faults_leave_the_angles_alone() {
        let before: Vec<f64> = (0..10).map(|f| f64::from(f % 3)).collect();
        let mut angles = before.clone();
        let mut run = |window, threshold| {
            clean(Columns::new(&mut angles[..], 10, 1), &[TURN], &OutlierRule { window, threshold })
        };
        assert_eq!(run(1, None), Err(SmoothingError::Window { window: 1 }));
        assert_eq!(run(5, Some(0.0)), Err(SmoothingError::AllOutliers { windows: 2, threshold: 0.0 }));
        assert_eq!(angles, before);
        angles[3] = f64::NAN;
        let found = clean(Columns::new(&mut angles[..], 10, 1), &[TURN], &OutlierRule::default());
        assert_eq!(found, Err(SmoothingError::NonFinite { frame: 3, column: 0 }));
    }
}
