//! `skinning`: bone weights by heat equilibrium (Baran and Popovic 2007), and linear-blend skinning with them.
//!
//! ```text
//! (L + M H) w_j = M H p_j        for every bone j, one factor for all
//! ```
//! L is the cotangent Laplacian, M the lumped Voronoi mass. H_ii = c / max(d_i, 1e-4 diag)^2 is the heat that vertex i takes
//! from its nearest bone, d_i away, and 0 where the segment to the nearest point of that bone crosses the surface; p_j,i = 1
//! where bone j is that one. Bones equally far (all that share a joint are, from a vertex at the joint) share p equally.
//! A component whose vertices see no bone gets heat at one vertex only, the one nearest to a bone, and so follows
//! that bone rigidly. Vertices on no triangle of positive area are in no system: their weights are 0 and they stay.
//!
//! ```text
//! Skeleton -> bones -> SkinningProblem -> weights (a Backend) -> Skin -> pose, frame after frame
//! ```
//!
//! # Sums
//! The exact weights of a vertex sum to 1, because L 1 = 0 and the p_j sum to 1. Those of the system as stored do so only up
//! to the rounding of its diagonal times its condition, which slivers and faint heat make large: constants are what an
//! almost singular system amplifies. So [`weights_of`](SkinningProblem::weights_of) divides every row by its sum.
//!
//! # Default input of a mesh that comes alone
//! [`default_bones`](defaults::default_bones): [`defaults::BONES`] segments between centres of regions of the mesh.
//!
//! # Right when
//! the weights of every vertex sum to 1; they lie in [0, 1] where no off-diagonal of L is positive; w_j -> p_j as
//! c grows where H_ii > 0; the rest pose is reproduced and equal motions of all bones move the surface rigidly.

pub mod bone;
pub mod defaults;
mod skeleton;
mod skin;
#[cfg(test)]
mod tests;

pub use bone::Bone;
pub use skeleton::{Joint, Skeleton, SkeletonError};
pub use skin::Skin;

use super::vertex_system::VertexSystem;
use crate::backend::{Backend, PrepareOptions};
use crate::columns::Columns;
use crate::dirichlet::components;
use crate::error::{PrepareError, SolveError};
use crate::laplacian::{Laplacian, Weights};
use crate::mass::{Mass, lumped};
use crate::mesh::TriangleMesh;
use crate::range::{exponent, times_power_of_two};
use crate::sparse::SymmetricCsr;
use crate::system::SystemError;
use crate::triangle_tree::TriangleTree;
use crate::vector::Vector;
use rayon::prelude::*;
use thiserror::Error;

/// c, the strength of the heat, where nothing else is asked: Baran and Popovic's.
pub const HEAT: f64 = 1.0;

/// Most bones: more columns than any skeleton has, and few enough that one block of them fits in memory.
pub const MOST_BONES: usize = 1024;

/// Least distance to a bone that counts, in bounding-box diagonals: a bone in the surface heats no more than this.
const LEAST_DISTANCE: f64 = 1e-4;

/// Distances that differ by less than this, relatively, are the same: the rounding of a dozen operations.
const TIE: f64 = 1e-12;

/// How near to its ends a segment to a bone may cross the surface, in diagonals: seams whose vertices are not shared, and
/// bones that lie in the surface.
const MARGIN: f64 = 1e-6;

/// Why meshes and bones make no skinning problem.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SkinningError {
    /// No bone has a segment.
    #[error("no bones: give at least one segment")]
    NoBones,
    /// More than [`MOST_BONES`].
    #[error("{count} bones; at most {MOST_BONES} are supported")]
    TooMany {
        /// How many.
        count: usize,
    },
    /// A bone has an end that is not a number.
    #[error("bone {bone} has an end that is not finite")]
    NonFinite {
        /// 0-based bone.
        bone: usize,
    },
    /// The heat is not a positive number.
    #[error("the strength of the heat is {heat}; it must be positive and finite")]
    Heat {
        /// c.
        heat: f64,
    },
    /// L + M H is not acceptable, for instance because no triangle has an area.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The backend cannot prepare it.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The backend cannot solve it.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// L + M H and M H p of a mesh and its bones.
#[derive(Clone, Debug)]
pub struct SkinningProblem {
    system: VertexSystem,
    /// M_ii H_ii at every vertex of the mesh.
    heat: Vec<f64>,
    nearest: Nearest,
    bones: usize,
}

