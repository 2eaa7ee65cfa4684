//! MatrixMarket coordinate files of symmetric matrices.
//!
//! Read: `coordinate`, `real` or `integer`, `symmetric` or `general` (then exactly symmetric), each entry once.
//! Written: 17 significant digits; the diagonal entry of a row that couples to nothing and is zero is left out, so
//! that unreferenced vertices have empty rows.

use std::io::{self, Write};
use std::path::Path;

use lapsolve::sparse::SymmetricCsr;

use super::text::{Line, Lines, shown};
use crate::file::{self, Fault, FileError, Place};

/// Which entries of a symmetric matrix a file lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// The lower triangle.
    Symmetric,
    /// All of them.
    General,
}

/// Reads a symmetric matrix. Diagonal entries that are not listed are zero.
///
/// # Errors
/// [`FileError`] naming the line of whatever is malformed, out of range, listed twice, not finite or not symmetric.
pub fn read(path: &Path) -> Result<SymmetricCsr, FileError> {
    parse(&file::read(path)?).map_err(|fault| fault.in_file(path))
}

/// Writes a matrix, atomically.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
pub fn write(path: &Path, matrix: &SymmetricCsr, symmetry: Symmetry) -> Result<(), FileError> {
    file::write_atomically(path, |out| write_to(out, matrix, symmetry))
}

/// An entry in the upper triangle.
#[derive(Clone, Copy)]
struct Entry {
    row: u32,
    column: u32,
    /// Whether the file lists it at (column, row), with row < column.
    below: bool,
    value: f64,
    line: usize,
}

/// See [`read`]. Memory: about six times the file; cost: one sort of the entries.
///
/// # Errors
/// A fault naming the line.
pub fn parse(bytes: &[u8]) -> Result<SymmetricCsr, Fault> {
    let mut lines = Lines::new(bytes, 1);
    let symmetry = banner(lines.next())?;
    let mut data = lines.filter(|line| !line.text.starts_with(b"%") && line.tokens().next().is_some());
    let cut_off = || Fault::new("ends before the entries it promises", "the file is cut off");
    let size = data.next().ok_or_else(cut_off)?;
    let (n, count) = dimensions(&size, bytes.len())?;
    let mut entries = Vec::with_capacity(count);
    for _ in 0..count {
        entries.push(entry(&data.next().ok_or_else(cut_off)?, n)?);
    }
    if let Some(line) = data.next() {
        return Err(line.fault("follows the last of the promised entries", "correct the number of entries"));
    }
    entries.sort_by_key(|e| (e.row, e.column)); // stable: of equal ones the later line comes second
    for same_place in entries.chunk_by(|a, b| (a.row, a.column) == (b.row, b.column)) {
        check_once(same_place, symmetry)?;
        if symmetry == Symmetry::General {
            check_mirrored(same_place)?;
        }
    }
    entries.dedup_by_key(|e| (e.row, e.column));
    assemble(n, &entries)
}

/// The first line: `%%MatrixMarket matrix coordinate real symmetric` and its like.
fn banner(line: Option<Line<'_>>) -> Result<Symmetry, Fault> {
    let expected = "save a real or integer coordinate matrix, symmetric or general";
    let line = line.ok_or_else(|| Fault::new("is empty", expected))?;
    let words: Vec<_> = line.tokens().map(<[u8]>::to_ascii_lowercase).collect();
    let words: Vec<_> = words.iter().map(Vec::as_slice).collect();
    match words[..] {
        [b"%%matrixmarket", b"matrix", b"coordinate", b"real" | b"integer" | b"double", b"symmetric"] => {
            Ok(Symmetry::Symmetric)
        }
        [b"%%matrixmarket", b"matrix", b"coordinate", b"real" | b"integer" | b"double", b"general"] => {
            Ok(Symmetry::General)
        }
        _ => Err(line.fault(format!("the kind `{}` is not supported", shown(line.text)), expected)),
    }
}

