//! An SPD system on those vertices of a mesh that have an equation.

use crate::columns::Columns;
use crate::sparse::SymmetricCsr;
use crate::system::{System, SystemError};

/// A system with one row per vertex of positive mass; the others (used by no triangle of positive area) are in no system.
#[derive(Clone, Debug)]
pub struct VertexSystem {
    system: System,
    vertices: Vec<u32>,
    all: usize,
}

impl VertexSystem {
    /// Drops the empty rows of `matrix` (n x n) and checks the rest as a [`System`].
    ///
    /// # Errors
    /// [`SystemError`]; row numbers are those of the smaller system.
    pub fn new(matrix: SymmetricCsr, positions: &[[f64; 3]]) -> Result<Self, SystemError> {
        let all = matrix.n();
        let coupled = matrix.coupled_rows();
        let vertices: Vec<u32> =
            (0..all as u32).filter(|&v| !matrix.is_absent(v as usize, &coupled)).collect();
        let matrix = if vertices.len() == all { matrix } else { compacted(&matrix, &vertices) };
        let positions = vertices.iter().map(|&v| positions[v as usize]).collect();
        Ok(Self { system: System::new(matrix, Some(positions))?, vertices, all })
    }

    /// The system; row i belongs to vertex `vertices()[i]`.
    pub fn system(&self) -> &System {
        &self.system
    }

    /// The vertex of every row, ascending.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// The rows of a block over all vertices that belong to the system.
    pub fn gather(&self, all: Columns<&[f64]>) -> Vec<f64> {
        self.vertices.iter().flat_map(|&v| all.row(v as usize)).copied().collect()
    }

    /// A solution over all vertices, n x k, from one over the rows; 0 at vertices without a row.
    pub fn scatter(&self, rows: Columns<&[f64]>) -> Vec<f64> {
        let k = rows.k();
        let mut all = vec![0.0; self.all * k];
        for (i, &v) in self.vertices.iter().enumerate() {
            all[v as usize * k..(v as usize + 1) * k].copy_from_slice(rows.row(i));
        }
        all
    }
}

/// The rows and columns `kept` (ascending) of a matrix whose other rows are empty.
fn compacted(matrix: &SymmetricCsr, kept: &[u32]) -> SymmetricCsr {
    let mut row_of = vec![u32::MAX; matrix.n()];
    for (row, &v) in kept.iter().enumerate() {
        row_of[v as usize] = row as u32;
    }
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for &v in kept {
        let (row_columns, row_values) = matrix.row(v as usize);
        columns.extend(row_columns.iter().map(|&j| row_of[j as usize]));
        values.extend_from_slice(row_values);
        starts.push(columns.len() as u32);
    }
    SymmetricCsr::from_sorted(starts, columns, values)
}
