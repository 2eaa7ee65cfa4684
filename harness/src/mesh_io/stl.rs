//! STL, binary and ascii. Its triangles share no vertices, so equal positions are merged, in order of first appearance.
//!
//! Own reader instead of a crate: those that exist store f32, name no lines, and need the same checks around them.

use super::builder::{MeshBuilder, Parsed};
use super::note::{Finding, Note};
use super::text::{Line, Lines, shown};
use super::weld::Welder;
use crate::file::{Fault, Place};

const HEADER: usize = 84; // 80 bytes of anything, then the number of triangles
const ROW: usize = 50; // normal and three corners as f32, two bytes of anything

/// The words that lines of an ascii STL begin with, in any case.
const KEYWORDS: [&[u8]; 7] = [b"vertex", b"facet", b"endfacet", b"outer", b"endloop", b"solid", b"endsolid"];

/// Whether the length of the file is exactly that of the binary STL it may begin as.
pub fn is_binary(bytes: &[u8]) -> bool {
    promised(bytes).is_some_and(|count| count > 0 && bytes.len() as u64 == HEADER as u64 + count * ROW as u64)
}

/// Whether the file begins as an ascii STL: `solid`, and a facet soon after.
pub fn is_ascii(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"solid")
        && Lines::new(&bytes[..bytes.len().min(4096)], 1) // room for a long name and comment lines
            .any(|line| line.tokens().next().is_some_and(|word| word.eq_ignore_ascii_case(b"facet")))
}

fn promised(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().expect("4 bytes"))))
}

/// Reads an STL file: ascii if it begins as one and its length is not that of a binary one (binary files may also
/// begin with `solid`). Cost: one hash look-up per corner; memory at most five times a binary file.
///
/// # Errors
/// A fault naming line or byte.
pub fn parse(bytes: &[u8]) -> Parsed {
    let mut builder = MeshBuilder::default();
    let mut welder = Welder::default();
    if is_ascii(bytes) && !is_binary(bytes) {
        read_ascii(bytes, &mut builder, &mut welder)?;
    } else {
        read_binary(bytes, &mut builder, &mut welder)?;
    }
    if welder.merged > 0 {
        builder.notes.push(Note { finding: Finding::RepeatedPositions, count: welder.merged, first: None });
    }
    builder.finish()
}

fn read_binary(bytes: &[u8], builder: &mut MeshBuilder, welder: &mut Welder) -> Result<(), Fault> {
    let count = promised(bytes).ok_or_else(|| {
        Fault::new(
            "is neither ascii STL (no `solid` and `facet`) nor long enough for binary STL",
            "export it again",
        )
    })?;
    let rows = bytes[HEADER..].as_chunks::<ROW>().0;
    if count > rows.len() as u64 {
        let problem = format!("promises {count} triangles, but has bytes for {}", rows.len());
        return Err(Fault::at(Place::Byte(HEADER - 4), problem, "the file is cut off or no STL file"));
    }
    let rows = &rows[..count as usize];
    for (t, row) in rows.iter().enumerate() {
        let place = Place::Element("triangle", t);
        let numbers: &[[u8; 4]; 9] = row[12..48].as_chunks().0.try_into().expect("36 bytes");
        let numbers = numbers.map(|x| f64::from(f32::from_le_bytes(x)));
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(Fault::at(
                place,
                "has a coordinate that is NaN or infinite",
                "remove it or repair the file",
            ));
        }
        let mut corner = |i: usize| {
            let point = [numbers[i], numbers[i + 1], numbers[i + 2]];
            welder.vertex(point, point, builder)
        };
        let corners = [corner(0), corner(3), corner(6)];
        builder.triangle(corners, place);
    }
    let end = HEADER + rows.len() * ROW;
    if end < bytes.len() {
        let first = Some(Place::Byte(end));
        builder.notes.push(Note { finding: Finding::TrailingBytes, count: bytes.len() - end, first });
    }
    Ok(())
}

