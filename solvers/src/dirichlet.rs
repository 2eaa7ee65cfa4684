//! Dirichlet reduction: splits the vertices into constrained, free and absent ones.
//!
//! With F the free and C the constrained vertices, L u = 0 on F and u = g on C read
//! L_FF u_F = -L_FC g (VA section 4; `workloads` section 1). L_FF is positive definite when every component of the mesh
//! has a constraint. *Absent* vertices have an empty row (used by no triangle of positive area): they are in no system.

use crate::backend::{Factor, Footprint, Harmonic, Phase, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};
use crate::sparse::SymmetricCsr;
use crate::system::{System, SystemError};
use thiserror::Error;

/// A Laplacian split by a set of constrained vertices.
#[derive(Clone, Debug)]
pub struct Dirichlet {
    laplacian: SymmetricCsr,
    fixed: Vec<u32>,
    free: Vec<u32>,
    system: Option<System>,
    /// Stored entry of L behind every stored entry of L_FF.
    source: Vec<u32>,
    coupling: Coupling,
}

/// L_FC by rows of F that touch a constraint: (free row, constraint row, stored entry of L), grouped by free row.
#[derive(Clone, Debug, Default)]
struct Coupling {
    entries: Vec<(u32, u32, u32)>,
}

/// Why constraints are refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DirichletError {
    /// A constrained vertex does not exist.
    #[error("constrained vertex {vertex} does not exist: the mesh has {vertices} vertices (0-based indices)")]
    OutOfRange {
        /// The index.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex is constrained twice.
    #[error("vertex {vertex} is constrained twice")]
    Twice {
        /// The vertex.
        vertex: u32,
    },
    /// A constrained vertex is on no triangle of positive area.
    #[error("constrained vertex {vertex} is on no triangle of positive area")]
    Absent {
        /// The vertex.
        vertex: u32,
    },
    /// Components without any constraint: the field is not determined there.
    #[error(
        "{count} component(s) have no constrained vertex, the first one holds vertex {first_vertex}; constrain one vertex in each"
    )]
    UnconstrainedComponent {
        /// How many.
        count: usize,
        /// Lowest vertex of the first one.
        first_vertex: u32,
    },
    /// The free part is not an acceptable system.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl Dirichlet {
    /// Splits `laplacian` (n x n, all vertices) by the constrained vertices `fixed` (any order, no repeats).
    /// `positions` (one per vertex) are handed on to the reduced system.
    ///
    /// # Errors
    /// [`DirichletError`]. Cost: a few passes over L.
    pub fn new(
        laplacian: SymmetricCsr,
        positions: Option<&[[f64; 3]]>,
        fixed: &[u32],
    ) -> Result<Self, DirichletError> {
        let vertices = laplacian.n();
        let coupled = laplacian.coupled_rows();
        let mut is_fixed = vec![false; vertices];
        for &vertex in fixed {
            let slot =
                is_fixed.get_mut(vertex as usize).ok_or(DirichletError::OutOfRange { vertex, vertices })?;
            if std::mem::replace(slot, true) {
                return Err(DirichletError::Twice { vertex });
            }
            if laplacian.is_absent(vertex as usize, &coupled) {
                return Err(DirichletError::Absent { vertex });
            }
        }
        let component = components(&laplacian);
        check_every_component(&laplacian, &coupled, &component, &is_fixed)?;
        let fixed = (0..vertices as u32).filter(|&v| is_fixed[v as usize]).collect();
        let free = (0..vertices as u32)
            .filter(|&v| !is_fixed[v as usize] && !laplacian.is_absent(v as usize, &coupled))
            .collect();
        Self::split(laplacian, positions, fixed, free)
    }

    /// Fixes one vertex of every component (its highest index) at zero: the algebraic grounding that makes a Laplacian
    /// definite without any epsilon. For one component without absent vertices the free rows are then 0..n-1 as they stand.
    ///
    /// # Errors
    /// [`DirichletError::System`] where the Laplacian has non-finite values or a free row without positive diagonal.
    pub fn grounded(laplacian: SymmetricCsr, positions: Option<&[[f64; 3]]>) -> Result<Self, DirichletError> {
        let coupled = laplacian.coupled_rows();
        let component = components(&laplacian);
        let mut highest = vec![None; laplacian.n()];
        for v in 0..laplacian.n() {
            if !laplacian.is_absent(v, &coupled) {
                highest[component[v] as usize] = Some(v as u32);
            }
        }
        let mut is_fixed = vec![false; laplacian.n()];
        for &v in highest.iter().flatten() {
            is_fixed[v as usize] = true;
        }
        let (mut fixed, mut free) = (Vec::new(), Vec::new());
        for v in 0..laplacian.n() {
            if is_fixed[v] {
                fixed.push(v as u32);
            } else if !laplacian.is_absent(v, &coupled) {
                free.push(v as u32);
            }
        }
        Self::split(laplacian, positions, fixed, free)
    }

    fn split(
        laplacian: SymmetricCsr,
        positions: Option<&[[f64; 3]]>,
        fixed: Vec<u32>,
        free: Vec<u32>,
    ) -> Result<Self, DirichletError> {
        const ABSENT: u32 = u32::MAX;
        let mut free_row = vec![ABSENT; laplacian.n()];
        let mut fixed_row = vec![ABSENT; laplacian.n()];
        for (row, &v) in free.iter().enumerate() {
            free_row[v as usize] = row as u32;
        }
        for (row, &v) in fixed.iter().enumerate() {
            fixed_row[v as usize] = row as u32;
        }
        let (mut row_starts, mut columns, mut source) = (vec![0], Vec::new(), Vec::new());
        let mut coupling = Vec::new();
        for v in 0..laplacian.n() {
            for entry in laplacian.row_range(v) {
                let w = laplacian.columns()[entry] as usize;
                match (free_row[v], free_row[w], fixed_row[v], fixed_row[w]) {
                    (ABSENT, f, c, _) | (f, ABSENT, _, c) if f != ABSENT && c != ABSENT => {
                        coupling.push((f, c, entry as u32));
                    }
                    (f, g, ..) if f != ABSENT && g != ABSENT => {
                        columns.push(g);
                        source.push(entry as u32);
                    }
                    _ => {}
                }
            }
            if free_row[v] != ABSENT {
                row_starts.push(columns.len() as u32);
            }
        }
        coupling.sort_unstable();
        let values = source.iter().map(|&e| laplacian.values()[e as usize]).collect();
        let system = if free.is_empty() {
            None
        } else {
            let matrix = SymmetricCsr::new(row_starts, columns, values).expect("a submatrix keeps the order");
            Some(System::new(matrix, positions.map(|p| free.iter().map(|&v| p[v as usize]).collect()))?)
        };
        Ok(Self { laplacian, fixed, free, system, source, coupling: Coupling { entries: coupling } })
    }

    /// The full Laplacian L.
    pub fn laplacian(&self) -> &SymmetricCsr {
        &self.laplacian
    }

    /// Constrained vertices C, ascending.
    pub fn fixed(&self) -> &[u32] {
        &self.fixed
    }

    /// Free vertices F, ascending: row i of the reduced system is vertex `free()[i]`.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// L_FF, or `None` where every vertex is constrained or absent.
    pub fn system(&self) -> Option<&System> {
        self.system.as_ref()
    }

    /// b = -L_FC g: `constraints` is |C| x k, `rhs` is |F| x k and written whole; only rows next to a constraint are
    /// non-zero. Cost: 2 k flops per entry of L_FC.
    pub fn right_hand_side(&self, constraints: Columns<&[f64]>, mut rhs: Columns<&mut [f64]>) {
        assert_eq!((constraints.n(), rhs.n()), (self.fixed.len(), self.free.len()), "constraints, rhs: rows");
        rhs.data_mut().fill(0.0);
        for &(f, c, entry) in &self.coupling.entries {
            let weight = self.laplacian.values()[entry as usize];
            for (b, g) in rhs.row_mut(f as usize).iter_mut().zip(constraints.row(c as usize)) {
                *b -= weight * g;
            }
        }
    }

    /// An elimination order of the reduced system from one of all vertices (constrained and absent ones are skipped).
    pub fn restrict_order(&self, order: &[u32]) -> Vec<u32> {
        let mut row = vec![u32::MAX; self.laplacian.n()];
        for (i, &v) in self.free.iter().enumerate() {
            row[v as usize] = i as u32;
        }
        order.iter().map(|&v| row[v as usize]).filter(|&i| i != u32::MAX).collect()
    }

    /// Rows of the reduced system next to a constraint, ascending: the non-zero rows of every right-hand side.
    pub fn active_rows(&self) -> Vec<u32> {
        let mut rows: Vec<u32> = self.coupling.entries.iter().map(|e| e.0).collect();
        rows.dedup();
        rows
    }

    /// L_FC by rows of F that touch a constraint: (free row, constraint row, stored entry of L), ascending.
    pub fn coupling(&self) -> &[(u32, u32, u32)] {
        &self.coupling.entries
    }

    /// Copies the free rows of an n x k block into a |F| x k block.
    pub fn gather(&self, all: Columns<&[f64]>, mut free: Columns<&mut [f64]>) {
        for (row, &v) in self.free.iter().enumerate() {
            free.row_mut(row).copy_from_slice(all.row(v as usize));
        }
    }

    /// Writes `free` (|F| x k) and `constraints` (|C| x k) to their vertices in `all` (n x k); absent rows become 0.
    pub fn scatter(&self, free: Columns<&[f64]>, constraints: Columns<&[f64]>, mut all: Columns<&mut [f64]>) {
        if self.free.len() + self.fixed.len() < self.laplacian.n() {
            all.data_mut().fill(0.0);
        }
        for (row, &v) in self.free.iter().enumerate() {
            all.row_mut(v as usize).copy_from_slice(free.row(row));
        }
        for (row, &v) in self.fixed.iter().enumerate() {
            all.row_mut(v as usize).copy_from_slice(constraints.row(row));
        }
    }

    /// New values of the full L; the split stays. No allocation.
    ///
    /// # Errors
    /// [`SystemError`] where the free part is no longer acceptable.
    ///
    /// # Panics
    /// If the number of values differs.
    pub fn update_values(&mut self, values: &[f64]) -> Result<(), SystemError> {
        self.laplacian.values_mut().copy_from_slice(values);
        if let Some(system) = &mut self.system {
            system.refresh(&self.source, values)?;
        }
        Ok(())
    }
}

