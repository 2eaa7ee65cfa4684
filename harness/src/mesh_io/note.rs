//! What was found in a mesh file and what was done about it.

use std::fmt;

use lapsolve::topology::{Found, Topology};
use serde::Serialize;

use crate::file::Place;

/// Something about a mesh that its user should know, with how often it occurs and where first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// What was found.
    pub finding: Finding,
    /// How many of them.
    pub count: usize,
    /// The first one; `None` where there is no single place.
    pub first: Option<Place>,
}

/// The kinds of [`Note`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Finding {
    /// The content is of another format than the file name says.
    OtherExtension,
    /// Bytes after the end of the mesh.
    TrailingBytes,
    /// Lines after the end of the mesh.
    TrailingLines,
    /// Lines that begin with a word the format does not define.
    UnknownLines,
    /// Faces with more than three corners.
    Polygons,
    /// Faces with fewer than three corners.
    SmallFaces,
    /// Points and lines among the primitives of a file.
    OtherPrimitives,
    /// Vertices at exactly the position of an earlier one, in a format whose triangles share no vertices.
    RepeatedPositions,
    /// Vertices on no triangle that has an area.
    UnreferencedVertices,
    /// Triangles that name a vertex twice.
    RepeatedCorners,
    /// Triangles with 2 area <= 1e-8 (longest edge)^2.
    ZeroArea,
    /// Triangles with the vertices of an earlier one.
    DuplicateTriangles,
    /// Edges of more than two triangles.
    NonManifoldEdges,
    /// Vertices where several fans of triangles meet.
    NonManifoldVertices,
    /// Edges whose two triangles disagree about the outside.
    ClashingEdges,
    /// Closed curves of edges with one triangle.
    BoundaryLoops,
    /// Components beyond the first.
    MoreComponents,
}

impl Finding {
    /// What was found, in the plural.
    pub fn text(self) -> &'static str {
        match self {
            Finding::OtherExtension => "file names with the extension of another format",
            Finding::TrailingBytes => "bytes after the end of the mesh",
            Finding::TrailingLines => "lines after the end of the mesh",
            Finding::UnknownLines => "lines with an unknown first word",
            Finding::Polygons => "faces with more than three corners",
            Finding::SmallFaces => "faces with fewer than three corners",
            Finding::OtherPrimitives => "primitives of points or lines",
            Finding::RepeatedPositions => "vertices at the position of an earlier one",
            Finding::UnreferencedVertices => "vertices on no triangle with an area",
            Finding::RepeatedCorners => "triangles that name a vertex twice",
            Finding::ZeroArea => "triangles without area",
            Finding::DuplicateTriangles => "triangles with the vertices of an earlier one",
            Finding::NonManifoldEdges => "edges of more than two triangles",
            Finding::NonManifoldVertices => "vertices where several fans of triangles meet",
            Finding::ClashingEdges => "edges whose triangles disagree about the outside",
            Finding::BoundaryLoops => "boundary loops",
            Finding::MoreComponents => "components besides the first",
        }
    }

    /// What was done about it.
    pub fn handling(self) -> &'static str {
        match self {
            Finding::OtherExtension => "read by content",
            Finding::TrailingBytes | Finding::TrailingLines | Finding::UnknownLines => "ignored",
            Finding::Polygons => "cut into triangle fans at the first corner",
            Finding::SmallFaces | Finding::OtherPrimitives => "dropped",
            Finding::RepeatedPositions => "merged",
            Finding::UnreferencedVertices => {
                "kept; not in any system, their field is 0 and their position stays"
            }
            Finding::RepeatedCorners | Finding::ZeroArea => {
                "kept; contribute nothing and hold nothing together"
            }
            Finding::DuplicateTriangles | Finding::NonManifoldEdges => "kept; every triangle contributes",
            Finding::NonManifoldVertices | Finding::BoundaryLoops => "kept",
            Finding::ClashingEdges => "kept; cotangents do not depend on orientation",
            Finding::MoreComponents => "kept; each is solved on its own",
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.count, self.finding.text())?;
        if let Some(first) = self.first {
            write!(f, " (first: {first})")?;
        }
        write!(f, ": {}", self.finding.handling())
    }
}

/// The notes of a topology report: what a regular closed surface of one component would not have.
pub fn of_topology(topology: &Topology) -> impl Iterator<Item = Note> {
    let loops = Found { count: topology.boundary_loops, first: None };
    let more_components = Found { count: topology.components.saturating_sub(1), first: None };
    [
        (Finding::UnreferencedVertices, "vertex", topology.unreferenced_vertices),
        (Finding::RepeatedCorners, "triangle", topology.repeated_corners),
        (Finding::ZeroArea, "triangle", topology.zero_area),
        (Finding::DuplicateTriangles, "triangle", topology.duplicates),
        (Finding::NonManifoldEdges, "triangle", topology.non_manifold_edges),
        (Finding::NonManifoldVertices, "vertex", topology.non_manifold_vertices),
        (Finding::ClashingEdges, "triangle", topology.clashing_edges),
        (Finding::BoundaryLoops, "", loops),
        (Finding::MoreComponents, "", more_components),
    ]
    .into_iter()
    .filter(|(_, _, found)| found.count > 0)
    .map(|(finding, what, found)| Note {
        finding,
        count: found.count,
        first: found.first.map(|index| Place::Element(what, index as usize)),
    })
}

/// Counts occurrences and remembers the first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    count: usize,
    first: Option<Place>,
}

impl Tally {
    /// Counts one more.
    pub fn add(&mut self, place: Place) {
        self.count += 1;
        self.first = self.first.or(Some(place));
    }

    /// The note, unless nothing was counted.
    pub fn note(self, finding: Finding) -> Option<Note> {
        (self.count > 0).then_some(Note { finding, count: self.count, first: self.first })
    }
}
