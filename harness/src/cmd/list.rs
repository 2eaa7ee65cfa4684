//! `list`: what there is, and why something is not.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::engine::workload::Workload;
use crate::environment::BuildRecord;
use crate::exit::Exit;
use crate::peers::{self, Peer};
use crate::record::names::{Family, Precision};
use crate::report::rows::Rows;
use crate::shapes::{SHAPES, Shape};
use lapsolve::registry::{Entry, OpenOptions};
use serde::Serialize;

/// List backends, workloads and meshes, and say why something is not available
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// Everything that can be named on the command line.
#[derive(Debug, Serialize)]
struct Inventory {
    backends: Vec<BackendRow>,
    workloads: Vec<NamedRow>,
    meshes: Vec<NamedRow>,
    peers: Vec<PeerRow>,
    build: BuildRecord,
}

/// A name and what it stands for.
#[derive(Debug, Serialize)]
struct NamedRow {
    id: String,
    meaning: String,
}

#[derive(Debug, Serialize)]
struct PeerRow {
    id: String,
    licence: String,
    available: bool,
    reason: Option<String>,
}

impl PeerRow {
    fn of(peer: &Peer) -> Self {
        let reason = peer.command().err();
        Self { id: peer.id.clone(), licence: peer.licence.clone(), available: reason.is_none(), reason }
    }
}

#[derive(Debug, Serialize)]
struct BackendRow {
    id: &'static str,
    family: Family,
    precision: Precision,
    licence: &'static str,
    available: bool,
    reason: Option<String>,
}

impl BackendRow {
    fn of(entry: &Entry) -> Self {
        let unavailable = (entry.open)(&OpenOptions::default()).err();
        Self {
            id: entry.id,
            family: entry.family.into(),
            precision: entry.precision.into(),
            licence: entry.licence,
            available: unavailable.is_none(),
            reason: unavailable.map(|why| why.to_string()),
        }
    }
}

/// Prints the inventory.
///
/// # Errors
/// Where stdout cannot be written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let workload = |w: &Workload| NamedRow { id: w.name().to_owned(), meaning: w.meaning() };
    let mesh = |shape: &Shape| NamedRow {
        id: format!("{}:N", shape.kind),
        meaning: format!("{}, N from {} to {}", shape.meaning, shape.range.start(), shape.range.end()),
    };
    let inventory = Inventory {
        backends: context.backends.iter().map(BackendRow::of).collect(),
        workloads: Workload::ALL.iter().map(workload).collect(),
        meshes: SHAPES.iter().map(mesh).collect(),
        peers: peers::catalogue().iter().map(PeerRow::of).collect(),
        build: BuildRecord::of_this_program(),
    };
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&inventory)?,
        format => inventory.rows().render(format),
    })?;
    Ok(Exit::Ok)
}

impl Inventory {
    fn rows(&self) -> Rows {
        let mut rows =
            Rows::new(["kind", "name", "family", "precision", "licence", "available, or what it is"]);
        for b in &self.backends {
            let available = b.reason.as_deref().unwrap_or("yes");
            rows.push(["backend", b.id, b.family.name(), b.precision.name(), b.licence, available]);
        }
        for peer in &self.peers {
            rows.push(["peer", &peer.id, "", "", &peer.licence, peer.reason.as_deref().unwrap_or("yes")]);
        }
        for (kind, named) in [("workload", &self.workloads), ("mesh", &self.meshes)] {
            for row in named {
                rows.push([kind, &row.id, "", "", "", &row.meaning]);
            }
        }
        rows
    }
}
