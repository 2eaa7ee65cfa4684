//! Measures the candidates on the user's system, and drops those early that cannot win.
//!
//! Successive halving (Jamieson and Talwalkar, AISTATS 2016) with what the question gives for free: a candidate whose set-up
//! and first solves already cost more than the best one does in all is stopped there.
//!
//! ```text
//! qualify:  one after the other: prepare, first solve, a short slice; stopped by time caps
//! heats:    those within twice the best, interleaved in shuffled rounds; set-ups repeated in fresh processes
//! final:    those within 1.15 times, the same for longer
//! ```
//! Everything runs through the engine: a process for each candidate, every answer checked, never two at the same moment.

use super::cost::Cost;
use super::figures::{Figures, Samples};
use super::question::{Question, Updates};
use super::rules::{self, Exclusion, Rule};
use crate::engine::cell::Running;
use crate::engine::settings::Settings;
use crate::engine::solver::Solver;
use crate::engine::source::Source;
use crate::engine::task::Task;
use crate::engine::task::edits::FirstEdit;
use crate::process;
use crate::record::names::Status;
use crate::record::result::Cell;
use crate::report::table;
use crate::statistics::percentiles::median;
use crate::statistics::random::Random;
use lapsolve::registry::{Accuracy, Entry};
use std::cell::OnceCell;
use std::time::Duration;

/// What the candidates solve.
pub struct Course<'a> {
    /// What is asked.
    pub question: &'a Question,
    /// The system.
    pub task: &'a Task,
    /// The mesh.
    pub source: &'a Source,
    /// Other constraints to move to, where they change.
    pub edit: Option<&'a FirstEdit>,
    /// Whether candidates may be stopped because others are faster; a model needs all of them.
    pub stops: bool,
}

/// A candidate in the race.
struct Runner<'a> {
    solver: &'a Solver,
    running: Running<'a>,
    samples: Samples,
    timed: usize,
}

/// What lives as long as the race: a solver and the settings of its attempts.
struct Lane {
    solver: Solver,
    settings: [OnceCell<Settings>; ATTEMPTS],
}

/// What came of a race.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Those that keep every rule, in no order.
    pub figures: Vec<Figures>,
    /// Those that do not.
    pub exclusions: Vec<Exclusion>,
}

/// Steady solves of one round: some ticks of the scheduler, some hundred solves of a small system.
const SLICE: Duration = Duration::from_millis(80);

/// Rounds of the heats, and of the final.
const HEATS: u32 = 3;
const FINAL: u32 = 6;

/// After the qualification and after the heats, who costs more than this times the best is out of the race: a single set-up
/// and a short slice can be off by half on a shared machine, the medians of the heats by some hundredths.
const TO_HEATS: f64 = 2.0;
const TO_FINAL: f64 = 1.15;

/// Most candidates in the heats and in the final.
const MOST_HEATS: usize = 5;
const MOST_FINAL: usize = 3;

/// Fresh set-ups of each candidate in the heats and again in the final, where they are more than this share of the total.
const SET_UPS: usize = 2;
const SET_UP_SHARE: f64 = 0.03;

/// A first solve touches its memory for the first time; later ones take at least this share of it.
const WARM_SHARE: f64 = 0.25;

/// Longest wait for one answer of the first candidate, which nothing bounds yet, and of later ones. The first are those that
/// are predicted to be fast: one that takes longer than half a minute would have to be predicted wrong.
const FIRST_CAP: Duration = Duration::from_secs(30);
const CAP: Duration = Duration::from_secs(8);

/// Time that reading the system and starting take besides the work itself, at most.
const START: Duration = Duration::from_secs(1);

/// Tolerances that are tried until the error of an iterative backend is small enough.
const ATTEMPTS: usize = 3;

