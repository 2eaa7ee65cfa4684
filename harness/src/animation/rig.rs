//! A mesh that follows a skeleton motion by linear-blend skinning.

use super::clip::Clip;
use super::fit::Fitted;
use lapsolve::backend::Backend;
use lapsolve::columns::Columns;
use lapsolve::mesh::TriangleMesh;
use lapsolve::rigid::Rigid;
use lapsolve::rotation::rotate;
use lapsolve::vector::{Vector, add, dot, scale, sub};
use lapsolve::workload::skinning::{Bone, HEAT, Skin, SkinningError, SkinningProblem};

/// Shorter bones, in diagonals of the mesh, have no direction of their own and get no weight.
const SHORTEST: f64 = 1e-6;

/// A mesh, its skeleton and its weights.
#[derive(Clone, Debug)]
pub struct Rig {
    clip: Clip,
    fitted: Fitted,
    skin: Skin,
    /// The joint that moves each bone.
    joint_of: Vec<usize>,
    motions: Vec<Rigid>,
    /// How the root moves, from its place at rest.
    root: Vec<Vector>,
}

/// What becomes of the motion of the root.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Root {
    /// It moves as captured, from where the mesh stands.
    #[default]
    Moves,
    /// Its horizontal motion is left out.
    InPlace,
}

impl Rig {
    /// Weights of all bones at all vertices by heat equilibrium, one factor and one column per bone, on `backend`.
    ///
    /// # Errors
    /// [`SkinningError`].
    pub fn new(
        mesh: &TriangleMesh,
        clip: Clip,
        fitted: Fitted,
        root: Root,
        backend: &dyn Backend,
    ) -> Result<Self, SkinningError> {
        let (bones, joint_of) = bones(&clip, &fitted, SHORTEST * mesh.diagonal());
        let problem = SkinningProblem::new(mesh, &bones, HEAT)?;
        let weights = problem.weights(backend)?;
        let count = bones.len();
        let weights = Columns::new(&weights[..], mesh.positions().len(), count);
        let skin = Skin::new(mesh.positions(), weights, count);
        let mut rig =
            Self { clip, fitted, skin, joint_of, motions: vec![Rigid::IDENTITY; count], root: Vec::new() };
        rig.root = rig.root_motion(root);
        Ok(rig)
    }

    /// The motion.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// Number of bones with weights.
    pub fn bones(&self) -> usize {
        self.joint_of.len()
    }

    /// Positions of all vertices in frame `k`.
    ///
    /// # Panics
    /// If there is no such frame or `positions` has another length.
    pub fn write(&mut self, k: usize, positions: &mut [Vector]) {
        let joints = self.joints(k, self.root[k]);
        for (motion, &j) in self.motions.iter_mut().zip(&self.joint_of) {
            *motion = joints[j];
        }
        self.skin.pose(&self.motions, positions);
    }

    /// How the surface about every joint moves in frame `k`, the root being displaced by `root`.
    fn joints(&self, k: usize, root: Vector) -> Vec<Rigid> {
        let (placed, rest) = (self.clip.place(k), &self.fitted.joints);
        let mut moved: Vec<Rigid> = Vec::with_capacity(rest.len());
        for (j, joint) in self.clip.joints.iter().enumerate() {
            let rotation = self.fitted.rotation(j, placed[j].rotation);
            let at = joint.parent.map_or_else(|| add(rest[j], root), |parent| moved[parent].apply(rest[j]));
            moved.push(Rigid { rotation, translation: sub(at, rotate(rotation, rest[j])) });
        }
        moved
    }

    /// The root's displacements: relative to the first frame, in units of the mesh, the figure standing on its ground in the
    /// lowest frame.
    fn root_motion(&self, root: Root) -> Vec<Vector> {
        let up = self.fitted.up;
        let height = |p: Vector| dot(p, up);
        let places: Vec<Vector> = (0..self.clip.len()).map(|k| self.clip.place(k)[0].position).collect();
        let mut shifts: Vec<Vector> = places
            .iter()
            .map(|&p| scale(self.fitted.scale, rotate(self.fitted.axes, sub(p, places[0]))))
            .collect();
        if root == Root::InPlace {
            shifts.iter_mut().for_each(|shift| *shift = scale(height(*shift), up));
        }
        let points = |joints: &[Rigid]| {
            let tips =
                self.fitted.ends.iter().zip(joints).filter_map(|(end, joint)| Some(joint.apply((*end)?)));
            let own = self.fitted.joints.iter().zip(joints).map(|(&p, joint)| joint.apply(p));
            own.chain(tips).map(height).fold(f64::INFINITY, f64::min)
        };
        let ground = points(&vec![Rigid::IDENTITY; self.fitted.joints.len()]);
        let lowest =
            (0..shifts.len()).map(|k| points(&self.joints(k, shifts[k]))).fold(f64::INFINITY, f64::min);
        shifts.iter_mut().for_each(|shift| *shift = add(*shift, scale(ground - lowest, up)));
        shifts
    }
}

/// The segments that belong to each joint: to the joints it carries and to its tip.
fn bones(clip: &Clip, fitted: &Fitted, shortest: f64) -> (Vec<Bone>, Vec<usize>) {
    let mut segments: Vec<Vec<[Vector; 2]>> = vec![Vec::new(); clip.joints.len()];
    for (j, joint) in clip.joints.iter().enumerate() {
        if let Some(parent) = joint.parent {
            segments[parent].push([fitted.joints[parent], fitted.joints[j]]);
        }
        segments[j].extend(fitted.ends[j].map(|end| [fitted.joints[j], end]));
    }
    let long = |&[a, b]: &[Vector; 2]| lapsolve::vector::norm(sub(a, b)) > shortest;
    let own = segments.into_iter().map(|own| own.into_iter().filter(long).collect::<Vec<_>>());
    let bones = own.enumerate().filter(|(_, own)| !own.is_empty());
    bones.map(|(j, segments)| (Bone { segments }, j)).unzip()
}
