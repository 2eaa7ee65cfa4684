//! Captured joint angles without wrap-around, outliers and shake.

use super::clip::{Channel, Clip};
use lapsolve::backend::Backend;
use lapsolve::columns::Columns;
use lapsolve::workload::smoothing::{
    OutlierRule, Outliers, Smoother, SmoothingError, clean as remove, roughness, unwrap,
};

/// What was done to a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleaning {
    /// Removed windows.
    pub outliers: Outliers,
    /// Root mean square of the second differences of all angles, degrees: as captured (unwrapped), without outliers,
    /// smoothed.
    pub roughness: [f64; 3],
}

/// Removes outlier windows by their variance, interpolates them, and smooths all channels: angles by equation 3 of the
/// paper with `lambda`, the coordinates of the root with them. Angles come out unwrapped.
///
/// # Errors
/// [`SmoothingError`]; the motion is then as it was.
pub fn clean(
    clip: &mut Clip,
    rule: &OutlierRule,
    lambda: f64,
    backend: &dyn Backend,
) -> Result<Cleaning, SmoothingError> {
    let (frames, width) = (clip.len(), clip.channels());
    let kinds: Vec<Channel> = clip.joints.iter().flat_map(|joint| joint.channels.iter().copied()).collect();
    let is_angle = |c: &usize| matches!(kinds[*c], Channel::Rotation(_));
    let angles: Vec<usize> = (0..width).filter(is_angle).collect();
    let mut values = clip.values.clone();
    for triple in triples(clip) {
        settle(&mut values, width, triple);
    }
    let mut columns = picked(&values, width, &angles);
    let periods = vec![360.0; angles.len()];
    let view = |columns: &[f64]| roughness(Columns::new(columns, frames, angles.len())).sqrt();
    let captured = {
        let mut plain = columns.clone();
        unwrap(Columns::new(&mut plain, frames, angles.len()), &periods);
        view(&plain)
    };
    let outliers = remove(Columns::new(&mut columns[..], frames, angles.len()), &periods, rule)?;
    let cleaned = view(&columns);
    put(&mut values, width, &angles, &columns);
    for c in (0..width).filter(|c| !is_angle(c)) {
        bridge(&mut values, width, c, &outliers);
    }
    let mut smooth = vec![0.0; values.len()];
    let mut smoother = Smoother::prepare(backend, frames, width, lambda)?;
    smoother.solve(Columns::new(&values, frames, width), Columns::new(&mut smooth, frames, width))?;
    let smoothed = view(&picked(&smooth, width, &angles));
    clip.values = smooth;
    Ok(Cleaning { outliers, roughness: [captured, cleaned, smoothed] })
}

/// Columns `which` of rows of `width`.
fn picked(values: &[f64], width: usize, which: &[usize]) -> Vec<f64> {
    values.chunks_exact(width).flat_map(|row| which.iter().map(|&c| row[c])).collect()
}

/// The reverse of [`picked`].
fn put(values: &mut [f64], width: usize, which: &[usize], columns: &[f64]) {
    for (row, own) in values.chunks_exact_mut(width).zip(columns.chunks_exact(which.len().max(1))) {
        which.iter().zip(own).for_each(|(&c, &x)| row[c] = x);
    }
}

/// Interpolates removed frames of a column.
fn bridge(values: &mut [f64], width: usize, column: usize, outliers: &Outliers) {
    let frames = values.len() / width;
    let at = |f: usize| f * width + column;
    let mut removed = vec![false; frames];
    outliers.removed.iter().for_each(|window| removed[window.clone()].fill(true));
    let kept: Vec<usize> = (0..frames).filter(|&f| !removed[f]).collect();
    for f in (0..frames).filter(|&f| removed[f]) {
        let next = kept.partition_point(|&k| k < f);
        values[at(f)] = match (next.checked_sub(1).map(|i| kept[i]), kept.get(next)) {
            (Some(a), Some(&b)) => {
                let s = (f - a) as f64 / (b - a) as f64;
                values[at(a)] * (1.0 - s) + values[at(b)] * s
            }
            (Some(a), None) => values[at(a)],
            (None, Some(&b)) => values[at(b)],
            (None, None) => values[at(f)],
        };
    }
}

/// Channels of joints that turn about three different axes.
fn triples(clip: &Clip) -> Vec<[usize; 3]> {
    let distinct = |own: Vec<(usize, usize)>| match own[..] {
        [a, b, c] if a.1 != b.1 && b.1 != c.1 && a.1 != c.1 => Some([a.0, b.0, c.0]),
        _ => None,
    };
    clip.rotations().into_iter().filter_map(distinct).collect()
}

/// Frames whose median tells which way a joint is described.
const MEMORY: usize = 5;

