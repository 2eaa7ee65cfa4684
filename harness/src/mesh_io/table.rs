//! Text tables: constraints (`vertex, g_1 .. g_k`), pairs of indices, columns of numbers.
//!
//! In: values separated by a comma, blanks or tabs; one optional header line; `#` starts a comment; blank lines are
//! skipped; indices count from 0. Out: commas, 17 significant digits, no header.

use std::path::Path;

use super::text::{Line, Lines};
use crate::file::{self, Fault, FileError};

/// Dirichlet constraints: vertices in ascending order, each with k values.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraints {
    /// Constrained vertices, ascending, each once.
    pub vertices: Vec<u32>,
    /// Their values, `vertices.len()` x k, vertex-major.
    pub values: Vec<f64>,
    /// Values per vertex, at least 1.
    pub k: usize,
}

/// Reads constraints of a mesh with `n` vertices.
///
/// # Errors
/// [`FileError`] naming the line of a malformed row, a vertex out of range or given twice, or a value that is not
/// finite; and for a file without rows.
pub fn read_constraints(path: &Path, n: usize) -> Result<Constraints, FileError> {
    parse_constraints(&file::read(path)?, n).map_err(|fault| fault.in_file(path))
}

/// Reads pairs `(a, b)` with `a < limits[0]` and `b < limits[1]`, in file order. A first line that holds one number,
/// as some published lists do, must be the number of pairs.
///
/// # Errors
/// [`FileError`] naming the line of a malformed row or an index out of range; and for a file without pairs.
pub fn read_pairs(path: &Path, limits: [usize; 2]) -> Result<Vec<[u32; 2]>, FileError> {
    parse_pairs(&file::read(path)?, limits).map_err(|fault| fault.in_file(path))
}

/// Reads columns: `n` rows, in vertex order, of the same number k of values. Returns k and the values, vertex-major.
///
/// # Errors
/// [`FileError`] naming the line of a malformed row, and for another number of rows.
pub fn read_columns(path: &Path, n: usize) -> Result<(usize, Vec<f64>), FileError> {
    parse_columns(&file::read(path)?, n).map_err(|fault| fault.in_file(path))
}

/// Reads rows of the same number k of values, as many as there are (at least one). Returns k and the values, row after row.
///
/// # Errors
/// [`FileError`] naming the line of a malformed row; and for a file without rows.
pub fn read_rows(path: &Path) -> Result<(usize, Vec<f64>), FileError> {
    parse_rows(&file::read(path)?).map_err(|fault| fault.in_file(path))
}

/// Reads vertices of a mesh with `n`, one per row, in file order.
///
/// # Errors
/// [`FileError`] naming the line of a malformed row or a vertex out of range; and for a file without rows.
pub fn read_vertices(path: &Path, n: usize) -> Result<Vec<u32>, FileError> {
    parse_vertices(&file::read(path)?, n).map_err(|fault| fault.in_file(path))
}

/// Writes pairs of indices under a header line, atomically.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
pub fn write_pairs(path: &Path, header: &str, pairs: &[(u32, u32)]) -> Result<(), FileError> {
    file::write_atomically(path, |out| {
        writeln!(out, "{header}")?;
        pairs.iter().try_for_each(|(a, b)| writeln!(out, "{a},{b}"))
    })
}

/// Writes rows of k values, atomically.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
///
/// # Panics
/// If `values` is no multiple of `k`.
pub fn write_columns(path: &Path, values: &[f64], k: usize) -> Result<(), FileError> {
    assert!(values.len().is_multiple_of(k), "values: k in each row");
    file::write_atomically(path, |out| {
        for row in values.chunks_exact(k) {
            for (i, value) in row.iter().enumerate() {
                write!(out, "{}{value:.16e}", if i == 0 { "" } else { "," })?;
            }
            writeln!(out)?;
        }
        Ok(())
    })
}

/// See [`read_constraints`].
///
/// # Errors
/// A fault naming the line.
pub fn parse_constraints(bytes: &[u8], n: usize) -> Result<Constraints, Fault> {
    let mut rows: Vec<(u32, Line<'_>)> = Vec::new();
    let mut k = 0;
    for line in data_lines(bytes) {
        let fields = Fields::of(line);
        let vertex = in_range(&line, fields.clone().next(), "vertex", n)?;
        let values = fields.count() - 1;
        if values == 0 {
            return Err(line.fault("a vertex without a value", "write rows `vertex, g_1 .. g_k`"));
        }
        if !rows.is_empty() && values != k {
            return Err(
                line.fault(format!("{values} values, but the rows before have {k}"), "complete the rows")
            );
        }
        k = values;
        rows.push((vertex, line));
    }
    if rows.is_empty() {
        return Err(Fault::new("has no constraints", "write rows `vertex, g_1 .. g_k`"));
    }
    rows.sort_by_key(|&(vertex, _)| vertex); // stable: of equal ones the later line comes second
    if let Some(twice) = rows.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let problem = format!("vertex {} was already given in line {}", twice[0].0, twice[0].1.number);
        return Err(twice[1].1.fault(problem, "remove one of the two"));
    }
    let mut values = Vec::with_capacity(rows.len() * k);
    for (_, line) in &rows {
        for field in Fields::of(*line).skip(1) {
            values.push(line.finite(Some(field), "value")?);
        }
    }
    Ok(Constraints { vertices: rows.iter().map(|&(vertex, _)| vertex).collect(), values, k })
}

