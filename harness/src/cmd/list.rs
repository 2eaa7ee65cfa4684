//! `list`: what there is, and why something is not.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::exit::Exit;
use crate::record::names::{Family, Precision};
use crate::report::rows::Rows;
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
    let inventory = Inventory { backends: context.backends.iter().map(BackendRow::of).collect() };
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&inventory)?,
        format => inventory.rows().render(format),
    })?;
    Ok(Exit::Ok)
}

impl Inventory {
    fn rows(&self) -> Rows {
        let mut rows = Rows::new(["kind", "name", "family", "precision", "licence", "available"]);
        for b in &self.backends {
            let available = b.reason.clone().unwrap_or_else(|| "yes".into());
            rows.push(["backend", b.id, b.family.name(), b.precision.name(), b.licence, &available]);
        }
        rows
    }
}
