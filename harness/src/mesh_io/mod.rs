//! Meshes, arrays and tables from and to files.
//!
//! Every reader takes the whole file as bytes and returns a checked result or a [`Fault`] that names the place and
//! the remedy. None panics, recurses, or allocates more than a small multiple of the bytes it was given: counts a
//! header promises are compared with the bytes that are left before anything is reserved.
//!
//! What is wrong with a mesh but no obstacle comes back as [`Note`]s, each saying what was done about it.

mod builder;
mod note;
pub mod npy;
mod obj;
mod ply;
pub mod table;
mod text;

use std::fmt;
use std::path::Path;

use lapsolve::mesh::TriangleMesh;
use sha2::{Digest, Sha256};

pub use self::note::{Finding, Note};
use crate::file::{self, Fault, FileError, Place};

/// A mesh with its provenance.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The mesh, in the file's order of vertices and triangles.
    pub mesh: TriangleMesh,
    /// What was found in the file and what was done about it.
    pub notes: Vec<Note>,
    /// SHA-256 of the mesh itself: positions (f64, little endian), then triangles (u32, little endian). The same for
    /// the same mesh in any format that keeps its bits.
    pub sha256: [u8; 32],
}

impl Loaded {
    /// Adds the checksum. Cost: one pass over the mesh.
    pub fn new(mesh: TriangleMesh, notes: Vec<Note>) -> Self {
        let sha256 = checksum(&mesh);
        Self { mesh, notes, sha256 }
    }
}

/// SHA-256 of positions (f64, little endian) and triangles (u32, little endian).
pub fn checksum(mesh: &TriangleMesh) -> [u8; 32] {
    let mut hash = Sha256::new();
    let mut buffer = Vec::with_capacity(1 << 16);
    for block in mesh.positions().as_flattened().chunks(1 << 13) {
        buffer.clear();
        buffer.extend(block.iter().flat_map(|x| x.to_le_bytes()));
        hash.update(&buffer);
    }
    for block in mesh.triangles().as_flattened().chunks(1 << 14) {
        buffer.clear();
        buffer.extend(block.iter().flat_map(|v| v.to_le_bytes()));
        hash.update(&buffer);
    }
    hash.finalize().into()
}

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Format {
    Ply,
    Obj,
}

impl Format {
    /// The format a file name stands for.
    pub fn of_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "ply" => Format::Ply,
            "obj" => Format::Obj,
            _ => return None,
        })
    }

    /// The format of the content, where it shows.
    fn of_content(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            return Some(Format::Ply);
        }
        None
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Ply => "PLY",
            Format::Obj => "OBJ",
        })
    }
}

/// Reads a mesh file: by content where that shows the format, else by extension.
///
/// # Errors
/// [`FileError`] naming file, place and remedy.
pub fn read_mesh(path: &Path) -> Result<Loaded, FileError> {
    let bytes = file::read(path)?;
    let (mesh, notes) =
        parse_mesh(&bytes, Format::of_extension(path)).map_err(|fault| fault.in_file(path))?;
    Ok(Loaded::new(mesh, notes))
}

/// Reads the bytes of a mesh file; `named` is the format its name stands for.
///
/// # Errors
/// A fault naming the place and the remedy.
pub fn parse_mesh(bytes: &[u8], named: Option<Format>) -> Result<(TriangleMesh, Vec<Note>), Fault> {
    if bytes.is_empty() {
        return Err(Fault::new("is empty", "export the mesh again"));
    }
    let shown = Format::of_content(bytes);
    let format = shown.or(named).ok_or_else(|| {
        Fault::new("is in no format that is known here", "use PLY, OBJ, OFF, STL, glTF or GLB")
    })?;
    let (mesh, mut notes) = match format {
        Format::Ply => ply::parse(bytes)?,
        Format::Obj => obj::parse(bytes)?,
    };
    if named.is_some_and(|named| named != format) {
        notes.push(Note { finding: Finding::OtherExtension, count: 1, first: Some(Place::Byte(0)) });
    }
    Ok((mesh, notes))
}

/// Writes a mesh in the format of the file name: PLY (binary, double) or OBJ. Atomic, see [`file::write_atomically`].
///
/// # Errors
/// [`FileError`] for another extension or a failed write.
pub fn write_mesh(path: &Path, mesh: &TriangleMesh) -> Result<(), FileError> {
    match Format::of_extension(path) {
        Some(Format::Ply) => file::write_atomically(path, |out| ply::write(mesh, out)),
        Some(Format::Obj) => file::write_atomically(path, |out| obj::write(mesh, out)),
        _ => Err(Fault::new("is no mesh format that is written here", "use .ply or .obj").in_file(path)),
    }
}
