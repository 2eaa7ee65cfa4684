//! Farthest-point sampling, defined so that every implementation picks the same points.

use crate::range::within_range;
use crate::vector::distance_squared;
use rayon::prelude::*;

/// Indices of `count` points (all, if there are fewer) in the order of their choice: first the one of smallest x, then y, then
/// z; then always the one whose smallest distance to those chosen is largest. Ties go to the lowest index.
///
/// Distances are compared squared, (dx dx + dy dy) + dz dz in f64 without fused multiply-add. Cost: count x points
/// distances, on the current rayon pool; the choice does not depend on the number of threads.
pub fn farthest_points(points: &[[f64; 3]], count: usize) -> Vec<u32> {
    let points = within_range(points);
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    if count == 0 || points.is_empty() {
        return chosen;
    }
    let mut next = lowest_point((0..points.len() as u32).map(|i| (i, points[i as usize])));
    // Negative once chosen, so that a chosen point loses against a point at distance 0.
    let mut distance = vec![f64::INFINITY; points.len()];
    while let Some(choice) = next {
        distance[choice as usize] = -1.0;
        chosen.push(choice);
        if chosen.len() == count.min(points.len()) {
            break;
        }
        next = Some(update(&points, points[choice as usize], &mut distance));
    }
    chosen
}

/// The index of the point of smallest x, then y, then z; the first of equal ones.
pub fn lowest_point(points: impl Iterator<Item = (u32, [f64; 3])>) -> Option<u32> {
    points.reduce(|best, next| if next.1 < best.1 { next } else { best }).map(|(index, _)| index)
}

/// Takes the distance to `to` into account and returns the index of the largest distance.
fn update(points: &[[f64; 3]], to: [f64; 3], distance: &mut [f64]) -> u32 {
    const CHUNK: usize = 8192; // points: some 10 us of work
    let farther = |a: (f64, u32), b: (f64, u32)| if b.0 > a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a };
    let scan = |(chunk, (distance, points)): (usize, (&mut [f64], &[[f64; 3]]))| {
        let mut best = (-2.0, 0);
        for (i, (d, p)) in distance.iter_mut().zip(points).enumerate() {
            *d = d.min(distance_squared(*p, to));
            if *d > best.0 {
                best = (*d, (chunk * CHUNK + i) as u32);
            }
        }
        best
    };
    let chunks = distance.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).enumerate();
    chunks.map(scan).reduce(|| (-2.0, u32::MAX), farther).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_halved_again_and_again() {
        let points: Vec<_> = (0..9).map(|i| [f64::from(8 - i), 0.0, 0.0]).collect();
        // Start at x = 0 (index 8), then x = 8, then 4; then 2 and 6 tie and the lower index is x = 6.
        assert_eq!(farthest_points(&points, 5), [8, 0, 4, 2, 6]);
    }

    #[test]
    fn duplicates_come_last_and_none_twice() {
        let points = [[1.0; 3], [0.0; 3], [1.0; 3], [0.0; 3]];
        assert_eq!(farthest_points(&points, 9), [1, 0, 2, 3]);
        assert_eq!(farthest_points(&[], 3), [0u32; 0]);
    }

    #[test]
    fn many_points_agree_with_the_plain_definition_at_any_scale() {
        let points: Vec<[f64; 3]> = (0..30_000u32)
            .map(|i| [1, 2, 3].map(|k| f64::from(i.wrapping_mul(2_654_435_761).rotate_left(7 * k) >> 20)))
            .collect();
        let mut plain = vec![lowest_point((0..).zip(points.iter().copied())).expect("points")];
        let mut nearest = vec![f64::INFINITY; points.len()];
        while plain.len() < 12 {
            let last = points[*plain.last().expect("one") as usize];
            let mut best = 0;
            for i in 0..points.len() {
                nearest[i] = nearest[i].min(distance_squared(points[i], last));
                if nearest[i] > nearest[best] {
                    best = i;
                }
            }
            plain.push(best as u32);
        }
        assert_eq!(farthest_points(&points, 12), plain);
        let huge: Vec<_> = points.iter().map(|p| p.map(|x| x * 2f64.powi(700))).collect();
        assert_eq!(farthest_points(&huge, 12), plain);
    }
}
