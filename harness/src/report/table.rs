//! The cells of a result as a table for the terminal, and as full rows for CSV.

use super::numbers::{self, significant};
use super::rows::Rows;
use crate::record::names::{DeviceType, Status};
use crate::record::result::{Cell, Summary};
use lapsolve::backend::FrameStep;
use lapsolve::registry;
use std::fmt::Write;

/// One row per cell, short enough for 100 columns of a terminal. Times in milliseconds, memory in 2^20 bytes.
pub fn overview(cells: &[Cell]) -> Rows {
    let mut rows = Rows::new([
        "mesh", "workload", "backend", "thr", "status", "setup ms", "solve ms", "fps", "eta", "error", "MiB",
        "% read",
    ]);
    for cell in cells {
        let threads = cell.threads.to_string();
        let percent = cell.bandwidth.fraction_of_read.map(|f| format!("{:.0}", 100.0 * f));
        rows.push([
            &cell.mesh.name,
            &cell.workload,
            &label(cell),
            &threads,
            cell.status.name(),
            &milliseconds(set_up(cell)),
            &milliseconds(median(cell)),
            &cell.frames_per_second.map_or_else(String::new, significant),
            &scientific(cell.accuracy.backward_error),
            &scientific(cell.accuracy.forward_error),
            &cell.peak_rss_bytes.map_or_else(String::new, |b| (b >> 20).to_string()),
            &percent.unwrap_or_default(),
        ]);
    }
    rows
}

/// The backend's name; a Vulkan driver that computes on the CPU is told apart from a GPU.
fn label(cell: &Cell) -> String {
    match cell.device_type {
        Some(DeviceType::SoftwareVulkan) => format!("{} (software)", cell.backend),
        _ => cell.backend.clone(),
    }
}

/// The main figures of every cell, in raw units.
pub fn full(cells: &[Cell]) -> Rows {
    let mut rows = Rows::new([
        "mesh",
        "triangles",
        "vertices",
        "workload",
        "backend",
        "threads",
        "status",
        "reason",
        "load_ns",
        "assemble_ns",
        "order_ns",
        "symbolic_ns",
        "numeric_ns",
        "upload_ns",
        "first_solve_ns",
        "samples",
        "solve_min_ns",
        "solve_p50_ns",
        "solve_p95_ns",
        "solve_max_ns",
        "frame_p50_ns",
        "update_p50_ns",
        "backward_error",
        "forward_error",
        "factor_nonzeros",
        "peak_rss_bytes",
        "allocations_per_frame",
        "iterations",
        "fraction_of_read",
        "device",
        "device_type",
    ]);
    for c in cells {
        let p = &c.phases_ns;
        let steady = if c.frame_ns.samples.is_some() { &c.frame_ns } else { &c.solve_ns };
        rows.push(
            [
                c.mesh.name.clone(),
                text(c.mesh.triangles),
                text(c.mesh.vertices),
                c.workload.clone(),
                c.backend.clone(),
                c.threads.to_string(),
                c.status.to_string(),
                c.reason.clone().unwrap_or_default(),
                text(p.load),
                text(p.assemble),
                text(p.order),
                text(p.symbolic),
                text(p.numeric),
                text(p.upload),
                text(p.first_solve),
                text(steady.samples),
                text(c.solve_ns.min),
                text(c.solve_ns.p50),
                text(c.solve_ns.p95),
                text(c.solve_ns.max),
                text(c.frame_ns.p50),
                text(c.update_ns.p50),
                text(c.accuracy.backward_error),
                text(c.accuracy.forward_error),
                text(c.factor.nonzeros),
                text(c.peak_rss_bytes),
                text(c.allocations_per_frame),
                text(c.iterations),
                text(c.bandwidth.fraction_of_read),
                c.device.clone().unwrap_or_default(),
                text(c.device_type),
            ]
            .each_ref()
            .map(String::as_str),
        );
    }
    rows
}

/// A line for every cell that is not `ok`, saying why.
pub fn reasons(cells: &[Cell]) -> String {
    let mut lines = String::new();
    for cell in cells.iter().filter(|cell| cell.status != Status::Ok) {
        let reason = cell.reason.as_deref().unwrap_or("no reason given");
        let Cell { mesh, workload, backend, threads, status, .. } = cell;
        let _ =
            writeln!(lines, "{}, {workload}, {backend}, {threads} thread(s): {status}: {reason}", mesh.name);
    }
    lines
}

/// A line for every cell whose frames or solves have parts: their medians in milliseconds, in the order of the frame; the
/// levels of a device's phase (`forward 00`, `forward 01`, ...) added up.
pub fn steps(cells: &[Cell]) -> String {
    let mut lines = String::new();
    for cell in cells.iter().filter(|cell| !cell.steps_ns.is_empty()) {
        let mut sums: Vec<(&str, u64)> = Vec::new();
        for (step, ns) in &cell.steps_ns {
            let name = step.split(' ').next().unwrap_or(step);
            match sums.last_mut() {
                Some((last, sum)) if *last == name => *sum += ns,
                _ => sums.push((name, *ns)),
            }
        }
        sums.sort_by_key(|(name, _)| FrameStep::ALL.iter().position(|step| step.name() == *name));
        let part = |(name, ns): &(&str, u64)| format!("{name} {}", milliseconds(Some(*ns)));
        let parts: Vec<String> = sums.iter().map(part).collect();
        let Cell { mesh, workload, backend, threads, .. } = cell;
        let _ = writeln!(
            lines,
            "{}, {workload}, {backend}, {threads} thread(s), ms: {}",
            mesh.name,
            parts.join(", ")
        );
    }
    lines
}

/// A line for every mesh on which some library assembled the Laplacian by itself: our time and theirs.
pub fn assemblies(cells: &[Cell]) -> String {
    let mut lines = String::new();
    let mut meshes: Vec<&str> = Vec::new();
    let foreign = |cell: &&Cell| registry::find(&cell.backend).is_none();
    for cell in cells.iter().filter(foreign) {
        let name = cell.mesh.name.as_str();
        let ours = cells.iter().find(|other| other.mesh.name == name && !foreign(other));
        let (Some(theirs), Some(ours)) = (cell.phases_ns.assemble, ours.and_then(|c| c.phases_ns.assemble))
        else {
            continue;
        };
        if theirs != ours && ours > 0 && !meshes.contains(&name) {
            meshes.push(name);
            let ratio = significant(theirs as f64 / ours as f64);
            let (ours, theirs) = (milliseconds(Some(ours)), milliseconds(Some(theirs)));
            let _ = writeln!(
                lines,
                "{name}, assembly of the Laplacian, ms: {ours} here, {theirs} in {} ({ratio} times)",
                cell.backend
            );
        }
    }
    lines
}

/// Median of the cell's frames, or solves where a frame is one.
pub fn median(cell: &Cell) -> Option<u64> {
    let Summary { p50, .. } = cell.frame_ns;
    p50.or(cell.solve_ns.p50)
}

/// Everything between the assembled matrix and the first solve.
pub fn set_up(cell: &Cell) -> Option<u64> {
    cell.phases_ns.set_up()
}

fn text<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

fn milliseconds(ns: Option<u64>) -> String {
    ns.map_or_else(String::new, numbers::milliseconds)
}

fn scientific(x: Option<f64>) -> String {
    x.map_or_else(String::new, numbers::scientific)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_figures_are_blank() {
        let rows = overview(&[Cell::default()]);
        assert_eq!(rows.rows[0][5..], [""; 7].map(String::from));
        assert!(reasons(&[Cell::default()]).contains("error: no reason given"));
    }
}
