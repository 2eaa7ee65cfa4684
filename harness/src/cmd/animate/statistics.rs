//! What every frame of an animation cost and did to the surface, as rows and in summary.

use crate::animation::figures::Figures;
use crate::report::rows::Rows;
use crate::statistics::percentiles;

/// One frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// From the template's positions in memory to the target's, nanoseconds.
    pub latency_ns: u64,
    /// Marks and vertices whose rotation was replaced, because a triangle collapsed or an average vanished.
    pub replaced: usize,
    /// What it did to the surface.
    pub figures: Figures,
}

/// One row per frame, for CSV.
pub fn rows(frames: &[Frame]) -> Rows {
    let mut rows = Rows::new([
        "frame",
        "latency_ms",
        "volume_change",
        "stretch_min",
        "stretch_mean",
        "stretch_max",
        "distorted_edges",
        "replaced_rotations",
    ]);
    for (k, frame) in frames.iter().enumerate() {
        let Figures { volume_change, stretch, distorted } = frame.figures;
        rows.push(
            [
                k.to_string(),
                format!("{:.4}", frame.latency_ns as f64 * 1e-6),
                volume_change.map_or_else(String::new, |change| format!("{change:.6}")),
                format!("{:.6}", stretch[0]),
                format!("{:.6}", stretch[1]),
                format!("{:.6}", stretch[2]),
                format!("{distorted:.6}"),
                frame.replaced.to_string(),
            ]
            .each_ref()
            .map(String::as_str),
        );
    }
    rows
}

/// The main figures of all frames, as rows (figure, value).
pub fn summary(frames: &[Frame], rows: &mut Rows) {
    let mut latencies: Vec<u64> = frames.iter().map(|frame| frame.latency_ns).collect();
    latencies.sort_unstable();
    let milliseconds =
        |ns: Option<u64>| ns.map_or_else(String::new, |ns| format!("{:.2} ms", ns as f64 * 1e-6));
    rows.push(["frames", &frames.len().to_string()]);
    rows.push(["median of a frame", &milliseconds(percentiles::median(&latencies))]);
    rows.push(["slowest frame", &milliseconds(latencies.last().copied())]);
    let changes: Vec<f64> = frames.iter().filter_map(|frame| frame.figures.volume_change).collect();
    match (changes.iter().copied().reduce(f64::min), changes.iter().copied().reduce(f64::max)) {
        (Some(low), Some(high)) => {
            let text = format!("{:+.2} % to {:+.2} %", 100.0 * low, 100.0 * high);
            rows.push(["volume change", &text]);
        }
        _ => rows.push(["volume change", "the surface is open"]),
    }
    let fold =
        |of: fn(&Frame) -> f64, pick: fn(f64, f64) -> f64| frames.iter().map(of).reduce(pick).unwrap_or(1.0);
    let low = fold(|frame| frame.figures.stretch[0], f64::min);
    let high = fold(|frame| frame.figures.stretch[2], f64::max);
    rows.push(["edge lengths", &format!("{low:.3} to {high:.3} of those at rest")]);
    let distorted = fold(|frame| frame.figures.distorted, f64::max);
    rows.push(["edges off by over a fifth", &format!("at most {:.2} %", 100.0 * distorted)]);
    let replaced = frames.iter().map(|frame| frame.replaced).sum::<usize>();
    if replaced > 0 {
        rows.push([
            "rotations replaced",
            &format!("{replaced} in all frames (collapsed or opposite triangles)"),
        ]);
    }
}
