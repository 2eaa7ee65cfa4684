//! `run`: meshes x workloads x backends -> table, JSON.

pub(super) mod choice;
pub(super) mod recorder;
pub(super) mod verdict;

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::engine::inputs::Inputs;
use crate::engine::plan::{Plan, Shard};
use crate::engine::settings::Settings;
use crate::engine::solver::Peer;
use crate::engine::workload::Workload;
use crate::exit::Exit;
use crate::record::{self, result::Cell};
use crate::report::table;
use recorder::Recorder;
use std::path::PathBuf;
use std::time::Duration;

/// Measure backends on workloads and meshes; without arguments the default suite
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Meshes: files or generated ones such as body:50000 (see `lapbench list`)
    #[arg(long, value_name = "MESH", value_delimiter = ',')]
    mesh: Vec<String>,
    /// SPD matrices, MatrixMarket
    #[arg(long, value_name = "FILE.mtx", value_delimiter = ',')]
    matrix: Vec<String>,
    /// Workloads
    #[arg(long, value_name = "WORKLOAD", value_delimiter = ',', value_enum)]
    workload: Vec<Workload>,
    /// Backends, or peers of the catalogue
    #[arg(long, value_name = "ID", value_delimiter = ',')]
    backend: Vec<String>,
    /// A foreign solver that speaks the peer protocol: of the catalogue, or any as NAME=COMMAND; may be repeated
    #[arg(long, value_name = "ID|NAME=COMMAND")]
    peer: Vec<Peer>,
    /// Every backend and every workload
    #[arg(long)]
    all: bool,
    /// Thread counts [default: all cores]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Vec<u16>,
    /// Relative residual asked of iterative backends
    #[arg(long, value_name = "TOL", default_value_t = lapsolve::limits::DEFAULT_TOLERANCE, value_parser = positive)]
    tol: f64,
    /// Vulkan device: index or part of its name
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Shorter, for a look: the result is marked as not quotable
    #[arg(long)]
    quick: bool,
    /// Seconds of steady solves per cell
    #[arg(long, value_name = "S", value_parser = positive)]
    cell_time: Option<f64>,
    /// Rates at which frames are started on a schedule; 0 leaves them out [default: 60,90,120]
    #[arg(long, value_name = "HZ", value_delimiter = ',', value_parser = rate, conflicts_with = "require_hz")]
    rates: Vec<f64>,
    /// Seconds to wait for one answer of a cell
    #[arg(long, value_name = "S", value_parser = positive)]
    cell_timeout: Option<f64>,
    /// Cap on the address space of a cell's process, bytes
    #[arg(long, value_name = "BYTES")]
    memory_limit: Option<u64>,
    /// Seed of the order within rounds
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Prefixes of backends of which at least one cell must be ok
    #[arg(long, value_name = "PREFIX", value_delimiter = ',')]
    require: Vec<String>,
    /// Judge every cell: can it be started so often per second, with at most 1% late?
    #[arg(long, value_name = "HZ", value_parser = positive)]
    require_hz: Option<f64>,
    /// End in exit code 5 where --require-hz stays undecided
    #[arg(long)]
    strict: bool,
    /// Measure this part of the cells only
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Where the result goes; rows are written as they are made
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Keep the finished cells of this result and measure the others; the result goes there unless --out is given
    #[arg(long, value_name = "FILE.json")]
    resume: Option<PathBuf>,
    /// Also make an HTML report of the result
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Append a line per cell to a history file
    #[arg(long, value_name = "FILE.jsonl", num_args = 0..=1, default_missing_value = "bench_results/history.jsonl")]
    history: Option<PathBuf>,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    #[command(flatten)]
    inputs: Inputs,
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value > 0.0 && value < 1e9 { Ok(value) } else { Err("must be above 0 and below 1e9".to_owned()) }
}

fn rate(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value == 0.0 || (0.1..=10_000.0).contains(&value) {
        Ok(value)
    } else {
        Err("must be 0, or between 0.1 and 10,000".to_owned())
    }
}

