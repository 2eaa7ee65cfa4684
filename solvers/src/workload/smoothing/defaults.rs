//! The sequence of a mesh that comes alone: its number of vertices is the number of frames.

/// Angles: three for each of shoulders, elbows, hips and knees, the joints that a depth camera follows best.
pub const COLUMNS: usize = 24;

/// Joint angles of `frames` frames and `columns` columns in radians, frame after frame: column c swings by 0.6 at
/// (20 + c) frames per period and shakes by up to 0.05 between neighbouring frames, as a depth camera's skeletons do. The
/// shake is the fractional part of multiples of the golden ratio, the same everywhere.
pub fn angles(frames: usize, columns: usize) -> Vec<f64> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let angle = |f: usize, c: usize| {
        let phase = std::f64::consts::TAU * f as f64 / (20 + c) as f64;
        let shake = ((f * columns + c) as f64 * GOLDEN).fract() - 0.5;
        0.6 * phase.sin() + 0.1 * shake
    };
    (0..frames).flat_map(|f| (0..columns).map(move |c| angle(f, c))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Columns;
    use crate::workload::smoothing::roughness;

    #[test]
    fn every_column_swings_and_shakes() {
        let angles = angles(200, COLUMNS);
        for c in 0..COLUMNS {
            let column: Vec<f64> = angles.iter().skip(c).step_by(COLUMNS).copied().collect();
            let (low, high) =
                column.iter().fold((0.0_f64, 0.0_f64), |(low, high), &x| (low.min(x), high.max(x)));
            assert!(low < -0.5 && high > 0.5 && high < 0.7, "{c}: {low} {high}");
            let rough = roughness(Columns::new(&column[..], 200, 1));
            assert!(rough > 1e-4, "{c}: {rough}");
        }
    }
}
