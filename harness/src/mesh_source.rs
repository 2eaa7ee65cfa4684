//! Meshes by name: a file, or one that is generated.

use std::path::Path;

use crate::file::FileError;
use crate::mesh_io::{self, Loaded};

/// Loads what `--mesh` names: a file.
///
/// # Errors
/// [`FileError`] naming file, place and remedy.
pub fn load(name_or_path: &str) -> Result<Loaded, FileError> {
    mesh_io::read_mesh(Path::new(name_or_path))
}