/// Measures and prints.
///
/// # Errors
/// Where the result cannot be read or written or there is no place for temporary files.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let plan = match args.plan(context) {
        Ok(plan) => plan,
        Err(unknown) => return Ok(context.unknown_backend(&unknown)),
    };
    let mut recorder = Recorder::new(args.out.as_ref().or(args.resume.as_ref()), args.is_short())?;
    if let Some(path) = &args.resume {
        let differences = recorder.resume(record::file::read(path)?);
        if !differences.is_empty() {
            eprintln!("{}: made in another environment: {}", path.display(), differences.join("; "));
            return Ok(Exit::Incomparable);
        }
    }
    recorder.save()?; // an unwritable place is found before anything is measured
    let finished: Vec<Cell> = recorder.finished().to_vec();
    plan.execute(&context.backends, &|cell| finished.iter().any(|f| f.same_as(cell)), &mut recorder)?;
    let (result, written) = recorder.finish(args.history.as_deref());
    print(args, &result)?; // what was measured is seen even where there was no room for it
    if let Some(path) = &args.report {
        let name = args.out.as_ref().and_then(|out| out.file_name());
        let name = name.map_or_else(|| "result".to_owned(), |name| name.to_string_lossy().into_owned());
        super::report::write_html(path, name, &result)?;
    }
    written?;
    Ok(args.verdict(&result.cells))
}

impl Args {
    /// Whether the run is too short to be quoted.
    fn is_short(&self) -> bool {
        self.quick
    }

    fn settings(&self) -> Settings {
        let base = if self.quick { Settings::quick() } else { Settings::default() };
        let seconds = |given: Option<f64>, or: Duration| given.map_or(or, Duration::from_secs_f64);
        let mut settings = Settings {
            cell_time: seconds(self.cell_time, base.cell_time),
            cell_timeout: seconds(self.cell_timeout, base.cell_timeout),
            tolerance: self.tol,
            device: self.device.clone(),
            memory_limit: self.memory_limit,
            seed: self.seed,
            ..base
        };
        if !self.rates.is_empty() {
            settings.rates = self.rates.iter().copied().filter(|&hz| hz > 0.0).collect();
        }
        if let Some(hz) = self.require_hz {
            settings.rates = vec![hz];
            settings.least_frames = verdict::FRAMES;
        }
        settings
    }

    /// The plan, or the name that is no backend.
    fn plan(&self, context: &Context) -> Result<Plan, String> {
        Ok(Plan {
            sources: choice::sources(&self.mesh, &self.matrix),
            workloads: choice::workloads(&self.workload, self.all),
            solvers: choice::solvers(&self.backend, &self.peer, self.all, context)?,
            threads: choice::threads(&self.threads),
            inputs: self.inputs.clone(),
            settings: self.settings(),
            shard: self.shard,
        })
    }

    fn verdict(&self, cells: &[Cell]) -> Exit {
        let mut exit = verdict::of_statuses(cells);
        for prefix in verdict::unmet(&self.require, cells) {
            eprintln!("--require {prefix}: no cell of such a backend is ok");
            exit = exit.or(Exit::Error);
        }
        if let Some(hz) = self.require_hz {
            exit = exit.or(verdict::of_rate(cells, hz, self.strict));
        }
        exit
    }
}

fn print(args: &Args, result: &record::result::ResultFile) -> std::io::Result<()> {
    match args.format {
        Format::Json => output::print(&record::file::text(result)),
        Format::Csv => output::print(&table::full(&result.cells).render(Format::Csv)),
        format => {
            output::print(&table::overview(&result.cells).render(format))?;
            eprint!(
                "{}{}{}",
                table::steps(&result.cells),
                table::assemblies(&result.cells),
                table::reasons(&result.cells)
            );
            if let Some(hz) = args.require_hz {
                output::print(&verdict::rows(&result.cells, hz).render(format))?;
            }
            if !result.quotable {
                eprintln!("shortened run: not quotable");
            }
            Ok(())
        }
    }
}