/// See [`read_columns`].
///
/// # Errors
/// A fault naming the line.
pub fn parse_columns(bytes: &[u8], n: usize) -> Result<(usize, Vec<f64>), Fault> {
    let (rows, k, values) = parse_at_most(bytes, n)?;
    if rows < n {
        return Err(Fault::new(format!("has {rows} rows, expected {n}"), "give one row per vertex"));
    }
    Ok((k, values))
}

/// See [`read_rows`].
///
/// # Errors
/// A fault naming the line.
pub fn parse_rows(bytes: &[u8]) -> Result<(usize, Vec<f64>), Fault> {
    match parse_at_most(bytes, usize::MAX)? {
        (0, ..) => Err(Fault::new("has no rows", "write numbers separated by commas, one row per line")),
        (_, k, values) => Ok((k, values)),
    }
}

/// See [`read_vertices`].
///
/// # Errors
/// A fault naming the line.
pub fn parse_vertices(bytes: &[u8], n: usize) -> Result<Vec<u32>, Fault> {
    let mut vertices = Vec::new();
    for line in data_lines(bytes) {
        let mut fields = Fields::of(line);
        vertices.push(in_range(&line, fields.next(), "vertex", n)?);
        if fields.next().is_some() {
            return Err(line.fault("more than one value", "write one vertex to a line"));
        }
    }
    if vertices.is_empty() {
        return Err(Fault::new("has no vertices", "write one vertex to a line"));
    }
    Ok(vertices)
}

/// Rows (no more than `n`), values per row, and the values.
fn parse_at_most(bytes: &[u8], n: usize) -> Result<(usize, usize, Vec<f64>), Fault> {
    let (mut values, mut rows, mut k) = (Vec::new(), 0, 0);
    for line in data_lines(bytes) {
        let before = values.len();
        for field in Fields::of(line) {
            values.push(line.finite(Some(field), "value")?);
        }
        let found = values.len() - before;
        if rows > 0 && found != k {
            let problem = format!("{found} values, but the rows before have {k}");
            return Err(line.fault(problem, "complete the rows"));
        }
        (k, rows) = (found, rows + 1);
        if rows > n {
            return Err(line.fault(format!("more than {n} rows"), "give one row per vertex"));
        }
    }
    Ok((rows, k, values))
}

/// See [`read_pairs`].
///
/// # Errors
/// A fault naming the line.
pub fn parse_pairs(bytes: &[u8], limits: [usize; 2]) -> Result<Vec<[u32; 2]>, Fault> {
    let mut pairs = Vec::new();
    let mut promised = None;
    for line in data_lines(bytes) {
        let mut fields = Fields::of(line);
        let (first, second) = (fields.next(), fields.next());
        if second.is_none() && pairs.is_empty() && promised.is_none() {
            promised = Some((line, line.integer(first, "number of pairs")?));
            continue;
        }
        if fields.next().is_some() {
            return Err(line.fault("more than two values", "write two indices to a line"));
        }
        let a = in_range(&line, first, "first index", limits[0])?;
        pairs.push([a, in_range(&line, second, "second index", limits[1])?]);
    }
    if let Some((line, count)) = promised.filter(|&(_, count)| count != pairs.len() as i64) {
        let problem = format!("promises {count} pairs, but {} follow", pairs.len());
        return Err(line.fault(problem, "complete the file or correct the number"));
    }
    if pairs.is_empty() {
        return Err(Fault::new("has no pairs", "write two indices to a line"));
    }
    Ok(pairs)
}

fn in_range(line: &Line<'_>, field: Option<&[u8]>, what: &str, limit: usize) -> Result<u32, Fault> {
    let index = line.index(field, what)?;
    if (index as usize) < limit {
        return Ok(index);
    }
    let problem = format!("{what} {index} is out of range: there are {limit}");
    Err(line.fault(problem, "indices count from 0"))
}

/// The lines with data: no comments, no blank ones, not the header (a first line whose first field is no number).
fn data_lines(bytes: &[u8]) -> impl Iterator<Item = Line<'_>> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes); // byte-order mark of some spreadsheets
    let mut first = true;
    Lines::new(bytes, 1).map(Line::without_comment).filter(move |line| {
        let Some(field) = Fields::of(*line).next() else { return false };
        let header = std::mem::take(&mut first) && line.value(Some(field), "").is_err();
        !header
    })
}

