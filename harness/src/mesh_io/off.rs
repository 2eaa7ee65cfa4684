//! OFF and its variants: `OFF`, with `C` (colours), `N` (normals), `ST` (texture coordinates) before it, as text.
//!
//! One vertex or face to a line, `#` comments anywhere; what follows `x y z` or the corners is skipped. The counts
//! may stand behind the keyword; the keyword may be missing.

use super::builder::{MeshBuilder, Parsed};
use super::note::{Finding, Tally};
use super::text::{Line, Lines, shown};
use crate::file::Fault;

/// Whether a file that begins with `word` is OFF, of a kind supported here or not.
pub fn is_keyword(word: &[u8]) -> bool {
    word.strip_suffix(b"OFF").is_some_and(|mut before| {
        for prefix in [&b"ST"[..], b"C", b"N", b"4", b"n"] {
            before = before.strip_prefix(prefix).unwrap_or(before);
        }
        before.is_empty()
    })
}

/// Reads an OFF file. Cost: one pass; memory at most six times the file.
///
/// # Errors
/// A fault naming the line.
pub fn parse(bytes: &[u8]) -> Parsed {
    let mut lines = Lines::new(bytes, 1);
    let [vertices, faces] = header(&mut lines)?;
    // "0 0 0\n" and "3 0 1 2\n" are the shortest vertex and triangle; a file may lack the last line's end.
    let least = vertices.checked_mul(6).zip(faces.checked_mul(2)).and_then(|(v, f)| v.checked_add(f));
    if least.is_none_or(|least| least > lines.bytes_left() + 1) {
        return Err(cut_off(vertices, faces, lines.number()));
    }
    let mut builder = MeshBuilder::default();
    let mut filled = lines.map(Line::without_comment).filter(|line| line.tokens().next().is_some());
    let mut last = 0;
    let mut next = || {
        let line = filled.next().ok_or_else(|| cut_off(vertices, faces, last))?;
        last = line.number;
        Ok(line)
    };
    for _ in 0..vertices {
        let line = next()?;
        builder.positions.push(line.point(&mut line.tokens())?);
    }
    let mut corners = Vec::new();
    for _ in 0..faces {
        let line = next()?;
        let mut tokens = line.tokens();
        let count = line.count(line.value(tokens.next(), "number of corners")?, "of corners")?;
        corners.clear();
        for _ in 0..count {
            corners.push(line.index(tokens.next(), "vertex index")?);
        }
        builder.face(&corners, line.place());
    }
    let mut rest = Tally::default();
    filled.for_each(|line| rest.add(line.place()));
    builder.notes.extend(rest.note(Finding::TrailingLines));
    builder.finish()
}

fn cut_off(vertices: usize, faces: usize, last_line: usize) -> Fault {
    let problem =
        format!("ends at line {last_line} before the {vertices} vertices and {faces} faces it promises");
    Fault::new(problem, "the file is cut off or its header wrong")
}

/// The numbers of vertices and faces.
fn header(lines: &mut Lines<'_>) -> Result<[usize; 2], Fault> {
    let mut next = || lines.by_ref().map(Line::without_comment).find(|line| line.tokens().next().is_some());
    let no_counts =
        || Fault::new("has no line with its numbers of vertices and faces", "the file is cut off");
    let mut line = next().ok_or_else(no_counts)?;
    let mut words = line.tokens().peekable();
    if let Some(keyword) = words.next_if(|word| word.ends_with(b"OFF")) {
        if !is_keyword(keyword) || keyword.iter().any(|b| b"4n".contains(b)) {
            let problem = format!("`{}` is not supported", shown(keyword));
            return Err(line.fault(problem, "save it as OFF with three coordinates"));
        }
        if words.peek() == Some(&&b"BINARY"[..]) {
            return Err(line.fault("binary OFF is not supported", "save it as text, or as PLY"));
        }
        if words.peek().is_none() {
            line = next().ok_or_else(no_counts)?;
            words = line.tokens().peekable();
        }
    }
    let mut counts = [0; 2];
    for (count, what) in counts.iter_mut().zip(["number of vertices", "number of faces"]) {
        *count = line.index(words.next(), what)? as usize;
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::Place;

    #[test]
    fn variants_comments_and_polygons() {
        for file in [
            "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0",
            "OFF 3 2 0\n# c\n0 0 0\n1 0 0 # here\n\n0 1 0\n3 0 1 2\n3 2 1 0\n",
            "3 2\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0\n",
            "# head\r\nSTCNOFF\r\n3 2 0\r\n0 0 0 1 0 0 255 0 0 255 .5 .5\r\n1 0 0\r\n0 1 0\r\n3 0 1 2 0.5 0.5 0.5\r\n3 2 1 0\r\n",
        ] {
            let (mesh, notes) = parse(file.as_bytes()).unwrap();
            assert_eq!(mesh.positions(), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
            assert_eq!(mesh.triangles(), [[0, 1, 2], [2, 1, 0]]);
            assert_eq!(notes, []);
        }
        let (mesh, notes) =
            parse(b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n2 0 1\nmore\n").unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
        let found: Vec<_> = notes.iter().map(|n| n.finding).collect();
        assert_eq!(found, [Finding::TrailingLines, Finding::Polygons, Finding::SmallFaces]);
    }

    #[test]
    fn faults_name_their_line() {
        for (file, line, part) in [
            ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", 4, "z coordinate"),
            ("OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n", 4, "not finite"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", 6, "vertex index"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", 6, "vertex 3"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n", 6, "out of range"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n1e9 0 1 2\n", 6, "cannot have"),
            ("OFF BINARY\n", 1, "binary"),
            ("4OFF\n3 1 0\n", 1, "not supported"),
            ("OFF\n-3 1 0\n", 2, "out of range"),
        ] {
            let fault = parse(file.as_bytes()).unwrap_err();
            assert_eq!(fault.place, Some(Place::Line(line)), "{fault}");
            assert!(fault.to_string().contains(part), "{fault}");
        }
        for file in
            ["OFF\n4000000000 4000000000 0\n0 0 0\n", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n#     \n", "OFF\n"]
        {
            assert!(parse(file.as_bytes()).unwrap_err().to_string().contains("cut off"));
        }
    }
}
