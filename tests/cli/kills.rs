//! `kill -9` of parent and child: what was measured stays, and nothing is left running.
#![cfg(target_os = "linux")]

use super::{program, read};
use lapbench::record::names::Status;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const LONG: &str =
    "run --mesh sphere:2 --workload harmonic --threads 1 --cell-time 30 --backend slow,dense --out";

fn start(out: &Path) -> Child {
    program()
        .args(LONG.split(' '))
        .arg(out)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts")
}

/// Process ids of the children of `parent`, with their command lines.
fn children(parent: u32) -> Vec<(u32, String)> {
    let tasks = std::fs::read_dir(format!("/proc/{parent}/task")).into_iter().flatten().flatten();
    let ids = tasks.filter_map(|t| std::fs::read_to_string(t.path().join("children")).ok());
    let ids: Vec<u32> =
        ids.flat_map(|s| s.split_whitespace().filter_map(|p| p.parse().ok()).collect::<Vec<_>>()).collect();
    let line = |id: u32| {
        std::fs::read_to_string(format!("/proc/{id}/cmdline")).unwrap_or_default().replace('\0', " ")
    };
    ids.into_iter().map(|id| (id, line(id))).collect()
}

/// Waits until `condition` gives something.
fn wait<T>(what: &str, mut condition: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = condition() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn kill(id: u32) {
    let status =
        std::process::Command::new("kill").args(["-9", &id.to_string()]).status().expect("kill runs");
    assert!(status.success());
}

/// Gone, or dead and not yet collected by whoever inherited it.
fn is_gone(id: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
    stat.rsplit(')').next().is_none_or(|rest| rest.trim().is_empty() || rest.trim().starts_with('Z'))
}

fn has_samples(out: &Path, backend: &str) -> bool {
    std::fs::metadata(out).is_ok()
        && read(out).cells.iter().any(|c| c.backend == backend && !c.samples_ns.is_empty())
}

#[test]
fn a_killed_parent_leaves_its_samples_and_no_children() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    let mut parent = start(&out);
    wait("samples", || has_samples(&out, "slow").then_some(()));
    let children = children(parent.id());
    assert_eq!(children.len(), 2, "{children:?}");
    parent.kill().expect("killed");
    parent.wait().expect("collected");
    for (id, line) in children {
        wait(&format!("the end of {line}"), || is_gone(id).then_some(()));
    }
    let cells = read(&out).cells;
    let slow = cells.iter().find(|c| c.backend == "slow").expect("a row");
    assert!(slow.status == Status::Ok && !slow.complete && slow.solve_ns.p50.is_some_and(|t| t > 20_000_000));
}

#[test]
fn a_killed_child_is_an_error_row_with_its_samples() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    let mut parent = start(&out);
    wait("samples", || has_samples(&out, "slow").then_some(()));
    let victim =
        wait("the child", || children(parent.id()).into_iter().find(|(_, line)| line.contains("slow")));
    kill(victim.0);
    let slow = wait("the row", || {
        read(&out).cells.into_iter().find(|c| c.backend == "slow" && c.status != Status::Ok)
    });
    assert_eq!(slow.status, Status::Error);
    assert!(slow.reason.as_deref().is_some_and(|r| r.contains("killed by signal 9")), "{:?}", slow.reason);
    assert!(!slow.samples_ns.is_empty());
    parent.kill().expect("killed");
    parent.wait().expect("collected");
}
