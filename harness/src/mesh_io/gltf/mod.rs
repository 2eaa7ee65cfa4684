//! glTF 2.0, as JSON (`.gltf`, buffers inside or beside it) and binary (`.glb`).
//!
//! The nodes of the default scene (else the first; without scenes all roots) are walked; every mesh on the way is placed by
//! the f64 product of its nodes' transforms, once per node that shows it. Triangles, strips and fans are read, points
//! and lines dropped. glTF splits vertices where normals or texture coordinates jump, so within one node equal
//! positions are merged. Skinned meshes come in their bind pose, without node transform; morph targets are skipped.

mod accessor;
mod animation;
mod buffers;
mod transform;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use ::gltf::mesh::Mode;
use ::gltf::{Document, Error, Gltf, Node, Primitive, Semantic, json};

use self::buffers::Buffers;
use self::transform::Transform;
use super::builder::{MeshBuilder, Parsed};
use super::frames::Frames;
use super::note::{Finding, Note, Tally};
use super::weld::Welder;
use crate::file::{Fault, Place};

/// Most vertices and triangles of a scene, every instance counted: a small file may show one mesh a million times.
const LARGEST: usize = 1 << 24;

/// Reads a glTF file; `folder` is where its external buffers lie, if it may have any.
///
/// # Errors
/// A fault naming node, accessor or buffer.
pub fn parse(bytes: &[u8], folder: Option<&Path>) -> Parsed {
    let (json, blob) = if bytes.starts_with(b"glTF") { split_binary(bytes)? } else { (bytes, None) };
    // The crate is given foreign bytes here and nowhere else; its lookups below follow indices it has validated.
    let document = match catch_unwind(|| validated(json)) {
        Ok(Ok(document)) => document,
        Ok(Err(error)) => return Err(unreadable(&explain(&error))),
        Err(_) => return Err(unreadable("its structure cannot be parsed")),
    };
    let scene = AssertUnwindSafe(|| Reader::new(&document, blob, folder)?.read(&document));
    catch_unwind(scene).unwrap_or_else(|_| Err(unreadable("its structure is inconsistent")))
}

/// Positions of the vertices over time, and frames per second; see `animation.rs`.
///
/// # Errors
/// A fault naming node, channel, accessor or buffer.
pub fn parse_animation(bytes: &[u8], folder: Option<&Path>) -> Result<(Frames, f64), Fault> {
    let (json, blob) = if bytes.starts_with(b"glTF") { split_binary(bytes)? } else { (bytes, None) };
    let document = match catch_unwind(|| validated(json)) {
        Ok(Ok(document)) => document,
        Ok(Err(error)) => return Err(unreadable(&explain(&error))),
        Err(_) => return Err(unreadable("its structure cannot be parsed")),
    };
    let frames = AssertUnwindSafe(|| animation::frames(&document, &Buffers::load(&document, blob, folder)?));
    catch_unwind(frames).unwrap_or_else(|_| Err(unreadable("its structure is inconsistent")))
}

/// The document that `text` describes, every index in it in range.
fn validated(text: &[u8]) -> Result<Document, Error> {
    let root = Gltf::from_slice_without_validation(text)?.document.into_json();
    // The crate's validation looks the positions of a primitive up before it has checked their index.
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    for (name, accessor) in primitives.flat_map(|primitive| &primitive.attributes) {
        if accessor.value() >= root.accessors.len() {
            let place = json::Path::new().field("meshes").field("primitives").key(&name.to_string());
            return Err(Error::Validation(vec![(place, json::validation::Error::IndexOutOfBounds)]));
        }
    }
    // It does not look at what the channels of animations move.
    let channels = root.animations.iter().flat_map(|animation| &animation.channels);
    for target in channels.map(|channel| &channel.target) {
        let place = json::Path::new().field("animations").field("channels").field("target");
        if target.node.value() >= root.nodes.len() {
            return Err(Error::Validation(vec![(
                place.field("node"),
                json::validation::Error::IndexOutOfBounds,
            )]));
        }
        if target.path == json::validation::Checked::Invalid {
            return Err(Error::Validation(vec![(place.field("path"), json::validation::Error::Invalid)]));
        }
    }
    Document::from_json(root)
}

fn unreadable(why: &str) -> Fault {
    Fault::new(format!("is no valid glTF 2.0 file ({why})"), "export it again")
}

/// The JSON and the binary chunk of a GLB file (glTF 2.0, section 4.4). Split here because the crate computes with the
/// lengths in the file before it checks them.
fn split_binary(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let word = |at: usize| {
        bytes.get(at..at + 4).map(|w| u32::from_le_bytes(w.try_into().expect("4 bytes")) as usize)
    };
    if word(4) != Some(2) {
        return Err(unreadable("the container is not of version 2"));
    }
    let length =
        word(8).filter(|&length| length <= bytes.len()).ok_or_else(|| unreadable("the file is cut off"))?;
    let (mut json, mut blob) = (None, None);
    let mut at = 12;
    while at < length {
        let (Some(size), Some(kind)) = (word(at), bytes.get(at + 4..at + 8)) else {
            return Err(unreadable("the header of a chunk is cut off"));
        };
        let chunk = bytes.get(at + 8..at + 8 + size).ok_or_else(|| unreadable("a chunk is cut off"))?;
        match kind {
            b"JSON" => json = json.or(Some(chunk)),
            b"BIN\0" => blob = blob.or(Some(chunk)),
            _ => {} // to be ignored, says the specification
        }
        at += 8 + size;
    }
    Ok((json.ok_or_else(|| unreadable("it has no JSON chunk"))?, blob))
}

