//! `harmonic`: a harmonic field from values at constrained vertices (VA section 4), L_FF u_F = -L_FC g, u_C = g.
//!
//! Here are the constraints and values of a mesh that comes without any, and the schedule of `harmonic-edit`. The split
//! into free and constrained vertices is [`crate::dirichlet`].

use super::sampling::{farthest_points, lowest_point};
use crate::dirichlet::components;
use crate::mesh::TriangleMesh;
use crate::rotation::{about_axis, product};
use crate::sparse::SymmetricCsr;

/// Constrained vertices where nothing else is asked: as many as VA's users mark triangles, within their 30 to 200.
pub const DEFAULT_CONSTRAINTS: usize = 50;

/// Constraints that `harmonic-edit` moves in one step.
pub const EDITED_CONSTRAINTS: usize = 10;

/// Vertices that `harmonic-edit` goes round: after 20 steps it is back at the default set.
pub const EDIT_SEQUENCE: usize = 200;

/// Columns of the default values: the components of a quaternion.
pub const COLUMNS: usize = 4;

/// Largest angle of the default rotation field about each axis: 60 degrees.
const ANGLE: f64 = std::f64::consts::FRAC_PI_3;

/// The vertices of `mesh` in the order of farthest-point sampling, from which constraint sets are taken.
///
/// Only vertices with a row in `laplacian` take part. A set is a window of the sequence, plus, in each component without a
/// vertex in that window, its vertex of smallest (x, y, z).
#[derive(Clone, Debug)]
pub struct Constraints {
    sequence: Vec<u32>,
    /// Component of every vertex (its lowest vertex), `None` where the row is absent.
    component: Vec<Option<u32>>,
    /// Component and vertex of smallest (x, y, z) in it, ascending by component.
    lowest: Vec<(u32, u32)>,
}

impl Constraints {
    /// Samples `count` vertices (all, if there are fewer). Cost: see [`farthest_points`].
    ///
    /// # Panics
    /// If `laplacian` has not one row per vertex of `mesh`.
    pub fn sample(mesh: &TriangleMesh, laplacian: &SymmetricCsr, count: usize) -> Self {
        assert_eq!(laplacian.n(), mesh.positions().len(), "laplacian: one row per vertex");
        let coupled = laplacian.coupled_rows();
        let present: Vec<u32> =
            (0..laplacian.n() as u32).filter(|&v| !laplacian.is_absent(v as usize, &coupled)).collect();
        let points: Vec<[f64; 3]> = present.iter().map(|&v| mesh.positions()[v as usize]).collect();
        let sequence = farthest_points(&points, count).iter().map(|&i| present[i as usize]).collect();
        let roots = components(laplacian);
        let mut component = vec![None; laplacian.n()];
        present.iter().for_each(|&v| component[v as usize] = Some(roots[v as usize]));
        let mut by_component = present;
        by_component.sort_by_key(|&v| roots[v as usize]);
        let lowest = by_component
            .chunk_by(|&a, &b| roots[a as usize] == roots[b as usize])
            .filter_map(|group| {
                let vertex = lowest_point(group.iter().map(|&v| (v, mesh.positions()[v as usize])))?;
                Some((roots[vertex as usize], vertex))
            })
            .collect();
        Self { sequence, component, lowest }
    }

    /// The default set of `harmonic`, ascending: the first [`DEFAULT_CONSTRAINTS`] vertices, and one in each component without.
    pub fn default_set(&self) -> Vec<u32> {
        self.window(0, DEFAULT_CONSTRAINTS)
    }

    /// The set after `step` steps of `harmonic-edit`, ascending: in every step the [`EDITED_CONSTRAINTS`] oldest vertices of
    /// the sequence leave and as many new ones come. The sequence is cyclic.
    pub fn edited_set(&self, step: usize) -> Vec<u32> {
        self.window(step * EDITED_CONSTRAINTS, DEFAULT_CONSTRAINTS)
    }

    /// Steps after which [`edited_set`](Self::edited_set) is the default set again.
    pub fn edit_period(&self) -> usize {
        (1..).find(|step| (step * EDITED_CONSTRAINTS).is_multiple_of(self.sequence.len().max(1))).unwrap_or(1)
    }

    fn window(&self, first: usize, count: usize) -> Vec<u32> {
        let length = self.sequence.len();
        let mut set: Vec<u32> =
            (first..first + count.min(length)).map(|i| self.sequence[i % length]).collect();
        let mut reached: Vec<u32> = set.iter().filter_map(|&v| self.component[v as usize]).collect();
        reached.sort_unstable();
        set.extend(self.lowest.iter().filter(|(c, _)| reached.binary_search(c).is_err()).map(|&(_, v)| v));
        set.sort_unstable();
        set
    }
}

