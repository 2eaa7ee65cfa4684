//! `kharmonic`: the table of a public benchmark of sparse solvers, for our backends and the peers, on any mesh.
//!
//! The benchmark (github.com/alecjacobson/sparse-solver-benchmark) solves (W_k + M) u = M x, 3 columns, for k = 1, 2, 3 and
//! prints seconds to factor, seconds to solve, and the residual. Here every answer is checked, and the residual is the
//! componentwise backward error, which can be read as right or wrong whatever the scale of the mesh.

use super::output::{self, Format};
use super::run::{choice, recorder::Recorder, verdict};
use super::{Context, Outcome};
use crate::engine::inputs::Inputs;
use crate::engine::plan::Plan;
use crate::engine::settings::Settings;
use crate::engine::solver::Peer;
use crate::engine::workload::Workload;
use crate::peers;
use crate::record;
use crate::record::names::Status;
use crate::record::result::Cell;
use crate::report::numbers::{scientific, significant};
use crate::report::rows::Rows;
use std::path::PathBuf;

/// Print the k-harmonic benchmark table: factor, solve, backward error for k = 1, 2, 3
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Meshes: files or generated ones
    #[arg(long, value_name = "MESH", value_delimiter = ',', default_value = "body:50000")]
    mesh: Vec<String>,
    /// Backends or peers [default: our direct solvers in f64 and every peer that is installed]
    #[arg(long, value_name = "ID", value_delimiter = ',')]
    backend: Vec<String>,
    /// A foreign solver as NAME=COMMAND; may be repeated
    #[arg(long, value_name = "NAME=COMMAND")]
    peer: Vec<Peer>,
    /// Thread counts [default: all cores]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Vec<u16>,
    /// Seconds of steady solves per cell
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = super::run::positive)]
    cell_time: f64,
    /// Seconds to wait for one answer of a cell
    #[arg(long, value_name = "S", default_value_t = 120.0, value_parser = super::run::positive)]
    cell_timeout: f64,
    /// Where the result goes; rows are written as they are made
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

const WORKLOADS: [Workload; 3] = [Workload::Kharmonic1, Workload::Kharmonic2, Workload::Kharmonic3];

/// Our direct solvers in f64 that are meant for systems of this size.
const BACKENDS: [&str; 3] = ["framechol-f64", "faer-llt", "faer-simplicial"];

/// Measures and prints.
///
/// # Errors
/// Where the result cannot be written or there is no place for temporary files.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let ids = if args.backend.is_empty() { default_solvers(context) } else { args.backend.clone() };
    let solvers = match choice::solvers(&ids, &args.peer, false, context) {
        Ok(solvers) => solvers,
        Err(unknown) => return Ok(context.unknown_backend(&unknown)),
    };
    let seconds = std::time::Duration::from_secs_f64;
    let plan = Plan {
        sources: choice::sources(&args.mesh, &[]),
        workloads: WORKLOADS.to_vec(),
        solvers,
        threads: choice::threads(&args.threads),
        inputs: Inputs { tau: lapsolve::workload::screened::DEFAULT_TAU, ..Inputs::default() },
        settings: Settings {
            cell_time: seconds(args.cell_time),
            cell_timeout: seconds(args.cell_timeout),
            rates: Vec::new(),
            columns: Vec::new(),
            ..Settings::default()
        },
        shard: None,
    };
    let mut recorder = Recorder::new(args.out.as_ref(), false)?;
    recorder.save()?;
    plan.execute(&context.backends, &|_| false, &mut recorder)?;
    let (result, written) = recorder.finish(None);
    output::print(&match args.format {
        Format::Json => record::file::text(&result),
        format => table(&result.cells).render(format),
    })?;
    eprint!("{}", crate::report::table::reasons(&result.cells));
    written?;
    Ok(verdict::of_statuses(&result.cells))
}

/// Ours, and the peers that are there; iterative ones are not what the benchmark is about.
fn default_solvers(context: &Context) -> Vec<String> {
    let ours = BACKENDS.iter().filter(|id| context.backend(id).is_some()).map(|id| (*id).to_owned());
    let direct = |id: &str| {
        !id.contains("-cg") && !id.starts_with("pyamg") && !id.ends_with("-f32") && id != "igl-harmonic"
    };
    let theirs = peers::catalogue().into_iter().filter(|peer| peer.command().is_ok() && direct(&peer.id));
    ours.chain(theirs.map(|peer| peer.id)).collect()
}

/// One row per mesh, solver and thread count, three figures per k: seconds to factor, seconds to solve, backward error.
fn table(cells: &[Cell]) -> Rows {
    let mut rows = Rows::new([
        "mesh",
        "solver",
        "thr",
        "k=1 factor s",
        "solve s",
        "error",
        "k=2 factor s",
        "solve s",
        "error",
        "k=3 factor s",
        "solve s",
        "error",
    ]);
    let mut seen: Vec<(&str, &str, usize)> = Vec::new();
    for cell in cells {
        let key = (cell.mesh.name.as_str(), cell.backend.as_str(), cell.threads);
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let of = |workload: Workload| {
            let same = |c: &&Cell| (c.mesh.name.as_str(), c.backend.as_str(), c.threads) == key;
            figures(cells.iter().filter(same).find(|c| c.workload == workload.name()))
        };
        let [a, b, c] = WORKLOADS.map(of);
        let threads = cell.threads.to_string();
        rows.push([key.0, key.1, &threads, &a[0], &a[1], &a[2], &b[0], &b[1], &b[2], &c[0], &c[1], &c[2]]);
    }
    rows
}

/// Factor (order, symbolic and numeric together), solve, componentwise backward error; of a cell that is not ok, its status.
fn figures(cell: Option<&Cell>) -> [String; 3] {
    match cell {
        None => [String::new(), String::new(), String::new()],
        Some(cell) if cell.status != Status::Ok => {
            [cell.status.name().replace('_', " "), String::new(), String::new()]
        }
        Some(cell) => {
            let seconds = |ns: Option<u64>| ns.map_or_else(String::new, |ns| significant(ns as f64 * 1e-9));
            let error = cell.accuracy.componentwise.map_or_else(String::new, scientific);
            [seconds(cell.phases_ns.set_up()), seconds(cell.solve_ns.p50), error]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::result::{Phases, Summary};

    #[test]
    fn one_row_per_solver_three_figures_per_k() {
        let cell = |workload: Workload, status| Cell {
            workload: workload.name().into(),
            backend: "a".into(),
            status,
            phases_ns: Phases { numeric: Some(1_500_000_000), ..Phases::default() },
            solve_ns: Summary::of(&[2_000_000]),
            ..Cell::default()
        };
        let cells =
            [cell(Workload::Kharmonic1, Status::Ok), cell(Workload::Kharmonic2, Status::NotConverged)];
        let rows = table(&cells);
        assert_eq!(
            rows.rows,
            [["", "a", "0", "1.50", "0.00200", "", "not converged", "", "", "", "", ""].map(String::from)]
        );
    }
}
