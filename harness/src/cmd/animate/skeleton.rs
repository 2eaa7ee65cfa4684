//! Skeleton motions from files, and how they get into a mesh.

use crate::animation::clip::{Channel, Clip, Joint};
use crate::animation::fit::Fitted;
use crate::animation::limbs::Figure;
use crate::animation::rig::{Rig, Root};
use crate::animation::{bvh, joints};
use crate::file::Fault;
use crate::mesh_io::table;
use anyhow::{Context, bail};
use lapsolve::backend::Backend;
use lapsolve::mesh::TriangleMesh;
use std::path::{Path, PathBuf};

/// How a skeleton gets into a mesh.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Skeleton")]
pub struct SkeletonArgs {
    /// Places of the joints in the mesh, rows `name, x, y, z` [default: found in a standing human figure]
    #[arg(long, value_name = "FILE.csv")]
    pub joints: Option<PathBuf>,
    /// Write the places of the joints, to be edited and given as --joints
    #[arg(long, value_name = "FILE.csv")]
    pub save_joints: Option<PathBuf>,
    /// Leave out how the figure moves over the ground
    #[arg(long)]
    pub in_place: bool,
    /// Parents of the joints of a .txt motion (rotation vector and translation of every joint), from the root's -1 on
    #[arg(long, value_name = "-1,0,1,..", allow_hyphen_values = true, value_delimiter = ',')]
    pub parents: Vec<i64>,
    /// Hierarchy of a .csv motion: a BVH file, whose own frames are left aside
    #[arg(long, value_name = "FILE.bvh")]
    pub skeleton: Option<PathBuf>,
}

impl SkeletonArgs {
    /// Whether `path` is a skeleton motion by its extension.
    pub fn is_motion(path: &Path) -> bool {
        let extension = path.extension().map(|e| e.to_ascii_lowercase());
        extension.is_some_and(|e| e == "bvh" || e == "csv" || e == "txt")
    }

    /// Reads a motion: `.bvh`, `.csv` (one row of channel values per frame, with --skeleton), `.txt` (with --parents).
    ///
    /// # Errors
    /// What the file lacks, naming the line.
    pub fn read(&self, path: &Path) -> anyhow::Result<Clip> {
        let extension = path.extension().map(|e| e.to_ascii_lowercase()).unwrap_or_default();
        if extension == "csv" {
            let Some(skeleton) = &self.skeleton else {
                bail!("{}: angles alone have no bones; give --skeleton FILE.bvh", path.display());
            };
            return Ok(angles(path, bvh::read(skeleton)?)?);
        }
        if extension == "txt" {
            return Ok(rotation_vectors(path, &self.parents)?);
        }
        Ok(bvh::read(path)?)
    }

    /// Puts the skeleton of `clip` into `mesh` and computes its weights.
    ///
    /// # Errors
    /// A mesh in which no figure is found, joints that are not named, weights that cannot be solved for.
    pub fn rig(
        &self,
        mesh: &TriangleMesh,
        clip: Clip,
        up: usize,
        backend: &dyn Backend,
    ) -> anyhow::Result<Rig> {
        let fitted = match &self.joints {
            Some(path) => Fitted::given(&clip, &joints::read(path, &clip)?, up),
            None => {
                let help =
                    "give the places of the joints with --joints (rows `name, x, y, z`), or another --up";
                let figure = Figure::of(mesh, up).with_context(|| help)?;
                Fitted::in_figure(&clip, &figure).with_context(|| help)?
            }
        };
        if let Some(path) = &self.save_joints {
            joints::write(path, &clip, &fitted.joints)?;
        }
        let root = if self.in_place { Root::InPlace } else { Root::Moves };
        let rig = Rig::new(mesh, clip, fitted, root, backend)?;
        let (joints, bones) = (rig.clip().joints.len(), rig.bones());
        eprintln!("skeleton: {joints} joints, {bones} bones, {} frames", rig.clip().len());
        Ok(rig)
    }
}

/// Channel values, one row per frame, of the joints of `skeleton`.
fn angles(path: &Path, skeleton: Clip) -> Result<Clip, crate::file::FileError> {
    let width = skeleton.channels();
    let (found, values) = table::read_rows(path)?;
    if found != width {
        let problem = format!("has {found} columns, but the skeleton has {width} channels");
        return Err(
            Fault::new(problem, "write one column per channel, in the order of the BVH file").in_file(path)
        );
    }
    Ok(Clip { values, ..skeleton })
}

