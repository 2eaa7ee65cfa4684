//! `validate`: accuracy only. Every check by name, with its figure and its limit.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::exit::Exit;
use crate::mesh_source;
use crate::reference::{Agreement, Python, igl, open3d};
use crate::report::rows::Rows;
use crate::verify::finding::{Finding, Findings, Level, Outcome as Ended};
use crate::verify::subject::{Discretisation, Subject};
use crate::verify::suite;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{Entry, OpenOptions};
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// Check backends against answers known on paper, against references, and on any mesh
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Meshes to check on, instead of the cases with known answers
    #[arg(long, value_name = "MESH", value_delimiter = ',')]
    mesh: Vec<String>,
    /// Backends to check; all that are available by default
    #[arg(long, value_name = "ID", value_delimiter = ',')]
    backend: Vec<String>,
    /// Programs of others to compare with, live (needs `cargo xtask setup` and --mesh)
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_enum, requires = "mesh")]
    against: Vec<Against>,
    /// Relative residual asked of iterative backends
    #[arg(long, value_name = "TOL", default_value_t = lapsolve::limits::DEFAULT_TOLERANCE)]
    tol: f64,
    /// Seconds that a backend's answers on one mesh may take before its other checks there are skipped; 0: no end
    ///
    /// An answer that was begun is waited for.
    #[arg(long, value_name = "S", default_value_t = 120)]
    patience: u32,
    /// Vertices along a side of the largest grid of the sine modes
    #[arg(long, value_name = "N", default_value_t = 257, value_parser = clap::value_parser!(u16).range(65..=2048))]
    grid: u16,
    /// Break the code in known ways and say which check notices what
    #[arg(long, conflicts_with_all = ["mesh", "against", "backend"])]
    mutants: bool,
    /// Print every finding, not only one line per check and case
    #[arg(long)]
    all: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// Programs of others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Against {
    /// libigl: Laplacian, masses, harmonic field
    Igl,
    /// Open3D: reading, area, one step of as-rigid-as-possible deformation
    Open3d,
}

/// The JSON form.
#[derive(Debug, Serialize)]
struct Report<'a> {
    schema_version: &'static str,
    passed: usize,
    failed: usize,
    findings: &'a [Finding],
}

/// Checks and prints.
///
/// # Errors
/// An unreadable mesh, a backend that was named and is not available, a reference that cannot be asked.
pub fn run(args: &Args, context: &Context) -> Outcome {
    if args.mutants {
        return mutants(args, context);
    }
    if let Some(unknown) = args.backend.iter().find(|id| context.backend(id).is_none()) {
        return Ok(context.unknown_backend(unknown));
    }
    let subjects = subjects(args, context)?;
    let mut findings = Findings::default();
    if args.mesh.is_empty() {
        eprintln!("checking {} backends on cases with known answers", subjects.len());
        let grids = [65, usize::from(args.grid)]; // all backends take the first one, most the second
        let distinct = if grids[0] == grids[1] { &grids[..1] } else { &grids[..] };
        findings = suite::analytic(&subjects, &Discretisation::TRUE, &context.backends, distinct);
    }
    for name in &args.mesh {
        let mesh = mesh_source::load(name)?.mesh;
        subjects.iter().for_each(Subject::rest);
        eprintln!("checking {} backends on {name}, {} triangles", subjects.len(), mesh.triangles().len());
        let short =
            Path::new(name).file_name().map_or(name.clone(), |file| file.to_string_lossy().into_owned());
        findings
            .all
            .extend(suite::of_mesh(&short, &mesh, &subjects, &Discretisation::TRUE, &context.backends).all);
        for subject in subjects.iter().filter(|subject| subject.overspent().is_some()) {
            eprintln!(
                "{}: its answers took more than {} s; its other checks on {name} were skipped (--patience)",
                subject.id, args.patience
            );
        }
        for against in &args.against {
            findings.about(&short, None);
            compare(*against, name, &mesh, &context.backends, &mut findings)?;
        }
    }
    print(args, &findings)?;
    Ok(if findings.failures().next().is_some() { Exit::Invalid } else { Exit::Ok })
}

/// The backends to check; those that cannot be opened are an error where they were named, else a line on stderr.
fn subjects(args: &Args, context: &Context) -> anyhow::Result<Vec<Subject>> {
    let options = OpenOptions { threads: 1, tolerance: args.tol, device: None };
    let patience = (args.patience > 0).then(|| Duration::from_secs(args.patience.into()));
    let mut subjects = Vec::new();
    for entry in &context.backends {
        let named = args.backend.iter().any(|id| id == entry.id);
        if !args.backend.is_empty() && !named {
            continue;
        }
        match Subject::open(entry, &options) {
            Ok(mut subject) => {
                subject.patience = patience;
                subjects.push(subject);
            }
            Err(why) if named => return Err(anyhow::anyhow!("{}: {why}", entry.id)),
            Err(why) => eprintln!("skipping {}: {why}", entry.id),
        }
    }
    Ok(subjects)
}