/// The bones nearest to every vertex: those that share its p.
#[derive(Clone, Debug)]
struct Nearest {
    starts: Vec<u32>,
    bones: Vec<u32>,
}

/// What one vertex sees of the bones.
struct View {
    distance: f64,
    bones: Vec<u32>,
    visible: bool,
}

impl SkinningProblem {
    /// Finds the nearest bone of every vertex, looks whether it is hidden, and assembles the system. `heat` is c.
    ///
    /// Cost: one distance per vertex and segment, one crossing test per vertex (a few microseconds), on the current rayon
    /// pool; the result has the same bits for any number of threads.
    ///
    /// # Errors
    /// [`SkinningError`].
    pub fn new(mesh: &TriangleMesh, bones: &[Bone], heat: f64) -> Result<Self, SkinningError> {
        check(bones, heat)?;
        let exponent = exponent(mesh.positions());
        if exponent != 0 {
            // The system does not depend on the unit of length; in this one squared distances are numbers.
            let scaled = |p: &Vector| p.map(|x| times_power_of_two(x, exponent));
            let bones: Vec<Bone> = bones
                .iter()
                .map(|b| Bone {
                    segments: b.segments.iter().map(|ends| ends.each_ref().map(scaled)).collect(),
                })
                .collect();
            let positions: Vec<Vector> = mesh.positions().iter().map(scaled).collect();
            if let Ok(mesh) = mesh.with_positions(positions) {
                check(&bones, heat)?;
                return Self::in_range(&mesh, &bones, heat);
            }
        }
        Self::in_range(mesh, bones, heat)
    }

    fn in_range(mesh: &TriangleMesh, bones: &[Bone], heat: f64) -> Result<Self, SkinningError> {
        let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
        let mass = lumped(mesh, Mass::Voronoi);
        let diagonal = mesh.diagonal();
        let tree = TriangleTree::new(mesh);
        let views: Vec<View> = (0..mesh.positions().len())
            .into_par_iter()
            .map(|v| View::of(mesh.positions()[v], v as u32, bones, &tree, MARGIN * diagonal))
            .collect();
        let lit = lit(&laplacian, &mass, &views);
        let taken = |v: usize| {
            let distance = views[v].distance.max(LEAST_DISTANCE * diagonal);
            if lit[v] { mass[v] * heat / (distance * distance) } else { 0.0 }
        };
        let heat: Vec<f64> = (0..views.len()).map(taken).collect();
        let mut matrix = laplacian;
        matrix.add_diagonal(&heat);
        let system = VertexSystem::new(matrix, mesh.positions())?;
        Ok(Self { system, heat, nearest: Nearest::of(&views), bones: bones.len() })
    }

    /// L + M H over the vertices that have a mass.
    pub fn system(&self) -> &VertexSystem {
        &self.system
    }

    /// Number of bones: columns of the right-hand side.
    pub fn bones(&self) -> usize {
        self.bones
    }

    /// M_ii H_ii of every vertex; 0 where its nearest bone is hidden.
    pub fn heat(&self) -> &[f64] {
        &self.heat
    }

    /// The bones nearest to vertex `v`, ascending: p_j,v is 1 over their number for these, and 0 for all others.
    pub fn nearest(&self, v: usize) -> &[u32] {
        &self.nearest.bones[self.nearest.starts[v] as usize..self.nearest.starts[v + 1] as usize]
    }

    /// M H p, one row per row of the system, one column per bone.
    pub fn right_hand_side(&self) -> Vec<f64> {
        let mut rhs = vec![0.0; self.system.vertices().len() * self.bones];
        for (row, &v) in rhs.chunks_exact_mut(self.bones).zip(self.system.vertices()) {
            let nearest = self.nearest(v as usize);
            for &bone in nearest {
                row[bone as usize] = self.heat[v as usize] / nearest.len() as f64;
            }
        }
        rhs
    }

    /// The weights of all bones at all vertices, n x bones: one preparation, one solve of all columns, and
    /// [`weights_of`](Self::weights_of).
    ///
    /// # Errors
    /// [`SkinningError::Prepare`] and [`SkinningError::Solve`] with what the backend says.
    pub fn weights(&self, backend: &dyn Backend) -> Result<Vec<f64>, SkinningError> {
        let (rows, rhs) = (self.system.vertices().len(), self.right_hand_side());
        let mut factor =
            backend.prepare(self.system.system(), &PrepareOptions::columns(self.bones), &mut |_| {})?;
        let mut weights = vec![0.0; rhs.len()];
        factor.solve(
            Columns::new(&rhs[..], rows, self.bones),
            Columns::new(&mut weights[..], rows, self.bones),
        )?;
        Ok(self.weights_of(Columns::new(&weights[..], rows, self.bones)))
    }

