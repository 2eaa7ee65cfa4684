//! `cost-model`: fits the model behind `choose --quick`, and measures how far it is off on other meshes.

use super::output;
use super::{Context, Outcome};
use crate::choose::answer::{self, Track};
use crate::choose::cost::Cost;
use crate::choose::figures::Figures;
use crate::choose::model::{FIGURES, Model, Observation, Spread};
use crate::choose::question::{Question, Updates};
use crate::engine::source::{Name, Source};
use crate::environment::Environment;
use crate::exit::Exit;
use crate::file;
use crate::report::rows::Rows;
use lapsolve::registry::{Accuracy, Entry};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Measure cells for the model of `choose --quick`: check it on meshes it does not know, or fit it anew (--fit)
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Meshes; several sizes for a fit
    #[arg(long, value_name = "MESH", value_delimiter = ',', required = true)]
    mesh: Vec<String>,
    /// Columns of a right-hand side
    #[arg(long, value_name = "K", value_delimiter = ',', default_values_t = [3u32])]
    columns: Vec<u32>,
    /// Leave out backends of which a smaller mesh has shown that a set-up and a solve take more than this many seconds
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    patience: f64,
    /// Fit to these meshes and write the model there (harness/src/choose/model.json is the one that is built in)
    #[arg(long, value_name = "FILE.json")]
    fit: Option<PathBuf>,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: output::Format,
}

/// Measures, then fits or checks.
///
/// # Errors
/// A mesh that cannot be read or solved on, or a model that cannot be written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let base = Question::default();
    let probe = answer::probe(&base, &context.backends, &mut |_| {})?;
    let mut observations = Vec::new();
    let mut sources =
        args.mesh.iter().map(|m| Name::Mesh(m.clone()).load(0)).collect::<Result<Vec<_>, _>>()?;
    sources.sort_by_key(|source| source.record.vertices);
    let mut slow: Vec<&'static str> = Vec::new();
    for source in &sources {
        for &columns in &args.columns {
            let entries: Vec<Entry> =
                context.backends.iter().filter(|e| !slow.contains(&e.id)).copied().collect();
            let observed = observe(source, columns, &entries)?;
            let seconds =
                |o: &Observation| (o.figures[0].unwrap_or(0.0) + o.figures[1].unwrap_or(0.0)) * 1e-9;
            slow.extend(entries.iter().map(|e| e.id).filter(|id| {
                observed.iter().find(|o| o.backend == *id).is_none_or(|o| seconds(o) > args.patience)
            }));
            observations.extend(observed);
        }
    }
    if let Some(path) = &args.fit {
        let model = Model {
            meshes: sources.iter().map(|s| s.record.name.clone()).collect(),
            machine: Environment::read().fingerprint.cpu.unwrap_or_default(),
            threads: base.threads(),
            accuracy: base.accuracy,
            probe,
            backends: Model::fit(&observations),
            left_out: Model::leave_one_out(&observations),
        };
        let text = serde_json::to_string_pretty(&model)? + "\n";
        file::write_atomically(path, |out| out.write_all(text.as_bytes()))?;
        eprintln!("fitted to {} cells; each mesh predicted by a fit to the others:", observations.len());
        output::print(&spreads(&model.left_out).render(args.format))?;
        return Ok(Exit::Ok);
    }
    let model = Model::built_in();
    for source in sources.iter().filter(|s| model.meshes.contains(&s.record.name)) {
        eprintln!("{}: the model was fitted on it; its errors below say little", source.record.name);
    }
    output::print(&spreads(&model.errors(&observations, &probe)).render(args.format))?;
    let regrets = regrets(&model, &observations, &probe);
    output::print(&regrets.render(args.format))?;
    Ok(Exit::Ok)
}

