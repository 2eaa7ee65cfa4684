//! What was found in a mesh file and what was done about it.

use std::fmt;

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
}

impl Finding {
    /// What was found, in the plural.
    pub fn text(self) -> &'static str {
        match self {
            Finding::OtherExtension => "file names with the extension of another format",
            Finding::TrailingBytes => "bytes after the end of the mesh",
            Finding::UnknownLines => "lines with an unknown first word",
            Finding::Polygons => "faces with more than three corners",
            Finding::SmallFaces => "faces with fewer than three corners",
            Finding::OtherPrimitives => "primitives of points or lines",
            Finding::RepeatedPositions => "vertices at the position of an earlier one",
        }
    }

    /// What was done about it.
    pub fn handling(self) -> &'static str {
        match self {
            Finding::OtherExtension => "read by content",
            Finding::TrailingBytes | Finding::UnknownLines => "ignored",
            Finding::Polygons => "cut into triangle fans at the first corner",
            Finding::SmallFaces | Finding::OtherPrimitives => "dropped",
            Finding::RepeatedPositions => "merged",
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
