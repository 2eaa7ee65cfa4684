//! PLY: ascii, binary little and big endian, any number types, properties and elements in any order.
//!
//! Read: `x y z` of element `vertex`, the list `vertex_indices` (or `vertex_index`) of `face`, and of `tristrips`
//! (strips separated by -1). Everything else is skipped. Written: binary little endian, `double` positions.

mod ascii;
mod binary;
mod header;
mod write;

pub use write::write;

use self::header::{Element, Encoding, Kind};
use super::builder::{MeshBuilder, Parsed};
use super::note::{Finding, Note};
use super::text::Lines;
use crate::file::{Fault, Place};

/// Reads a PLY file. Cost: one pass; memory at most eight times the file (positions stored as 8-bit integers).
///
/// # Errors
/// A fault naming line, byte or element.
pub fn parse(bytes: &[u8]) -> Parsed {
    let mut lines = Lines::new(bytes, 1);
    let header = header::parse(&mut lines)?;
    let mut builder = MeshBuilder::default();
    match header.encoding {
        Encoding::Ascii => ascii::read(&header.elements, &mut lines, &mut builder)?,
        Encoding::Little | Encoding::Big => {
            // In a file whose first line ends with a bare \r, a body that begins with byte 10 must keep it.
            let body = body_start(bytes, &lines);
            let left =
                binary::read(&header.elements, bytes, body, header.encoding == Encoding::Big, &mut builder)?;
            if left > 0 {
                let first = Some(Place::Byte(bytes.len() - left));
                builder.notes.push(Note { finding: Finding::TrailingBytes, count: left, first });
            }
        }
    }
    builder.finish()
}

fn body_start(bytes: &[u8], lines: &Lines<'_>) -> usize {
    let start = bytes.len() - lines.bytes_left();
    let bare_cr = bytes.get(3) == Some(&b'\r') && bytes.get(4) != Some(&b'\n');
    if bare_cr && bytes[..start].ends_with(b"\r\n") { start - 1 } else { start }
}

/// What an element means for the mesh.
enum Role {
    /// Positions: where `x`, `y`, `z` stand among the properties.
    Vertices([usize; 3]),
    /// Polygons: where the list stands among the properties.
    Faces(usize),
    /// Triangle strips: likewise.
    Strips(usize),
    /// Nothing.
    Other,
}

fn role(element: &Element) -> Result<Role, Fault> {
    let list = || {
        let at = element.position(&["vertex_indices", "vertex_index"])?;
        matches!(element.properties[at].kind, Kind::List { .. }).then_some(at)
    };
    match element.name.as_str() {
        "vertex" => {
            let mut at = [0; 3];
            for (slot, name) in at.iter_mut().zip(["x", "y", "z"]) {
                let found =
                    element.position(&[name]).filter(|&i| matches!(element.properties[i].kind, Kind::One(_)));
                *slot = found.ok_or_else(|| {
                    Fault::new(format!("element vertex has no number `{name}`"), "positions need x, y and z")
                })?;
            }
            Ok(Role::Vertices(at))
        }
        "face" if element.count > 0 => list()
            .map(Role::Faces)
            .ok_or_else(|| Fault::new("element face has no list `vertex_indices`", "repair the header")),
        "tristrips" => Ok(list().map_or(Role::Other, Role::Strips)),
        _ => Ok(Role::Other),
    }
}

/// A vertex index from a number of any type.
fn index(value: f64, place: Place) -> Result<u32, Fault> {
    let index = value as u32; // saturates; the comparison finds whatever does not fit
    if f64::from(index) == value {
        return Ok(index);
    }
    Err(Fault::at(place, format!("names vertex {value}"), "indices are whole numbers from 0"))
}

