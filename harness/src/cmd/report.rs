//! `report`: result files as one HTML file, Markdown, CSV, JUnit or a picture.

use super::{Outcome, output};
use crate::exit::Exit;
use crate::file;
use crate::record;
use crate::record::result::{Cell, ResultFile};
use crate::report::{html, junit, markdown, rows::Rows, table};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Make a report from result files: one self-contained HTML file, Markdown, CSV, JUnit or SVG
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Several results stand one below the other, each with its own environment and ranks.\n\nExamples:\n  \
    lapbench report r.json --out r.html\n  lapbench report r.json --format markdown"
)]
pub struct Args {
    /// Result files of `run` or `merge`
    #[arg(required = true, value_name = "RESULT.json")]
    results: Vec<PathBuf>,
    /// Where the report goes [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Form of the report [default: by the ending of --out, else HTML]
    #[arg(long, value_enum)]
    format: Option<Form>,
}

/// Forms of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Form {
    /// One file with pictures and a table that sorts and filters
    Html,
    /// A short table, for a README
    Markdown,
    /// One line per cell
    Csv,
    /// One test case per cell, for continuous integration
    Junit,
    /// One picture of all medians
    Svg,
}

impl Form {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "html" | "htm" => Some(Self::Html),
            "md" => Some(Self::Markdown),
            "csv" => Some(Self::Csv),
            "xml" => Some(Self::Junit),
            "svg" => Some(Self::Svg),
            _ => None,
        }
    }
}

/// Reads, renders, writes.
///
/// # Errors
/// Where a result cannot be read or the report cannot be written.
pub fn run(args: &Args) -> Outcome {
    let read = |path: &PathBuf| -> anyhow::Result<(String, ResultFile)> {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok((name, record::file::read(path)?))
    };
    let results: Vec<(String, ResultFile)> = args.results.iter().map(read).collect::<Result<_, _>>()?;
    let form = args.format.or_else(|| args.out.as_deref().and_then(Form::of)).unwrap_or(Form::Html);
    let text = render(form, &results)?;
    match &args.out {
        Some(path) => {
            file::write_atomically(path, |out| out.write_all(text.as_bytes())).context("the report")?;
            eprintln!("{}: {} KiB", path.display(), text.len().div_ceil(1024));
        }
        None => output::print(&text)?,
    }
    Ok(Exit::Ok)
}

/// Writes the HTML report of one result.
///
/// # Errors
/// Where it cannot be written.
pub fn write_html(path: &Path, name: String, result: &ResultFile) -> anyhow::Result<()> {
    let page = html::page(&[(name, result.clone())]);
    file::write_atomically(path, |out| out.write_all(page.as_bytes())).context("the report")?;
    eprintln!("{}: {} KiB", path.display(), page.len().div_ceil(1024));
    Ok(())
}

fn render(form: Form, results: &[(String, ResultFile)]) -> anyhow::Result<String> {
    Ok(match form {
        Form::Html => html::page(results),
        Form::Markdown => results
            .iter()
            .map(|(name, result)| markdown::markdown(name, result))
            .collect::<Vec<_>>()
            .join("\n"),
        Form::Csv => csv(results).render(output::Format::Csv),
        Form::Junit => junit::junit(results)?,
        Form::Svg => match results {
            [(_, result)] => markdown::picture(result),
            _ => anyhow::bail!("a picture shows one result: times of different files do not compare"),
        },
    })
}

/// All cells; of several results, with the file in front.
fn csv(results: &[(String, ResultFile)]) -> Rows {
    if let [(_, result)] = results {
        return table::full(&result.cells);
    }
    let mut all = Rows::default();
    for (name, result) in results {
        let Rows { header, rows } = table::full(&result.cells);
        all.header = std::iter::once("file".to_owned()).chain(header).collect();
        all.rows.extend(rows.into_iter().map(|row| std::iter::once(name.clone()).chain(row).collect()));
    }
    if all.header.is_empty() {
        all.header = table::full(&[] as &[Cell]).header;
    }
    all
}
