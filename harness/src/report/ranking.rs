//! Who is fastest, said only where it may be: right answers to one workload, one precision, one kind of hardware, one
//! thread count, one level of achieved error.

use super::view::{Hardware, View, achieved_error, interval_ms, is_valid, median_ms};
use crate::record::names::{Division, Precision};
use crate::record::result::Cell;
use crate::statistics::ranking::{Standing, Time, rank};

/// Levels of error at which solvers are compared: a cell takes part where its achieved error is at most the level. 1e-8 is
/// what iterative solvers are held to at their default tolerance, 1e-12 is the level of direct ones, 1e-4 that of f32.
pub const LEVELS: [f64; 3] = [1e-4, 1e-8, 1e-12];

/// What solvers of one rank have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct Class {
    /// What they solve: a library that does not do a workload is no worse for it.
    pub workload: String,
    /// What they compute in.
    pub precision: Precision,
    /// What they run on.
    pub hardware: Hardware,
    /// Threads they were given.
    pub threads: usize,
    /// Largest achieved error.
    pub level: f64,
}

/// A rank of one class.
#[derive(Clone, Debug)]
pub struct Ranking {
    /// What they have in common.
    pub class: Class,
    /// Names of the solvers, as in [`View::label`], with the division of each.
    pub solvers: Vec<(String, Option<Division>)>,
    /// Titles of the problems.
    pub problems: Vec<String>,
    /// Milliseconds, by solver and problem.
    pub times: Vec<Vec<Time>>,
    /// From the best on.
    pub standings: Vec<Standing>,
}

/// Every rank that a result holds, those of most solvers first; classes with a single solver are none.
pub fn rankings(view: &View<'_>) -> Vec<Ranking> {
    let mut rankings: Vec<Ranking> =
        classes(view).into_iter().filter_map(|class| Ranking::of(view, class)).collect();
    rankings.sort_by_key(|ranking| std::cmp::Reverse((ranking.standings.len(), ranking.class.threads)));
    rankings
}

/// Classes that occur. Of the levels, the tightest that leaves the same cells is kept, so that no rank comes twice.
fn classes(view: &View<'_>) -> Vec<Class> {
    let mut found: Vec<Class> = Vec::new();
    for cell in view.result.cells.iter().filter(|cell| is_valid(cell)) {
        let Some(precision) = cell.precision else { continue };
        let class = |level| Class {
            workload: cell.workload.clone(),
            precision,
            hardware: Hardware::of(cell),
            threads: cell.threads,
            level,
        };
        let mut before = 0;
        for level in LEVELS.into_iter().rev() {
            let class = class(level);
            let members = view.result.cells.iter().filter(|cell| class.holds(cell)).count();
            if members > before && !found.contains(&class) {
                found.push(class);
            }
            before = members;
        }
    }
    found
}

impl Class {
    /// Whether a cell belongs to it.
    pub fn holds(&self, cell: &Cell) -> bool {
        is_valid(cell)
            && cell.workload == self.workload
            && cell.precision == Some(self.precision)
            && Hardware::of(cell) == self.hardware
            && cell.threads == self.threads
            && achieved_error(cell).is_some_and(|error| error <= self.level)
    }

    /// "harmonic: f64 on CPU, 2 threads, error at most 1e-8".
    pub fn title(&self) -> String {
        let threads =
            if self.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", self.threads) };
        let Self { workload, precision, hardware, level, .. } = self;
        format!("{workload}: {precision} on {}, {threads}, error at most {level:.0e}", hardware.name())
    }
}

impl Ranking {
    fn of(view: &View<'_>, class: Class) -> Option<Self> {
        let mut solvers: Vec<(String, Option<Division>)> = Vec::new();
        for cell in view.result.cells.iter().filter(|cell| class.holds(cell)) {
            if !solvers.iter().any(|(name, _)| *name == cell.backend) {
                solvers.push((cell.backend.clone(), cell.division));
            }
        }
        let groups = view.groups.iter().filter(|g| g.cells.iter().any(|cell| class.holds(cell)));
        let groups: Vec<_> = groups.collect();
        let time = |name: &str, cells: &[&Cell]| -> Time {
            let cell = cells.iter().find(|cell| cell.backend == name && class.holds(cell))?;
            let median = median_ms(cell)?;
            let (low, high) = interval_ms(cell).unwrap_or((median, median));
            Some((median, low, high))
        };
        let times: Vec<Vec<Time>> =
            solvers.iter().map(|(name, _)| groups.iter().map(|g| time(name, &g.cells)).collect()).collect();
        let standings = rank(&times);
        let problems = groups.iter().map(|g| g.title()).collect();
        (standings.len() > 1).then_some(Self { class, solvers, problems, times, standings })
    }
}
