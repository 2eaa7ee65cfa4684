//! A result arranged for reading: groups of cells that solve the same thing, and a stable look for every solver.

use super::chart::style::Style;
use crate::record::names::{DeviceType, Status};
use crate::record::result::{Cell, Mesh, ResultFile};

/// A result, arranged.
pub struct View<'a> {
    /// The file.
    pub result: &'a ResultFile,
    /// Cells that solve the same thing, in the order in which they were first met.
    pub groups: Vec<Group<'a>>,
    /// Every solver's name in pictures and tables, in the order in which they were first met.
    pub solvers: Vec<String>,
    several_threads: bool,
}

/// Cells of one mesh and one workload.
pub struct Group<'a> {
    /// The mesh or matrix.
    pub mesh: &'a Mesh,
    /// The workload.
    pub workload: &'a str,
    /// One per solver and thread count.
    pub cells: Vec<&'a Cell>,
}

impl<'a> View<'a> {
    /// Arranges `result`.
    pub fn new(result: &'a ResultFile) -> Self {
        let several_threads = result.cells.windows(2).any(|pair| pair[0].threads != pair[1].threads);
        let mut view = Self { result, groups: Vec::new(), solvers: Vec::new(), several_threads };
        for cell in &result.cells {
            let label = view.label(cell);
            if !view.solvers.contains(&label) {
                view.solvers.push(label);
            }
            let same = |g: &&mut Group<'_>| g.mesh.name == cell.mesh.name && g.workload == cell.workload;
            match view.groups.iter_mut().find(same) {
                Some(group) => group.cells.push(cell),
                None => {
                    let (mesh, workload) = (&cell.mesh, cell.workload.as_str());
                    view.groups.push(Group { mesh, workload, cells: vec![cell] });
                }
            }
        }
        view
    }

    /// The name of a cell's solver: its backend, and its threads where the result has several counts.
    pub fn label(&self, cell: &Cell) -> String {
        if self.several_threads {
            format!("{} ({} thr)", cell.backend, cell.threads)
        } else {
            cell.backend.clone()
        }
    }

    /// How a solver looks in every picture.
    pub fn style(&self, label: &str) -> Style {
        Style(self.solvers.iter().position(|solver| solver == label).unwrap_or(0))
    }

    /// Every workload, in order, once.
    pub fn workloads(&self) -> Vec<&'a str> {
        let mut workloads = Vec::new();
        for group in &self.groups {
            if !workloads.contains(&group.workload) {
                workloads.push(group.workload);
            }
        }
        workloads
    }
}

impl<'a> Group<'a> {
    /// "body:50000, transfer".
    pub fn title(&self) -> String {
        format!("{}, {}", self.mesh.name, self.workload)
    }

    /// Cells with right answers and a time: all that may stand in a picture or a rank.
    pub fn valid(&self) -> impl Iterator<Item = &'a Cell> {
        self.cells.iter().copied().filter(|cell| is_valid(cell))
    }

    /// "ms per frame" or "ms per solve".
    pub fn unit(&self) -> &'static str {
        if self.cells.iter().any(|cell| cell.frame_ns.p50.is_some()) {
            "ms per frame"
        } else {
            "ms per solve"
        }
    }
}

/// Whether a cell's time may be shown: every checked answer is right.
pub fn is_valid(cell: &Cell) -> bool {
    cell.status == Status::Ok && steady(cell).p50.is_some()
}

/// Frames, or solves where a frame is one.
pub fn steady(cell: &Cell) -> &crate::record::result::Summary {
    if cell.frame_ns.p50.is_some() { &cell.frame_ns } else { &cell.solve_ns }
}

/// Median of a frame or solve in milliseconds.
pub fn median_ms(cell: &Cell) -> Option<f64> {
    steady(cell).p50.map(|ns| ns as f64 * 1e-6)
}

/// The interval of that median in milliseconds.
pub fn interval_ms(cell: &Cell) -> Option<(f64, f64)> {
    let steady = steady(cell);
    steady.p50_low.zip(steady.p50_high).map(|(low, high)| (low as f64 * 1e-6, high as f64 * 1e-6))
}

/// The error that an answer has: forward where a reference solution certifies it, else backward.
pub fn achieved_error(cell: &Cell) -> Option<f64> {
    let certified = cell.accuracy.forward_error.filter(|_| cell.accuracy.certifiable != Some(false));
    certified.or(cell.accuracy.backward_error)
}

/// What computes: cells of different kinds are never ranked together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hardware {
    /// The processor.
    Cpu,
    /// Vulkan on the processor.
    SoftwareVulkan,
    /// A GPU.
    Gpu,
}

impl Hardware {
    /// Of a cell; what does not say runs on the processor.
    pub fn of(cell: &Cell) -> Self {
        match cell.device_type {
            Some(DeviceType::Integrated | DeviceType::Discrete) => Self::Gpu,
            Some(DeviceType::SoftwareVulkan) => Self::SoftwareVulkan,
            Some(DeviceType::Cpu) | None => Self::Cpu,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "CPU",
            Self::SoftwareVulkan => "software Vulkan (CPU)",
            Self::Gpu => "GPU",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::result::{Accuracy, Summary};

    fn cell(mesh: &str, backend: &str, threads: usize) -> Cell {
        Cell {
            mesh: Mesh { name: mesh.into(), ..Mesh::default() },
            backend: backend.into(),
            threads,
            status: Status::Ok,
            solve_ns: Summary::of(&[1_000_000; 7]),
            ..Cell::default()
        }
    }

    #[test]
    fn cells_of_a_mesh_stand_together_and_threads_are_named_where_they_differ() {
        let mut result =
            ResultFile { cells: vec![cell("m", "a", 1), cell("n", "a", 1), cell("m", "b", 1)], ..empty() };
        let view = View::new(&result);
        assert_eq!(view.groups.iter().map(|g| g.cells.len()).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(view.solvers, ["a", "b"]);
        result.cells.push(cell("m", "a", 2));
        assert_eq!(View::new(&result).solvers, ["a (1 thr)", "b (1 thr)", "a (2 thr)"]);
    }

    #[test]
    fn an_error_that_no_reference_certifies_is_not_claimed() {
        let accuracy = Accuracy {
            backward_error: Some(1e-15),
            forward_error: Some(1e-3),
            certifiable: Some(false),
            ..Accuracy::default()
        };
        let cell = Cell { accuracy, ..cell("m", "a", 1) };
        assert_eq!(achieved_error(&cell), Some(1e-15));
        assert!(!is_valid(&Cell { status: Status::Invalid, ..cell }));
    }

    fn empty() -> ResultFile {
        ResultFile {
            schema_version: String::new(),
            command: String::new(),
            quotable: true,
            environment: Default::default(),
            cells: Vec::new(),
        }
    }
}
