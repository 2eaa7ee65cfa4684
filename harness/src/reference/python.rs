//! The interpreter of the reference programs, and a run of one of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use lapsolve::mesh::TriangleMesh;
use serde_json::Value;

use crate::cache;
use crate::file::FileError;
use crate::mesh_io::{self, npy};

/// The programs, by file name; they import each other.
const PROGRAMS: [(&str, &str); 5] = [
    ("mesh_files.py", include_str!("../../../reference/mesh_files.py")),
    ("default_constraints.py", include_str!("../../../reference/default_constraints.py")),
    ("igl_reference.py", include_str!("../../../reference/igl_reference.py")),
    ("open3d_reference.py", include_str!("../../../reference/open3d_reference.py")),
    ("pipelines_reference.py", include_str!("../../../reference/pipelines_reference.py")),
];

/// Why a reference has nothing to say.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// No interpreter with the libraries.
    #[error("no reference libraries: {looked}; install them with `cargo xtask setup`")]
    Unavailable {
        /// Where they were looked for.
        looked: String,
    },
    /// The program failed or printed no JSON.
    #[error("{program}: {message}")]
    Failed {
        /// Which program.
        program: &'static str,
        /// The end of what it said.
        message: String,
    },
    /// A file that passes between us and the program.
    #[error(transparent)]
    File(#[from] FileError),
    /// A folder for those files.
    #[error("no folder for temporary files: {0}")]
    Folder(#[from] std::io::Error),
}

/// An interpreter that has the pinned libraries.
#[derive(Clone, Debug)]
pub struct Python {
    interpreter: PathBuf,
}

impl Python {
    /// The interpreter at `interpreter`; that it is one shows when it runs.
    pub fn at(interpreter: PathBuf) -> Self {
        Self { interpreter }
    }

    /// The one of [`cache::python`], which `cargo xtask setup` installs.
    ///
    /// # Errors
    /// [`ReferenceError::Unavailable`] where there is none.
    pub fn find() -> Result<Self, ReferenceError> {
        match cache::python() {
            Some(interpreter) if interpreter.exists() => Ok(Self::at(interpreter)),
            Some(interpreter) => Err(ReferenceError::Unavailable {
                looked: format!("{} does not exist", interpreter.display()),
            }),
            None => Err(ReferenceError::Unavailable {
                looked: "neither LAPBENCH_REFERENCE nor HOME is set".into(),
            }),
        }
    }

    /// Runs `program MESH_FILE OUT_FOLDER EXTRA ..` in a folder of its own.
    pub(super) fn run(
        &self,
        program: &'static str,
        mesh: MeshFile<'_>,
        extra: impl FnOnce(&Path) -> Result<Vec<String>, FileError>,
    ) -> Result<Answer, ReferenceError> {
        let folder = tempfile::Builder::new().prefix("lapbench-reference").tempdir()?;
        for (name, text) in PROGRAMS {
            fs::write(folder.path().join(name), text)?;
        }
        let mesh = match mesh {
            MeshFile::Path(path) => path.to_path_buf(),
            MeshFile::Mesh(mesh) => {
                let path = folder.path().join("mesh.ply");
                mesh_io::write_mesh(&path, mesh)?;
                path
            }
        };
        let output = Command::new(&self.interpreter)
            .arg(folder.path().join(program))
            .args([mesh.as_path(), &folder.path().join("out")])
            .args(extra(folder.path())?)
            .stdin(Stdio::null())
            .output()?;
        let failed = |message: String| ReferenceError::Failed { program, message };
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(failed(format!(
                "{}: {}",
                output.status,
                said.trim().lines().last().unwrap_or("no message")
            )));
        }
        let printed = output.stdout.trim_ascii();
        let last = printed.rsplit(|&byte| byte == b'\n').next().unwrap_or_default(); // libraries print warnings before
        let facts =
            serde_json::from_slice(last).map_err(|error| failed(format!("printed no JSON: {error}")))?;
        Ok(Answer { facts, folder })
    }
}

/// The mesh that a reference is given.
pub(super) enum MeshFile<'a> {
    /// Our reading of it, written as PLY with every bit.
    Mesh(&'a TriangleMesh),
    /// The file itself.
    Path(&'a Path),
}

/// What a program printed and wrote.
pub(super) struct Answer {
    /// Versions, sizes.
    pub facts: Value,
    folder: tempfile::TempDir,
}

impl Answer {
    /// All numbers of the array `name`, which must have `rows` rows where that is known.
    pub fn array(&self, name: &'static str, rows: Option<usize>) -> Result<Vec<f64>, ReferenceError> {
        let array = npy::read(&self.folder.path().join("out").join(name).with_extension("npy"))?;
        match rows {
            Some(rows) if array.shape.first() != Some(&rows) => Err(ReferenceError::Failed {
                program: name,
                message: format!("an array of shape {:?} instead of {rows} rows", array.shape),
            }),
            _ => Ok(array.values),
        }
    }

    /// The versions of its tools, as one line.
    pub fn versions(&self) -> String {
        let Some(versions) = self.facts["versions"].as_object() else { return "unknown versions".into() };
        let words =
            versions.iter().map(|(tool, version)| format!("{tool} {}", version.as_str().unwrap_or("?")));
        words.collect::<Vec<_>>().join(", ")
    }
}
