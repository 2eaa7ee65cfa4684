//! A surface moved outwards or inwards until it encloses the volume asked for.

use super::enclosure::{CHUNK, cubic};
use super::{Enclosure, VolumeError};
use crate::backend::{Backend, PrepareOptions};
use crate::columns::Columns;
use crate::laplacian::{Laplacian, Weights};
use crate::mass::{Mass, lumped};
use crate::mesh::TriangleMesh;
use crate::rotation::{Quaternion, normalised, rotate};
use crate::team::Team;
use crate::vector::{Vector, add, cross, norm, scale, sub};
use crate::workload::vertex_system::VertexSystem;

/// Over which length normals are smoothed, in diagonals: ten times what a surface that lost a twentieth of its volume has
/// to move, so that edges change by a tenth of that at most, and thinner than the limbs that are to grow.
const LENGTH: f64 = 0.01;

/// Columns of the directions.
const SPACE: usize = 3;

/// Newton's method doubles its digits; more steps than this mean that there is no root nearby.
const MOST_STEPS: usize = 50;

/// Everything that moving a surface needs; a frame allocates nothing.
///
/// ```text
/// (M + l^2 L) d = M n                             once, at rest: n the unit normals, l a hundredth of the diagonal
/// x_i += s R_i d_i,   V(x + s R d) = wanted       every frame: R the rotations of the vertices; Newton from s = 0
/// ```
/// Normals as they are would tear creases and fine details apart, which are smaller than the step; the gradient of V would
/// move a vertex by the area around it besides. Smooth directions change edges by s / l. The cubic in s is exact, so that
/// one pass over the triangles serves all steps of Newton's method.
pub struct Inflation {
    enclosure: Enclosure,
    team: Team,
    /// d at rest.
    rest: Vec<Vector>,
    /// R d.
    directions: Vec<Vector>,
    /// Coefficients of V(x + s R d), summed over each chunk of triangles.
    parts: Vec<[f64; 4]>,
}

impl Inflation {
    /// Prepares the surface of `mesh`: one factorisation and one solve of three columns on `backend`. Frames run on
    /// `threads` threads, with the same bits for any number of them.
    ///
    /// # Errors
    /// [`VolumeError`] where `mesh` encloses no volume, the backend fails, or the system refuses a thread.
    pub fn new(backend: &dyn Backend, mesh: &TriangleMesh, threads: usize) -> Result<Self, VolumeError> {
        let enclosure = Enclosure::new(mesh)?;
        let rest = smooth(backend, mesh, &normals(mesh))?;
        Ok(Self {
            team: Team::new(threads).map_err(|error| VolumeError::Threads { why: error.to_string() })?,
            directions: vec![[0.0; 3]; rest.len()],
            parts: vec![[0.0; 4]; mesh.triangles().len().div_ceil(CHUNK)],
            rest,
            enclosure,
        })
    }

    /// The surface at rest.
    pub fn enclosure(&self) -> &Enclosure {
        &self.enclosure
    }

    /// Moves the surface until it encloses `ratio` times its volume at rest; returns s, positive along the normals.
    /// `rotations` are those of the vertices since rest, of any length; vertices whose rotation is 0 stay. Where there is an
    /// error, nothing has moved. Cost: one pass over the triangles and two over the vertices, no allocation.
    ///
    /// # Errors
    /// [`VolumeError::Unreachable`].
    ///
    /// # Panics
    /// If the number of positions or rotations is not that of the vertices.
    pub fn restore(
        &mut self,
        ratio: f64,
        rotations: &[Quaternion],
        positions: &mut [Vector],
    ) -> Result<f64, VolumeError> {
        assert_eq!(rotations.len(), self.rest.len(), "rotations: one per vertex");
        assert_eq!(positions.len(), self.rest.len(), "positions: one per vertex");
        let rest = &self.rest;
        self.team.for_each_run(&mut self.directions, 1, |vertices, directions| {
            let turned = rotations[vertices.clone()].iter().zip(&rest[vertices]);
            directions.iter_mut().zip(turned).for_each(|(direction, (&q, &d))| {
                *direction = normalised(q, 0.0).map_or([0.0; 3], |q| rotate(q, d));
            });
        });
        let cubic = self.cubic(positions);
        let wanted = ratio * self.enclosure.at_rest();
        let step = if ratio > 0.0 { root(cubic, wanted) } else { None };
        let step = step.ok_or(VolumeError::Unreachable { volume: cubic[0], wanted })?;
        let directions = &self.directions;
        self.team.for_each_run(positions, 1, |vertices, positions| {
            positions.iter_mut().zip(&directions[vertices]).for_each(|(x, &d)| *x = add(*x, scale(step, d)));
        });
        Ok(step)
    }

