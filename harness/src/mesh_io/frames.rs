//! Animations: positions of the same vertices over time.

use lapsolve::mesh::TriangleMesh;
use std::path::{Path, PathBuf};

use super::{Format, npy, read_mesh};
use crate::file::{Fault, FileError};

/// Positions of the same vertices over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    vertices: usize,
    positions: Vec<[f64; 3]>,
}

impl Frames {
    /// Takes over positions, frame after frame.
    ///
    /// # Panics
    /// If `positions` is no multiple of `vertices`, or `vertices` is 0.
    pub fn new(vertices: usize, positions: Vec<[f64; 3]>) -> Self {
        assert!(positions.len().is_multiple_of(vertices), "frames: the same number of vertices in each");
        Self { vertices, positions }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.positions.len() / self.vertices
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Vertices of each frame.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// The positions of frame `k`.
    pub fn frame(&self, k: usize) -> &[[f64; 3]] {
        &self.positions[k * self.vertices..][..self.vertices]
    }

    /// The frames in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[[f64; 3]]> {
        self.positions.chunks_exact(self.vertices)
    }
}

/// Reads frames of `mesh`: a `.npy` file of shape (frames, vertices, 3), a folder of mesh files in the order of their names
/// (`frame_0000.ply` ...), or an animated glTF file (see [`super::read_animation`]).
///
/// # Errors
/// [`FileError`] of whatever cannot be read, or has another number of vertices or other triangles.
pub fn read(path: &Path, mesh: &TriangleMesh) -> Result<Frames, FileError> {
    if path.is_dir() {
        return read_folder(path, mesh);
    }
    match Format::of_extension(path) {
        Some(Format::Gltf) => super::read_animation(path, mesh).map(|(frames, _)| frames),
        _ => read_npy(path, mesh.positions().len()),
    }
}

fn read_npy(path: &Path, vertices: usize) -> Result<Frames, FileError> {
    let array = npy::read(path)?;
    match array.shape[..] {
        [frames, n, 3] if n == vertices && n > 0 && frames > 0 => {
            Ok(Frames::new(vertices, array.values.as_chunks().0.to_vec()))
        }
        _ => {
            let problem = format!("has shape {:?}, expected (frames, {vertices}, 3)", array.shape);
            Err(Fault::new(problem, "the frames must have the vertices of the mesh they move").in_file(path))
        }
    }
}

fn read_folder(folder: &Path, template: &TriangleMesh) -> Result<Frames, FileError> {
    let vertices = template.positions().len();
    let unreadable = |e: std::io::Error| {
        Fault::new(format!("cannot be read ({e})"), "check the folder and its permissions").in_file(folder)
    };
    let entries: Result<Vec<_>, _> =
        std::fs::read_dir(folder).and_then(Iterator::collect).map_err(unreadable);
    let mut files: Vec<PathBuf> = entries?.iter().map(std::fs::DirEntry::path).collect();
    files.retain(|file| Format::of_extension(file).is_some());
    files.sort();
    let mut positions = Vec::new();
    for file in &files {
        let mesh = read_mesh(file)?.mesh;
        let found = mesh.positions().len();
        if found != vertices {
            let problem = format!("has {found} vertices, but the mesh that it moves has {vertices}");
            return Err(Fault::new(problem, "export all frames with the same vertices").in_file(file));
        }
        if mesh.triangles() != template.triangles() {
            let remedy = "export all frames with the connectivity of the reference pose";
            return Err(Fault::new("has other triangles than the mesh that it moves", remedy).in_file(file));
        }
        positions.extend_from_slice(mesh.positions());
    }
    if positions.is_empty() {
        return Err(Fault::new("holds no mesh files", "name a folder of frames").in_file(folder));
    }
    Ok(Frames::new(vertices, positions))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh_io::write_mesh;

    fn mesh(vertices: usize, shift: f64) -> TriangleMesh {
        TriangleMesh::new((0..vertices).map(|i| [i as f64, shift, 0.0]).collect(), vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn folders_in_the_order_of_names_and_arrays() {
        let folder = tempfile::tempdir().unwrap();
        let three = mesh(3, 0.0);
        assert!(read(folder.path(), &three).unwrap_err().to_string().contains("no mesh files"));
        for (name, shift) in [("frame_0001.obj", 2.0), ("frame_0000.ply", 1.0), ("frame_0010.ply", 3.0)] {
            write_mesh(&folder.path().join(name), &mesh(3, shift)).unwrap();
        }
        std::fs::write(folder.path().join("readme.txt"), "no frame").unwrap();
        let frames = read(folder.path(), &three).unwrap();
        assert_eq!(frames.iter().map(|frame| frame[0][1]).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
        assert!(read(folder.path(), &mesh(4, 0.0)).unwrap_err().to_string().contains("frame_0000.ply"));
        let turned = TriangleMesh::new(three.positions().to_vec(), vec![[0, 2, 1]]).unwrap();
        assert!(read(folder.path(), &turned).unwrap_err().to_string().contains("other triangles"));

        let array = folder.path().join("frames.npy");
        npy::write(&array, &[2, 3, 3], &[0.5; 18]).unwrap();
        assert_eq!(read(&array, &three).unwrap(), Frames::new(3, vec![[0.5; 3]; 6]));
        assert!(read(&array, &mesh(4, 0.0)).unwrap_err().to_string().contains("(frames, 4, 3)"));
    }
}