/// (a, b, c) and (a + 180, 180 - b, c + 180) are one rotation. Writes every frame in the form that is nearest to the frames
/// before, of which the median counts, so that no single wild frame turns the description of all that follow.
fn settle(values: &mut [f64], width: usize, triple: [usize; 3]) {
    let mut before: Vec<[f64; 3]> = Vec::new();
    for row in values.chunks_exact_mut(width) {
        let own = triple.map(|c| row[c]);
        let other = [own[0] + 180.0, 180.0 - own[1], own[2] + 180.0];
        let chosen = if before.is_empty() {
            own
        } else {
            let reference = median(&before);
            if distance(other, reference) < distance(own, reference) { other } else { own }
        };
        triple.iter().zip(chosen).for_each(|(&c, x)| row[c] = x);
        before.push(chosen);
        if before.len() > MEMORY {
            before.remove(0);
        }
    }
}

/// The frame of `frames` from which the others are least far.
fn median(frames: &[[f64; 3]]) -> [f64; 3] {
    let sum = |a: &[f64; 3]| frames.iter().map(|&b| distance(*a, b)).sum::<f64>();
    *frames.iter().min_by(|a, b| sum(a).total_cmp(&sum(b))).expect("not empty")
}

/// Sum of the differences of angles, whole turns left out.
fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| ((x - y + 180.0).rem_euclid(360.0) - 180.0).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::animation::clip::tests::leg;
    use lapsolve::registry::{OpenOptions, find};
    use lapsolve::rotation::dot4;

    /// A leg that swings, whose root turns around three times while it walks.
    fn motion(frames: usize) -> Clip {
        let frame = |k: usize| {
            let t = k as f64 / frames as f64;
            let turn = (3.0 * 360.0 * t + 180.0).rem_euclid(360.0) - 180.0;
            [t, 1.0, 0.0, turn, 10.0 * (40.0 * t).sin(), 0.0, 0.0, 30.0 * (40.0 * t).cos(), 0.0]
        };
        leg((0..frames).flat_map(frame).collect())
    }

    fn cleaned(clip: &Clip, lambda: f64) -> (Clip, Cleaning) {
        let backend = (find("faer-llt").unwrap().open)(&OpenOptions::default()).unwrap();
        let mut clip = clip.clone();
        let cleaning = clean(&mut clip, &OutlierRule::default(), lambda, &*backend).unwrap();
        (clip, cleaning)
    }

    /// Largest angle between the rotations of two motions, radians.
    fn apart(a: &Clip, b: &Clip) -> f64 {
        let pairs = (0..a.len()).flat_map(|k| a.place(k).into_iter().zip(b.place(k)));
        pairs.map(|(x, y)| 2.0 * dot4(x.rotation, y.rotation).abs().min(1.0).acos()).fold(0.0, f64::max)
    }

    #[test]
    fn turns_and_other_descriptions_of_the_same_rotation_are_no_outliers() {
        let clip = motion(300);
        let mut flipped = clip.clone();
        for row in flipped.values.chunks_exact_mut(9).skip(100).step_by(3) {
            (row[3], row[4], row[5]) = (row[3] + 180.0, 180.0 - row[4], row[5] - 180.0);
            row[7] += 720.0;
        }
        assert!(apart(&clip, &flipped) < 1e-6);
        let (result, cleaning) = cleaned(&flipped, 1.0);
        assert_eq!(cleaning.outliers.frames(), 0, "{:?}", cleaning.outliers);
        assert!(apart(&clip, &result) < 0.05, "{}", apart(&clip, &result));
        assert!(result.values.chunks_exact(9).last().unwrap()[3].abs() > 800.0, "unwrapped over three turns");
    }

    #[test]
    fn wild_frames_are_removed_and_shake_goes() {
        let clip = motion(300);
        let mut noisy = clip.clone();
        for (i, x) in noisy.values.iter_mut().enumerate() {
            *x += if i % 9 < 3 { 0.0 } else { 0.8 * ((i * i) as f64 * 0.7).sin() }; // shake
        }
        // 90 degrees and more about every axis: 140 would be near the other description of the same rotation.
        for k in [57, 58, 171] {
            noisy.values[9 * k + 3..9 * k + 9]
                .iter_mut()
                .enumerate()
                .for_each(|(i, x)| *x += 90.0 + 9.0 * i as f64);
            noisy.values[9 * k] += 0.5;
        }
        let (result, cleaning) = cleaned(&noisy, 3.0);
        assert!(cleaning.outliers.removed.iter().any(|w| w.contains(&57)), "{:?}", cleaning.outliers.removed);
        assert!(cleaning.outliers.removed.iter().any(|w| w.contains(&171)));
        assert!(cleaning.outliers.frames() <= 15, "{:?}", cleaning.outliers.removed);
        let [captured, removed, smooth] = cleaning.roughness;
        assert!(captured > 2.0 * removed && removed > 2.0 * smooth, "{:?}", cleaning.roughness);
        assert!(apart(&clip, &result) < 0.12, "{}", apart(&clip, &result));
        // The root's coordinate is bridged over the removed frames.
        assert!((result.values[9 * 57] - clip.values[9 * 57]).abs() < 0.02);
    }
}