/// Facets are checked for having three vertices; the other keywords and the normals say nothing new.
fn read_ascii(bytes: &[u8], builder: &mut MeshBuilder, welder: &mut Welder) -> Result<(), Fault> {
    let mut corners = Vec::new();
    let mut open: Option<Line<'_>> = None;
    for line in Lines::new(bytes, 1) {
        let mut tokens = line.tokens();
        let Some(word) = tokens.next() else { continue };
        let keyword = KEYWORDS.into_iter().find(|keyword| word.eq_ignore_ascii_case(keyword));
        match keyword.unwrap_or_default() {
            b"vertex" => {
                if open.is_none() {
                    return Err(line.fault("a vertex outside of a facet", "repair or export the file again"));
                }
                let point = line.point(&mut tokens)?;
                corners.push(welder.vertex(point, point, builder));
            }
            b"facet" => match open.replace(line) {
                None => corners.clear(),
                Some(_) => {
                    return Err(line.fault("a facet within a facet", "repair or export the file again"));
                }
            },
            b"endfacet" => {
                let &[a, b, c] = &corners[..] else {
                    let problem = format!("ends a facet with {} vertices", corners.len());
                    return Err(line.fault(problem, "facets have three vertices"));
                };
                if open.take().is_none() {
                    return Err(
                        line.fault("ends a facet that did not begin", "repair or export the file again")
                    );
                }
                builder.triangle([a, b, c], line.place());
            }
            b"solid" | b"endsolid" | b"outer" | b"endloop" => {}
            // Continuation of a title or a comment some programs write; within a facet nothing else may stand.
            _ if open.is_none() => {}
            _ => {
                let problem = format!("`{}` is no word of an ascii STL facet", shown(word));
                return Err(line.fault(problem, "repair or export the file again"));
            }
        }
    }
    match open {
        None => Ok(()),
        Some(line) => Err(line.fault("begins a facet that does not end", "the file is cut off")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [[[f32; 3]; 3]; 2] = [
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[1.0, 0.0, -0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]],
    ];

    fn binary(title: &[u8]) -> Vec<u8> {
        let mut file = title.to_vec();
        file.resize(80, b' ');
        file.extend(2u32.to_le_bytes());
        for triangle in CORNERS {
            file.extend([0; 12]);
            triangle.as_flattened().iter().for_each(|x| file.extend(x.to_le_bytes()));
            file.extend([0; 2]);
        }
        file
    }

    fn ascii() -> String {
        let mut file = String::from("solid a name\n");
        for triangle in CORNERS {
            file += " facet normal 0 0 nan\n  outer loop\n";
            triangle.iter().for_each(|[x, y, z]| file += &format!("   Vertex {x} {y} {z:e}\n"));
            file += "  endloop\n endfacet\n";
        }
        file + "endsolid\n"
    }

    #[test]
    fn corners_are_merged_in_order_of_appearance() {
        for file in [binary(b"made by hand"), binary(b"solid facet"), ascii().into_bytes()] {
            let (mesh, notes) = parse(&file).unwrap();
            assert_eq!(mesh.positions(), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]]);
            assert_eq!(mesh.triangles(), [[0, 1, 2], [1, 3, 2]]);
            assert_eq!(notes, [Note { finding: Finding::RepeatedPositions, count: 2, first: None }]);
        }
    }

    #[test]
    fn damaged_files_are_errors() {
        let file = binary(b"");
        assert!((0..file.len()).all(|length| parse(&file[..length]).is_err()));
        let mut nan = binary(b"");
        nan[84 + 50 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(parse(&nan).unwrap_err().place, Some(Place::Element("triangle", 1)));
        let text = ascii();
        for (from, to, line) in [
            ("Vertex 1 0 0e0\n", "", 7),
            ("endfacet", "", 9),
            ("facet normal", "", 4),
            ("0 1 0e0", "0 1 x", 6),
            ("0 1 0e0", "0 1 inf", 6),
            ("endloop", "enloop", 7),
        ] {
            let fault = parse(text.replacen(from, to, 1).as_bytes()).unwrap_err();
            assert_eq!(fault.place, Some(Place::Line(line)), "{from}: {fault}");
        }
        assert!(parse(&text.as_bytes()[..text.len() - 30]).unwrap_err().to_string().contains("cut off"));
    }
}