/// The triangles of strips separated by -1, without those that repeat a vertex (they only join strips).
fn add_strips(values: &[f64], place: Place, builder: &mut MeshBuilder) -> Result<(), Fault> {
    for strip in values.split(|&value| value == -1.0) {
        for (k, window) in strip.windows(3).enumerate() {
            let [a, b, c] = [index(window[0], place)?, index(window[1], place)?, index(window[2], place)?];
            if a != b && b != c && c != a {
                builder.triangle(if k % 2 == 0 { [a, b, c] } else { [b, a, c] }, place);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]];

    /// A square as a quad and a triangle, with properties and elements a reader must skip.
    fn decorated(big: bool) -> Vec<u8> {
        let name = if big { "binary_big_endian" } else { "binary_little_endian" };
        let mut file = format!(
            "ply\r\nformat {name} 1.0\r\ncomment made by hand\r\nelement camera 2\r\nproperty list ushort double lens\r\n\
             property uchar id\r\nelement vertex 4\r\nproperty uchar red\r\nproperty double z\r\nproperty short x\r\n\
             property float y\r\nelement face 2\r\nproperty float quality\r\nproperty list uint ushort vertex_indices\r\n\
             property list uchar float texcoord\r\nend_header\r\n"
        )
        .into_bytes();
        macro_rules! put {
            ($value:expr) => {
                file.extend(if big { $value.to_be_bytes() } else { $value.to_le_bytes() })
            };
        }
        for lenses in [0u16, 3] {
            put!(lenses);
            (0..lenses).for_each(|_| put!(1.5f64));
            put!(7u8);
        }
        for [x, y, z] in SQUARE {
            put!(255u8);
            put!(z);
            put!((x as i16));
            put!((y as f32));
        }
        for face in [&[0u16, 1, 2, 3][..], &[0, 2, 1]] {
            put!(0.5f32);
            put!((face.len() as u32));
            face.iter().for_each(|v| put!(*v));
            put!(2u8);
            put!(0.0f32);
            put!(1.0f32);
        }
        file
    }

    #[test]
    fn any_types_order_and_byte_order() {
        for big in [false, true] {
            let (mesh, notes) = parse(&decorated(big)).unwrap();
            assert_eq!(mesh.positions(), SQUARE);
            assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3], [0, 2, 1]]);
            assert_eq!(
                notes,
                [Note { finding: Finding::Polygons, count: 1, first: Some(Place::Element("face", 0)) }]
            );
        }
    }

    #[test]
    fn every_truncation_is_an_error() {
        let file = decorated(false);
        for length in 0..file.len() {
            assert!(parse(&file[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn what_is_written_reads_back_bit_by_bit() {
        let positions = vec![[0.1, -0.0, 1e-310], [f64::MAX, 1.0 / 3.0, -5e300], [1.0, 2.0, 3.0]];
        let mesh = lapsolve::mesh::TriangleMesh::new(positions, vec![[2, 1, 0]]).unwrap();
        let mut file = Vec::new();
        write(&mesh, &mut file).unwrap();
        let (read, notes) = parse(&file).unwrap();
        assert_eq!(read.triangles(), mesh.triangles());
        let bits = |m: &lapsolve::mesh::TriangleMesh| {
            m.positions().as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&read), bits(&mesh));
        assert_eq!(notes, []);
    }

    #[test]
    fn promises_cost_nothing() {
        for (vertices, faces) in [(4_000_000_000u64, 1), (3, 4_000_000_000), (u64::MAX >> 1, u64::MAX >> 1)] {
            for format in ["ascii", "binary_little_endian"] {
                let file = format!(
                    "ply\nformat {format} 1.0\nelement nothing {vertices}\nelement vertex {vertices}\nproperty float x\n\
                     property float y\nproperty float z\nelement face {faces}\n\
                     property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n      "
                );
                let fault = parse(file.as_bytes()).unwrap_err();
                assert!(fault.to_string().contains("header"), "{fault}");
            }
        }
    }

    #[test]
    fn strips_alternate_and_drop_their_joints() {
        let file = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                    element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                    0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 2 0\n9 0 1 2 3 3 -1 2 3 4\n";
        let (mesh, _) = parse(file.as_bytes()).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
    }
}
