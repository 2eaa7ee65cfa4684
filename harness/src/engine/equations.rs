//! The equations a cell solves: what children receive as files and what answers are held against.

use super::array_file::ArrayFile;
use super::protocol::{MatrixFiles, Problem};
use crate::verify::solution::Question;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::workload::matrix;
use std::io;
use std::path::Path;

/// Equations with their data.
#[derive(Clone, Debug)]
pub enum Equations {
    /// A x = b.
    System {
        /// A.
        system: System,
        /// b, n x k.
        b: Vec<f64>,
        /// Columns.
        k: usize,
        /// The vertex of every row and the number of all vertices, where the rows are some vertices of a mesh.
        vertices: Option<(Vec<u32>, usize)>,
    },
    /// L_FF u_F = -L_FC g, u_C = g.
    Harmonic {
        /// L and C.
        problem: Box<Dirichlet>,
        /// Positions of all vertices, handed on to children.
        positions: Option<Vec<[f64; 3]>>,
        /// The mesh' triangles, handed on to peers that assemble by themselves.
        triangles: Option<Vec<[u32; 3]>>,
        /// g, |C| x k.
        g: Vec<f64>,
        /// Columns.
        k: usize,
    },
}

impl Equations {
    /// Columns k.
    pub fn columns(&self) -> usize {
        match self {
            Equations::System { k, .. } | Equations::Harmonic { k, .. } => *k,
        }
    }

    /// Rows of a solution.
    pub fn rows(&self) -> usize {
        match self {
            Equations::System { system, .. } => system.n(),
            Equations::Harmonic { problem, .. } => problem.laplacian().n(),
        }
    }

    /// Order of the system that is solved.
    pub fn unknowns(&self) -> usize {
        self.reduced().map_or(0, |(system, _)| system.n())
    }

    /// The SPD system behind them with its right-hand side (unknowns x k); none where every vertex is constrained.
    pub fn reduced(&self) -> Option<(&System, Vec<f64>)> {
        match self {
            Equations::System { system, b, .. } => Some((system, b.clone())),
            Equations::Harmonic { problem, g, k, .. } => {
                let system = problem.system()?;
                let mut b = vec![0.0; system.n() * k];
                let g = Columns::new(&g[..], problem.fixed().len(), *k);
                problem.right_hand_side(g, Columns::new(&mut b, system.n(), *k));
                Some((system, b))
            }
        }
    }

    /// A solution (rows x k) as one row per vertex; vertices without an equation get 0.
    pub fn on_vertices(&self, x: &[f64]) -> Vec<f64> {
        let k = self.columns();
        let Equations::System { vertices: Some((vertices, all)), .. } = self else { return x.to_vec() };
        let mut whole = vec![0.0; all * k];
        for (&v, row) in vertices.iter().zip(x.chunks_exact(k)) {
            whole[v as usize * k..(v as usize + 1) * k].copy_from_slice(row);
        }
        whole
    }

    /// The stored values of the matrix that `update` replaces: A, or the full L.
    pub fn values(&self) -> &[f64] {
        match self {
            Equations::System { system, .. } => system.matrix().values(),
            Equations::Harmonic { problem, .. } => problem.laplacian().values(),
        }
    }

    /// Row starts and column indices of the same matrix.
    pub fn pattern(&self) -> (&[u32], &[u32]) {
        let matrix = match self {
            Equations::System { system, .. } => system.matrix(),
            Equations::Harmonic { problem, .. } => problem.laplacian(),
        };
        (matrix.row_starts(), matrix.columns())
    }

    /// The same right-hand sides with other values on the same pattern; none where they are not acceptable.
    pub fn with_values(&self, values: &[f64]) -> Option<Self> {
        let mut changed = self.clone();
        match &mut changed {
            Equations::System { system, .. } => system.update_values(values).ok()?,
            Equations::Harmonic { problem, .. } => problem.update_values(values).ok()?,
        }
        Some(changed)
    }

    /// The same matrix with `k` columns of oscillating numbers: x_ij = sin(i + 3 j + 1), or g_ij.
    pub fn with_columns(&self, k: usize) -> Self {
        let mut changed = self.clone();
        match &mut changed {
            Equations::System { system, b, k: columns, .. } => {
                *b = matrix::default_right_hand_side(system.matrix(), k);
                *columns = k;
            }
            Equations::Harmonic { problem, g, k: columns, .. } => {
                *g = matrix::default_solution(problem.fixed().len(), k);
                *columns = k;
            }
        }
        changed
    }

    /// The block that a solve is given: b, or g.
    pub fn input(&self) -> (&[f64], usize) {
        match self {
            Equations::System { b, k, .. } => (b, *k),
            Equations::Harmonic { g, k, .. } => (g, *k),
        }
    }

    /// The same as a question to [`crate::verify`].
    pub fn question(&self) -> Question<'_> {
        match self {
            Equations::System { system, b, k, .. } => {
                Question::System { matrix: system.matrix(), rhs: Columns::new(b, system.n(), *k) }
            }
            Equations::Harmonic { problem, g, k, .. } => {
                Question::Harmonic { problem, values: Columns::new(g, problem.fixed().len(), *k) }
            }
        }
    }

    /// Writes everything a child needs into `folder`: the problem, and the input of its solves.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, folder: &Path) -> io::Result<(Problem, ArrayFile)> {
        match self {
            Equations::System { system, b, k, .. } => {
                let matrix = write_matrix(folder, system.matrix())?;
                let positions = system.positions().map(|p| write_points(folder, p)).transpose()?;
                let rhs = ArrayFile::write(&folder.join("rhs.f64"), b, *k)?;
                Ok((Problem::System { matrix, positions }, rhs))
            }
            Equations::Harmonic { problem, positions, triangles, g, k } => {
                let laplacian = write_matrix(folder, problem.laplacian())?;
                let positions = positions.as_ref().map(|p| write_points(folder, p)).transpose()?;
                let triangles = triangles
                    .as_ref()
                    .map(|t| ArrayFile::write(&folder.join("triangles.u32"), t.as_flattened(), 3));
                let triangles = triangles.transpose()?;
                let fixed = ArrayFile::write(&folder.join("fixed.u32"), problem.fixed(), 1)?;
                let values = ArrayFile::write(&folder.join("constraints.f64"), g, *k)?;
                Ok((Problem::Harmonic { laplacian, positions, triangles, fixed }, values))
            }
        }
    }
}

fn write_matrix(folder: &Path, matrix: &SymmetricCsr) -> io::Result<MatrixFiles> {
    Ok(MatrixFiles {
        n: matrix.n(),
        row_starts: ArrayFile::write(&folder.join("row_starts.u32"), matrix.row_starts(), 1)?,
        columns: ArrayFile::write(&folder.join("columns.u32"), matrix.columns(), 1)?,
        values: ArrayFile::write(&folder.join("values.f64"), matrix.values(), 1)?,
    })
}

fn write_points(folder: &Path, points: &[[f64; 3]]) -> io::Result<ArrayFile> {
    ArrayFile::write(&folder.join("positions.f64"), points.as_flattened(), 3)
}
