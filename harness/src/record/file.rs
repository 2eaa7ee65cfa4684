//! Result files on disk: read with checks, rewritten whole and atomically after every change.

use super::result::ResultFile;
use crate::file::{self, FileError};
use anyhow::{Context, bail};
use std::path::Path;

/// Reads a result file of any 1.x version.
///
/// # Errors
/// Where the file cannot be read, is no result file, or has another major version.
pub fn read(path: &Path) -> anyhow::Result<ResultFile> {
    let bytes = file::read(path)?;
    let result: ResultFile = serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: not a result file of this program", path.display()))?;
    if !result.schema_version.starts_with("1.") {
        bail!("{}: schema_version {} is not 1.x", path.display(), result.schema_version);
    }
    Ok(result)
}

/// Writes `result` under its name, whole or not at all: one line for each cell, so that files can be searched and
/// compared line by line.
///
/// # Errors
/// [`FileError`].
pub fn write(path: &Path, result: &ResultFile) -> Result<(), FileError> {
    file::write_atomically(path, |out| out.write_all(text(result).as_bytes()))
}

/// The file's content.
pub fn text(result: &ResultFile) -> String {
    let json = |value: serde_json::Result<String>| value.expect("results are plain data");
    let head = ResultFile { cells: Vec::new(), ..result.clone() };
    let head = json(serde_json::to_string(&head));
    let head = head.strip_suffix("]}").expect("cells come last");
    let cells: Vec<String> = result.cells.iter().map(|cell| json(serde_json::to_string(cell))).collect();
    format!("{head}\n{}\n]}}\n", cells.join(",\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Environment;
    use crate::record::names::Status;
    use crate::record::result::{Accuracy, Cell, SCHEMA_VERSION, Summary};

    fn example() -> ResultFile {
        let accuracy = Accuracy { backward_error: Some(1e-16), ..Accuracy::default() };
        let cell = Cell {
            workload: "harmonic".into(),
            status: Status::Ok,
            solve_ns: Summary::of(&[1, 2, 3]),
            samples_ns: vec![1, 2, 3],
            accuracy,
            ..Cell::default()
        };
        ResultFile {
            schema_version: SCHEMA_VERSION.into(),
            command: "lapbench run".into(),
            quotable: true,
            environment: Environment::read(),
            cells: vec![cell.clone(), cell],
        }
    }

    #[test]
    fn comes_back_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.json");
        for result in [example(), ResultFile { cells: vec![], ..example() }] {
            write(&path, &result).unwrap();
            assert_eq!(read(&path).unwrap(), result);
        }
    }

    #[test]
    fn every_member_is_present() {
        let cell = serde_json::to_value(&example().cells[0]).unwrap();
        for pointer in
            ["/reason", "/phases_ns/upload", "/solve_ns/p999", "/accuracy/certifiable", "/bandwidth/gb_per_s"]
        {
            assert_eq!(cell.pointer(pointer), Some(&serde_json::Value::Null), "{pointer}");
        }
    }

    #[test]
    fn other_versions_and_other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.json");
        let refused = |content: &str| {
            std::fs::write(&path, content).unwrap();
            format!("{:#}", read(&path).unwrap_err())
        };
        assert!(refused(&text(&example()).replacen(SCHEMA_VERSION, "2.0", 1)).contains("2.0 is not 1.x"));
        assert!(refused("{}").contains("not a result file"));
        let newer = text(&example()).replacen("\"quotable\"", "\"news\":1,\"quotable\"", 1);
        std::fs::write(&path, newer).unwrap();
        assert_eq!(read(&path).unwrap(), example());
    }
}
