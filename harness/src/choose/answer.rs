//! The answer to a question: found by measuring or from the model.

use super::explain;
use super::figures::Figures;
use super::model::{Model, PROBE_BACKEND, PROBE_MESH, Probe, Spread};
use super::question::{Question, Task, Updates};
use super::race::{Course, Outcome};
use super::ranking::{Ranked, rank};
use super::rules::{self, Exclusion, Rule};
use super::snippet;
use crate::engine::inputs::Inputs;
use crate::engine::source::{Content, Name, Source};
use crate::engine::task;
use crate::engine::task::edits::{Edits, FirstEdit};
use crate::engine::workload::Workload;
use crate::engine::workspace::Workspace;
use crate::record::result::Mesh;
use anyhow::{Context, bail};
use lapsolve::registry::Entry;
use serde::Serialize;
use std::collections::BTreeMap;

/// What `choose` found.
#[derive(Debug, Serialize)]
pub struct Answer {
    /// What was asked.
    pub question: Question,
    /// On which mesh.
    pub mesh: Mesh,
    /// Whether the figures are predictions of the model.
    pub predicted: bool,
    /// Errors of such predictions on meshes left out of the fit, by figure; null for a measurement.
    pub prediction_errors: Option<BTreeMap<String, Spread>>,
    /// The backend to use; null where none keeps every rule.
    pub choice: Option<String>,
    /// All that keep every rule, cheapest first.
    pub ranked: Vec<Ranked>,
    /// All others with the reason.
    pub excluded: Vec<Exclusion>,
    /// The choice in three sentences.
    pub explanation: String,
    /// What goes under `[dependencies]`.
    pub cargo_toml: Option<String>,
    /// A program that uses it.
    pub program: Option<String>,
}

impl Answer {
    fn new(question: &Question, mesh: Mesh, outcome: Outcome, model: Option<&Model>) -> Self {
        let ranked = rank(outcome.figures, question);
        let explanation = explain::explain(&ranked, question);
        let first = ranked.first().map(|r| &r.figures);
        // A backend of somebody else's program is not in the library.
        let own = first.filter(|f| lapsolve::registry::find(&f.backend).is_some());
        Self {
            question: question.clone(),
            mesh,
            predicted: model.is_some(),
            prediction_errors: model.map(|m| m.left_out.clone()),
            choice: first.map(|f| f.backend.clone()),
            excluded: outcome.exclusions,
            explanation,
            cargo_toml: own.map(|f| snippet::dependency(&f.backend)),
            program: own.map(|f| snippet::program(f, question)),
            ranked,
        }
    }
}