/// Numbers of one joint in a file of rotation vectors: three radians, three coordinates.
const PER_JOINT: usize = 6;

/// A motion as rows of (rotation vector, translation) per joint, relative to the parent. Translations of all joints but the
/// root are taken from the first frame: bones do not change their length.
fn rotation_vectors(path: &Path, parents: &[i64]) -> Result<Clip, crate::file::FileError> {
    use lapsolve::vector::norm;
    let fault = |problem: String, remedy: &str| Fault::new(problem, remedy).in_file(path);
    let (width, values) = table::read_rows(path)?;
    if width % PER_JOINT != 0 || width == 0 {
        let problem = format!("has {width} columns, no multiple of {PER_JOINT}");
        return Err(fault(problem, "write a rotation vector and a translation for every joint"));
    }
    let count = width / PER_JOINT;
    let is_tree = parents.iter().enumerate().all(|(j, &p)| p < j as i64 && (p >= 0) == (j > 0));
    if parents.len() != count || !is_tree {
        let problem =
            format!("has {count} joints, and --parents names {} that must form a tree", parents.len());
        return Err(fault(
            problem,
            "give the parent of every joint, -1 for the root, parents before children",
        ));
    }
    use Channel::{Position, Rotation};
    let turning = [Rotation(2), Rotation(1), Rotation(0)];
    let joint = |j: usize| Joint {
        name: format!("joint_{j}"),
        parent: usize::try_from(parents[j]).ok(),
        offset: std::array::from_fn(|i| if j == 0 { 0.0 } else { values[PER_JOINT * j + 3 + i] }),
        channels: if j == 0 {
            [Position(0), Position(1), Position(2)].into_iter().chain(turning).collect()
        } else {
            turning.to_vec()
        },
        end: None,
    };
    let joints: Vec<Joint> = (0..count).map(joint).collect();
    let mut channels = Vec::with_capacity(values.len() / width * (3 * count + 3));
    for row in values.chunks_exact(width) {
        channels.extend_from_slice(&row[3..6]);
        for joint in row.chunks_exact(PER_JOINT) {
            let vector = [joint[0], joint[1], joint[2]];
            let angle = norm(vector);
            let (sin, cos) = (0.5 * angle).sin_cos();
            let along = if angle > 0.0 { sin / angle } else { 0.5 };
            channels.extend(euler_zyx([cos, vector[0] * along, vector[1] * along, vector[2] * along]));
        }
    }
    const ASSUMED: f64 = 1.0 / 30.0; // the files do not say
    Ok(Clip { joints, frame_time: ASSUMED, values: channels })
}

/// Degrees about z, y and x with R = Rz Ry Rx.
fn euler_zyx([w, x, y, z]: lapsolve::rotation::Quaternion) -> [f64; 3] {
    let about_y = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let about_z = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    let about_x = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    [about_z, about_y, about_x].map(f64::to_degrees)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::rotation::{about_axis, dot4, product};

    #[test]
    fn rotation_vectors_become_the_same_rotations() {
        for (z, y, x) in [(0.3, -1.2, 2.0), (3.0, 1.5, -3.0), (0.0, 0.0, 0.0)] {
            let q = product(product(about_axis(2, z), about_axis(1, y)), about_axis(0, x));
            let [a, b, c] = euler_zyx(q).map(f64::to_radians);
            let back = product(product(about_axis(2, a), about_axis(1, b)), about_axis(0, c));
            assert!(dot4(q, back).abs() > 1.0 - 1e-12, "{z} {y} {x}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("walk.txt");
        std::fs::write(&path, "0 0 1.5707963267948966 1 2 3 0 0 0 0 -1 0\n0 0 0 1 2 4 0 0.1 0 0 -1 0\n")
            .unwrap();
        let clip = rotation_vectors(&path, &[-1, 0]).unwrap();
        let placed = clip.place(0);
        // The thigh points down; turned by a right angle about z it points along x.
        assert!(
            placed[1].position.iter().zip([2.0, 2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12),
            "{placed:?}"
        );
        for parents in [&[-1][..], &[-1, 1], &[0, 0], &[]] {
            assert!(rotation_vectors(&path, parents).unwrap_err().to_string().contains("--parents"));
        }
    }
}
