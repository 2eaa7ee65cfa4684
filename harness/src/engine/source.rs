//! What cells are solved on: meshes and matrices by name.

use crate::body::Build;
use crate::environment::hexadecimal;
use crate::mesh_io::{Loaded, matrix_market, table};
use crate::mesh_source;
use crate::record::result::Mesh;
use crate::subdivision::Subdivision;
use anyhow::Context;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;
use sha2::{Digest, Sha256};
use std::path::Path;
use std::time::Instant;

/// A mesh or matrix with its description for the record.
#[derive(Clone, Debug)]
pub struct Source {
    /// For the record.
    pub record: Mesh,
    /// Time to read or make it, nanoseconds.
    pub load_ns: u64,
    /// Median time to assemble its plain cotangent Laplacian with all threads, nanoseconds; none without triangles.
    pub assemble_ns: Option<u64>,
    /// The thing itself.
    pub content: Content,
    /// The mesh before subdivision, where it was subdivided.
    pub unsubdivided: Option<TriangleMesh>,
    /// Which generated human it is, if one: it has a template that walks.
    pub body: Option<Build>,
}

/// What a source holds.
#[derive(Clone, Debug)]
pub enum Content {
    /// A triangle mesh.
    Mesh(TriangleMesh),
    /// An SPD matrix.
    Matrix(SymmetricCsr),
    /// A sequence of joint angles.
    Sequence(Sequence),
}

/// Joint angles, frame after frame.
#[derive(Clone, Debug)]
pub struct Sequence {
    /// The angles, frames x columns.
    pub angles: Vec<f64>,
    /// Angles per frame.
    pub columns: usize,
}

/// How a source is named on the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Name {
    /// `--mesh`: a file or a generated mesh.
    Mesh(String),
    /// `--matrix`: a MatrixMarket file.
    Matrix(String),
    /// `--angles`: a table of joint angles.
    Sequence(String),
}

impl Name {
    /// The name in results: files without their folder.
    pub fn short(&self) -> String {
        let (Name::Mesh(name) | Name::Matrix(name) | Name::Sequence(name)) = self;
        Path::new(name).file_name().map_or_else(|| name.clone(), |file| file.to_string_lossy().into_owned())
    }

    /// The name in results of what [`load`](Self::load) makes of it.
    pub fn recorded(&self, subdivide: u32) -> String {
        match self {
            Name::Mesh(_) if subdivide > 0 => format!("{}+loop{subdivide}", self.short()),
            _ => self.short(),
        }
    }

    /// Loads it; a mesh is then subdivided `subdivide` times.
    ///
    /// # Errors
    /// What the reader says, naming the file; or a subdivision that would not fit.
    pub fn load(&self, subdivide: u32) -> anyhow::Result<Source> {
        let begin = Instant::now();
        let mut unsubdivided = None;
        let (content, sha256, notes) = match self {
            Name::Mesh(name) => {
                let Loaded { mesh, notes, sha256, .. } = mesh_source::load(name)?;
                if subdivide == 0 {
                    (Content::Mesh(mesh), hexadecimal(&sha256), notes)
                } else {
                    let fine =
                        Subdivision::new(&mesh, subdivide).with_context(|| name.clone())?.mesh().clone();
                    let sha256 = hexadecimal(&crate::mesh_io::checksum(&fine));
                    unsubdivided = Some(mesh);
                    (Content::Mesh(fine), sha256, notes)
                }
            }
            Name::Matrix(name) => {
                let matrix = matrix_market::read(Path::new(name))?;
                let sha256 = matrix_checksum(&matrix);
                (Content::Matrix(matrix), sha256, Vec::new())
            }
            Name::Sequence(name) => {
                let (columns, angles) = table::read_rows(Path::new(name))?;
                let sha256 = numbers_checksum(&angles);
                (Content::Sequence(Sequence { angles, columns }), sha256, Vec::new())
            }
        };
        let load_ns = begin.elapsed().as_nanos() as u64;
        let assemble_ns = match &content {
            Content::Mesh(mesh) => Some(assembly_time(mesh)),
            _ => None,
        };
        for note in notes {
            eprintln!("{}: {note}", self.short());
        }
        let (triangles, vertices) = match &content {
            Content::Mesh(mesh) => (Some(mesh.triangles().len()), mesh.positions().len()),
            Content::Matrix(matrix) => (None, matrix.n()),
            Content::Sequence(sequence) => (None, sequence.angles.len() / sequence.columns),
        };
        let name = self.recorded(subdivide);
        let record = Mesh { name, triangles, vertices: Some(vertices), sha256: Some(sha256) };
        let body = if subdivide == 0 { self.body() } else { None };
        Ok(Source { record, load_ns, assemble_ns, content, unsubdivided, body })
    }

    fn body(&self) -> Option<Build> {
        let Name::Mesh(name) = self else { return None };
        match name.split_once(':')?.0 {
            "body" => Some(Build::Male),
            "body-female" => Some(Build::Female),
            _ => None,
        }
    }
}

/// Times an assembly is repeated: the first one starts threads and touches memory that the others find ready.
const ASSEMBLIES: usize = 5;

fn assembly_time(mesh: &TriangleMesh) -> u64 {
    let mut times: Vec<u64> = (0..ASSEMBLIES)
        .map(|_| {
            let begin = Instant::now();
            drop(std::hint::black_box(Laplacian::assemble(mesh, Weights::Plain)));
            begin.elapsed().as_nanos() as u64
        })
        .collect();
    times.sort_unstable();
    times[ASSEMBLIES / 2]
}

/// SHA-256 of numbers, little endian.
fn numbers_checksum(numbers: &[f64]) -> String {
    let mut hash = Sha256::new();
    numbers.iter().for_each(|x| hash.update(x.to_le_bytes()));
    hexadecimal(&hash.finalize())
}

/// SHA-256 of row starts, column indices (u32) and values (f64), little endian.
fn matrix_checksum(matrix: &SymmetricCsr) -> String {
    let mut hash = Sha256::new();
    let mut indices = matrix.row_starts().iter().chain(matrix.columns());
    let mut block = Vec::with_capacity(1 << 16);
    loop {
        block.clear();
        indices.by_ref().take(1 << 14).for_each(|i| block.extend(i.to_le_bytes()));
        if block.is_empty() {
            break;
        }
        hash.update(&block);
    }
    for values in matrix.values().chunks(1 << 13) {
        block.clear();
        values.iter().for_each(|v| block.extend(v.to_le_bytes()));
        hash.update(&block);
    }
    hexadecimal(&hash.finalize())
}