/// The crate's validation names JSON places; the first says enough.
fn explain(error: &Error) -> String {
    match error {
        Error::Validation(list) if !list.is_empty() => format!("{}: {}", list[0].0, list[0].1),
        other => other.to_string(),
    }
}

struct Reader {
    buffers: Buffers,
    builder: MeshBuilder,
    merged: usize,
    other_primitives: Tally,
    /// Vertices and triangles so far, merged ones included.
    seen: usize,
}

impl Reader {
    fn new(document: &Document, blob: Option<&[u8]>, folder: Option<&Path>) -> Result<Self, Fault> {
        Ok(Self {
            buffers: Buffers::load(document, blob, folder)?,
            builder: MeshBuilder::default(),
            merged: 0,
            other_primitives: Tally::default(),
            seen: 0,
        })
    }

    fn read(mut self, document: &Document) -> Parsed {
        let mut visited = vec![false; document.nodes().len()];
        let mut pending: Vec<(Node<'_>, Transform)> = Vec::new();
        for root in roots(document) {
            pending.push((root, Transform::IDENTITY));
            while let Some((node, parent)) = pending.pop() {
                let place = Place::Element("node", node.index());
                if std::mem::replace(&mut visited[node.index()], true) {
                    return Err(Fault::at(
                        place,
                        "is reached twice",
                        "nodes must form trees; export the file again",
                    ));
                }
                let world = parent.then(&Transform::of(&node));
                self.read_node(&node, &world)?;
                // Last child first, so that the first is popped next: file order.
                let children: Vec<_> = node.children().collect();
                pending.extend(children.into_iter().rev().map(|child| (child, world)));
            }
        }
        self.finish()
    }

    fn read_node(&mut self, node: &Node<'_>, world: &Transform) -> Result<(), Fault> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let world = if node.skin().is_some() { &Transform::IDENTITY } else { world };
        let mut welder = Welder::default();
        for primitive in mesh.primitives() {
            self.read_primitive(&primitive, world, &mut welder, Place::Element("node", node.index()))?;
        }
        self.merged += welder.merged;
        Ok(())
    }

    fn read_primitive(
        &mut self,
        primitive: &Primitive<'_>,
        world: &Transform,
        welder: &mut Welder,
        place: Place,
    ) -> Result<(), Fault> {
        let Some(corners_of) = triangle_corners(primitive.mode()) else {
            self.other_primitives.add(place);
            return Ok(());
        };
        let positions = primitive.get(&Semantic::Positions).ok_or_else(|| {
            Fault::at(place, "shows a primitive without POSITION", "export it without compression")
        })?;
        let positions = accessor::positions(&positions, &self.buffers)?;
        let indices = match primitive.indices() {
            Some(indices) => Some(accessor::indices(&indices, &self.buffers)?),
            None => None,
        };
        let corners = indices.as_ref().map_or(positions.len(), Vec::len);
        self.seen = self.seen.saturating_add(positions.len()).saturating_add(corners);
        if self.seen > LARGEST {
            let problem = format!("brings the scene over {LARGEST} vertices and corners, instances included");
            return Err(Fault::at(place, problem, "split the scene"));
        }
        let vertices: Vec<u32> =
            positions.iter().map(|&p| welder.vertex(p, world.apply(p), &mut self.builder)).collect();
        let vertex = |corner: usize| {
            let index = indices.as_ref().map_or(corner, |indices| indices[corner] as usize);
            vertices.get(index).copied().ok_or_else(|| {
                let problem = format!("shows a primitive with vertex index {index} of {}", vertices.len());
                Fault::at(place, problem, "export the file again")
            })
        };
        for t in 0.. {
            let [a, b, c] = corners_of(t);
            if a.max(b).max(c) >= corners {
                break;
            }
            let (a, b, c) = (vertex(a)?, vertex(b)?, vertex(c)?);
            self.builder.triangle(if world.mirrors() { [a, c, b] } else { [a, b, c] }, place);
        }
        Ok(())
    }

    fn finish(mut self) -> Parsed {
        self.builder.notes.extend(self.other_primitives.note(Finding::OtherPrimitives));
        if self.merged > 0 {
            let note = Note { finding: Finding::RepeatedPositions, count: self.merged, first: None };
            self.builder.notes.push(note);
        }
        self.builder.finish()
    }
}

/// The nodes to start from.
fn roots(document: &Document) -> Vec<Node<'_>> {
    if let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) {
        return scene.nodes().collect();
    }
    let mut is_child = vec![false; document.nodes().len()];
    document.nodes().flat_map(|node| node.children()).for_each(|child| is_child[child.index()] = true);
    document.nodes().filter(|node| !is_child[node.index()]).collect()
}

/// Which corners triangle t of a primitive has (glTF 2.0, section 3.7.2.1); `None` for points and lines.
fn triangle_corners(mode: Mode) -> Option<fn(usize) -> [usize; 3]> {
    match mode {
        Mode::Triangles => Some(|t| [3 * t, 3 * t + 1, 3 * t + 2]),
        Mode::TriangleStrip => Some(|t| [t, t + 1 + t % 2, t + 2 - t % 2]),
        Mode::TriangleFan => Some(|t| [t + 1, t + 2, 0]),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => None,
    }
}

#[cfg(test)]
mod tests;
