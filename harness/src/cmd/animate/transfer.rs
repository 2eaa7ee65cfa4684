//! `animate transfer`: the motion of a template drives a target (video-driven animation).

use super::frames::{Extras, Frames};
use super::keep_volume::Wanted;
use super::outputs::{Animation, Made, OutputArgs, rate};
use super::skeleton::SkeletonArgs;
use super::solver::SolverArgs;
use super::statistics;
use super::template::{Template, generated};
use crate::animation::correspondences::{self, Pair, Proposal};
use crate::body::{self, Body};
use crate::cmd::{Context, Outcome};
use crate::engine::child::open_loop;
use crate::exit::Exit;
use crate::mesh_io::table;
use crate::mesh_source;
use crate::report::rows::Rows;
use crate::statistics::percentiles;
use crate::vector::Vector;
use anyhow::{Context as _, bail};
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{distance_squared, norm};
use lapsolve::workload::transfer::TransferProblem;
use lapsolve::workload::transfer::defaults::{DEFAULT_MARKS, default_marks, thinned};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The motion of a template mesh drives a target mesh
///
/// Marked triangles of the target turn as the corresponding triangles of the template; between the marks rotations are a
/// harmonic field, and the surface is the one whose details fit them best (de Aguiar et al. 2007).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    lapbench animate transfer --template body-template:30000 --target body:294000 --out walk.glb\n  \
    lapbench animate transfer --template t.ply --frames walk.bvh --target scan.ply --correspondences c.csv --out walk.glb\n  \
    lapbench animate transfer --template t.ply --frames poses.npy --target scan.ply --correspondences c.csv --out frames/ \
    --sheet sheet.png --statistics figures.csv --plot figures.svg\n\
    Without --correspondences pairs are proposed and written beside the result, for you to edit.")]
pub struct Args {
    /// The template in its reference pose: a mesh, a generated one, or an animated glTF file
    #[arg(long, value_name = "MESH")]
    template: String,
    /// Its motion: a folder of meshes, poses (frames x vertices x 3), an animated glTF, or a skeleton motion
    #[arg(long, value_name = "FOLDER|FILE.npy|FILE.glb|FILE.bvh")]
    frames: Option<PathBuf>,
    /// The mesh that is to move
    #[arg(long, value_name = "MESH")]
    target: String,
    #[command(flatten)]
    marks: MarkArgs,
    /// Iterations of as-rigid-as-possible deformation on top of every frame: fewer edges are stretched or squeezed
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1000))]
    arap: u32,
    /// Move the surface along its smoothed normals, by as much everywhere, until it encloses the volume at rest, times what
    /// the template's volume has become in that frame (`rest`: times 1)
    #[arg(long, value_name = "template|rest", value_enum, num_args = 0..=1, require_equals = true,
          default_missing_value = "template")]
    keep_volume: Option<Wanted>,
    /// Start a frame HZ times a second, on a schedule, and say how many were late
    #[arg(long, value_name = "HZ", value_parser = rate)]
    play: Option<f64>,
    /// Frames of --play; the motion begins anew where it ends [default: one pass of the motion]
    #[arg(long, value_name = "N", requires = "play", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    play_frames: Option<u32>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    skeleton: SkeletonArgs,
    #[command(flatten)]
    solver: SolverArgs,
}

/// What of the target follows what of the template.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Correspondences")]
struct MarkArgs {
    /// Corresponding triangles, rows `template, target`
    #[arg(long, value_name = "FILE.csv")]
    correspondences: Option<PathBuf>,
    /// The rows of --correspondences are vertices
    #[arg(long, requires = "correspondences")]
    vertices: bool,
    /// Most correspondences that are used, spread over the target
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_marks: Option<u32>,
    /// Where the correspondences in use are written [default: beside --out, where they were proposed]
    #[arg(long, value_name = "FILE.csv")]
    save_correspondences: Option<PathBuf>,
    /// Parts of the target without a correspondence: an error, or they follow the nearest marked vertex rigidly
    #[arg(long, value_name = "error|follow", value_enum, default_value_t)]
    loose: Loose,
}

/// What becomes of components without a mark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Loose {
    /// An error that names them.
    #[default]
    Error,
    /// They follow the nearest vertex of a marked component rigidly.
    Follow,
}

