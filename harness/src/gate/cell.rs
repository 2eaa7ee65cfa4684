//! What the gate judges: cells, and the cases (processes) that several cells share.

use crate::engine::source::Name;
use crate::engine::workload::Workload;
use crate::record::result;
use clap::ValueEnum;
use std::fmt;
use std::str::FromStr;

/// The cells that are judged when none are given: the direct solver's set-up, solve and frame, its mixed variant, and the
/// multigrid's solve, each process well under 0.25 s on one core.
pub const DEFAULT: [&str; 6] = [
    "body:50000/harmonic/framechol-f64/solve",
    "body:100000/harmonic/framechol-f64/setup",
    "body:100000/harmonic/framechol-f64/solve",
    "body:50000/transfer/framechol-f64/frame",
    "body:50000/poisson/framechol-mixed/solve",
    "body:50000/harmonic/cg-multigrid/solve",
];

/// The same for two foreign solvers, which do systems and harmonic fields.
pub const DEFAULT_FOREIGN: [&str; 4] = [
    "body:50000/harmonic/solve",
    "body:50000/harmonic/setup",
    "body:100000/poisson/setup",
    "body:100000/poisson/solve",
];

/// Which time of a process is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Measure {
    /// All phases of the preparation, once.
    Setup,
    /// Median of the steady solves.
    Solve,
    /// Median of the steady `transfer` frames.
    Frame,
}

/// A cell by its name: `MESH/WORKLOAD/BACKEND/MEASURE`; without the backend where both sides are foreign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Mesh, file or generated.
    pub mesh: String,
    /// Workload.
    pub workload: Workload,
    /// Backend; `None`: the foreign solvers of both sides.
    pub backend: Option<String>,
    /// What is judged.
    pub measure: Measure,
}

/// One kind of process and the times of it that are judged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// Mesh.
    pub mesh: Name,
    /// Workload.
    pub workload: Workload,
    /// Backend; `None`: the foreign solvers of both sides.
    pub backend: Option<String>,
    /// What is judged of each process.
    pub measures: Vec<Measure>,
}

impl Measure {
    /// The last part of a cell's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Setup => "setup",
            Self::Solve => "solve",
            Self::Frame => "frame",
        }
    }

    /// The steady repetition of a workload.
    fn of(workload: Workload) -> Self {
        if workload == Workload::Transfer { Self::Frame } else { Self::Solve }
    }

    /// The time in a process' row, nanoseconds.
    pub fn of_row(self, row: &result::Cell) -> Option<u64> {
        let phases = row.phases_ns;
        let set_up = [phases.order, phases.symbolic, phases.numeric, phases.upload];
        match self {
            Self::Setup => set_up.iter().flatten().copied().reduce(|a, b| a + b),
            Self::Solve => row.solve_ns.p50,
            Self::Frame => row.frame_ns.p50,
        }
        .filter(|&ns| ns > 0)
    }
}

impl FromStr for Cell {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts: Vec<&str> = text.split('/').collect();
        let last = parts.last().copied().unwrap_or_default();
        let measures = [Measure::Setup, Measure::Solve, Measure::Frame];
        let measure = measures.into_iter().find(|m| m.name() == last);
        if measure.is_some() {
            parts.pop();
        }
        let workload =
            |name: Option<&&str>| Workload::from_str(name.copied().unwrap_or_default(), false).ok();
        let (workload, backend) = match (workload(parts.last()), parts.len()) {
            (Some(workload), _) => (workload, None),
            (None, n) => {
                let found = n.checked_sub(2).and_then(|at| workload(parts.get(at)));
                let found = found.ok_or_else(|| form(text))?;
                (found, parts.pop().map(str::to_owned))
            }
        };
        parts.pop();
        let mesh = parts.join("/");
        let natural = Measure::of(workload);
        let measure = measure.unwrap_or(natural);
        if mesh.is_empty() || backend.as_deref() == Some("") || workload == Workload::Matrix {
            return Err(form(text));
        }
        if measure != Measure::Setup && measure != natural {
            return Err(format!("`{text}`: `{workload}` has setup and {}, not {last}", natural.name()));
        }
        Ok(Self { mesh, workload, backend, measure })
    }
}

fn form(text: &str) -> String {
    format!(
        "`{text}` is no cell: expected MESH/WORKLOAD/BACKEND or MESH/WORKLOAD/BACKEND/setup|solve|frame, for example {} \
        (two foreign solvers: without BACKEND)",
        DEFAULT[0]
    )
}

impl Case {
    /// The cases of `cells`: those that differ in nothing but the measure share processes. Repeated cells count once.
    pub fn group(cells: &[Cell]) -> Vec<Self> {
        let mut cases: Vec<Self> = Vec::new();
        for cell in cells {
            let mesh = Name::Mesh(cell.mesh.clone());
            let same =
                |c: &&mut Self| c.mesh == mesh && c.workload == cell.workload && c.backend == cell.backend;
            match cases.iter_mut().find(same) {
                Some(case) if case.measures.contains(&cell.measure) => {}
                Some(case) => case.measures.push(cell.measure),
                None => cases.push(Self {
                    mesh,
                    workload: cell.workload,
                    backend: cell.backend.clone(),
                    measures: vec![cell.measure],
                }),
            }
        }
        cases
    }

    /// The name of one of its cells.
    pub fn cell_name(&self, measure: Measure) -> String {
        format!("{self}/{}", measure.name())
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.mesh.short(), self.workload)?;
        self.backend.as_ref().map_or(Ok(()), |backend| write!(f, "/{backend}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read() {
        let cell = |text: &str| text.parse::<Cell>().unwrap();
        let full = cell("/data/a.ply/transfer/faer-llt/setup");
        assert_eq!((full.mesh.as_str(), full.workload), ("/data/a.ply", Workload::Transfer));
        assert_eq!((full.backend.as_deref(), full.measure), (Some("faer-llt"), Measure::Setup));
        assert_eq!(cell("body:9/transfer/x").measure, Measure::Frame);
        assert_eq!(cell("body:9/kharmonic-2/x/solve").measure, Measure::Solve);
        assert_eq!(cell("a/b.ply/poisson").backend, None);
        for wrong in [
            "",
            "body:9",
            "harmonic",
            "/harmonic/x",
            "body:9/harmonic/",
            "body:9/none/x",
            "b/transfer/x/solve",
        ] {
            assert!(wrong.parse::<Cell>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn cells_share_processes() {
        let cells: Vec<Cell> = DEFAULT.iter().map(|name| name.parse().unwrap()).collect();
        let cases = Case::group(&cells);
        assert_eq!(cases.len(), 5);
        assert_eq!(cases[1].measures, [Measure::Setup, Measure::Solve]);
        let names: Vec<String> =
            cases.iter().flat_map(|case| case.measures.iter().map(|&m| case.cell_name(m))).collect();
        assert_eq!(names, DEFAULT);
        assert!(DEFAULT_FOREIGN.iter().all(|name| name.parse::<Cell>().unwrap().backend.is_none()));
    }
}
