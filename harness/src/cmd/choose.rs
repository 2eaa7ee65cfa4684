//! `choose`: which backend for this mesh and this use, with the evidence and the program.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::choose::answer::{self, Answer};
use crate::choose::explain::time;
use crate::choose::question::{Question, Updates};
use crate::engine::source::Name;
use crate::exit::Exit;
use crate::report::rows::Rows;
use indicatif::ProgressBar;
use std::fmt::Write;
use std::io::IsTerminal;
use std::time::Duration;

/// Choose a backend for a mesh and a use: measures the candidates on it, and prints the program that uses the best
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    lapbench choose --mesh scan.ply                                        1000 frames, 3 columns, error 1e-8\n  \
    lapbench choose --mesh scan.ply --frames 1 --accuracy 1e-4             a single solve, display accuracy\n  \
    lapbench choose --mesh scan.ply --updates values --budget-ms 16.6      new matrix values in every frame, at 60 Hz\n  \
    lapbench choose --mesh scan.ply --quick                                predicted within two seconds\n\
    Exit code 1 where no backend keeps every rule.")]
pub struct Args {
    /// The mesh: a file or a generated one such as body:50000
    #[arg(long, value_name = "MESH")]
    mesh: String,
    #[command(flatten)]
    question: Question,
    /// Predict from a fitted cost model instead of measuring
    #[arg(long)]
    quick: bool,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// Answers and prints.
///
/// # Errors
/// A mesh that cannot be read or solved on, or no place for temporary files.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let terminal = std::io::stderr().is_terminal() && std::env::var_os("CI").is_none();
    let spinner = if terminal { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
    spinner.enable_steady_tick(Duration::from_millis(200));
    let mut progress = |doing: &str| spinner.set_message(doing.to_owned());
    progress("reading the mesh");
    let source = Name::Mesh(args.mesh.clone()).load(0)?;
    let find = if args.quick { answer::predict } else { answer::measure };
    let answer = find(&args.question, &source, &context.backends, &mut progress)?;
    spinner.finish_and_clear();
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(&answer)?,
        Format::Human => human(&answer),
        format => ranking(&answer).render(format),
    })?;
    if answer.choice.is_none() {
        eprintln!("no backend keeps every rule; the table says which rule each one breaks");
        return Ok(Exit::Error);
    }
    Ok(Exit::Ok)
}

/// Everything, for people.
fn human(answer: &Answer) -> String {
    let mut text = format!("{}: {}\n", answer.mesh.name, answer.question.sentence());
    if let Some(errors) = &answer.prediction_errors {
        let spread: Vec<String> =
            errors.iter().map(|(figure, s)| format!("{figure} {:.2} ({:.2})", s.median, s.p90)).collect();
        let _ = writeln!(
            text,
            "PREDICTED by a model, not measured. Half (nine of ten) of its predictions for meshes it was not fitted on were\nwithin these factors: {}.",
            spread.join(", ")
        );
    }
    if !answer.ranked.is_empty() {
        let _ = write!(text, "\n{}", ranking(answer).render(Format::Human));
    }
    if !answer.excluded.is_empty() {
        let _ = writeln!(text, "\n\nRuled out:");
        for out in &answer.excluded {
            let _ = writeln!(text, "  {} ({}): {}", out.backend, out.rule.name(), out.reason);
        }
    }
    let _ = writeln!(text, "\n{}", answer.explanation);
    if let (Some(dependency), Some(program)) = (&answer.cargo_toml, &answer.program) {
        let _ = write!(text, "\nCargo.toml:\n\n[dependencies]\n{dependency}\n\nsrc/main.rs:\n\n{program}");
    }
    text
}

/// One row per candidate that keeps every rule.
fn ranking(answer: &Answer) -> Rows {
    let mut rows = Rows::new([
        "rank", "backend", "set-up", "solve", "change", "total", "ratio", "error", "MB", "late", "solves",
        "note",
    ]);
    for (i, ranked) in answer.ranked.iter().enumerate() {
        let figures = &ranked.figures;
        let change = match answer.question.updates {
            Updates::Never => String::new(),
            _ => time(figures.cost.change),
        };
        let mut notes = Vec::new();
        if ranked.ties {
            notes.push("ties with the first".to_owned());
        }
        if figures.cost.prepares_anew {
            notes.push("prepares anew".to_owned());
        }
        if let Some(iterations) = figures.iterations {
            notes.push(format!("{iterations} iterations"));
        }
        if figures.solves > 0 && !figures.error_is_certain {
            notes.push("error not certain: residual".to_owned());
        }
        rows.push([
            &(i + 1).to_string(),
            &figures.backend,
            &time(figures.cost.set_up),
            &time(figures.cost.solve),
            &change,
            &time(ranked.total),
            &format!("{:.2}", ranked.ratio),
            &figures.error.map_or_else(String::new, |e| format!("{e:.0e}")),
            &figures.peak_bytes.map_or_else(String::new, |b| format!("{:.0}", b as f64 * 1e-6)),
            &figures.late.map_or_else(String::new, |l| format!("{:.1}%", 100.0 * l)),
            &if figures.solves > 0 { figures.solves.to_string() } else { "predicted".to_owned() },
            &notes.join(", "),
        ]);
    }
    rows
}
