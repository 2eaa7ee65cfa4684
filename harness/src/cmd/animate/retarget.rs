//! `animate retarget`: a noisy skeleton motion, cleaned and smoothed, moves a mesh (the depth-camera pipeline).

use super::outputs::{Animation, Made, OutputArgs};
use super::skeleton::SkeletonArgs;
use super::solver::SolverArgs;
use super::statistics;
use crate::animation::angles::{self, Cleaning};
use crate::animation::bvh;
use crate::animation::rig::Rig;
use crate::cmd::{Context, Outcome};
use crate::exit::Exit;
use crate::mesh_source;
use crate::report::rows::Rows;
use crate::vector::Vector;
use anyhow::Context as _;
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::smoothing::{LAMBDA, OutlierRule};
use std::path::PathBuf;
use std::time::Instant;

/// A captured skeleton motion, cleaned and smoothed, moves a mesh
///
/// Windows of frames whose joint angles vary too much are removed and interpolated; all angles are smoothed by one sparse
/// system; bone weights are a heat equilibrium; the mesh follows by linear-blend skinning.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    lapbench animate retarget --mesh woman.ply --motion walk.bvh --out walk.glb --sheet walk.png\n  \
    lapbench animate retarget --mesh body:20000 --motion angles.csv --skeleton camera.bvh --window 5 --save-motion clean.bvh \
    --out frames/")]
pub struct Args {
    /// The mesh that is to move, a standing figure
    #[arg(long, value_name = "MESH")]
    mesh: String,
    /// Joint angles: .bvh, .csv (channels as columns, with --skeleton), .txt (with --parents)
    #[arg(long, value_name = "FILE")]
    motion: PathBuf,
    #[command(flatten)]
    cleaning: CleaningArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    skeleton: SkeletonArgs,
    #[command(flatten)]
    solver: SolverArgs,
}

/// How the motion is cleaned.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Cleaning")]
struct CleaningArgs {
    /// Frames of a window that is judged as one
    #[arg(long, value_name = "N", default_value_t = OutlierRule::default().window as u32, value_parser = clap::value_parser!(u32).range(2..))]
    window: u32,
    /// Largest variance of a window that stays, square degrees, mean over all angles [default: 20 times the median]
    #[arg(long, value_name = "VARIANCE", value_parser = not_negative)]
    threshold: Option<f64>,
    /// Weight of the second difference against the captured angles; 0 leaves them as they are
    #[arg(long, allow_negative_numbers = true, value_name = "LAMBDA", default_value_t = LAMBDA, value_parser = not_negative)]
    lambda: f64,
    /// The cleaned motion as a BVH file
    #[arg(long, value_name = "FILE.bvh")]
    save_motion: Option<PathBuf>,
}

fn not_negative(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x >= 0.0)
        .ok_or("expected a number from 0".to_owned())
}

/// Cleans, skins, writes.
///
/// # Errors
/// What cannot be read, does not fit, cannot be solved or written; nothing half-written is left.
pub fn run(args: &Args, context: &Context) -> Outcome {
    if !args.output.is_wanted() && args.cleaning.save_motion.is_none() {
        eprintln!(
            "error: nothing to make: give --out, --sheet, --preview, --statistics, --plot or --save-motion"
        );
        return Ok(Exit::Usage);
    }
    let backend = args.solver.open(context)?;
    let mesh = mesh_source::load(&args.mesh).context("--mesh")?.mesh;
    let mut clip = args.skeleton.read(&args.motion)?;
    let rule = OutlierRule { window: args.cleaning.window as usize, threshold: args.cleaning.threshold };
    let cleaning = angles::clean(&mut clip, &rule, args.cleaning.lambda, &*backend)
        .with_context(|| args.motion.display().to_string())?;
    let mut rows = Rows::new(["figure", "value"]);
    describe(&cleaning, clip.len(), &mut rows);
    if let Some(path) = &args.cleaning.save_motion {
        bvh::write(path, &clip)?;
    }
    if args.output.is_wanted() {
        let rate = 1.0 / clip.frame_time;
        let rig = args.skeleton.rig(&mesh, clip, args.output.up_axis(), &*backend)?;
        let mut skinned = Skinned { mesh, rig, every: args.output.every as usize };
        let made = args.output.write(&mut skinned, Some(rate))?;
        statistics::summary(&made, &mut rows);
    }
    args.output.print(&rows)?;
    Ok(Exit::Ok)
}

fn describe(cleaning: &Cleaning, frames: usize, rows: &mut Rows) {
    let removed = cleaning.outliers.frames();
    rows.push(["frames captured", &frames.to_string()]);
    let windows: Vec<String> =
        cleaning.outliers.removed.iter().map(|w| format!("{} to {}", w.start, w.end - 1)).collect();
    const SHOWN: usize = 8;
    let more = windows.len().saturating_sub(SHOWN);
    let list = windows[..windows.len() - more].join(", ");
    let list = if more > 0 { format!("{list} and {more} more") } else { list };
    let text = if removed == 0 { "none".to_owned() } else { format!("{removed} frames: {list}") };
    rows.push(["removed as outliers", &text]);
    rows.push(["variance allowed", &format!("{:.3} square degrees", cleaning.outliers.threshold)]);
    let [captured, cleaned, smooth] = cleaning.roughness;
    let text =
        format!("{captured:.4} captured, {cleaned:.4} without outliers, {smooth:.4} smoothed (degrees)");
    rows.push(["second differences", &text]);
}

/// A mesh that follows its skeleton.
struct Skinned {
    mesh: TriangleMesh,
    rig: Rig,
    every: usize,
}

impl Animation for Skinned {
    fn frames(&self) -> usize {
        self.rig.clip().len().div_ceil(self.every)
    }

    fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    fn template(&self) -> Option<&TriangleMesh> {
        None
    }

    fn template_pose(&self) -> &[Vector] {
        &[]
    }

    fn make(&mut self, k: usize, positions: &mut [Vector]) -> anyhow::Result<Made> {
        let begin = Instant::now();
        self.rig.write(k * self.every, positions);
        Ok(Made { latency_ns: begin.elapsed().as_nanos() as u64, ..Made::default() })
    }
}