    /// The weights at all vertices, n x bones, from a solution of the system: its rows divided by their sums, which are 1
    /// but for rounding. Rows whose sum is not positive or not finite belong to no weights and stay as they are.
    pub fn weights_of(&self, solution: Columns<&[f64]>) -> Vec<f64> {
        let mut weights = self.system.scatter(solution);
        for row in weights.chunks_exact_mut(self.bones) {
            let sum: f64 = row.iter().sum();
            if sum > 0.0 && sum.is_finite() {
                row.iter_mut().for_each(|w| *w /= sum);
            }
        }
        weights
    }
}

fn check(bones: &[Bone], heat: f64) -> Result<(), SkinningError> {
    if bones.len() > MOST_BONES {
        return Err(SkinningError::TooMany { count: bones.len() });
    }
    if bones.iter().all(|bone| bone.segments.is_empty()) {
        return Err(SkinningError::NoBones);
    }
    let finite = |bone: &Bone| bone.segments.as_flattened().as_flattened().iter().all(|x| x.is_finite());
    if let Some(bone) = bones.iter().position(|bone| !finite(bone)) {
        return Err(SkinningError::NonFinite { bone });
    }
    if !(heat > 0.0 && heat.is_finite()) {
        return Err(SkinningError::Heat { heat });
    }
    Ok(())
}

impl View {
    /// The bones nearest to vertex `v` at `point`: of those equally far the ones that are not hidden, if there are any.
    fn of(point: Vector, v: u32, bones: &[Bone], tree: &TriangleTree, margin: f64) -> Self {
        let near: Vec<(u32, f64, Vector)> = (0..)
            .zip(bones)
            .filter_map(|(j, bone)| bone.nearest(point).map(|(squared, at)| (j, squared.sqrt(), at)))
            .collect();
        let distance = near.iter().fold(f64::INFINITY, |least, &(_, d, _)| least.min(d));
        let tied = |&&(_, d, _): &&(u32, f64, Vector)| d <= distance * (1.0 + TIE);
        let mut seen: Option<(Vector, bool)> = None; // tied bones mostly share the point: one test for all
        let mut sees = |at: Vector| match seen {
            Some((point, sees)) if point == at => sees,
            _ => {
                let sees = !tree.crosses(point, at, Some(v), margin);
                seen = Some((at, sees));
                sees
            }
        };
        let visible: Vec<u32> =
            near.iter().filter(tied).filter(|&&(_, _, at)| sees(at)).map(|&(j, ..)| j).collect();
        match visible.is_empty() {
            false => Self { distance, bones: visible, visible: true },
            true => {
                Self { distance, bones: near.iter().filter(tied).map(|&(j, ..)| j).collect(), visible: false }
            }
        }
    }
}

impl Nearest {
    fn of(views: &[View]) -> Self {
        let mut nearest = Self { starts: vec![0], bones: Vec::new() };
        for view in views {
            nearest.bones.extend_from_slice(&view.bones);
            nearest.starts.push(nearest.bones.len() as u32);
        }
        nearest
    }
}

/// The vertices that take heat: those that see their bone, and in components without any the vertex nearest to a bone (of
/// equally near ones the lowest).
fn lit(laplacian: &SymmetricCsr, mass: &[f64], views: &[View]) -> Vec<bool> {
    let component = components(laplacian);
    let mut lit: Vec<bool> = views.iter().zip(mass).map(|(view, &m)| view.visible && m > 0.0).collect();
    let mut has_light = vec![false; views.len()];
    (0..views.len()).filter(|&v| lit[v]).for_each(|v| has_light[component[v] as usize] = true);
    let mut nearest: Vec<Option<u32>> = vec![None; views.len()];
    for v in (0..views.len()).filter(|&v| mass[v] > 0.0) {
        let best = &mut nearest[component[v] as usize];
        if best.is_none_or(|best| views[v].distance < views[best as usize].distance) {
            *best = Some(v as u32);
        }
    }
    for (root, best) in nearest.iter().enumerate() {
        if let Some(v) = best.filter(|_| !has_light[root]) {
            lit[v as usize] = true;
        }
    }
    lit
}
