//! What a run solves when more is given than a mesh.

use std::path::PathBuf;

/// Overrides of the default inputs; all optional.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Inputs")]
pub struct Inputs {
    /// Constraints of `harmonic`: rows `vertex, g_1 .. g_k`; handles of `arap`: rows `vertex, x, y, z`
    #[arg(long, value_name = "FILE.csv", visible_alias = "handles")]
    pub constraints: Option<PathBuf>,
    /// Right-hand side of system workloads, one row per vertex
    #[arg(long, value_name = "FILE.npy")]
    pub rhs: Option<PathBuf>,
    /// Columns of the default right-hand side
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub columns: Option<u32>,
    /// Template of `transfer` in its reference pose [default: the mesh itself before subdivision]
    #[arg(long, value_name = "MESH")]
    pub template: Option<String>,
    /// Motion of the template: frames x vertices x 3, or a folder of meshes [default: a twist; for bodies a walk]
    #[arg(long, value_name = "FILE.npy|FOLDER")]
    pub frames: Option<PathBuf>,
    /// Corresponding triangles of `transfer`: rows `template, target`
    #[arg(long, value_name = "FILE.csv", requires = "template")]
    pub correspondences: Option<PathBuf>,
    /// Most correspondences that are used, spread over the target
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub max_marks: Option<u32>,
    /// tau of `screened`: 1e-4 is nearly the mass matrix, 1e6 nearly the singular Laplacian
    #[arg(long, value_name = "TAU", allow_negative_numbers = true, default_value_t = lapsolve::workload::screened::DEFAULT_TAU)]
    pub tau: f64,
    /// Bones of `skinning`, one segment per row: `x1, y1, z1, x2, y2, z2` [default: 22 segments; of bodies their own bones]
    #[arg(long, value_name = "FILE.csv")]
    pub bones: Option<PathBuf>,
    /// Strength of the heat of `skinning`; large: every vertex follows its nearest bone alone
    #[arg(long, value_name = "C", allow_negative_numbers = true, default_value_t = lapsolve::workload::skinning::HEAT)]
    pub heat: f64,
    /// lambda of `smoothing`, the weight of second differences
    #[arg(long, value_name = "LAMBDA", allow_negative_numbers = true, default_value_t = lapsolve::workload::smoothing::LAMBDA)]
    pub lambda: f64,
    /// Iterations of `arap`
    #[arg(long, value_name = "N", default_value_t = lapsolve::workload::arap::ITERATIONS, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    pub iterations: u32,
    /// Sources of `geodesic`: one vertex per row [default: the smallest (x, y, z) of every component]
    #[arg(long, value_name = "FILE.csv")]
    pub sources: Option<PathBuf>,
    /// Loop subdivision of every mesh, N times
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=6))]
    pub subdivide: u32,
}
