//! Meshes by name: a file, or one that is generated.

use std::path::Path;

use crate::file::FileError;
use crate::mesh_io::{self, Loaded};
use crate::shapes;

/// Loads what `--mesh` names: a generated mesh ([`shapes::SHAPES`], for example `body:50000`) or a file.
///
/// # Errors
/// [`FileError`] naming file, place and remedy.
pub fn load(name_or_path: &str) -> Result<Loaded, FileError> {
    if let Some(made) = shapes::generate(name_or_path) {
        let mesh = made.map_err(|fault| fault.in_file(Path::new(name_or_path)))?;
        return Ok(Loaded::new(mesh, Vec::new()));
    }
    mesh_io::read_mesh(Path::new(name_or_path))
}