impl Course<'_> {
    /// Measures `entries`, the most promising first.
    pub fn race(&self, entries: &[Entry], progress: &mut dyn FnMut(&str)) -> Outcome {
        let lane = |entry: &Entry| Lane {
            solver: Solver::BuiltIn(*entry),
            settings: [const { OnceCell::new() }; ATTEMPTS],
        };
        let lanes: Vec<Lane> = entries.iter().map(lane).collect();
        let mut outcome = Outcome::default();
        let mut runners: Vec<Runner<'_>> = Vec::new();
        let mut best = f64::INFINITY;
        for (index, (entry, lane)) in entries.iter().zip(&lanes).enumerate() {
            progress(&format!("{} of {}: {}", index + 1, entries.len(), entry.id));
            match self.qualify(entry, lane, index, best) {
                Ok(runner) => {
                    let figures = runner.figures(self.question);
                    match rules::after(&figures, self.question) {
                        Err(exclusion) => outcome.exclusions.push(exclusion),
                        Ok(()) => {
                            best = best.min(figures.cost.total(self.question));
                            runners.push(runner);
                            self.retire(&mut runners, TO_HEATS, MOST_HEATS, &mut outcome);
                        }
                    }
                }
                Err(exclusion) => outcome.exclusions.push(exclusion),
            }
        }
        let mut random = Random::new(1);
        for (rounds, keep, most) in [(HEATS, TO_FINAL, MOST_FINAL), (FINAL, 1.0, 0)] {
            progress(&format!("{} candidates left", runners.len()));
            for _ in 0..rounds {
                random.shuffle(&mut runners);
                runners.iter_mut().for_each(|runner| runner.round(self));
            }
            self.repeat_set_ups(&mut runners, progress);
            self.retire(&mut runners, keep, most, &mut outcome);
        }
        outcome
    }

    /// Ends those that cost more than `factor` times the best, and all but the best `most`; their figures stay.
    fn retire(&self, runners: &mut Vec<Runner<'_>>, factor: f64, most: usize, outcome: &mut Outcome) {
        let most = if self.stops { most } else { 0 };
        let total = |runner: &Runner<'_>| runner.figures(self.question).cost.total(self.question);
        runners.sort_by(|a, b| total(a).total_cmp(&total(b)));
        let limit = runners.first().map_or(0.0, total) * factor;
        let fits = |runners: &[Runner<'_>]| {
            let largest = runners.iter().filter_map(|r| r.running.peak_bytes()).max().unwrap_or(0);
            runners.len() < 2 || process::available_bytes().is_none_or(|free| free > 2 * largest)
        };
        while let Some(last) = runners.last() {
            if runners.len() <= most && total(last) <= limit && fits(runners.as_slice()) {
                break;
            }
            if let Some(runner) = runners.pop() {
                self.settle(runner, outcome);
            }
        }
    }

    /// Takes the figures of a runner, and ends it.
    fn settle(&self, mut runner: Runner<'_>, outcome: &mut Outcome) {
        runner.running.look_at_memory();
        let row = runner.running.row();
        if let Some(exclusion) = failed(&row) {
            outcome.exclusions.push(exclusion);
            return;
        }
        let figures = runner.figures(self.question);
        match rules::after(&figures, self.question) {
            Ok(()) => outcome.figures.push(figures),
            Err(exclusion) => outcome.exclusions.push(exclusion),
        }
    }

    /// Prepares a candidate, solves once and for a short slice. `best` is the cost of the best one so far.
    fn qualify<'a>(
        &'a self,
        entry: &Entry,
        lane: &'a Lane,
        index: usize,
        best: f64,
    ) -> Result<Runner<'a>, Exclusion> {
        let cap = if best.is_finite() && self.stops {
            CAP.min(START + Duration::from_nanos((2.0 * best) as u64))
        } else if self.stops {
            FIRST_CAP
        } else {
            CAP
        };
        let running = self.start(entry, lane, index, cap)?;
        let mut samples = Samples::default();
        samples.add_set_up(&running.row());
        let mut runner = Runner { solver: &lane.solver, running, samples, timed: 0 };
        // Before the cost: an error is the same on a busy machine.
        rules::accuracy(&runner.figures(self.question), self.question)?;
        let hopeful = runner.lower_bound(self.question);
        if self.stops && hopeful > TO_HEATS * best {
            return Err(Exclusion::new(entry.id, Rule::Cost, self.hopeless(&runner, best)));
        }
        runner.round(self);
        let row = runner.running.row();
        failed(&row).map_or(Ok(runner), Err)
    }

    fn hopeless(&self, runner: &Runner<'_>, best: f64) -> String {
        let row = runner.running.row();
        let set_up = table::set_up(&row).unwrap_or(0) as f64 * 1e-6;
        let first = row.phases_ns.first_solve.unwrap_or(0) as f64 * 1e-6;
        format!(
            "set-up {set_up:.1} ms and first solve {first:.1} ms: {} in all would take at least {:.2} s, the best one takes {:.2} s",
            if self.question.frames == 1 {
                "a frame".to_owned()
            } else {
                format!("{} frames", self.question.frames)
            },
            runner.lower_bound(self.question) * 1e-9,
            best * 1e-9
        )
    }

    /// A process that has prepared and solved once, to the accuracy asked for.
    fn start<'a>(
        &'a self,
        entry: &Entry,
        lane: &'a Lane,
        index: usize,
        cap: Duration,
    ) -> Result<Running<'a>, Exclusion> {
        let mut tolerance = self.question.accuracy;
        let mut attempt = 0;
        loop {
            let settings = lane.settings[attempt].get_or_init(|| self.settings(tolerance, cap));
            let threads = self.question.threads();
            let mut running = Running::new(self.task, self.source, &lane.solver, threads, settings, index);
            running.begin();
            let row = running.row();
            let error = row.accuracy.forward_error.filter(|_| row.accuracy.certifiable != Some(false));
            let too_large = error.is_some_and(|error| error > self.question.accuracy);
            if entry.accuracy == Accuracy::Iterative && too_large && attempt + 1 < ATTEMPTS {
                // The error is about proportional to the residual; half of it leaves room for the "about".
                tolerance *= 0.5 * self.question.accuracy / error.unwrap_or(1.0);
                tolerance = tolerance.max(f64::EPSILON);
                attempt += 1;
                continue;
            }
            return match failed(&row) {
                Some(exclusion) => Err(exclusion),
                None => Ok(running),
            };
        }
    }

    fn settings(&self, tolerance: f64, cap: Duration) -> Settings {
        Settings {
            cell_time: SLICE,
            rounds: 1,
            cell_timeout: cap,
            open_loop_time: Duration::ZERO,
            tolerance,
            device: self.question.device.clone(),
            ..Settings::default()
        }
    }

    /// Fresh set-ups of all, in turn, where they matter for the total.
    fn repeat_set_ups(&self, runners: &mut [Runner<'_>], progress: &mut dyn FnMut(&str)) {
        let share = |runner: &Runner<'_>| {
            let cost = runner.figures(self.question).cost;
            (cost.set_up + cost.first) / cost.total(self.question)
        };
        if runners.len() < 2 && self.stops || runners.iter().all(|runner| share(runner) < SET_UP_SHARE) {
            return;
        }
        for k in 0..SET_UPS {
            progress(&format!("fresh set-ups, {} of {SET_UPS}", k + 1));
            for (index, runner) in runners.iter_mut().enumerate() {
                let tolerance = runner.running.row().tolerance.unwrap_or(self.question.accuracy);
                let settings = self.settings(tolerance, CAP);
                let threads = self.question.threads();
                // Numbered apart from those that still live: their files must not be written over.
                let mut fresh =
                    Running::new(self.task, self.source, runner.solver, threads, &settings, 1000 + index);
                fresh.begin();
                let row = fresh.row();
                if row.status == Status::Ok {
                    runner.samples.add_set_up(&row);
                }
            }
        }
    }
}

