//! Small bad files, and good ones of unusual form, with the outcome declared in `corpus/outcomes.txt`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lapbench::mesh_io::Finding;

use crate::check_that_nothing_panicked;
use crate::readers::{READERS, Reader};

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus")
}

fn name(finding: &Finding) -> String {
    let value = serde_json::to_value(finding).expect("a finding is a word");
    value.as_str().expect("a finding is a word").to_owned()
}

/// `Err` says how the outcome differs from the declared one.
fn check(reader: &Reader, path: &Path, declared: &str) -> Result<(), String> {
    let (word, detail) = declared.split_once(' ').unwrap_or((declared, ""));
    match (word, (reader.read)(path)) {
        ("ok", Ok(findings)) => {
            let found = findings.iter().map(name).collect::<Vec<_>>().join(",");
            if found == detail { Ok(()) } else { Err(format!("found {found}")) }
        }
        ("error", Err(error)) => {
            let message = error.to_string();
            let names_file = message.contains(&*path.file_name().expect("a file").to_string_lossy());
            if !names_file || error.fault.remedy.is_empty() || !message.contains(detail) {
                return Err(format!("message: {message}"));
            }
            Ok(())
        }
        (_, Ok(_)) => Err("was read".into()),
        (_, Err(error)) => Err(format!("message: {error}")),
    }
}

#[test]
fn every_file_has_its_declared_outcome() {
    check_that_nothing_panicked();
    let table = std::fs::read_to_string(folder().join("outcomes.txt")).unwrap();
    let mut declared = BTreeSet::new();
    let mut differing = Vec::new();
    for row in table.lines().filter(|line| !line.starts_with('#')) {
        let (file, outcome) = row.split_once(' ').expect("a file and its outcome");
        let reader = READERS.iter().find(|reader| file.starts_with(&format!("{}/", reader.folder)));
        let reader = reader.unwrap_or_else(|| panic!("no reader for {file}"));
        if let Err(difference) = check(reader, &folder().join(file), outcome.trim()) {
            differing.push(format!("{file}: declared {}, but {difference}", outcome.trim()));
        }
        declared.insert(file.to_owned());
    }
    check_that_nothing_panicked();
    assert!(differing.is_empty(), "\n{}", differing.join("\n"));
    for reader in &READERS {
        for entry in std::fs::read_dir(folder().join(reader.folder)).unwrap() {
            let file = format!("{}/{}", reader.folder, entry.unwrap().file_name().to_string_lossy());
            assert!(declared.contains(&file) || file == "gltf/square.bin", "{file} has no declared outcome");
        }
    }
}
