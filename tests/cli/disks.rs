//! Full disks and read-only folders, made for the occasion: a small file system mounted in a namespace of its own.
#![cfg(target_os = "linux")]

use std::path::Path;
use std::process::{Command, Output};
use tests::needs::{self, Need};

/// Runs lapbench with a file system mounted at `folder`/disk (`options` as for `mount -o`) and copies what is on it to
/// `folder`/kept afterwards. `None` where this machine lets nobody mount.
fn on_a_disk(folder: &Path, options: &str, arguments: &str) -> Option<Output> {
    let (disk, kept) = (folder.join("disk"), folder.join("kept"));
    for path in [&disk, &kept] {
        std::fs::create_dir_all(path).expect("a folder");
    }
    let script = r#"mount -t tmpfs -o "$1" tmpfs "$2" || exit 99; disk=$2; kept=$3; shift 3; "$@"; code=$?
        cp -r "$disk"/. "$kept"; exit $code"#;
    let output = Command::new("unshare")
        .args(["--map-root-user", "--mount", "sh", "-c", script, "sh", options])
        .args([&disk, &kept])
        .arg(super::program().get_program())
        .args(arguments.split_whitespace())
        .env("TMPDIR", if arguments.contains("--out") { folder } else { &disk })
        .output();
    let refusal = match &output {
        Ok(output) if output.status.code() != Some(99) && !output.stderr.starts_with(b"unshare:") => None,
        Ok(output) => Some(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
        Err(error) => Some(error.to_string()),
    };
    match refusal {
        None => output.ok(),
        Some(reason) => {
            needs::skip(Need::Namespaces, &format!("no file system of its own: {reason}"));
            None
        }
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The samples of 0.6 s fill far more than 64 KB, the empty result far less.
#[test]
fn a_disk_that_fills_up_costs_the_file_and_not_the_figures() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("disk/r.json");
    let run = format!(
        "run --mesh sphere:1 --workload harmonic --backend framechol-f64 --threads 1 --cell-time 0.6 --out {}",
        out.display()
    );
    let Some(output) = on_a_disk(folder.path(), "size=64k", &run) else { return };
    let (text, table) = (stderr(&output), String::from_utf8_lossy(&output.stdout).into_owned());
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("r.json") && text.contains("measuring goes on"), "{text}");
    assert!(table.contains("framechol-f64") && table.contains("ok"), "{table}");
    let left: Vec<_> = std::fs::read_dir(folder.path().join("kept")).expect("a folder").flatten().collect();
    assert_eq!(left.iter().map(|f| f.file_name()).collect::<Vec<_>>(), ["r.json"], "nothing half-written");
    assert!(super::read(&left[0].path()).cells.iter().all(|cell| cell.backend == "framechol-f64"));
}

#[test]
fn no_room_for_the_arrays_is_an_error_that_names_the_place() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let Some(output) = on_a_disk(
        folder.path(),
        "size=16k",
        "run --quick --mesh sphere:5 --workload harmonic --backend framechol-f64",
    ) else {
        return;
    };
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("space") && !text.contains("panicked"), "{text}");
}

#[test]
fn a_read_only_folder_is_found_before_anything_is_measured() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for command in ["run --mesh body:294000 --backend dense", "matrix --mesh sphere:2 --which L"] {
        let out = folder.path().join("disk/r.out");
        let Some(output) = on_a_disk(folder.path(), "ro", &format!("{command} --out {}", out.display()))
        else {
            return;
        };
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains("r.out") && text.contains("ead-only"), "{text}");
    }
}
