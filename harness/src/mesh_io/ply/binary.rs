//! The body of a binary PLY file.

use super::header::{Element, Kind, Scalar};
use super::{Role, add_strips, index, role};
use crate::file::{Fault, Place};
use crate::mesh_io::builder::MeshBuilder;

/// Reads all elements from byte `start`; returns how many bytes follow them.
///
/// # Errors
/// A fault naming byte or element.
pub fn read(
    elements: &[Element],
    bytes: &[u8],
    start: usize,
    big: bool,
    builder: &mut MeshBuilder,
) -> Result<usize, Fault> {
    let mut body = Body { bytes, at: start, big };
    for element in elements {
        let least = element.count.checked_mul(element.least_row_bytes());
        if least.is_none_or(|least| least > body.left()) {
            let problem = format!(
                "the {} elements `{}` the header promises need more than the {} bytes left",
                element.count,
                element.name,
                body.left()
            );
            return Err(Fault::at(Place::Byte(body.at), problem, "the file is cut off or its header wrong"));
        }
        match (role(element)?, element.fixed_row_bytes()) {
            (Role::Vertices(at), Some(row)) => {
                let rows = body.take(element.count * row)?;
                read_positions(element, at, rows, row, big, &mut builder.positions);
            }
            (Role::Vertices(at), None) => body.vertices_with_lists(element, at, builder)?,
            (Role::Faces(list), _) => body.faces(element, list, builder)?,
            (Role::Strips(list), _) => body.strips(element, list, builder)?,
            (Role::Other, Some(row)) => _ = body.take(element.count * row)?,
            (Role::Other, None) => {
                for _ in 0..element.count {
                    body.row(element, |_, _| {})?;
                }
            }
        }
    }
    Ok(body.left())
}

/// Positions from rows of `row` bytes each. The two layouts that nearly every file has are read as whole arrays.
fn read_positions(
    element: &Element,
    at: [usize; 3],
    rows: &[u8],
    row: usize,
    big: bool,
    positions: &mut Vec<[f64; 3]>,
) {
    let fields = at.map(|i| {
        let before = Element { properties: element.properties[..i].to_vec(), ..element.clone() };
        match element.properties[i].kind {
            Kind::One(scalar) => (scalar, before.least_row_bytes()),
            Kind::List { .. } => unreachable!("a row of fixed size has no lists"),
        }
    });
    let first = fields[0].1;
    let together = |scalar: Scalar| !big && (0..3).all(|i| fields[i] == (scalar, first + i * scalar.size()));
    let rows = rows.chunks_exact(row);
    if together(Scalar::F32) {
        positions.extend(rows.map(|r| {
            let xyz: &[[u8; 4]; 3] = r[first..first + 12].as_chunks().0.try_into().expect("12 bytes");
            xyz.map(|x| f64::from(f32::from_le_bytes(x)))
        }));
    } else if together(Scalar::F64) {
        positions.extend(rows.map(|r| {
            let xyz: &[[u8; 8]; 3] = r[first..first + 24].as_chunks().0.try_into().expect("24 bytes");
            xyz.map(f64::from_le_bytes)
        }));
    } else {
        positions.extend(rows.map(|r| fields.map(|(scalar, offset)| scalar.read(&r[offset..], big))));
    }
}

/// The part of the file not yet read.
struct Body<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
}

impl<'a> Body<'a> {
    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let taken = self.bytes[self.at..].get(..count).ok_or_else(|| {
            Fault::at(
                Place::Byte(self.at),
                "the file ends in the middle of an element",
                "the file is cut off",
            )
        })?;
        self.at += count;
        Ok(taken)
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64, Fault> {
        Ok(scalar.read(self.take(scalar.size())?, self.big))
    }

