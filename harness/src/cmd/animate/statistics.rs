//! What every frame of an animation cost and did to the surface, as rows and in summary.

use super::keep_volume::Kept;
use super::outputs::Made;
use crate::animation::figures::Figures;
use crate::report::rows::Rows;
use crate::statistics::percentiles;

/// One frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// What making it took.
    pub made: Made,
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
        "keep_volume_ms",
        "keep_volume_offset",
    ]);
    for (k, frame) in frames.iter().enumerate() {
        let Figures { volume_change, stretch, distorted } = frame.figures;
        let Made { latency_ns, replaced, kept } = frame.made;
        rows.push(
            [
                k.to_string(),
                format!("{:.4}", latency_ns as f64 * 1e-6),
                volume_change.map_or_else(String::new, |change| format!("{change:.6}")),
                format!("{:.6}", stretch[0]),
                format!("{:.6}", stretch[1]),
                format!("{:.6}", stretch[2]),
                format!("{distorted:.6}"),
                replaced.to_string(),
                kept.map_or_else(String::new, |kept| format!("{:.4}", kept.ns as f64 * 1e-6)),
                kept.map_or_else(String::new, |kept| format!("{:.6}", kept.offset)),
            ]
            .each_ref()
            .map(String::as_str),
        );
    }
    rows
}

/// The main figures of all frames, as rows (figure, value).
pub fn summary(frames: &[Frame], rows: &mut Rows) {
    let mut latencies: Vec<u64> = frames.iter().map(|frame| frame.made.latency_ns).collect();
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
    let kept: Vec<Kept> = frames.iter().filter_map(|frame| frame.made.kept).collect();
    if !kept.is_empty() {
        let mut times: Vec<u64> = kept.iter().map(|kept| kept.ns).collect();
        times.sort_unstable();
        let offsets = || kept.iter().map(|kept| 100.0 * kept.offset);
        let (low, high) =
            (offsets().fold(f64::INFINITY, f64::min), offsets().fold(f64::NEG_INFINITY, f64::max));
        let median = milliseconds(percentiles::median(&times));
        let text = format!(
            "{low:+.3} to {high:+.3} % of the diagonal along the normals; {median} of a frame (median)"
        );
        rows.push(["moved to keep the volume", &text]);
    }
    let low = fold(|frame| frame.figures.stretch[0], f64::min);
    let high = fold(|frame| frame.figures.stretch[2], f64::max);
    rows.push(["edge lengths", &format!("{low:.3} to {high:.3} of those at rest")]);
    let distorted = fold(|frame| frame.figures.distorted, f64::max);
    rows.push(["edges off by over a fifth", &format!("at most {:.2} %", 100.0 * distorted)]);
    let replaced = frames.iter().map(|frame| frame.made.replaced).sum::<usize>();
    if replaced > 0 {
        rows.push([
            "rotations replaced",
            &format!("{replaced} in all frames (collapsed or opposite triangles)"),
        ]);
    }
}
