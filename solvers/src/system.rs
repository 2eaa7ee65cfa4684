//! The front door of every solve: a sparse SPD system, checked once.

use crate::sparse::SymmetricCsr;
use thiserror::Error;

/// A x = b with A symmetric positive definite, as backends receive it.
///
/// Shape and symmetry hold by the form of [`SymmetricCsr`]; finiteness and a positive diagonal are checked here, once.
/// Whether A really is positive definite only its factorisation tells. Singular matrices (a closed surface's
/// Laplacian) are made definite before they come here: see [`crate::dirichlet::Dirichlet::grounded`].
#[derive(Clone, Debug)]
pub struct System {
    matrix: SymmetricCsr,
    positions: Option<Vec<[f64; 3]>>,
}

/// Why a matrix is refused as a [`System`].
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SystemError {
    /// A value is NaN or infinite.
    #[error("row {row} of the matrix holds a value that is not finite")]
    NonFinite {
        /// 0-based row.
        row: usize,
    },
    /// A diagonal entry is zero or negative, so the matrix cannot be positive definite.
    #[error(
        "the diagonal of row {row} is {value}; a positive definite matrix needs positive diagonal entries"
    )]
    Diagonal {
        /// 0-based row.
        row: usize,
        /// The entry.
        value: f64,
    },
    /// `positions` does not hold one point per row.
    #[error("{got} positions were given for {expected} rows")]
    Positions {
        /// Order of the matrix.
        expected: usize,
        /// Number of positions.
        got: usize,
    },
}

impl System {
    /// Checks the matrix; `positions` (one point per row) may help orderings and hierarchies, never correctness.
    ///
    /// # Errors
    /// [`SystemError`] naming the first offending row. Cost: one pass over the values.
    pub fn new(matrix: SymmetricCsr, positions: Option<Vec<[f64; 3]>>) -> Result<Self, SystemError> {
        if let Some(p) = positions.as_ref().filter(|p| p.len() != matrix.n()) {
            return Err(SystemError::Positions { expected: matrix.n(), got: p.len() });
        }
        check_values(&matrix, matrix.values())?;
        Ok(Self { matrix, positions })
    }

    /// The matrix A.
    pub fn matrix(&self) -> &SymmetricCsr {
        &self.matrix
    }

    /// Order n.
    pub fn n(&self) -> usize {
        self.matrix.n()
    }

    /// One point per row, where the system comes from a mesh.
    pub fn positions(&self) -> Option<&[[f64; 3]]> {
        self.positions.as_deref()
    }

    /// New values on the same pattern (length `matrix().stored()`), checked like the first ones.
    ///
    /// # Errors
    /// [`SystemError`]; the old values are then still in place. No allocation.
    ///
    /// # Panics
    /// If the number of values differs.
    pub fn update_values(&mut self, values: &[f64]) -> Result<(), SystemError> {
        assert_eq!(values.len(), self.matrix.stored(), "values: one per stored entry");
        check_values(&self.matrix, values)?;
        self.matrix.values_mut().copy_from_slice(values);
        Ok(())
    }

    /// As [`update_values`](Self::update_values), each value picked from `all` by its index in `source`. After an error
    /// the new values are in place all the same and must be replaced before the next use.
    pub(crate) fn refresh(&mut self, source: &[u32], all: &[f64]) -> Result<(), SystemError> {
        for (value, &entry) in self.matrix.values_mut().iter_mut().zip(source) {
            *value = all[entry as usize];
        }
        check_values(&self.matrix, self.matrix.values())
    }
}

fn check_values(pattern: &SymmetricCsr, values: &[f64]) -> Result<(), SystemError> {
    for row in 0..pattern.n() {
        let entries = &values[pattern.row_range(row)];
        if entries.iter().any(|v| !v.is_finite()) {
            return Err(SystemError::NonFinite { row });
        }
        if entries[0] <= 0.0 {
            return Err(SystemError::Diagonal { row, value: entries[0] });
        }
    }
    Ok(())
}