/// Order and number of entries.
fn dimensions(line: &Line<'_>, file_bytes: usize) -> Result<(usize, usize), Fault> {
    let mut tokens = line.tokens();
    let mut next = |what| line.index(tokens.next(), what).map(|x| x as usize);
    let (rows, columns, count) =
        (next("number of rows")?, next("number of columns")?, next("number of entries")?);
    if rows != columns {
        return Err(line.fault(format!("a {rows} x {columns} matrix is not square"), "give a square matrix"));
    }
    if rows == 0 {
        return Err(line.fault("the matrix has no rows", "give a matrix with entries"));
    }
    // An entry takes six bytes ("1 1 1\n"); rows may be empty, but hardly outnumber the bytes of their file.
    if count > file_bytes / 6 + 1 || rows > file_bytes {
        let problem =
            format!("{rows} rows and {count} entries are more than a file of {file_bytes} bytes holds");
        return Err(line.fault(problem, "the file is cut off or its size line wrong"));
    }
    Ok((rows, count))
}

fn entry(line: &Line<'_>, n: usize) -> Result<Entry, Fault> {
    let mut tokens = line.tokens();
    let mut index = |what| {
        let index = line.index(tokens.next(), what)?;
        if index == 0 || index as usize > n {
            let problem = format!("{what} {index} is out of range 1..{n}");
            return Err(line.fault(problem, "indices count from 1"));
        }
        Ok(index - 1)
    };
    let (row, column) = (index("row")?, index("column")?);
    let value = line.finite(tokens.next(), "value")?;
    if tokens.next().is_some() {
        return Err(line.fault("more than three values", "write row, column and value"));
    }
    Ok(Entry { row: row.min(column), column: row.max(column), below: row > column, value, line: line.number })
}

/// Entries with the same place in the upper triangle: a symmetric file lists one of them, a general one each side.
fn check_once(same_place: &[Entry], symmetry: Symmetry) -> Result<(), Fault> {
    for (k, e) in same_place.iter().enumerate() {
        if same_place[..k].iter().any(|earlier| symmetry == Symmetry::Symmetric || earlier.below == e.below) {
            let problem = format!("entry ({}, {}) was listed before", e.row + 1, e.column + 1);
            return Err(Fault::at(Place::Line(e.line), problem, "list each entry once"));
        }
    }
    Ok(())
}

/// Beside the diagonal, both sides are listed and equal.
fn check_mirrored(same_place: &[Entry]) -> Result<(), Fault> {
    let symmetric = match same_place {
        [one] => one.row == one.column,
        [a, b] => a.value == b.value,
        _ => unreachable!("each side is listed once"),
    };
    if symmetric {
        return Ok(());
    }
    let first = same_place[0];
    let problem = format!("entry ({}, {}) has no equal mirror image", first.row + 1, first.column + 1);
    Err(Fault::at(Place::Line(first.line), problem, "symmetric matrices only: save (A + A')/2"))
}

/// The matrix of sorted upper entries, each place once, with the diagonal stored in full.
fn assemble(n: usize, entries: &[Entry]) -> Result<SymmetricCsr, Fault> {
    let (mut row_starts, mut columns, mut values) = (Vec::with_capacity(n + 1), Vec::new(), Vec::new());
    let mut rest = entries.iter().peekable();
    for row in 0..n as u32 {
        row_starts.push(columns.len() as u32);
        columns.push(row);
        values.push(rest.next_if(|e| e.row == row && e.column == row).map_or(0.0, |e| e.value));
        while let Some(entry) = rest.next_if(|e| e.row == row) {
            columns.push(entry.column);
            values.push(entry.value);
        }
    }
    row_starts.push(columns.len() as u32);
    SymmetricCsr::new(row_starts, columns, values).map_err(|e| Fault::new(e.to_string(), "split the matrix"))
}

