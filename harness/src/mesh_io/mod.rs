//! Meshes, arrays and tables from and to files.
//!
//! Every reader takes the whole file as bytes and returns a checked result or a [`Fault`] that names the place and
//! the remedy. None panics, recurses, or allocates more than a small multiple of the bytes it was given: counts a
//! header promises are compared with the bytes that are left before anything is reserved.
//!
//! What is wrong with a mesh but no obstacle comes back as [`Note`]s, each saying what was done about it.
//!
//! # Mesh formats
//! | format | read | written |
//! |---|---|---|
//! | PLY | ascii, binary of both byte orders, any number types, triangle strips | binary little endian, `double` |
//! | OBJ | `v` and `f` with all forms of corners; curves, lines and looks are skipped | 17 significant digits |
//! | OFF | text, also with colours, normals, texture coordinates, or without keyword | - |
//! | STL | ascii and binary; equal positions merged | - |
//! | glTF, GLB | scenes with placed meshes; equal positions merged within a node | - |
//!
//! Vertices and triangles keep the order of the file. Polygons become fans of triangles at their first corner, right
//! for convex ones. A coordinate that is NaN or infinite, an index out of range and a file without triangles are errors;
//! nothing else about a mesh is.
//!
//! # Which format a file has
//! The content decides where it shows beyond doubt: `ply` and a line end; `glTF` or `{`; the keyword `OFF` or a variant;
//! `solid` with a `facet`; the exact length of a binary STL; a first word that only OBJ has. Otherwise the extension
//! decides. Where the two disagree the mesh is read by content and a note says so.

mod builder;
pub mod frames;
mod gltf;
pub mod matrix_market;
mod note;
pub mod npy;
mod obj;
mod off;
mod ply;
mod stl;
pub mod table;
pub(crate) mod text;
mod weld;

use std::fmt;
use std::path::Path;

use lapsolve::mesh::TriangleMesh;
use lapsolve::topology::Topology;
use sha2::{Digest, Sha256};

pub use self::gltf::parse_animation;
pub use self::note::{Finding, Note};
use self::text::Lines;
use crate::file::{self, Fault, FileError};

/// A mesh with its provenance.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The mesh, in the file's order of vertices and triangles.
    pub mesh: TriangleMesh,
    /// What was found in the file and in the mesh, and what was done about it.
    pub notes: Vec<Note>,
    /// How the triangles hang together.
    pub topology: Topology,
    /// SHA-256 of the mesh itself: positions (f64, little endian), then triangles (u32, little endian). The same for
    /// the same mesh in any format that keeps its bits.
    pub sha256: [u8; 32],
}

impl Loaded {
    /// Examines a mesh and adds checksum and report; `notes` are those of its reader.
    pub fn new(mesh: TriangleMesh, mut notes: Vec<Note>) -> Self {
        let (topology, sha256) = rayon::join(|| Topology::of(&mesh), || checksum(&mesh));
        notes.extend(note::of_topology(&topology));
        Self { mesh, notes, topology, sha256 }
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
pub enum Format {
    /// PLY, ascii or binary.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// OFF, text.
    Off,
    /// STL, ascii or binary.
    Stl,
    /// glTF 2.0, JSON or binary (GLB).
    Gltf,
}

impl Format {
    /// The format a file name stands for.
    pub fn of_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "ply" => Format::Ply,
            "obj" => Format::Obj,
            "off" | "coff" | "noff" => Format::Off,
            "stl" => Format::Stl,
            "gltf" | "glb" => Format::Gltf,
            _ => return None,
        })
    }

    /// The format of the content, where it shows beyond doubt.
    fn of_content(bytes: &[u8]) -> Option<Self> {
        let begin = bytes.trim_ascii_start();
        let first_line = Lines::new(&bytes[..bytes.len().min(4096)], 1).next_filled();
        let first_word = first_line.and_then(|line| line.tokens().next()).unwrap_or_default();
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            Some(Format::Ply)
        } else if bytes.starts_with(b"glTF") || begin.starts_with(b"{") {
            Some(Format::Gltf)
        } else if off::is_keyword(first_word) {
            Some(Format::Off)
        } else if stl::is_ascii(bytes) || stl::is_binary(bytes) {
            Some(Format::Stl)
        } else if [&b"v"[..], b"vn", b"vt", b"mtllib", b"usemtl"].contains(&first_word) {
            Some(Format::Obj)
        } else {
            None
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Ply => "PLY",
            Format::Obj => "OBJ",
            Format::Off => "OFF",
            Format::Stl => "STL",
            Format::Gltf => "glTF",
        })
    }
}

/// Reads a mesh file: by content where that shows the format, else by extension.
///
/// # Errors
/// [`FileError`] naming file, place and remedy.
pub fn read_mesh(path: &Path) -> Result<Loaded, FileError> {
    let bytes = file::read(path)?;
    let folder = path.parent();
    let (mesh, notes) =
        parse_mesh(&bytes, Format::of_extension(path), folder).map_err(|fault| fault.in_file(path))?;
    drop(bytes);
    Ok(Loaded::new(mesh, notes))
}

/// Reads the animation of a glTF file: positions of the vertices of `mesh` over time, and frames per second. The file must show
/// as many vertices as `mesh` has, in its order; so it does where the mesh was read from it, or from a file exported with it.
///
/// # Errors
/// [`FileError`] for a file without animation, or with another number of vertices.
pub fn read_animation(path: &Path, mesh: &TriangleMesh) -> Result<(frames::Frames, f64), FileError> {
    let bytes = file::read(path)?;
    let (frames, rate) = parse_animation(&bytes, path.parent()).map_err(|fault| fault.in_file(path))?;
    if frames.vertices() != mesh.positions().len() {
        let (found, wanted) = (frames.vertices(), mesh.positions().len());
        let problem = format!("moves {found} vertices, but the mesh that it moves has {wanted}");
        return Err(Fault::new(problem, "take the mesh from the same file").in_file(path));
    }
    Ok((frames, rate))
}

/// Reads the bytes of a mesh file. `named` is the format its name stands for; `folder` is where its external buffers
/// may lie.
///
/// # Errors
/// A fault naming the place and the remedy.
pub fn parse_mesh(
    bytes: &[u8],
    named: Option<Format>,
    folder: Option<&Path>,
) -> Result<(TriangleMesh, Vec<Note>), Fault> {
    if bytes.is_empty() {
        return Err(Fault::new("is empty", "export the mesh again"));
    }
    if bytes.starts_with(b"\x93NUMPY") {
        return Err(Fault::new("is an array, not a mesh", "give it as frames, and a mesh file here"));
    }
    let format = Format::of_content(bytes).or(named).ok_or_else(|| {
        Fault::new("is in no mesh format that is known here", "use PLY, OBJ, OFF, STL, glTF or GLB")
    })?;
    let (mesh, mut notes) = match format {
        Format::Ply => ply::parse(bytes)?,
        Format::Obj => obj::parse(bytes)?,
        Format::Off => off::parse(bytes)?,
        Format::Stl => stl::parse(bytes)?,
        Format::Gltf => gltf::parse(bytes, folder)?,
    };
    if named.is_some_and(|named| named != format) {
        notes.push(Note { finding: Finding::OtherExtension, count: 1, first: None });
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