/// Moves the target.
///
/// # Errors
/// What cannot be read, does not fit, cannot be solved or written; nothing half-written is left.
pub fn run(args: &Args, context: &Context) -> Outcome {
    if !args.output.is_wanted() && args.play.is_none() {
        eprintln!("error: nothing to make: give --out, --sheet, --preview, --statistics, --plot or --play");
        return Ok(Exit::Usage);
    }
    let backend = args.solver.open(context)?;
    let target_body = generated(&args.target).map(|(build, triangles)| Body::new(build, triangles));
    let target = match &target_body {
        Some(body) => body.mesh.clone(),
        None => mesh_source::load(&args.target).context("--target")?.mesh,
    };
    let template =
        Template::new(&args.template, args.frames.as_deref(), &args.skeleton, &args.output, &*backend)?;
    let pairs = args.pairs(&template, &target, target_body.as_ref())?;
    let problem = TransferProblem::new(&template.mesh, target, &pairs, Weights::Plain)?;
    args.refuse_loose_parts(&problem)?;
    let mut rows = Rows::new(["figure", "value"]);
    describe(&problem, &mut rows);
    let begin = Instant::now();
    let frames = Frames::prepare(&*backend, &problem, &template.mesh, args.extras())?;
    rows.push(["set-up", &format!("{:.0} ms", begin.elapsed().as_secs_f64() * 1e3)]);
    let rate = template.rate;
    let pose = template.mesh.positions().to_vec();
    let mut moving = Moving { template, problem, frames, pose };
    if args.output.is_wanted() {
        let made = args.output.write(&mut moving, rate)?;
        statistics::summary(&made, &mut rows);
    }
    if let Some(hz) = args.play {
        play(&mut moving, hz, args.play_frames, &mut rows)?;
    }
    args.output.print(&rows)?;
    Ok(Exit::Ok)
}

impl Args {
    fn extras(&self) -> Extras {
        Extras { arap: self.arap, volume: self.keep_volume, threads: self.solver.threads() }
    }

    /// The correspondences: given, known, or proposed and written down.
    fn pairs(
        &self,
        template: &Template,
        target: &TriangleMesh,
        body: Option<&Body>,
    ) -> anyhow::Result<Vec<Pair>> {
        let limits = [template.mesh.triangles().len(), target.triangles().len()];
        let most = self.marks.max_marks.map(|most| most as usize);
        let mut proposed = false;
        let pairs: Vec<Pair> = match (&self.marks.correspondences, &template.body, body) {
            (Some(path), ..) if self.marks.vertices => {
                correspondences::read_vertex_pairs(path, &template.mesh, target)?
            }
            (Some(path), ..) => table::read_pairs(path, limits)?.into_iter().map(|[p, t]| (p, t)).collect(),
            (None, Some(from), Some(to)) => {
                let pairs = body::correspondences(from, to, most.unwrap_or(DEFAULT_MARKS));
                pairs.into_iter().map(|[p, t]| (p, t)).collect()
            }
            (None, ..) if template.mesh.triangles() == target.triangles() => default_marks(target),
            (None, ..) => {
                proposed = true;
                self.propose(&template.mesh, target, most.unwrap_or(DEFAULT_MARKS))?
            }
        };
        let used = match most {
            Some(most) if pairs.len() > most => thinned(&template.mesh, target, &pairs, most)?,
            _ => pairs,
        };
        let beside = || Some(self.output.out.as_ref()?.with_extension("correspondences.csv"));
        let place =
            self.marks.save_correspondences.clone().or_else(|| if proposed { beside() } else { None });
        if let Some(path) = place {
            table::write_pairs(&path, "template,target", &used)?;
            eprintln!(
                "{}: {} correspondences; edit them and give them as --correspondences",
                path.display(),
                used.len()
            );
        }
        Ok(used)
    }

    fn propose(
        &self,
        template: &TriangleMesh,
        target: &TriangleMesh,
        most: usize,
    ) -> anyhow::Result<Vec<Pair>> {
        let Proposal { pairs, distance } = correspondences::propose(template, target, most);
        if pairs.len() < 3 {
            bail!(
                "template and target do not lie over each other well enough to propose correspondences ({} found); \
                 give --correspondences (rows `template triangle, target triangle`)",
                pairs.len()
            );
        }
        eprintln!(
            "proposed {} of {most} correspondences, {:.1} % of the diagonal apart after alignment; look at the result \
             before you trust them",
            pairs.len(),
            100.0 * distance
        );
        Ok(pairs)
    }

    fn refuse_loose_parts(&self, problem: &TransferProblem) -> anyhow::Result<()> {
        let loose = problem.pieces().detached();
        let Some(first) = loose.first() else { return Ok(()) };
        let (count, vertex, size) = (loose.len(), first.vertices[0], first.vertices.len());
        let what = format!(
            "{count} component(s) of the target have no correspondence, the first one with vertex {vertex} ({size} vertices)"
        );
        match self.marks.loose {
            Loose::Error => bail!(
                "{what}; mark a triangle on each, or give `--loose follow` and they follow the nearest marked vertex rigidly"
            ),
            Loose::Follow => eprintln!("{what}: they follow the nearest marked vertex rigidly"),
        }
        Ok(())
    }
}