impl Runner<'_> {
    fn figures(&self, question: &Question) -> Figures {
        Figures::measured(&self.running.row(), &self.samples, question)
    }

    /// A cost that the measured one will hardly be below, from set-up and first solve; changes are not known yet.
    fn lower_bound(&self, question: &Question) -> f64 {
        let row = self.running.row();
        let first = row.phases_ns.first_solve.unwrap_or(0) as f64;
        let set_up = table::set_up(&row).unwrap_or(0) as f64;
        Cost { set_up, first, solve: WARM_SHARE * first, change: 0.0, prepares_anew: false }.total(question)
    }

    /// A slice of solves, and one of changes where there are any.
    fn round(&mut self, course: &Course<'_>) {
        self.running.round();
        match (course.question.updates, course.edit) {
            _ if self.samples.prepares_anew => {}
            (Updates::Values, _) => self.running.change_values(SLICE),
            (Updates::Constraints, Some(edit)) => self.running.change_constraints(edit, SLICE),
            _ => {}
        }
        let changes = course.question.updates != Updates::Never;
        if changes && (self.running.changes().is_empty() || self.samples.prepares_anew) {
            self.samples.prepares_anew = true;
            self.running.prepare_again(SLICE);
        }
        self.samples.changes = self.running.changes().to_vec();
        let row = self.running.row();
        let mut slice = row.samples_ns.get(self.timed..).unwrap_or_default().to_vec();
        self.timed = row.samples_ns.len();
        slice.sort_unstable();
        self.samples.rounds.extend(median(&slice).map(|t| t as f64));
    }
}

/// Why a row is out, unless it is fine.
fn failed(row: &Cell) -> Option<Exclusion> {
    let reason = row.reason.clone().unwrap_or_else(|| row.status.to_string());
    let rule = match row.status {
        Status::Ok => return None,
        Status::Unavailable => Rule::Unavailable,
        Status::Unsupported => Rule::Size,
        Status::Timeout => Rule::Cost,
        Status::Oom => Rule::Memory,
        Status::NotConverged => Rule::Accuracy,
        Status::Invalid => Rule::Accuracy,
        Status::Error => Rule::Failure,
    };
    Some(Exclusion::new(&row.backend, rule, reason))
}
