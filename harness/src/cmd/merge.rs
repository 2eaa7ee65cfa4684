//! `merge`: the shards of one run as one result.

use super::{Outcome, output};
use crate::exit::Exit;
use crate::record;
use crate::record::result::{Cell, ResultFile};
use std::path::PathBuf;

/// Merge the shards of one run (`run --shard I/N`) into one result; other machines or builds are refused
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Results of the shards
    #[arg(required = true, value_name = "SHARD.json")]
    shards: Vec<PathBuf>,
    /// Where the result goes [default: standard output]
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
}

/// Merges; exit code 6 where the environments differ, because their times do not belong into one ranking.
///
/// # Errors
/// Where a shard cannot be read, two shards hold the same finished cell, or the result cannot be written.
pub fn run(args: &Args) -> Outcome {
    let mut shards = args.shards.iter().map(|path| Ok((path, record::file::read(path)?)));
    let Some((first_path, mut merged)) = shards.next().transpose()? else { return Ok(Exit::Usage) };
    let shards: Vec<(&PathBuf, ResultFile)> = shards.collect::<anyhow::Result<_>>()?;
    for (path, shard) in shards {
        let differences = merged.environment.fingerprint.differences(&shard.environment.fingerprint);
        if !differences.is_empty() {
            eprintln!(
                "{} and {} were made in different environments: {}\ntheir times do not belong into one ranking; \
                 `report` shows both, one below the other",
                first_path.display(),
                path.display(),
                differences.join("; ")
            );
            return Ok(Exit::Incomparable);
        }
        if let Some(twice) = absorb(&mut merged, shard) {
            anyhow::bail!("{}: {twice} was measured in another shard too", path.display());
        }
    }
    match &args.out {
        Some(path) => record::file::write(path, &merged)?,
        None => output::print(&record::file::text(&merged))?,
    }
    eprintln!("{} cells of {} shards", merged.cells.len(), args.shards.len());
    Ok(Exit::Ok)
}

/// Adds a shard; the name of a finished cell that both hold. Of an unfinished one the other is taken.
fn absorb(merged: &mut ResultFile, shard: ResultFile) -> Option<String> {
    merged.quotable &= shard.quotable;
    if !merged.command.contains(&shard.command) {
        merged.command = format!("{}\n{}", merged.command, shard.command);
    }
    let (info, other) = (&mut merged.environment.info, &shard.environment.info);
    let larger = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::max);
    info.load1 = larger(info.load1, other.load1);
    info.load1_end = larger(info.load1_end, other.load1_end);
    info.steal = larger(info.steal, other.steal);
    for cell in shard.cells {
        match merged.cells.iter_mut().find(|known| known.same_as(&cell)) {
            None => merged.cells.push(cell),
            Some(known) if !known.complete => *known = cell,
            Some(_) if !cell.complete => {}
            Some(known) => return Some(name(known)),
        }
    }
    None
}

fn name(cell: &Cell) -> String {
    let Cell { mesh, workload, backend, threads, .. } = cell;
    format!("{}, {workload}, {backend}, {threads} thread(s)", mesh.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Environment;

    fn shard(command: &str, cells: &[(&str, bool)]) -> ResultFile {
        let cell = |&(backend, complete): &(&str, bool)| Cell {
            backend: backend.into(),
            complete,
            ..Cell::default()
        };
        ResultFile {
            schema_version: "1.1".into(),
            command: command.into(),
            quotable: true,
            environment: Environment::default(),
            cells: cells.iter().map(cell).collect(),
        }
    }

    #[test]
    fn cells_come_together_and_finished_ones_win() {
        let mut merged = shard("run --shard 0/2", &[("a", true), ("b", false)]);
        assert_eq!(absorb(&mut merged, shard("run --shard 1/2", &[("b", true), ("c", true)])), None);
        assert_eq!(merged.cells.iter().filter(|c| c.complete).count(), 3);
        assert_eq!(merged.command, "run --shard 0/2\nrun --shard 1/2");
        let twice = absorb(&mut merged, shard("x", &[("a", true)]));
        assert!(twice.is_some_and(|name| name.contains(", a, ")));
    }
}