/// The fields of a row: separated by one comma with or without blanks, or by blanks and tabs alone.
#[derive(Clone)]
struct Fields<'a> {
    rest: Option<&'a [u8]>,
}

impl<'a> Fields<'a> {
    fn of(line: Line<'a>) -> Self {
        Self { rest: Some(line.text.trim_ascii()).filter(|text| !text.is_empty()) }
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest?;
        let end = rest.iter().position(|&b| b == b',' || b.is_ascii_whitespace()).unwrap_or(rest.len());
        let (field, tail) = rest.split_at(end);
        let tail = tail.trim_ascii_start();
        // A comma promises another field, even an empty one, which is then an error where it is read.
        self.rest = match tail.strip_prefix(b",") {
            Some(after) => Some(after.trim_ascii_start()),
            None => Some(tail).filter(|tail| !tail.is_empty()),
        };
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::Place;

    #[test]
    fn separators_header_comments_and_order() {
        let file = b"\xef\xbb\xbfvertex, gx, gy\r\n# marks\r\n7, 1.5,-2\r\n\r\n 3\t1e-3   4 # last\r\n";
        let read = parse_constraints(file, 8).unwrap();
        assert_eq!(read, Constraints { vertices: vec![3, 7], values: vec![1e-3, 4.0, 1.5, -2.0], k: 2 });
        assert_eq!(parse_pairs(b"2\n0, 1\n2 , 3\n", [3, 4]).unwrap(), [[0, 1], [2, 3]]);
        assert_eq!(parse_pairs(b"a b\n0 1\n", [3, 4]).unwrap(), [[0, 1]]);
    }

    #[test]
    fn columns_have_one_row_per_vertex() {
        assert_eq!(parse_columns(b"x y\n1,2\n3 4\n", 2), Ok((2, vec![1.0, 2.0, 3.0, 4.0])));
        for (file, part) in [
            ("1\n2\n3\n", "line 3: more than 2 rows"),
            ("1\n", "has 1 rows"),
            ("", "has 0 rows"),
            ("1\n2 3\n", "line 2: 2 values"),
            ("1\ninf\n", "line 2"),
        ] {
            let fault = parse_columns(file.as_bytes(), 2).unwrap_err().to_string();
            assert!(fault.contains(part), "{file:?}: {fault}");
        }
    }

    #[test]
    fn rows_and_vertices_without_a_known_number() {
        assert_eq!(parse_rows(b"a b\n1,2\n3 4\n5 6"), Ok((2, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])));
        assert_eq!(parse_vertices(b"vertex\n3\n 0 \n", 4), Ok(vec![3, 0]));
        for (file, part) in [("", "no vertices"), ("4\n", "out of range"), ("1 2\n", "more than one")] {
            let fault = parse_vertices(file.as_bytes(), 4).unwrap_err().to_string();
            assert!(fault.contains(part), "{file:?}: {fault}");
        }
        assert!(parse_rows(b"# nothing\n").is_err() && parse_rows(b"1 2\n3\n").is_err());
    }

    #[test]
    fn faults_name_their_line() {
        for (file, line, part) in [
            ("1 0\n9 0\n", 2, "out of range"),
            ("1 0\n-1 0\n", 2, "out of range"),
            ("1 0\n2 nan\n", 2, "not finite"),
            ("1 0\n\n1 5\n", 3, "already given in line 1"),
            ("1 0\n2 0 0\n", 2, "2 values"),
            ("1\n", 1, "without a value"),
            ("1,,2\n", 1, "no number"),
            ("1.5, 2\n", 1, "no whole number"),
        ] {
            let fault = parse_constraints(file.as_bytes(), 8).unwrap_err();
            assert_eq!(fault.place, Some(Place::Line(line)), "{fault}");
            assert!(fault.to_string().contains(part), "{fault}");
        }
        for (file, part) in
            [("", "no pairs"), ("3\n0 1\n", "promises 3"), ("0 1 2\n", "two values"), ("0 1\n2\n", "second")]
        {
            let fault = parse_pairs(file.as_bytes(), [8, 8]).unwrap_err();
            assert!(fault.to_string().contains(part), "{fault}");
        }
    }

    #[test]
    fn columns_keep_every_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        write_columns(&path, &[0.1, -1e-300, f64::MAX, 1.0 / 3.0], 2).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let values: Vec<f64> = text.split(['\n', ',']).filter_map(|x| x.parse().ok()).collect();
        assert_eq!(values, [0.1, -1e-300, f64::MAX, 1.0 / 3.0]);
        assert_eq!(text.lines().count(), 2);
    }
}