/// Marks and alignment.
fn describe(problem: &TransferProblem, rows: &mut Rows) {
    let marks = problem.marks();
    let (target, alignment) = (problem.target(), marks.alignment());
    rows.push([
        "target",
        &format!("{} triangles, {} vertices", target.triangles().len(), target.positions().len()),
    ]);
    rows.push(["correspondences", &marks.all().len().to_string()]);
    let [w, x, y, z] = alignment.rotation;
    let angle = 2.0 * norm([x, y, z]).atan2(w.abs()).to_degrees();
    let [a, b, c] = alignment.translation;
    let text = format!(
        "turned by {angle:.1} degrees, scaled by {:.4}, moved by ({a:.4}, {b:.4}, {c:.4})",
        alignment.scale
    );
    rows.push(["alignment of the template", &text]);
    let squares: f64 = marks.all().iter().map(|mark| distance_squared(mark.offset, [0.0; 3])).sum();
    let off = (squares / marks.all().len() as f64).sqrt() / target.diagonal();
    rows.push([
        "marks after alignment",
        &format!("{:.2} % of the diagonal apart (root mean square)", 100.0 * off),
    ]);
    const ROUGH: f64 = 0.15; // of the diagonal: half a limb
    if off > ROUGH {
        eprintln!(
            "the reference poses differ by {:.0} % of the diagonal at the marks: are the columns in order?",
            100.0 * off
        );
    }
}

/// A template, a target, and the frames between them.
struct Moving {
    template: Template,
    problem: TransferProblem,
    frames: Frames,
    pose: Vec<Vector>,
}

impl Animation for Moving {
    fn frames(&self) -> usize {
        self.template.frames()
    }

    fn mesh(&self) -> &TriangleMesh {
        self.problem.target()
    }

    fn template(&self) -> Option<&TriangleMesh> {
        Some(&self.template.mesh)
    }

    fn template_pose(&self) -> &[Vector] {
        &self.pose
    }

    fn make(&mut self, k: usize, positions: &mut [Vector]) -> anyhow::Result<Made> {
        self.template.write(k, &mut self.pose);
        let begin = Instant::now();
        self.frames.frame(&self.pose, positions)?;
        let latency_ns = begin.elapsed().as_nanos() as u64;
        Ok(Made { latency_ns, replaced: self.frames.replaced(), kept: self.frames.kept() })
    }
}

/// Most bytes of template poses kept ready for a schedule; longer motions are shortened.
const READY: usize = 1 << 30;

/// Frames on a schedule: what counts is the time from the scheduled start, so that a stall delays the frames behind it too.
/// Poses of the template are in memory beforehand: they come from a camera in a live system.
fn play(moving: &mut Moving, hz: f64, wanted: Option<u32>, rows: &mut Rows) -> anyhow::Result<()> {
    const WARM: usize = 3;
    let size = size_of_val(&moving.pose[..]).max(1);
    let ready = moving.frames().min((READY / size).max(2));
    let poses: Vec<Vec<Vector>> = (0..ready)
        .map(|k| {
            moving.template.write(k, &mut moving.pose);
            moving.pose.clone()
        })
        .collect();
    let count = wanted.unwrap_or(moving.frames() as u32);
    let mut target = moving.problem.target().positions().to_vec();
    for pose in poses.iter().cycle().take(WARM) {
        moving.frames.frame(pose, &mut target)?;
    }
    let mut poses = poses.iter().cycle();
    let limit = Duration::from_secs_f64(10.0 + 4.0 * f64::from(count) / hz);
    let mut latencies = open_loop::latencies(hz, count, limit, || {
        moving.frames.frame(poses.next().expect("a cycle"), &mut target).map(|_| ())
    })?;
    let period = 1e9 / hz;
    let late = latencies.iter().filter(|&&ns| ns as f64 > period).count();
    latencies.sort_unstable();
    let ms = |ns: Option<u64>| ns.map_or_else(String::new, |ns| format!("{:.2}", ns as f64 * 1e-6));
    let (median, slowest) = (ms(percentiles::median(&latencies)), ms(latencies.last().copied()));
    let text = format!(
        "{late} of {} frames late; latency {median} ms (median), {slowest} ms (slowest), allowed {:.2} ms",
        latencies.len(),
        period * 1e-6
    );
    rows.push([&format!("at {hz} Hz"), &text]);
    Ok(())
}
