//! `matrix`: writes L, M or the system of a workload as MatrixMarket.

use super::Outcome;
use crate::engine::inputs::Inputs;
use crate::engine::source::{Content, Name, Source};
use crate::engine::task;
use crate::engine::workload::Workload;
use crate::exit::Exit;
use crate::mesh_io::matrix_market::{self, Symmetry};
use anyhow::Context;
use clap::ValueEnum;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mass::{self, Mass};
use lapsolve::registry::Entry;
use lapsolve::sparse::SymmetricCsr;
use std::path::PathBuf;

/// Write a matrix of a mesh as MatrixMarket, 17 significant digits
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The mesh
    #[arg(long, value_name = "MESH")]
    mesh: String,
    /// Which matrix: L (positive semi-definite cotangent stiffness), M (lumped Voronoi mass), M-barycentric, or the system of
    /// a workload by its name
    #[arg(long, value_name = "L|M|M-barycentric|WORKLOAD", default_value = "L", value_parser = which)]
    which: Which,
    /// Where it goes
    #[arg(long, value_name = "FILE.mtx")]
    out: PathBuf,
    /// List both triangles
    #[arg(long)]
    general: bool,
    #[command(flatten)]
    inputs: Inputs,
}

#[derive(Clone, Copy, Debug)]
enum Which {
    Stiffness,
    Mass(Mass),
    System(Workload),
}

fn which(text: &str) -> Result<Which, String> {
    match text {
        "L" | "l" => Ok(Which::Stiffness),
        "M" | "m" => Ok(Which::Mass(Mass::Voronoi)),
        "M-barycentric" => Ok(Which::Mass(Mass::Barycentric)),
        name => Workload::from_str(name, true)
            .ok()
            .filter(|w| w.needs_mesh())
            .map(Which::System)
            .ok_or_else(|| "expected L, M, M-barycentric or a workload".to_owned()),
    }
}

/// Writes it.
///
/// # Errors
/// A mesh that cannot be read, a system that is not acceptable, or a place that is not writable.
pub fn run(args: &Args, context: &super::Context) -> Outcome {
    let source = Name::Mesh(args.mesh.clone()).load(args.inputs.subdivide)?;
    let Content::Mesh(mesh) = &source.content else { unreachable!("a mesh was asked for") };
    let matrix = match args.which {
        Which::Stiffness => Laplacian::assemble(mesh, Weights::Plain).into_matrix(),
        Which::Mass(kind) => diagonal(&mass::lumped(mesh, kind))?,
        Which::System(workload) => system(workload, &source, &args.inputs, &context.backends)?,
    };
    let symmetry = if args.general { Symmetry::General } else { Symmetry::Symmetric };
    matrix_market::write(&args.out, &matrix, symmetry)?;
    Ok(Exit::Ok)
}

fn diagonal(entries: &[f64]) -> anyhow::Result<SymmetricCsr> {
    let indices: Vec<u32> = (0..=entries.len() as u32).collect();
    SymmetricCsr::new(indices.clone(), indices[..entries.len()].to_vec(), entries.to_vec())
        .context("a diagonal matrix")
}

fn system(
    workload: Workload,
    source: &Source,
    inputs: &Inputs,
    backends: &[Entry],
) -> anyhow::Result<SymmetricCsr> {
    let equations = task::equations(workload, source, inputs, backends)?;
    let (system, _) = equations.reduced().context("every vertex is constrained: there is no system")?;
    Ok(system.matrix().clone())
}