/// Asks a reference and records where it differs.
fn compare(
    against: Against,
    name: &str,
    mesh: &TriangleMesh,
    backends: &[Entry],
    findings: &mut Findings,
) -> anyhow::Result<()> {
    let python = Python::find()?;
    let solver = backends.iter().find(|e| e.id == "faer-llt").or(backends.first());
    let solver = Subject::open(solver.expect("there are backends"), &OpenOptions::default())?;
    match against {
        Against::Igl => {
            let theirs = igl::IglValues::compute(&python, mesh)?;
            let found = igl::compare(mesh, &theirs, &*solver.backend, solver.limits.harmonic)?;
            record("libigl", &theirs.versions, found, findings);
        }
        Against::Open3d => {
            let found = open3d::compare_reading(&python, Path::new(name), mesh)?;
            record("Open3D", "", found, findings);
        }
    }
    Ok(())
}

fn record(program: &str, versions: &str, agreements: Vec<Agreement>, findings: &mut Findings) {
    for a in agreements {
        let check = if program == "libigl" { "against libigl" } else { "against Open3D" };
        let note = format!("{}, {} compared, worst at {} {versions}", a.quantity, a.compared, a.place);
        findings.at_most(Level::Matrix, check, a.worst, a.limit, note);
    }
}

fn print(args: &Args, findings: &Findings) -> anyhow::Result<()> {
    let failed = findings.failures().count();
    let passed = findings.all.iter().filter(|f| f.outcome == Ended::Passed).count();
    let text = match args.format {
        Format::Json => {
            let report = Report { schema_version: "1.0", passed, failed, findings: &findings.all };
            serde_json::to_string_pretty(&report)?
        }
        Format::Human if !args.all => rows(summaries(&findings.all).into_iter()).render(args.format),
        format => rows(findings.all.iter()).render(format),
    };
    output::print(&text)?;
    eprintln!("{passed} of {} checks passed, {failed} failed", findings.all.len());
    Ok(())
}

/// One finding for each check and case, the one with the least to spare; and everything that failed.
fn summaries(all: &[Finding]) -> Vec<&Finding> {
    let spare = |f: &Finding| match (f.outcome, f.value, f.limit) {
        (Ended::Failed, ..) => f64::NEG_INFINITY,
        (Ended::Passed, Some(value), Some(limit)) => 1.0 - value / limit.max(f64::MIN_POSITIVE),
        (Ended::Passed, ..) => 1.0,
        (Ended::NotCertifiable | Ended::NotConverged, ..) => 0.0,
        (Ended::Skipped, ..) => 2.0,
    };
    let mut kept: Vec<&Finding> = Vec::new();
    for finding in all {
        let same = |k: &&mut &Finding| {
            k.check == finding.check && k.case == finding.case && k.level == finding.level
        };
        let failed = finding.outcome == Ended::Failed;
        match kept.iter_mut().find(same) {
            Some(old) if !failed && spare(old) > spare(finding) => *old = finding,
            Some(old) if !failed || *old == finding => {}
            _ => kept.push(finding),
        }
    }
    kept
}

fn rows<'a>(findings: impl Iterator<Item = &'a Finding>) -> Rows {
    let mut rows = Rows::new(["level", "check", "case", "backend", "value", "limit", "outcome", "note"]);
    let figure = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.2e}"));
    for f in findings {
        let (value, limit) = (figure(f.value), figure(f.limit));
        let backend = f.backend.as_deref().unwrap_or_default();
        rows.push([
            &f.level.to_string(),
            f.check,
            &f.case,
            backend,
            &value,
            &limit,
            &f.outcome.to_string(),
            &f.note,
        ]);
    }
    rows
}

/// Breaks the code and prints which check notices what. A survivor is a failed validation.
#[cfg(feature = "mutants")]
fn mutants(args: &Args, context: &Context) -> Outcome {
    let table = crate::verify::mutants::kill_table(&context.backends).map_err(anyhow::Error::msg)?;
    let survivors = table.iter().filter(|kill| kill.killed_by.is_empty()).count();
    let names = |kill: &crate::verify::mutants::Kill| kill.killed_by.iter().copied().collect::<Vec<_>>();
    let text = if args.format == Format::Json {
        let rows: Vec<_> =
            table.iter().map(|k| serde_json::json!({"mutant": k.mutant, "killed_by": names(k)})).collect();
        serde_json::to_string_pretty(
            &serde_json::json!({"schema_version": "1.0", "survivors": survivors, "mutants": rows}),
        )?
    } else {
        let mut rows = Rows::new(["mutant", "killed by"]);
        for kill in &table {
            let by = if kill.killed_by.is_empty() { "SURVIVED".to_owned() } else { names(kill).join(", ") };
            rows.push([kill.mutant, &by]);
        }
        rows.render(args.format)
    };
    output::print(&text)?;
    eprintln!("{} mutants, {survivors} survived", table.len());
    Ok(if survivors > 0 { Exit::Invalid } else { Exit::Ok })
}

#[cfg(not(feature = "mutants"))]
fn mutants(_: &Args, _: &Context) -> Outcome {
    anyhow::bail!(
        "built without the feature `mutants`; run `cargo run --release --features mutants -- validate --mutants`"
    )
}