/// Component number of every row (lowest row of the component) by union-find over the stored pattern.
pub(crate) fn components(matrix: &SymmetricCsr) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..matrix.n() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for i in 0..matrix.n() {
        for &j in &matrix.row(i).0[1..] {
            let (a, b) = (root(&mut parent, i as u32), root(&mut parent, j));
            // The lower root wins, so that a component is named by its lowest vertex.
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    for v in 0..matrix.n() as u32 {
        parent[v as usize] = root(&mut parent, v);
    }
    parent
}

fn check_every_component(
    laplacian: &SymmetricCsr,
    coupled: &[bool],
    component: &[u32],
    is_fixed: &[bool],
) -> Result<(), DirichletError> {
    let mut constrained = vec![false; laplacian.n()];
    for v in 0..laplacian.n() {
        constrained[component[v] as usize] |= is_fixed[v];
    }
    let lonely =
        |v: &usize| component[*v] as usize == *v && !laplacian.is_absent(*v, coupled) && !constrained[*v];
    let count = (0..laplacian.n()).filter(lonely).count();
    match (0..laplacian.n()).find(lonely) {
        Some(v) => Err(DirichletError::UnconstrainedComponent { count, first_vertex: v as u32 }),
        None => Ok(()),
    }
}

/// The provided [`Harmonic`]: a [`Dirichlet`] split around any [`Factor`].
pub struct ReducedHarmonic {
    problem: Dirichlet,
    factor: Option<Box<dyn Factor>>,
    rhs: Vec<f64>,
    x: Vec<f64>,
}

impl ReducedHarmonic {
    /// Wraps `factor` (prepared for `problem.system()`, `None` where nothing is free), with room for `max_columns`.
    pub fn new(problem: Dirichlet, factor: Option<Box<dyn Factor>>, max_columns: usize) -> Self {
        let length = problem.free.len() * max_columns;
        Self { problem, factor, rhs: vec![0.0; length], x: vec![0.0; length] }
    }
}

impl Harmonic for ReducedHarmonic {
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError> {
        let (rows, k) = (self.problem.free.len(), constraints.k());
        let rhs = &mut self.rhs[..rows * k];
        let mut x = Columns::new(&mut self.x[..rows * k], rows, k);
        self.problem.right_hand_side(constraints, Columns::new(&mut *rhs, rows, k));
        self.problem.gather(field.view(), x.reborrow());
        let outcome = match &mut self.factor {
            Some(factor) => factor.solve(Columns::new(&*rhs, rows, k), x.reborrow()),
            None => Ok(Solved::default()),
        };
        self.problem.scatter(x.view(), constraints, field);
        outcome
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.problem.update_values(values)?;
        match (&mut self.factor, self.problem.system()) {
            (Some(factor), Some(system)) => factor.update_values(system.matrix().values(), on),
            _ => Ok(()),
        }
    }

    fn observe(&mut self, observer: Option<Box<dyn FnMut(u32, f64) + Send>>) -> bool {
        self.factor.as_mut().is_some_and(|factor| factor.observe(observer))
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        self.factor.as_mut().map_or(Ok(Vec::new()), |factor| factor.device_phases())
    }

    fn footprint(&self) -> Footprint {
        self.factor.as_ref().map(|f| f.footprint()).unwrap_or_default()
    }
}
