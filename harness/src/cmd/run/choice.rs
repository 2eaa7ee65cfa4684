//! What is measured when it is not said.

use crate::cmd::Context;
use crate::engine::solver::{Peer, Solver};
use crate::engine::source::Name;
use crate::engine::workload::Workload;
use lapsolve::registry::{Entry, OpenOptions};

/// Meshes of the default suite: a size for every machine, and that of VA's scans.
const MESHES: [&str; 2] = ["body:50000", "body:294000"];

/// Workloads of the default suite.
const WORKLOADS: [Workload; 1] = [Workload::Harmonic];

/// Backends of the default suite: of every family the first that can be opened here.
const BACKENDS: [&[&str]; 3] =
    [&["framechol-f64", "faer-llt"], &["cg-multigrid", "cg-jacobi"], &["vulkan-direct-f64"]];

/// The meshes and matrices given, or the default ones.
pub fn sources(meshes: &[String], matrices: &[String]) -> Vec<Name> {
    if meshes.is_empty() && matrices.is_empty() {
        return MESHES.iter().map(|&name| Name::Mesh(name.to_owned())).collect();
    }
    let meshes = meshes.iter().cloned().map(Name::Mesh);
    meshes.chain(matrices.iter().cloned().map(Name::Matrix)).collect()
}

/// The workloads given, all, or the default ones.
pub fn workloads(given: &[Workload], all: bool) -> Vec<Workload> {
    match (given, all) {
        ([], false) => WORKLOADS.to_vec(),
        ([], true) => Workload::ALL.to_vec(),
        (given, _) => given.to_vec(),
    }
}

/// The backends and peers given, all, or the default ones. Peers alone are measured alone.
pub fn solvers(ids: &[String], peers: &[Peer], all: bool, context: &Context) -> Vec<Solver> {
    let named = |id: &str| context.backend(id).copied();
    let entries: Vec<Entry> = if !ids.is_empty() {
        ids.iter().filter_map(|id| named(id)).collect()
    } else if all {
        context.backends.clone()
    } else if peers.is_empty() {
        let opens = |entry: &Entry| (entry.open)(&OpenOptions::default()).is_ok();
        BACKENDS.iter().filter_map(|ids| ids.iter().filter_map(|id| named(id)).find(opens)).collect()
    } else {
        Vec::new()
    };
    entries.into_iter().map(Solver::BuiltIn).chain(peers.iter().cloned().map(Solver::Foreign)).collect()
}

/// The thread counts given, or all cores.
pub fn threads(given: &[u16]) -> Vec<usize> {
    if given.is_empty() {
        vec![std::thread::available_parallelism().map_or(1, Into::into)]
    } else {
        given.iter().map(|&n| usize::from(n)).collect()
    }
}
