//! The template: a mesh that moves, by what is known of it.

use super::outputs::OutputArgs;
use super::skeleton::SkeletonArgs;
use crate::animation::rig::Rig;
use crate::body::{Body, Build, walk};
use crate::mesh_io::frames::{self, Frames};
use crate::mesh_io::{self, Format};
use crate::mesh_source;
use anyhow::{Context, bail};
use lapsolve::backend::Backend;
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::Vector;
use std::path::Path;

/// A mesh and its motion.
pub struct Template {
    /// The reference pose.
    pub mesh: TriangleMesh,
    /// Which generated human it is, if one.
    pub body: Option<Body>,
    motion: Motion,
    every: usize,
    /// Frames per second of the whole motion, if it says.
    pub rate: Option<f64>,
}

enum Motion {
    Frames(Frames),
    Rig(Box<Rig>),
}

/// Frames of a generated human's walk: the length of the first sequence of the paper.
const WALK: usize = 156;

impl Template {
    /// Loads `name` and the motion in `frames`: a folder or array of poses, an animated glTF file, or a skeleton motion. A
    /// generated human walks and a glTF file plays its own animation where no motion is given.
    ///
    /// # Errors
    /// A motion that cannot be read, does not fit the mesh, or is missing.
    pub fn new(
        name: &str,
        frames: Option<&Path>,
        skeleton: &SkeletonArgs,
        output: &OutputArgs,
        backend: &dyn Backend,
    ) -> anyhow::Result<Self> {
        let (mesh, body) = match generated(name) {
            Some((build, triangles)) => {
                let body = Body::new(build, triangles);
                (body.mesh.clone(), Some(body))
            }
            None => (mesh_source::load(name).context("--template")?.mesh, None),
        };
        let every = output.every as usize;
        let (motion, rate) = match frames {
            Some(path) if SkeletonArgs::is_motion(path) => {
                let clip = skeleton.read(path)?;
                let rate = Some(1.0 / clip.frame_time);
                (Motion::Rig(Box::new(skeleton.rig(&mesh, clip, output.up_axis(), backend)?)), rate)
            }
            Some(path) if Format::of_extension(path) == Some(Format::Gltf) && !path.is_dir() => {
                let (frames, rate) = mesh_io::read_animation(path, &mesh)?;
                (Motion::Frames(frames), Some(rate))
            }
            Some(path) => (Motion::Frames(frames::read(path, &mesh).context("--frames")?), None),
            None => match &body {
                Some(body) => {
                    let walk = walk(body, WALK);
                    let positions = (0..walk.frames()).flat_map(|k| walk.positions(k)).collect();
                    (Motion::Frames(Frames::new(mesh.positions().len(), positions)), Some(30.0))
                }
                None if Format::of_extension(Path::new(name)) == Some(Format::Gltf) => {
                    let (frames, rate) = mesh_io::read_animation(Path::new(name), &mesh)?;
                    (Motion::Frames(frames), Some(rate))
                }
                None => bail!(
                    "how does the template move? Give --frames: a folder of meshes, a .npy array (frames x vertices \
                     x 3), an animated .glb, or a skeleton motion (.bvh)"
                ),
            },
        };
        Ok(Self { mesh, body, motion, every, rate })
    }

    /// Number of frames taken.
    pub fn frames(&self) -> usize {
        let all = match &self.motion {
            Motion::Frames(frames) => frames.len(),
            Motion::Rig(rig) => rig.clip().len(),
        };
        all.div_ceil(self.every)
    }

    /// Positions of all vertices in frame `k` of those taken.
    pub fn write(&mut self, k: usize, positions: &mut [Vector]) {
        match &mut self.motion {
            Motion::Frames(frames) => positions.copy_from_slice(frames.frame(k * self.every)),
            Motion::Rig(rig) => rig.write(k * self.every, positions),
        }
    }
}

/// The generated human that `name` asks for, if it is one and its size is allowed.
pub fn generated(name: &str) -> Option<(Build, usize)> {
    let (kind, number) = name.split_once(':')?;
    let build = match kind {
        "body" => Build::Male,
        "body-female" => Build::Female,
        "body-template" => Build::Template,
        _ => return None,
    };
    Some((build, number.parse().ok().filter(|n| crate::body::TRIANGLES.contains(n))?))
}
