//! Collects the vertices and faces of a file into a checked mesh.

use lapsolve::mesh::{MeshError, TriangleMesh};

use super::note::{Finding, Note, Tally};
use crate::file::{Fault, Place};

/// A mesh under construction. Faces may name vertices that are added later.
#[derive(Default)]
pub struct MeshBuilder {
    /// Vertex positions so far.
    pub positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// The highest vertex index so far and the face that names it.
    highest: Option<(u32, Place)>,
    polygons: Tally,
    small_faces: Tally,
    /// What the reader itself found.
    pub notes: Vec<Note>,
}

/// What a reader returns.
pub type Parsed = Result<(TriangleMesh, Vec<Note>), Fault>;

impl MeshBuilder {
    /// Makes room for triangles the reader has seen the bytes of.
    pub fn reserve_triangles(&mut self, count: usize) {
        self.triangles.reserve(count);
    }

    /// Adds a triangle.
    #[inline]
    pub fn triangle(&mut self, corners: [u32; 3], place: Place) {
        let high = corners[0].max(corners[1]).max(corners[2]);
        if self.highest.is_none_or(|(highest, _)| high > highest) {
            self.highest = Some((high, place));
        }
        self.triangles.push(corners);
    }

    /// Adds a face of any number of corners: a fan of triangles at its first corner, right for convex faces.
    pub fn face(&mut self, corners: &[u32], place: Place) {
        match corners {
            &[a, b, c] => return self.triangle([a, b, c], place),
            [] | [_] | [_, _] => return self.small_faces.add(place),
            _ => self.polygons.add(place),
        }
        for pair in corners[1..].windows(2) {
            self.triangle([corners[0], pair[0], pair[1]], place);
        }
    }

    /// Checks what was collected.
    ///
    /// # Errors
    /// A fault naming the face with the highest index when that is out of range, the first vertex that is not finite,
    /// or the lack of triangles.
    pub fn finish(mut self) -> Parsed {
        let vertices = self.positions.len();
        if let Some((index, place)) = self.highest.filter(|&(index, _)| index as usize >= vertices) {
            let problem = format!("names vertex {index} (0-based), but the file has {vertices} vertices");
            return Err(Fault::at(place, problem, "correct the index or restore the missing vertices"));
        }
        self.notes.extend(self.polygons.note(Finding::Polygons));
        self.notes.extend(self.small_faces.note(Finding::SmallFaces));
        match TriangleMesh::new(self.positions, self.triangles) {
            Ok(mesh) => Ok((mesh, self.notes)),
            Err(error) => Err(explain(&error)),
        }
    }
}

/// Says a [`MeshError`] as a fault of the file.
fn explain(error: &MeshError) -> Fault {
    match *error {
        MeshError::NonFinite { vertex } => Fault::at(
            Place::Element("vertex", vertex),
            "has a coordinate that is NaN or infinite",
            "remove the vertex or repair the file",
        ),
        MeshError::Empty => {
            Fault::new("has no triangles", "a surface is needed; point clouds and lines are none")
        }
        MeshError::TooLarge { .. } | MeshError::IndexOutOfRange { .. } => {
            Fault::new(error.to_string(), "split or repair the mesh")
        }
    }
}