/// Measures the candidates on the mesh.
///
/// # Errors
/// A mesh that cannot be read or solved on, or no place for temporary files.
pub fn measure(
    question: &Question,
    source: &Source,
    backends: &[Entry],
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Answer> {
    let track = Track::new(question, source, backends, progress)?;
    let unknowns = track.task.unknowns();
    let (mut entries, exclusions) = admitted(question, backends, unknowns);
    sort_by_prediction(&mut entries, question, source);
    let mut outcome = track.course(question, source, true).race(&entries, progress);
    outcome.exclusions.extend(exclusions);
    Ok(Answer::new(question, source.record.clone(), outcome, None))
}

/// Predicts from the model; one probe is measured.
///
/// # Errors
/// No mesh, or no place for temporary files.
pub fn predict(
    question: &Question,
    source: &Source,
    backends: &[Entry],
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Answer> {
    let model = Model::built_in();
    let n = source.record.vertices.unwrap_or(0);
    let (entries, mut exclusions) = admitted(question, backends, n);
    let probe = probe(question, backends, progress)?;
    let mut figures = Vec::new();
    for entry in entries {
        match model.predict(entry.id, n, question, &probe) {
            None => {
                let reason = "the model was not fitted to it; measure without --quick".to_owned();
                exclusions.push(Exclusion { backend: entry.id.to_owned(), rule: Rule::Unavailable, reason });
            }
            Some(predicted) => match rules::after(&predicted, question) {
                Ok(()) => figures.push(predicted),
                Err(exclusion) => exclusions.push(exclusion),
            },
        }
    }
    Ok(Answer::new(question, source.record.clone(), Outcome { figures, exclusions }, Some(&model)))
}

/// The entries that may be tried, and the others with the reason.
pub fn admitted(question: &Question, backends: &[Entry], unknowns: usize) -> (Vec<Entry>, Vec<Exclusion>) {
    let (mut entries, mut exclusions) = (Vec::new(), Vec::new());
    for entry in backends {
        match rules::before(entry, question, unknowns) {
            Ok(()) => entries.push(*entry),
            Err(exclusion) => exclusions.push(exclusion),
        }
    }
    (entries, exclusions)
}

/// The cheapest by the model first, so that the others can be stopped early; those that it does not know after the first
/// third, where a bound is known already.
fn sort_by_prediction(entries: &mut [Entry], question: &Question, source: &Source) {
    let model = Model::built_in();
    let n = source.record.vertices.unwrap_or(0);
    let total = |entry: &Entry| {
        model.predict(entry.id, n, question, &model.probe).map(|figures| figures.cost.total(question))
    };
    let mut known: Vec<f64> = entries.iter().filter_map(total).collect();
    known.sort_by(f64::total_cmp);
    let unknown = known.get(known.len() / 3).copied().unwrap_or(0.0);
    entries.sort_by(|a, b| total(a).unwrap_or(unknown).total_cmp(&total(b).unwrap_or(unknown)));
}

/// The system of a question on a mesh, with its files.
pub struct Track {
    /// The system.
    pub task: task::Task,
    edit: Option<FirstEdit>,
    _workspace: Workspace,
}

impl Track {
    /// Assembles, solves for reference, writes what the candidates read.
    ///
    /// # Errors
    /// A system that is not acceptable, or no place for temporary files.
    pub fn new(
        question: &Question,
        source: &Source,
        backends: &[Entry],
        progress: &mut dyn FnMut(&str),
    ) -> anyhow::Result<Self> {
        let Content::Mesh(mesh) = &source.content else { bail!("a mesh is needed") };
        if question.workload == Task::Poisson && question.updates == Updates::Constraints {
            bail!("`poisson` has no constraints that could change; ask for --workload harmonic");
        }
        progress("assembling, solving for reference");
        let workspace = Workspace::new()?;
        let workload = match question.workload {
            Task::Harmonic => Workload::Harmonic,
            Task::Poisson => Workload::Poisson,
        };
        let inputs = inputs(question, mesh.positions().len(), &workspace)?;
        let task = task::Task::new(workload, source, &inputs, backends, workspace.folder("task")?)
            .with_context(|| source.record.name.clone())?;
        let edit = match question.updates {
            Updates::Constraints => Edits::new(mesh, &inputs)?.first(&workspace.path("edit"))?,
            _ => None,
        };
        Ok(Self { task, edit, _workspace: workspace })
    }

    /// The race on it.
    pub fn course<'a>(&'a self, question: &'a Question, source: &'a Source, stops: bool) -> Course<'a> {
        Course { question, task: &self.task, source, edit: self.edit.as_ref(), stops }
    }
}

/// The default right-hand side with as many columns as asked for.
fn inputs(question: &Question, n: usize, workspace: &Workspace) -> anyhow::Result<Inputs> {
    let k = question.columns as usize;
    let mut inputs = Inputs { columns: Some(question.columns), ..Inputs::default() };
    if question.workload == Task::Poisson && k != lapsolve::workload::poisson::COLUMNS {
        let path = workspace.path("rhs.npy");
        let rhs = lapsolve::workload::matrix::default_solution(n, k);
        crate::mesh_io::npy::write_columns(&path, &rhs, k)?;
        inputs.rhs = Some(path);
    }
    Ok(inputs)
}

/// Measures the probe on this machine with the question's threads.
///
/// # Errors
/// Where it cannot be measured.
pub fn probe(
    question: &Question,
    backends: &[Entry],
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Probe> {
    let question = Question { frames: 100, accuracy: 1e-2, threads: question.threads, ..Question::default() };
    progress("probing this machine");
    let source = Name::Mesh(PROBE_MESH.to_owned()).load(0)?;
    let track = Track::new(&question, &source, backends, &mut |_| {})?;
    let entry = *lapsolve::registry::find(PROBE_BACKEND).context("no backend for the probe")?;
    let outcome = track.course(&question, &source, true).race(&[entry, entry, entry], &mut |_| {});
    // Three processes: the middle one of each figure.
    let middle = |figure: fn(&Figures) -> f64| {
        let mut all: Vec<f64> = outcome.figures.iter().map(figure).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    match (middle(|f| f.cost.set_up), middle(|f| f.cost.solve)) {
        (Some(set_up), Some(solve)) => Ok(Probe { set_up, solve }),
        _ => bail!("the probe could not be measured: {:?}", outcome.exclusions),
    }
}
