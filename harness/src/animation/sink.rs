//! Where frames go: a GLB file, a folder of PLY files, or an array. Nothing appears before all frames are there.

use super::glb::GlbWriter;
use crate::file::{Fault, FileError};
use crate::mesh_io::{npy, write_mesh};
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::Vector;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Receives frames in order.
pub enum Sink {
    /// `.glb`: one morph target per frame.
    Glb(Box<GlbWriter>),
    /// A folder: `frame_0000.ply` and so on.
    Folder(Folder),
    /// `.npy`: shape (frames, vertices, 3), float64.
    Array(Array),
}

impl Sink {
    /// A place for `frames` frames of `mesh` at `rate` frames per second, by the extension of `path`.
    ///
    /// # Errors
    /// [`FileError`] for a place that is not writable, another extension, or a folder with other files in it.
    pub fn new(path: &Path, mesh: &TriangleMesh, frames: usize, rate: f64) -> Result<Self, FileError> {
        let extension = path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
        if path.is_dir() {
            return Folder::new(path, mesh, frames).map(Self::Folder);
        }
        match extension.as_deref() {
            None => Folder::new(path, mesh, frames).map(Self::Folder),
            Some("glb") => Ok(Self::Glb(Box::new(GlbWriter::new(path, mesh, frames, rate)?))),
            Some("npy") => Ok(Self::Array(Array {
                path: path.to_owned(),
                vertices: mesh.positions().len(),
                values: Vec::new(),
            })),
            Some(_) => {
                let remedy = "name a .glb or .npy file, or a folder for PLY files";
                Err(Fault::new("is no form of animation that is written here", remedy).in_file(path))
            }
        }
    }

    /// The next frame.
    ///
    /// # Errors
    /// [`FileError`] for a full disk.
    pub fn push(&mut self, positions: &[Vector]) -> Result<(), FileError> {
        match self {
            Self::Glb(writer) => writer.push(positions),
            Self::Folder(folder) => folder.push(positions),
            Self::Array(array) => {
                array.values.extend_from_slice(positions.as_flattened());
                Ok(())
            }
        }
    }

    /// All frames are there: they appear under their name.
    ///
    /// # Errors
    /// [`FileError`] for a full disk.
    pub fn finish(self) -> Result<(), FileError> {
        match self {
            Self::Glb(writer) => writer.finish(),
            Self::Folder(folder) => folder.finish(),
            Self::Array(Array { path, vertices, values }) => {
                npy::write(&path, &[values.len() / (3 * vertices), vertices, 3], &values)
            }
        }
    }
}

/// Frames as an array.
pub struct Array {
    path: PathBuf,
    vertices: usize,
    values: Vec<f64>,
}

/// A folder of PLY files in the making.
pub struct Folder {
    path: PathBuf,
    temporary: TempDir,
    mesh: TriangleMesh,
    next: usize,
    digits: usize,
}

/// An error of the file system at `path`.
pub(super) fn not_writable(path: &Path, error: &io::Error) -> FileError {
    let problem = format!("cannot be written ({error})");
    Fault::new(problem, "check its folder, permissions and free space").in_file(path)
}

/// Whether a file is one that an earlier animation left.
fn is_frame(name: &OsStr) -> bool {
    let number = name.to_str().and_then(|name| name.strip_prefix("frame_")?.strip_suffix(".ply"));
    number.is_some_and(|number| number.len() >= 4 && number.bytes().all(|b| b.is_ascii_digit()))
}

impl Folder {
    fn new(path: &Path, mesh: &TriangleMesh, frames: usize) -> Result<Self, FileError> {
        if path.exists() {
            let entries = std::fs::read_dir(path).and_then(Iterator::collect::<io::Result<Vec<_>>>);
            let entries = entries.map_err(|e| not_writable(path, &e))?;
            if let Some(other) = entries.iter().find(|entry| !is_frame(&entry.file_name())) {
                let problem = format!("holds other files ({})", other.file_name().display());
                return Err(Fault::new(problem, "name a new folder for the frames").in_file(path));
            }
        }
        let around = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        builder.prefix(".lapbench-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o777)); // less the umask, as any created folder
        }
        let temporary = builder.tempdir_in(around).map_err(|e| not_writable(path, &e))?;
        let digits = frames.saturating_sub(1).to_string().len().max(4);
        Ok(Self { path: path.to_owned(), temporary, mesh: mesh.clone(), next: 0, digits })
    }

    fn push(&mut self, positions: &[Vector]) -> Result<(), FileError> {
        let name = format!("frame_{:0digits$}.ply", self.next, digits = self.digits);
        let posed = self.mesh.with_positions(positions.to_vec()).map_err(|error| {
            Fault::new(format!("frame {} cannot be written ({error})", self.next), "check the motion")
                .in_file(&self.path)
        })?;
        self.next += 1;
        write_mesh(&self.temporary.path().join(name), &posed)
    }

    /// Puts the new folder into the place of an old one with frames only, which is removed afterwards.
    fn finish(self) -> Result<(), FileError> {
        let failed = |e: io::Error| not_writable(&self.path, &e);
        let fresh = self.temporary.keep();
        if !self.path.exists() {
            return std::fs::rename(&fresh, &self.path).map_err(failed);
        }
        let old = fresh.with_extension("old");
        std::fs::rename(&self.path, &old).map_err(failed)?;
        std::fs::rename(&fresh, &self.path).map_err(failed)?;
        std::fs::remove_dir_all(&old).map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh_io::frames;

    #[test]
    fn folders_appear_whole_replace_frames_and_spare_other_files() {
        let mesh = crate::mesh_source::load("sphere:0").unwrap().mesh;
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("walk");
        for count in [3, 2] {
            let mut sink = Sink::new(&path, &mesh, count, 30.0).unwrap();
            (0..count).for_each(|_| sink.push(mesh.positions()).unwrap());
            sink.finish().unwrap();
            let found = frames::read(&path, &mesh).unwrap();
            assert_eq!((found.len(), found.frame(0)), (count, mesh.positions()));
        }
        assert!(path.join("frame_0000.ply").exists() && std::fs::read_dir(home.path()).unwrap().count() == 1);
        let mut unfinished = Sink::new(&path, &mesh, 2, 30.0).unwrap();
        unfinished.push(mesh.positions()).unwrap();
        drop(unfinished);
        assert_eq!(std::fs::read_dir(home.path()).unwrap().count(), 1, "what is not finished leaves nothing");
        std::fs::write(path.join("notes.txt"), "mine").unwrap();
        assert!(Sink::new(&path, &mesh, 2, 30.0).err().unwrap().to_string().contains("notes.txt"));
        assert!(
            Sink::new(&home.path().join("a.fbx"), &mesh, 2, 30.0).err().unwrap().to_string().contains(".glb")
        );
    }

    #[test]
    fn arrays_have_one_row_per_frame() {
        let mesh = crate::mesh_source::load("sphere:0").unwrap().mesh;
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.npy");
        let mut sink = Sink::new(&path, &mesh, 2, 30.0).unwrap();
        (0..2).for_each(|_| sink.push(mesh.positions()).unwrap());
        sink.finish().unwrap();
        assert_eq!(frames::read(&path, &mesh).unwrap().len(), 2);
    }
}
