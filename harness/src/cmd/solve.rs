//! `solve`: one workload on one mesh with one backend; checks the solution and writes it.

use super::{Context, Outcome};
use crate::engine::inputs::Inputs;
use crate::engine::settings::Settings;
use crate::engine::single;
use crate::engine::solver::Solver;
use crate::engine::source::Name;
use crate::engine::task::Task;
use crate::engine::workload::Workload;
use crate::engine::workspace::Workspace;
use crate::exit::Exit;
use crate::mesh_io::{npy, table};
use crate::record::names::Status;
use anyhow::bail;
use std::path::{Path, PathBuf};

/// Solve one workload on one mesh and write the solution, one row per vertex
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The mesh
    #[arg(long, value_name = "MESH", required_unless_present_any = ["matrix", "angles"])]
    mesh: Option<String>,
    /// An SPD matrix instead of a mesh, MatrixMarket
    #[arg(long, value_name = "FILE.mtx", conflicts_with = "mesh")]
    matrix: Option<String>,
    /// Joint angles instead of a mesh, for `smoothing`: one row per frame, without jumps by whole turns
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["mesh", "matrix"])]
    angles: Option<String>,
    /// The workload; a matrix and a table of angles have their own
    #[arg(long, value_name = "WORKLOAD", value_enum, default_value_t = Workload::Harmonic)]
    workload: Workload,
    /// The backend
    #[arg(long, value_name = "ID")]
    backend: String,
    /// Threads of a solve
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: u16,
    /// Relative residual asked of iterative backends
    #[arg(long, value_name = "TOL", default_value_t = lapsolve::limits::DEFAULT_TOLERANCE)]
    tol: f64,
    /// Vulkan device: index or part of its name
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Where the solution goes: .csv (k numbers a row, no header) or .npy (n x k, float64)
    #[arg(long, value_name = "FILE.csv|FILE.npy")]
    out: PathBuf,
    #[command(flatten)]
    inputs: Inputs,
}

/// Solves, checks, writes.
///
/// # Errors
/// What cannot be read, prepared, solved or written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let Some(entry) = context.backend(&args.backend) else {
        return Ok(context.unknown_backend(&args.backend));
    };
    let (name, workload) = match (&args.mesh, &args.matrix, &args.angles) {
        (_, Some(matrix), _) => (Name::Matrix(matrix.clone()), Workload::Matrix),
        (.., Some(angles)) => (Name::Sequence(angles.clone()), Workload::Smoothing),
        (mesh, None, None) => (Name::Mesh(mesh.clone().unwrap_or_default()), args.workload),
    };
    let workspace = Workspace::new()?;
    let source = name.load(args.inputs.subdivide)?;
    let task = Task::new(workload, &source, &args.inputs, &context.backends, workspace.folder("task")?)?;
    let settings = Settings { tolerance: args.tol, device: args.device.clone(), ..Settings::default() };
    let solver = Solver::BuiltIn(*entry);
    let (cell, solution) = single::solve(&task, &source, &solver, usize::from(args.threads), &settings);
    let accuracy = &cell.accuracy;
    if let (Some(eta), Some(omega)) = (accuracy.backward_error, accuracy.componentwise) {
        eprintln!("backward error {eta:.1e} (componentwise {omega:.1e})");
    }
    let reason = cell.reason.unwrap_or_default();
    match (cell.status, solution) {
        (Status::Ok, Some(x)) => {
            write(&args.out, &task.on_vertices(x), task.columns())?;
            Ok(Exit::Ok)
        }
        (Status::Invalid, _) => {
            eprintln!("{}: wrong answer, not written: {reason}", args.backend);
            Ok(Exit::Invalid)
        }
        (status, _) => bail!("{}: {status}: {reason}", args.backend),
    }
}

fn write(path: &Path, x: &[f64], k: usize) -> anyhow::Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        npy::write_columns(path, x, k)?;
    } else {
        table::write_columns(path, x, k)?;
    }
    Ok(())
}
