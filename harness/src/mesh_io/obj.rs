//! Wavefront OBJ: vertices and polygons in f64.
//!
//! Own reader instead of a crate: those that exist give no line numbers in errors, and positions and indices are all
//! we need. Normals, texture coordinates, materials, groups and curves are skipped; so are weights and colours
//! behind `x y z`.

use std::io::{self, Write};

use lapsolve::mesh::TriangleMesh;

use super::builder::{MeshBuilder, Parsed};
use super::note::{Finding, Tally};
use super::text::{Line, Lines, shown};
use crate::file::Fault;

/// Words a line may begin with that say nothing about the surface's vertices and faces.
const SKIPPED: [&[u8]; 38] = [
    b"vt",
    b"vn",
    b"vp",
    b"g",
    b"o",
    b"s",
    b"mg",
    b"usemtl",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"l",
    b"p",
    b"cstype",
    b"deg",
    b"bmat",
    b"step",
    b"curv",
    b"curv2",
    b"surf",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
    b"con",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"shadow_obj",
    b"trace_obj",
    b"ctech",
    b"stech",
    b"call",
    b"csh",
    b"vc",
];

/// Reads an OBJ file. Cost: one pass; memory at most eight times the file.
///
/// # Errors
/// A fault naming the line.
pub fn parse(bytes: &[u8]) -> Parsed {
    let mut builder = MeshBuilder::default();
    let mut unknown = Tally::default();
    let mut corners = Vec::new();
    let mut joined = Vec::new();
    let mut lines = Lines::new(bytes, 1);
    while let Some(mut line) = lines.next() {
        if line.text.ends_with(b"\\") {
            joined = join_continued(line, &mut lines, joined);
            line.text = &joined;
        }
        let line = line.without_comment();
        let mut tokens = line.tokens();
        match tokens.next() {
            None => {}
            Some(b"v") => builder.positions.push(line.point(&mut tokens)?),
            Some(b"f" | b"fo") => {
                corners.clear();
                for token in tokens {
                    corners.push(corner(&line, token, builder.positions.len())?);
                }
                builder.face(&corners, line.place());
            }
            Some(word) if SKIPPED.contains(&word) => {}
            Some(_) => unknown.add(line.place()),
        }
    }
    builder.notes.extend(unknown.note(Finding::UnknownLines));
    builder.finish()
}

/// The text of a line that ends in a backslash together with the lines that continue it.
fn join_continued(first: Line<'_>, lines: &mut Lines<'_>, mut joined: Vec<u8>) -> Vec<u8> {
    joined.clear();
    let mut part = Some(first);
    while let Some(line) = part {
        let continued = line.text.strip_suffix(b"\\");
        joined.extend_from_slice(continued.unwrap_or(line.text));
        joined.push(b' ');
        part = continued.and_then(|_| lines.next());
    }
    joined
}

/// The 0-based vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative v counts back from the last vertex.
fn corner(line: &Line<'_>, token: &[u8], vertices: usize) -> Result<u32, Fault> {
    let digits = token.split(|&b| b == b'/').next().unwrap_or_default();
    let number = line.integer(Some(digits), "vertex index")?;
    let index = if number < 0 { vertices as i64 + number } else { number - 1 };
    u32::try_from(index).map_err(|_| {
        let problem =
            format!("vertex index `{}` is out of range ({vertices} vertices so far)", shown(digits));
        line.fault(problem, "indices count from 1, or from -1 backwards")
    })
}

/// Writes `v` and `f` lines; 17 significant digits, so that reading gives every bit back.
///
/// # Errors
/// Those of `out`.
pub fn write(mesh: &TriangleMesh, out: &mut dyn Write) -> io::Result<()> {
    for [x, y, z] in mesh.positions() {
        writeln!(out, "v {x:.16e} {y:.16e} {z:.16e}")?;
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corner_forms_negative_indices_and_polygons() {
        let file = "# comment\nmtllib a.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.5 0.5 0.5 # colour\nv 0 1 0\nvt 0 0\n\
                    vn 0 0 1\ng part\nf 1/1/1 2//1 3/1 4\nf -4 -3 \\\n -2\r\nf 1 2\nbanana 1\n";
        let (mesh, notes) = parse(file.as_bytes()).unwrap();
        assert_eq!(mesh.positions().len(), 4);
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
        let found: Vec<_> = notes.iter().map(|n| (n.finding, n.count)).collect();
        assert_eq!(found, [(Finding::UnknownLines, 1), (Finding::Polygons, 1), (Finding::SmallFaces, 1)]);
    }

    #[test]
    fn faults_name_their_line() {
        for (file, line, part) in [
            ("v 0 0 0\nv 1 0\n", 2, "z coordinate"),
            ("v 0 0 nan\n", 1, "not finite"),
            ("v 0 0 1e999\n", 1, "not finite"),
            ("v 0 0 0\nf 1 2 0\n", 2, "count from 1"),
            ("v 0 0 0\nf -1 -1 -2\n", 2, "out of range"),
            ("v 0 0 0\n\nf 1 1 7\n", 3, "vertex 6"),
            ("f 1 2 x/y\n", 1, "no whole number"),
            ("f 1 2 99999999999\n", 1, "out of range"),
        ] {
            let fault = parse(file.as_bytes()).unwrap_err();
            assert_eq!(fault.place, Some(crate::file::Place::Line(line)), "{fault}");
            assert!(fault.to_string().contains(part), "{fault}");
        }
        assert!(parse(b"v 0 0 0\n").unwrap_err().to_string().contains("no triangles"));
    }

    #[test]
    fn what_is_written_reads_back_bit_by_bit() {
        let positions = vec![[0.1, -0.0, 1e-310], [f64::MAX, 1.0 / 3.0, -5e300], [1.0, 2.0, 3.0]];
        let mesh = TriangleMesh::new(positions, vec![[2, 1, 0]]).unwrap();
        let mut file = Vec::new();
        write(&mesh, &mut file).unwrap();
        assert_eq!(parse(&file).unwrap(), (mesh, vec![]));
    }
}
