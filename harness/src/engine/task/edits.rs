//! How the constraints of `harmonic-edit` move, and what the field of every step is checked against.

use crate::engine::array_file::ArrayFile;
use crate::engine::equations::Equations;
use crate::engine::inputs::Inputs;
use anyhow::anyhow;
use lapsolve::dirichlet::{Dirichlet, DirichletError};
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::workload::harmonic::{Constraints, EDIT_SEQUENCE, difference};
use std::io;
use std::path::Path;

/// A mesh whose constraints move.
#[derive(Debug)]
pub struct Edits {
    mesh: TriangleMesh,
    laplacian: SymmetricCsr,
    constraints: Constraints,
    inputs: Inputs,
}

/// The files of one edit.
#[derive(Debug)]
pub struct Edit {
    /// Vertices to constrain.
    pub add: ArrayFile,
    /// Vertices to free.
    pub remove: ArrayFile,
    /// Values at the new set.
    pub input: ArrayFile,
}

/// The first edit of the schedule, and what holds after it.
#[derive(Debug)]
pub struct FirstEdit {
    /// Its files.
    pub edit: Edit,
    /// The equations with the constraints moved.
    pub equations: Equations,
}

impl Edits {
    /// The default schedule of `mesh`.
    ///
    /// # Errors
    /// Where other constraints are given.
    pub fn new(mesh: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        if inputs.constraints.is_some() {
            return Err(anyhow!("`harmonic-edit` moves the default constraints; it takes no --constraints"));
        }
        let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
        let constraints = Constraints::sample(mesh, &laplacian, EDIT_SEQUENCE);
        Ok(Self { mesh: mesh.clone(), laplacian, constraints, inputs: inputs.clone() })
    }

    /// Steps after which the default constraints are back.
    pub fn period(&self) -> usize {
        self.constraints.edit_period()
    }

    /// Writes what leads from step `k` to the next one.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, k: usize, path: &Path) -> io::Result<Edit> {
        let (from, to) = (self.constraints.edited_set(k), self.constraints.edited_set(k + 1));
        let (add, remove) = difference(&from, &to);
        let (g, columns) = super::default_values(&self.mesh, &to, &self.inputs);
        Ok(Edit {
            add: ArrayFile::write(&path.with_extension("add"), &add, 1)?,
            remove: ArrayFile::write(&path.with_extension("remove"), &remove, 1)?,
            input: ArrayFile::write(&path.with_extension("constraints"), &g, columns)?,
        })
    }

    /// What holds after `k` steps.
    ///
    /// # Errors
    /// None for a mesh whose default constraints are acceptable.
    pub fn equations(&self, k: usize) -> Result<Equations, DirichletError> {
        let set = self.constraints.edited_set(k);
        let (g, columns) = super::default_values(&self.mesh, &set, &self.inputs);
        let problem = Box::new(Dirichlet::new(self.laplacian.clone(), Some(self.mesh.positions()), &set)?);
        Ok(Equations::Harmonic { problem, positions: None, triangles: None, g, k: columns })
    }

    /// The first edit; none where the mesh is too small to have other vertices.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn first(&self, path: &Path) -> anyhow::Result<Option<FirstEdit>> {
        let edit = self.write(0, path)?;
        if edit.add.rows == 0 || edit.remove.rows == 0 {
            return Ok(None);
        }
        Ok(Some(FirstEdit { edit, equations: self.equations(1)? }))
    }
}