    /// V(x + s R d) as a polynomial in s.
    fn cubic(&mut self, positions: &[Vector]) -> [f64; 4] {
        let Self { enclosure, team, directions, parts, .. } = self;
        let at = |v: u32| [enclosure.relative(v, positions), directions[v as usize]];
        team.for_each(parts, |chunk, part| {
            *part = [0.0; 4];
            for t in &enclosure.triangles()[enclosure.chunk(chunk)] {
                let cone = cubic(t.map(at));
                part.iter_mut().zip(cone).for_each(|(sum, x)| *sum += x);
            }
        });
        let cones = parts.iter().fold([0.0; 4], |sum, part| std::array::from_fn(|i| sum[i] + part[i]));
        let fans = enclosure.fans(at);
        std::array::from_fn(|i| cones[i] + fans[i])
    }
}

/// Normals of unit length, weighted by area; 0 where the areas cancel.
fn normals(mesh: &TriangleMesh) -> Vec<Vector> {
    let mut normals = vec![[0.0; 3]; mesh.positions().len()];
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|v| mesh.positions()[v as usize]);
        let area = cross(sub(b, a), sub(c, a));
        t.iter().for_each(|&v| normals[v as usize] = add(normals[v as usize], area));
    }
    for normal in &mut normals {
        let length = norm(*normal);
        *normal = if length > 0.0 { scale(1.0 / length, *normal) } else { [0.0; 3] };
    }
    normals
}

/// d of (M + l^2 L) d = M n; 0 at vertices on no triangle of positive area. Clamped weights make d an average of the n.
fn smooth(
    backend: &dyn Backend,
    mesh: &TriangleMesh,
    normals: &[Vector],
) -> Result<Vec<Vector>, VolumeError> {
    let mass = lumped(mesh, Mass::Voronoi);
    let mut matrix = Laplacian::assemble(mesh, Weights::ClampedPerEdge).into_matrix();
    let length = LENGTH * mesh.diagonal();
    matrix.values_mut().iter_mut().for_each(|v| *v *= length * length);
    matrix.add_diagonal(&mass);
    let system = VertexSystem::new(matrix, mesh.positions())?;
    let weighted: Vec<Vector> = normals.iter().zip(&mass).map(|(&n, &m)| scale(m, n)).collect();
    let rhs = system.gather(Columns::new(weighted.as_flattened(), normals.len(), SPACE));
    let rows = system.vertices().len();
    let mut solution = vec![0.0; rhs.len()];
    backend
        .prepare(system.system(), &PrepareOptions::columns(SPACE), &mut |_| {})?
        .solve(Columns::new(&rhs[..], rows, SPACE), Columns::new(&mut solution[..], rows, SPACE))?;
    Ok(system.scatter(Columns::new(&solution[..], rows, SPACE)).as_chunks::<SPACE>().0.to_vec())
}

/// The s with c0 + c1 s + c2 s^2 + c3 s^3 = `wanted` that is reached from 0 with V growing in s all the way, as it does until
/// the surface has been turned inside out.
fn root([c0, c1, c2, c3]: [f64; 4], wanted: f64) -> Option<f64> {
    let slope = |s: f64| c1 + s * (2.0 * c2 + s * 3.0 * c3);
    let rounding = 4.0 * f64::EPSILON * (c0.abs() + wanted.abs()) / c1; // of V, as a step
    let mut s = 0.0;
    for _ in 0..MOST_STEPS {
        let step = (wanted - (c0 + s * (c1 + s * (c2 + s * c3)))) / slope(s);
        if !(slope(s) > 0.0 && step.is_finite()) {
            return None;
        }
        s += step;
        if step.abs() <= rounding + 2.0 * f64::EPSILON * s.abs() {
            let flattest = -c2 / (3.0 * c3);
            let passed = s.min(0.0) < flattest && flattest < s.max(0.0);
            return (!passed || slope(flattest) > 0.0).then_some(s);
        }
    }
    None
}