/// Vertices to add and to remove, ascending, on the way from one ascending set to another.
pub fn difference(from: &[u32], to: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let missing = |of: &[u32], set: &[u32]| -> Vec<u32> {
        of.iter().copied().filter(|v| set.binary_search(v).is_err()).collect()
    };
    (missing(to, from), missing(from, to))
}

/// Default values at `vertices`, |C| x 4: the quaternion q_x(60 deg s_x) q_y(60 deg s_y) q_z(60 deg s_z) in the order
/// (w, x, y, z), with s_i in [-1, 1] the place of the vertex in the bounding box along axis i (0 on a flat axis).
pub fn default_values(mesh: &TriangleMesh, vertices: &[u32]) -> Vec<f64> {
    let (low, high) = mesh.bounding_box();
    let place = |p: [f64; 3], i: usize| place_between(low[i], high[i], p[i]);
    vertices
        .iter()
        .flat_map(|&v| {
            let p = mesh.positions()[v as usize];
            let [x, y, z] = [0, 1, 2].map(|i| about_axis(i, ANGLE * place(p, i)));
            product(product(x, y), z)
        })
        .collect()
}

/// Where x lies between `low` (-1) and `high` (1); 0 where they coincide.
pub(super) fn place_between(low: f64, high: f64, x: f64) -> f64 {
    // Halved first, so that the length of a huge box stays finite.
    let half = 0.5 * high - 0.5 * low;
    if half > 0.0 { ((x - low) / half - 1.0).clamp(-1.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laplacian::{Laplacian, Weights};

    /// `strips` strips of 40 triangles each, far apart, and one unused vertex.
    fn strips(strips: u32) -> TriangleMesh {
        let positions = (0..strips)
            .flat_map(|s| (0..42).map(move |i| [f64::from(i / 2), f64::from(i % 2), 100.0 * f64::from(s)]))
            .chain([[-50.0; 3]])
            .collect();
        let triangles =
            (0..strips).flat_map(|s| (0..40).map(move |i| [0, 1, 2].map(|k| 42 * s + i + k))).collect();
        TriangleMesh::new(positions, triangles).expect("valid")
    }

    fn sample(mesh: &TriangleMesh, count: usize) -> Constraints {
        Constraints::sample(mesh, Laplacian::assemble(mesh, Weights::Plain).matrix(), count)
    }

    #[test]
    fn every_component_has_a_constraint_and_unused_vertices_have_none() {
        let mesh = strips(60);
        let set = sample(&mesh, DEFAULT_CONSTRAINTS).default_set();
        assert!(set.len() > DEFAULT_CONSTRAINTS && set.is_sorted_by(|a, b| a < b));
        for s in 0..60 {
            assert!(set.iter().any(|v| v / 42 == s), "strip {s}");
        }
        assert!(!set.contains(&(60 * 42)));
    }

    #[test]
    fn small_meshes_constrain_every_vertex() {
        let mesh = strips(1);
        assert_eq!(sample(&mesh, DEFAULT_CONSTRAINTS).default_set(), (0..42).collect::<Vec<_>>());
    }

    #[test]
    fn an_edit_moves_ten_constraints() {
        let mesh = strips(5);
        let constraints = sample(&mesh, 100);
        assert_eq!(constraints.edit_period(), 10);
        assert_eq!(constraints.edited_set(10), constraints.default_set());
        let (before, after) = (constraints.edited_set(0), constraints.edited_set(1));
        assert_eq!(before, constraints.default_set());
        let (add, remove) = difference(&before, &after);
        assert_eq!((add.len(), remove.len()), (EDITED_CONSTRAINTS, EDITED_CONSTRAINTS));
    }

    #[test]
    fn values_are_rotations_and_no_column_is_zero() {
        let mesh = strips(3);
        let all: Vec<u32> = (0..3 * 42).collect();
        let values = default_values(&mesh, &all);
        for q in values.chunks(4) {
            assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-15);
        }
        for column in 0..4 {
            assert!(values.chunks(4).any(|q| q[column].abs() > 0.1), "column {column}");
        }
        // Lowest corner: -60 degrees about every axis. cos 30 = h, sin 30 = 1/2.
        let h = 0.75f64.sqrt();
        let q = product(product([h, -0.5, 0.0, 0.0], [h, 0.0, -0.5, 0.0]), [h, 0.0, 0.0, -0.5]);
        assert!(values[..4].iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-15));
    }
}
