//! `kharmonic`: (W_k + M) u = M x with W_1 = L, W_(k+1) = W_k M^-1 L: the ladder of bi- and triharmonic smoothing.
//!
//! It is the public benchmark github.com/alecjacobson/sparse-solver-benchmark: 3 columns, the positions themselves, in file
//! units. Entries grow like (edge length)^-4 at k = 3 against M's (edge length)^2, so that f64 itself runs out: from
//! k = 2 on only backward errors are judged, and a factorisation at k = 3 may rightly fail.

use super::vertex_system::VertexSystem;
use crate::mesh::TriangleMesh;
use crate::sparse::SymmetricCsr;
use crate::system::SystemError;

/// Largest backward error of an answer for k >= 2, where forward errors cannot be certified.
pub const BACKWARD_ERROR: f64 = 1e-8;

/// W_k + M over the vertices that have a mass, for k = 1, 2, 3; `mass` is the diagonal of M (Voronoi, as in libigl).
///
/// Cost: k - 1 sparse products; rows have about 7, 19 and 37 entries on a closed surface.
///
/// # Errors
/// [`SystemError`], for instance where products overflow.
///
/// # Panics
/// If `k` is not 1, 2 or 3 or the shapes do not fit.
pub fn system(
    mesh: &TriangleMesh,
    laplacian: &SymmetricCsr,
    mass: &[f64],
    k: u32,
) -> Result<VertexSystem, SystemError> {
    assert!((1..=3).contains(&k), "k: 1, 2 or 3");
    assert_eq!(
        (laplacian.n(), mass.len()),
        (mesh.positions().len(), mesh.positions().len()),
        "one row per vertex"
    );
    let stiffness = Rows::full(laplacian);
    let mut power = stiffness.clone();
    for _ in 1..k {
        power = power.times_inverse_mass_times(mass, &stiffness);
    }
    let mut matrix = power.upper();
    matrix.add_diagonal(mass);
    VertexSystem::new(matrix, mesh.positions())
}

/// A matrix by rows, both triangles, columns ascending.
#[derive(Clone)]
struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl Rows {
    fn full(matrix: &SymmetricCsr) -> Self {
        let pattern = matrix.full_pattern();
        Self {
            starts: pattern.starts.iter().map(|&s| s as usize).collect(),
            columns: pattern.columns,
            values: pattern.source.iter().map(|&e| matrix.values()[e as usize]).collect(),
        }
    }

    fn row(&self, i: usize) -> impl Iterator<Item = (u32, f64)> {
        let range = self.starts[i]..self.starts[i + 1];
        self.columns[range.clone()].iter().copied().zip(self.values[range].iter().copied())
    }

    /// A M^-1 B, row by row with a dense accumulator (Gustavson 1978). Vertices without mass have empty rows in A and B.
    fn times_inverse_mass_times(&self, mass: &[f64], b: &Self) -> Self {
        let n = mass.len();
        let (mut sum, mut seen) = (vec![0.0; n], vec![u32::MAX; n]);
        let mut result = Self { starts: vec![0], columns: Vec::new(), values: Vec::new() };
        let mut touched = Vec::new();
        for i in 0..n {
            touched.clear();
            for (j, a) in self.row(i).filter(|&(j, _)| mass[j as usize] > 0.0) {
                let scaled = a / mass[j as usize];
                for (c, value) in b.row(j as usize) {
                    if std::mem::replace(&mut seen[c as usize], i as u32) != i as u32 {
                        sum[c as usize] = 0.0;
                        touched.push(c);
                    }
                    sum[c as usize] += scaled * value;
                }
            }
            touched.sort_unstable();
            result.columns.extend_from_slice(&touched);
            result.values.extend(touched.iter().map(|&c| sum[c as usize]));
            result.starts.push(result.columns.len());
        }
        result
    }

    /// The upper triangle; rounding makes the lower one differ in its last bits. Rows without entries get a zero diagonal.
    fn upper(&self) -> SymmetricCsr {
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in 0..self.starts.len() - 1 {
            let mut entries = self.row(i).filter(|&(j, _)| j as usize >= i).peekable();
            if entries.peek().is_none_or(|&(j, _)| j as usize != i) {
                columns.push(i as u32);
                values.push(0.0);
            }
            entries.for_each(|(j, v)| {
                columns.push(j);
                values.push(v);
            });
            starts.push(columns.len() as u32);
        }
        SymmetricCsr::from_sorted(starts, columns, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laplacian::{Laplacian, Weights};
    use crate::mass::{Mass, lumped};

    /// Both triangles of a matrix as n x n numbers.
    fn dense(a: &SymmetricCsr) -> Vec<f64> {
        let n = a.n();
        let mut full = vec![0.0; n * n];
        for i in 0..n {
            for (&j, &v) in a.row(i).0.iter().zip(a.row(i).1) {
                full[i * n + j as usize] = v;
                full[j as usize * n + i] = v;
            }
        }
        full
    }

    #[test]
    fn powers_agree_with_dense_products() {
        let positions =
            (0..12).map(|i| [f64::from(i / 3), f64::from(i % 3), (f64::from(i) * 0.7).sin()]).collect();
        let quads = (0..3u32).flat_map(|x| (0..2u32).map(move |y| 3 * x + y));
        let triangles = quads.flat_map(|v| [[v, v + 3, v + 1], [v + 1, v + 3, v + 4]]).collect();
        let mesh = TriangleMesh::new(positions, triangles).expect("valid");
        let l = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let mass = lumped(&mesh, Mass::Voronoi);
        let (n, stiffness) = (12, dense(&l));
        let mut power = stiffness.clone();
        for k in 1..=3 {
            let found = dense(system(&mesh, &l, &mass, k).expect("finite").system().matrix());
            for i in 0..n {
                for j in 0..n {
                    let expected = power[i * n + j] + if i == j { mass[i] } else { 0.0 };
                    let scale = power[i * n + i].abs() + power[j * n + j].abs();
                    assert!((found[i * n + j] - expected).abs() <= 1e-13 * scale, "k = {k}, entry {i} {j}");
                }
            }
            power = (0..n * n)
                .map(|at| (0..n).map(|m| power[at / n * n + m] / mass[m] * stiffness[m * n + at % n]).sum())
                .collect();
        }
    }
}