fn write_to(out: &mut dyn Write, matrix: &SymmetricCsr, symmetry: Symmetry) -> io::Result<()> {
    let coupled = matrix.coupled_rows();
    let present = |i: usize| !matrix.is_absent(i, &coupled);
    let absent = (0..matrix.n()).filter(|&i| !present(i)).count();
    let (word, count) = match symmetry {
        Symmetry::Symmetric => ("symmetric", matrix.stored() - absent),
        Symmetry::General => ("general", matrix.nonzeros() - absent),
    };
    writeln!(out, "%%MatrixMarket matrix coordinate real {word}\n{} {} {count}", matrix.n(), matrix.n())?;
    for i in (0..matrix.n()).filter(|&i| present(i)) {
        let (columns, values) = matrix.row(i);
        for (&j, value) in columns.iter().zip(values) {
            writeln!(out, "{} {} {value:.16e}", j + 1, i + 1)?;
            if symmetry == Symmetry::General && j as usize != i {
                writeln!(out, "{} {} {value:.16e}", i + 1, j + 1)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix() -> SymmetricCsr {
        let triplets = [(0, 0, 2.0), (0, 1, -0.1), (0, 3, 1e-300), (1, 1, 1.0 / 3.0), (3, 3, 4.0)];
        SymmetricCsr::from_triplets(4, &triplets).unwrap() // row 2 is absent
    }

    #[test]
    fn both_kinds_keep_every_bit() {
        for (symmetry, entries) in [(Symmetry::Symmetric, 5), (Symmetry::General, 7)] {
            let mut file = Vec::new();
            write_to(&mut file, &matrix(), symmetry).unwrap();
            assert_eq!(file.iter().filter(|&&b| b == b'\n').count(), 2 + entries);
            assert_eq!(parse(&file).unwrap(), matrix());
        }
    }

    #[test]
    fn faults_name_their_line() {
        let symmetric = "%%MatrixMarket matrix coordinate real symmetric\n% comment\n";
        let general = "%%MatrixMarket matrix coordinate integer general\n\n";
        for (head, body, line, part) in [
            ("%%MatrixMarket matrix array real general\n", "", 1, "not supported"),
            ("%%MatrixMarket matrix coordinate pattern symmetric\n", "", 1, "not supported"),
            (symmetric, "2 3 1\n1 1 1\n", 3, "not square"),
            (symmetric, "4000000000 4000000000 1\n1 1 1\n", 3, "more than"),
            (symmetric, "2 2 4000000000\n1 1 1\n", 3, "more than"),
            (symmetric, "0 0 0\n", 3, "no rows"),
            (symmetric, "2 2 2\n1 1 1\n3 1 1\n", 5, "row 3 is out of range"),
            (symmetric, "2 2 2\n1 1 1\n1 0 1\n", 5, "column 0"),
            (symmetric, "2 2 2\n1 1 1\n2 1 nan\n", 5, "not finite"),
            (symmetric, "2 2 3\n1 1 1\n2 1 1\n1 2 1\n", 6, "was listed"),
            (symmetric, "2 2 3\n1 1 1\n2 2 1\n1 1 1\n", 6, "was listed"),
            (symmetric, "2 2 1\n1 1 1\n2 2 1\n", 5, "follows"),
            (symmetric, "2 2 1\n1 1 1 0\n", 4, "more than three"),
            (general, "2 2 3\n1 1 1\n1 2 3\n2 2 1\n", 5, "mirror"),
            (general, "2 2 4\n1 1 1\n1 2 3\n2 1 4\n2 2 1\n", 5, "mirror"),
            (general, "2 2 3\n1 2 3\n2 1 3\n2 1 3\n", 6, "was listed"),
        ] {
            let fault = parse(format!("{head}{body}").as_bytes()).unwrap_err();
            assert_eq!(fault.place, Some(Place::Line(line)), "{body}: {fault}");
            assert!(fault.to_string().contains(part), "{body}: {fault}");
        }
        let cut = format!("{symmetric}2 2 3\n1 1 1\n2 1 1\n");
        assert!(parse(cut.as_bytes()).unwrap_err().to_string().contains("cut off"));
    }
}