/// Every backend on a mesh: set-up, solves, new values; direct ones with edits of the constraints as well.
fn observe(source: &Source, columns: u32, backends: &[Entry]) -> anyhow::Result<Vec<Observation>> {
    let is_direct = |e: &&Entry| e.accuracy == Accuracy::Direct;
    let direct: Vec<Entry> = backends.iter().filter(is_direct).copied().collect();
    let iterative: Vec<Entry> = backends.iter().filter(|e| !is_direct(e)).copied().collect();
    let values = Question { columns, updates: Updates::Values, ..Question::default() };
    // Direct ones have an accuracy of their own: none is left out for it.
    let loose = Question { accuracy: 0.1, ..values.clone() };
    let edits = Question { updates: Updates::Constraints, ..loose.clone() };
    let measure = |question: &Question, entries: &[Entry]| -> anyhow::Result<Vec<Figures>> {
        let track = Track::new(question, source, backends, &mut |_| {})?;
        let (entries, _) = answer::admitted(question, entries, track.task.unknowns());
        let mut progress = |doing: &str| eprintln!("{}, {columns} column(s): {doing}", source.record.name);
        let outcome = track.course(question, source, false).race(&entries, &mut progress);
        outcome.exclusions.iter().for_each(|out| eprintln!("{}: {}", out.backend, out.reason));
        Ok(outcome.figures)
    };
    let edited = measure(&edits, &direct)?;
    let mut observations = Vec::new();
    for (figures, iterative) in measure(&loose, &direct)?
        .into_iter()
        .map(|f| (f, false))
        .chain(measure(&values, &iterative)?.into_iter().map(|f| (f, true)))
    {
        let Cost { set_up, first, solve, change, prepares_anew } = figures.cost;
        let edit = edited.iter().find(|f| f.backend == figures.backend && !f.cost.prepares_anew);
        observations.push(Observation {
            mesh: source.record.name.clone(),
            vertices: source.record.vertices.unwrap_or(0),
            columns,
            iterative,
            error: figures.error,
            figures: [
                Some(set_up),
                Some(first),
                Some(solve),
                (!prepares_anew).then_some(change),
                edit.map(|f| f.cost.change),
                figures.peak_bytes.map(|b| b as f64),
            ],
            backend: figures.backend,
        });
    }
    Ok(observations)
}

fn spreads(spreads: &BTreeMap<String, Spread>) -> Rows {
    let mut rows = Rows::new(["figure", "half within a factor of", "nine of ten within", "cells"]);
    for name in FIGURES {
        if let Some(s) = spreads.get(name) {
            rows.push([name, &format!("{:.2}", s.median), &format!("{:.2}", s.p90), &s.count.to_string()]);
        }
    }
    rows
}

/// What following the model costs: for some questions on every mesh, the measured total of the predicted choice over that
/// of the best.
fn regrets(model: &Model, observations: &[Observation], probe: &crate::choose::model::Probe) -> Rows {
    let mut rows = Rows::new(["mesh", "columns", "updates", "frames", "model says", "best", "costs"]);
    let mut keys: Vec<(&str, u32)> = observations.iter().map(|o| (o.mesh.as_str(), o.columns)).collect();
    keys.sort_unstable();
    keys.dedup();
    for (mesh, columns) in keys {
        let cells: Vec<&Observation> =
            observations.iter().filter(|o| o.mesh == mesh && o.columns == columns).collect();
        for (updates, frames) in [(Updates::Never, 1), (Updates::Never, 1000), (Updates::Values, 1000)] {
            let asked = Question { frames, columns, updates, ..Question::default() };
            let measured = |o: &Observation| {
                let [set_up, first, solve, change, ..] = o.figures;
                let change = if updates == Updates::Never { Some(0.0) } else { change.or(set_up) };
                let cost = Cost {
                    set_up: set_up?,
                    first: first?,
                    solve: solve?,
                    change: change?,
                    prepares_anew: false,
                };
                o.error.is_none_or(|e| e <= asked.accuracy).then(|| cost.total(&asked))
            };
            let predicted = |o: &Observation| {
                let figures = model.predict(&o.backend, o.vertices, &asked, probe)?;
                figures.error.is_none_or(|e| e <= asked.accuracy).then(|| figures.cost.total(&asked))
            };
            let least = |f: &dyn Fn(&Observation) -> Option<f64>| {
                let known = cells.iter().filter_map(|&o| Some((o, f(o)?)));
                known.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(o, _)| o)
            };
            let (Some(choice), Some(best)) = (least(&predicted), least(&measured)) else { continue };
            let regret = match (measured(choice), measured(best)) {
                (Some(choice), Some(best)) => format!("{:.2}", choice / best),
                _ => "breaks a rule".to_owned(),
            };
            let updates = if updates == Updates::Never { "never" } else { "values" };
            rows.push([
                mesh,
                &columns.to_string(),
                updates,
                &frames.to_string(),
                &choice.backend,
                &best.backend,
                &regret,
            ]);
        }
    }
    rows
}
