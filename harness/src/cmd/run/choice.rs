//! What is measured when it is not said.

use crate::cmd::Context;
use crate::engine::solver::{Peer, Solver};
use crate::engine::source::Name;
use crate::engine::workload::Workload;
use lapsolve::registry::{Entry, OpenOptions};

/// Meshes of the default suite: a size for every machine, and that of VA's scans.
const MESHES: [&str; 2] = ["body:50000", "body:294000"];

/// Workloads of the default suite.
const WORKLOADS: [Workload; 2] = [Workload::Harmonic, Workload::Transfer];

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

/// The backends and peers given, all that are built in, or the default ones. Peers alone are measured alone.
///
/// # Errors
/// The first name that is neither a backend nor a peer of the catalogue.
pub fn solvers(ids: &[String], peers: &[Peer], all: bool, context: &Context) -> Result<Vec<Solver>, String> {
    let mut solvers: Vec<Solver> = if !ids.is_empty() {
        ids.iter().map(|id| solver(id, context)).collect::<Result<_, _>>()?
    } else if all {
        context.backends.iter().copied().map(Solver::BuiltIn).collect()
    } else if peers.is_empty() {
        let opens = |entry: &&Entry| (entry.open)(&OpenOptions::default()).is_ok();
        let first = |ids: &&[&str]| ids.iter().filter_map(|id| context.backend(id)).find(opens).copied();
        BACKENDS.iter().filter_map(first).map(Solver::BuiltIn).collect()
    } else {
        Vec::new()
    };
    solvers.extend(peers.iter().cloned().map(Solver::Foreign));
    Ok(solvers)
}

/// The backend or peer of that name.
fn solver(id: &str, context: &Context) -> Result<Solver, String> {
    let built_in = context.backend(id).copied().map(Solver::BuiltIn);
    built_in.or_else(|| Peer::known(id).map(Solver::Foreign)).ok_or_else(|| id.to_owned())
}

/// The thread counts given, or all cores.
pub fn threads(given: &[u16]) -> Vec<usize> {
    if given.is_empty() {
        vec![std::thread::available_parallelism().map_or(1, Into::into)]
    } else {
        given.iter().map(|&n| usize::from(n)).collect()
    }
}