    /// Length and bytes of a list.
    fn list(&mut self, length: Scalar, item: Scalar) -> Result<&'a [u8], Fault> {
        let at = self.at;
        let length = self.number(length)?;
        // Negative and NaN become 0 by the cast, a fraction is cut; neither equals what was read.
        let count = length as usize;
        if count as f64 != length {
            return Err(Fault::at(Place::Byte(at), format!("a list of length {length}"), "repair the file"));
        }
        let bytes = count.saturating_mul(item.size());
        self.take(bytes).map_err(|_| {
            let problem = format!("a list of {count} values is longer than the file");
            Fault::at(Place::Byte(at), problem, "the file is cut off or damaged before this place")
        })
    }

    /// Reads one row and hands each property's bytes over: a list without its length.
    fn row(&mut self, element: &Element, mut use_property: impl FnMut(usize, &'a [u8])) -> Result<(), Fault> {
        for (i, property) in element.properties.iter().enumerate() {
            let bytes = match property.kind {
                Kind::One(scalar) => self.take(scalar.size())?,
                Kind::List { length, item } => self.list(length, item)?,
            };
            use_property(i, bytes);
        }
        Ok(())
    }

    fn vertices_with_lists(
        &mut self,
        element: &Element,
        at: [usize; 3],
        builder: &mut MeshBuilder,
    ) -> Result<(), Fault> {
        let big = self.big;
        for _ in 0..element.count {
            let mut point = [0.0; 3];
            self.row(element, |i, bytes| {
                if let (Some(axis), Kind::One(scalar)) =
                    (at.iter().position(|&place| place == i), element.properties[i].kind)
                {
                    point[axis] = scalar.read(bytes, big);
                }
            })?;
            builder.positions.push(point);
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element, list: usize, builder: &mut MeshBuilder) -> Result<(), Fault> {
        let mut done = 0;
        if let [property] = &element.properties[..]
            && let Kind::List { length: Scalar::U8 | Scalar::I8, item: Scalar::I32 | Scalar::U32 } =
                property.kind
            && !self.big
        {
            done = self.plain_triangles(element.count, builder);
        }
        let mut corners = Vec::new();
        for face in done..element.count {
            let place = Place::Element("face", face);
            corners.clear();
            for value in self.list_of_row(element, list)? {
                corners.push(index(value, place)?);
            }
            builder.face(&corners, place);
        }
        Ok(())
    }

    /// The commonest layout, one byte of length and 32-bit indices, as long as the faces are triangles with indices
    /// below 2^31. Returns how many were read; 13 bytes each. The caller goes on with the next, of whatever kind.
    fn plain_triangles(&mut self, count: usize, builder: &mut MeshBuilder) -> usize {
        builder.reserve_triangles(count.min(self.left() / 13));
        let rows = self.bytes[self.at..].as_chunks::<13>().0;
        let mut read = 0;
        for (face, row) in rows.iter().take(count).enumerate() {
            let [3, corners @ ..] = row else { break };
            let corners: &[[u8; 4]; 3] = corners.as_chunks().0.try_into().expect("12 bytes");
            let corners = corners.map(u32::from_le_bytes);
            if corners.iter().any(|&v| v > i32::MAX as u32) {
                break;
            }
            builder.triangle(corners, Place::Element("face", face));
            read += 1;
        }
        self.at += 13 * read;
        read
    }

    fn strips(&mut self, element: &Element, list: usize, builder: &mut MeshBuilder) -> Result<(), Fault> {
        for strip in 0..element.count {
            let values: Vec<f64> = self.list_of_row(element, list)?.collect();
            add_strips(&values, Place::Element("strip", strip), builder)?;
        }
        Ok(())
    }

    /// Reads one row; the values of its property `list`.
    fn list_of_row(
        &mut self,
        element: &Element,
        list: usize,
    ) -> Result<impl Iterator<Item = f64> + use<'a>, Fault> {
        let Kind::List { item, .. } = element.properties[list].kind else {
            unreachable!("the role of the element was given for its list")
        };
        let mut found: &[u8] = &[];
        self.row(element, |i, bytes| {
            if i == list {
                found = bytes;
            }
        })?;
        let big = self.big;
        Ok(found.chunks_exact(item.size()).map(move |bytes| item.read(bytes, big)))
    }
}
