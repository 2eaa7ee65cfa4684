//! The `transfer` workload of a run: template, correspondences, motion, and the frame that is known exactly.

use crate::body::{Body, Build, correspondences, walk};
use crate::engine::array_file::ArrayFile;
use crate::engine::inputs::Inputs;
use crate::engine::motion::Motion;
use crate::engine::protocol::{MeshFiles, Problem};
use crate::engine::source::Source;
use crate::mesh_io::frames::{self, Frames};
use crate::mesh_io::table;
use crate::mesh_source;
use anyhow::{Context, bail};
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::transfer::TransferProblem;
use lapsolve::workload::transfer::defaults::{DEFAULT_MARKS, default_marks, thinned};
use lapsolve::workload::twist::{FRAMES, Twist};
use std::io;
use std::path::Path;

/// A template that moves, and what of the target follows what of it.
#[derive(Debug)]
pub struct Setting {
    /// The template in its reference pose.
    pub template: TriangleMesh,
    /// The target in its reference pose.
    pub target: TriangleMesh,
    /// Corresponding triangles (template, target).
    pub marks: Vec<(u32, u32)>,
    /// How the template moves.
    pub motion: Motion,
}

/// Triangles of the template of a body: that of a captured performer, far coarser than a scan.
const BODY_TEMPLATE: usize = 30_000;

impl Setting {
    /// The setting of `source` (the target) under the overrides.
    ///
    /// # Errors
    /// Files that cannot be read or do not fit.
    pub fn new(source: &Source, target: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        let mut setting = match (&inputs.template, source.body) {
            (Some(template), _) => Self::given(template, target, inputs)?,
            (None, Some(build)) if inputs.frames.is_none() => Self::of_body(build, target),
            (None, _) => Self::own(source, target, inputs)?,
        };
        if let Some(most) = inputs.max_marks {
            setting.marks = thinned(&setting.template, target, &setting.marks, most as usize)?;
        }
        Ok(setting)
    }

    /// The template in the frame by which answers are held against the reference.
    pub fn checked_pose(&self) -> Vec<[f64; 3]> {
        let mut pose = self.template.positions().to_vec();
        self.motion.write(self.motion.checked_frame(), &mut pose);
        pose
    }

    /// Checks the marks and assembles L.
    ///
    /// # Errors
    /// A mark that does not exist or has no area.
    pub fn problem(&self) -> anyhow::Result<TransferProblem> {
        Ok(TransferProblem::new(&self.template, self.target.clone(), &self.marks, Weights::Plain)?)
    }

    fn given(template: &str, target: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        let template = mesh_source::load(template)?.mesh;
        let limits = [template.triangles().len(), target.triangles().len()];
        let marks = match &inputs.correspondences {
            Some(path) => table::read_pairs(path, limits)?.into_iter().map(|[p, t]| (p, t)).collect(),
            None if limits[0] == limits[1] => default_marks(target),
            None => bail!(
                "--template has {} triangles, the mesh {}: give --correspondences",
                limits[0],
                limits[1]
            ),
        };
        let motion = Motion::given(inputs, &template)?.unwrap_or_else(|| Motion::Twist(Twist::of(&template)));
        Ok(Self { template, target: target.clone(), marks, motion })
    }

    /// A mesh that comes alone, or its unsubdivided form, as its own template.
    fn own(source: &Source, target: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        let template = source.unsubdivided.as_ref().unwrap_or(target).clone();
        let motion = Motion::given(inputs, &template)?.unwrap_or_else(|| Motion::Twist(Twist::of(&template)));
        // A child in the middle of its triangle moves as the triangle does.
        let middle = |t: u32| (0..inputs.subdivide).fold(t, |t, _| 4 * t + 3);
        let marks = default_marks(&template).into_iter().map(|(p, t)| (p, middle(t))).collect();
        Ok(Self { template, target: target.clone(), marks, motion })
    }

    /// A generated human follows the walk of the template body.
    fn of_body(build: Build, target: &TriangleMesh) -> Self {
        let triangles = target.triangles().len();
        let template = Body::new(Build::Template, BODY_TEMPLATE.min(triangles));
        let body = Body::new(build, triangles);
        let pairs = correspondences(&template, &body, DEFAULT_MARKS);
        let walk = walk(&template, FRAMES as usize);
        let positions = (0..walk.frames()).flat_map(|k| walk.positions(k)).collect();
        let motion = Motion::Frames(Frames::new(template.mesh.positions().len(), positions));
        let marks = pairs.into_iter().map(|[p, t]| (p, t)).collect();
        Self { template: template.mesh, target: target.clone(), marks, motion }
    }

    /// Writes what children prepare.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, folder: &Path) -> io::Result<Problem> {
        let marks: Vec<u32> = self.marks.iter().flat_map(|&(p, t)| [p, t]).collect();
        Ok(Problem::Transfer {
            target: write_mesh(folder, "target", &self.target)?,
            template: write_mesh(folder, "template", &self.template)?,
            marks: ArrayFile::write(&folder.join("marks.u32"), &marks, 2)?,
        })
    }

    /// Writes frames `first .. first + count` of the motion, one per row.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_frames(&self, path: &Path, first: usize, count: usize) -> io::Result<ArrayFile> {
        let n = self.template.positions().len();
        let mut positions = vec![[0.0; 3]; n * count];
        for (k, frame) in positions.chunks_exact_mut(n).enumerate() {
            self.motion.write(first + k, frame);
        }
        ArrayFile::write(path, positions.as_flattened(), 3 * n)
    }
}

impl Motion {
    fn given(inputs: &Inputs, template: &TriangleMesh) -> anyhow::Result<Option<Self>> {
        let Some(path) = &inputs.frames else { return Ok(None) };
        let frames = frames::read(path, template).context("--frames")?;
        Ok(Some(Motion::Frames(frames)))
    }
}

pub(super) fn write_mesh(folder: &Path, name: &str, mesh: &TriangleMesh) -> io::Result<MeshFiles> {
    let path = |what: &str| folder.join(format!("{name}-{what}"));
    Ok(MeshFiles {
        positions: ArrayFile::write(&path("positions.f64"), mesh.positions().as_flattened(), 3)?,
        triangles: ArrayFile::write(&path("triangles.u32"), mesh.triangles().as_flattened(), 3)?,
    })
}
