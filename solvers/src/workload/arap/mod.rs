//! `arap`: as-rigid-as-possible deformation by handles (Sorkine and Alexa 2007).
//!
//! Minimises sum_i sum_j w_ij |(x'_i - x'_j) - R_i (x_i - x_j)|^2 over positions x' and one rotation R_i per vertex, x' given
//! at the handles. An iteration alternates
//!
//! ```text
//! local   R_i = argmax tr(R S_i),  S_i = sum_j w_ij (x_i - x_j) (x'_i - x'_j)^T            polar, spokes
//! global  L_FF x'_F = b_F - L_FC h,  b_i = sum_j w_ij / 2 (R_i + R_j) (x_i - x_j)          one factor, 3 columns
//! ```
//! with h the handle positions. Neither half can raise the energy where no w_ij is negative ([`Weights::ClampedPerEdge`]).
//!
//! [`Arap::solve`] starts from R_i = I: its first global step gives x + u, u the field that is harmonic off the handles and
//! their displacement on them; then come the iterations. That is Open3D's `deform_as_rigid_as_possible` with one iteration
//! more (with weights clamped per edge, on closed surfaces; it doubles boundary weights) and libigl's `arap` with SPOKES
//! energy started from x + u.
//! [`Arap::resume`] instead goes on from any positions with the handles moved at once: libigl's `arap`, dragging a handle.
//!
//! # Default input of a mesh that comes alone
//! [`defaults::handles`]: the default constraints of `harmonic`, carried along by the extreme frame of the default twist;
//! [`ITERATIONS`] iterations, weights clamped per edge: negative ones can turn S_i against the edges it is made of.
//!
//! # Right when
//! handles in place leave the mesh as it is; a rigid motion of three handles or more of a component, not in line, moves it
//! rigidly once converged; the energy never rises (no negative weights); equal to Open3D and libigl as above.

pub mod defaults;
mod polar;
mod spokes;
#[cfg(test)]
mod tests;

pub use spokes::{Padded, Turn};

use crate::backend::{Backend, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::dirichlet::{Dirichlet, DirichletError};
use crate::error::{PrepareError, SolveError};
use crate::laplacian::{Laplacian, Weights};
use crate::mesh::TriangleMesh;
use crate::sparse::SymmetricCsr;
use crate::team::Team;
use spokes::{NO_TURN, Spokes};
use std::ops::Range;
use thiserror::Error;

/// Iterations where nothing else is asked: libigl's default, after which little is left to see.
pub const ITERATIONS: u32 = 10;

/// Most threads of the local step.
const MOST_THREADS: usize = 64;

/// Coordinates.
const SPACE: usize = 3;

/// Why mesh and handles make no problem.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ArapError {
    /// Handles out of range, given twice, on no triangle, or missing on a component.
    #[error(transparent)]
    Handles(#[from] DirichletError),
    /// The backend cannot prepare it.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The system refuses threads.
    #[error("threads for the local step: {what}")]
    Threads {
        /// The system's words.
        what: String,
    },
}

/// L split by the handles, and the reference pose.
#[derive(Clone, Debug)]
pub struct ArapProblem {
    dirichlet: Dirichlet,
    rest: Vec<[f64; 3]>,
}

impl ArapProblem {
    /// `handles`: vertices in any order, no repeats, at least one in every component.
    ///
    /// # Errors
    /// [`ArapError::Handles`] naming the vertex.
    pub fn new(mesh: &TriangleMesh, handles: &[u32], weights: Weights) -> Result<Self, ArapError> {
        let laplacian = Laplacian::assemble(mesh, weights).into_matrix();
        Self::from_laplacian(laplacian, mesh.positions(), handles)
    }

    /// With weights of one's own: w_ij = -L_ij of a Laplacian over all vertices.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    ///
    /// # Panics
    /// If the number of positions is not that of rows.
    pub fn from_laplacian(
        laplacian: SymmetricCsr,
        rest: &[[f64; 3]],
        handles: &[u32],
    ) -> Result<Self, ArapError> {
        assert_eq!(laplacian.n(), rest.len(), "rest: one position per row");
        let dirichlet = Dirichlet::new(laplacian, Some(rest), handles)?;
        Ok(Self { dirichlet, rest: rest.to_vec() })
    }

    /// The handles, ascending: the order of their positions.
    pub fn handles(&self) -> &[u32] {
        self.dirichlet.fixed()
    }

    /// The split Laplacian; its system is the one of every global step.
    pub fn dirichlet(&self) -> &Dirichlet {
        &self.dirichlet
    }

    /// The reference pose.
    pub fn rest(&self) -> &[[f64; 3]] {
        &self.rest
    }
}

/// A prepared deformation: the factor, the spokes, the present pose and all buffers. Iterations allocate nothing.
pub struct Arap {
    problem: ArapProblem,
    factor: Option<Box<dyn Factor>>,
    spokes: Spokes,
    team: Team,
    /// Vertices of every thread, balanced by spokes, and the free rows among them.
    parts: Vec<Part>,
    /// x', one padded point per vertex.
    positions: Vec<Padded>,
    turns: Vec<Turn>,
    /// -L_FC h, |F| x 3.
    pull: Vec<f64>,
    rhs: Vec<f64>,
    solution: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Part {
    vertices: Range<usize>,
    rows: Range<usize>,
}

impl Arap {
    /// Prepares L_FF on `backend` and as many threads for the local step as the backend uses.
    ///
    /// # Errors
    /// [`ArapError::Prepare`] with what the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &ArapProblem,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, ArapError> {
        let factor = match problem.dirichlet.system() {
            Some(system) => Some(backend.prepare(system, &PrepareOptions::columns(SPACE), on)?),
            None => None,
        };
        let threads = backend.describe().threads.clamp(1, MOST_THREADS);
        let team = Team::new(threads).map_err(|error| ArapError::Threads { what: error.to_string() })?;
        let spokes = Spokes::new(problem.dirichlet.laplacian(), &problem.rest);
        let unknowns = SPACE * problem.dirichlet.free().len();
        Ok(Self {
            parts: parts(spokes.starts(), problem.dirichlet.free(), threads),
            positions: spokes.rest().to_vec(),
            turns: vec![NO_TURN; spokes.vertices()],
            pull: vec![0.0; unknowns],
            rhs: vec![0.0; unknowns],
            solution: vec![0.0; unknowns],
            problem: problem.clone(),
            factor,
            spokes,
            team,
        })
    }

    /// The problem that was prepared.
    pub fn problem(&self) -> &ArapProblem {
        &self.problem
    }

    /// Deforms from the reference pose: R = I, the first global step, then `iterations` iterations. `handles`: one position
    /// per handle, ascending by vertex; `positions` (one per vertex) is overwritten, unreferenced vertices stay.
    ///
    /// # Errors
    /// As [`Factor::solve`]; [`SolveError::NonFinite`] with the first handle that is not finite.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn solve(
        &mut self,
        handles: &[[f64; 3]],
        iterations: u32,
        positions: &mut [[f64; 3]],
    ) -> Result<Solved, SolveError> {
        self.start(handles)?;
        let mut solved = self.iterate(iterations)?;
        if iterations == 0 {
            solved = Solved::default();
        }
        self.write(positions);
        Ok(solved)
    }

    /// The pose of R = I: x + (harmonic field of the handles' displacements). One solve.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn start(&mut self, handles: &[[f64; 3]]) -> Result<Solved, SolveError> {
        self.positions.copy_from_slice(self.spokes.rest());
        self.turns.fill(NO_TURN);
        self.move_handles(handles)?;
        self.global()
    }

    /// Goes on from `positions` with the handles moved; the next [`iterate`](Self::iterate) begins with a local step. No solve.
    ///
    /// # Errors
    /// [`SolveError::NonFinite`] with the first handle (or vertex) that is not finite.
    pub fn resume(&mut self, handles: &[[f64; 3]], positions: &[[f64; 3]]) -> Result<(), SolveError> {
        assert_eq!(positions.len(), self.positions.len(), "positions: one per vertex");
        check_finite(positions)?;
        for (x, &[a, b, c]) in self.positions.iter_mut().zip(positions) {
            *x = [a, b, c, 0.0];
        }
        self.move_handles(handles)
    }

    /// `count` times a local and a global step. No allocation, no lock.
    ///
    /// # Errors
    /// As [`Factor::solve`]; the pose is then the one before the failed step.
    pub fn iterate(&mut self, count: u32) -> Result<Solved, SolveError> {
        let mut solved = Solved::default();
        for _ in 0..count {
            self.local();
            solved = self.global()?;
        }
        Ok(solved)
    }

    /// The present pose, one position per vertex.
    ///
    /// # Panics
    /// If the number of positions differs.
    pub fn write(&self, positions: &mut [[f64; 3]]) {
        assert_eq!(positions.len(), self.positions.len(), "positions: one per vertex");
        for (out, &[x, y, z, _]) in positions.iter_mut().zip(&self.positions) {
            *out = [x, y, z];
        }
    }

    /// The energy of the present pose with the rotations of the last local step.
    pub fn energy(&self) -> f64 {
        self.spokes.energy(&self.positions, &self.turns)
    }

    /// What it holds; a solve is one global step.
    pub fn footprint(&self) -> Footprint {
        let buffers = self.spokes.bytes() + 64 * self.positions.len() + 8 * SPACE * self.pull.len();
        let factor = self.factor.as_ref().map(|factor| factor.footprint()).unwrap_or_default();
        Footprint { host_bytes: factor.host_bytes.map(|bytes| bytes + buffers as u64), ..factor }
    }

    fn move_handles(&mut self, handles: &[[f64; 3]]) -> Result<(), SolveError> {
        let dirichlet = &self.problem.dirichlet;
        assert_eq!(handles.len(), dirichlet.fixed().len(), "handles: one position per handle");
        check_finite(handles)?;
        for (&v, &[x, y, z]) in dirichlet.fixed().iter().zip(handles) {
            self.positions[v as usize] = [x, y, z, 0.0];
        }
        let rows = dirichlet.free().len();
        if !handles.is_empty() && rows > 0 {
            let given = Columns::new(handles.as_flattened(), handles.len(), SPACE);
            dirichlet.right_hand_side(given, Columns::new(&mut self.pull[..], rows, SPACE));
        }
        Ok(())
    }

    /// All rotations from the present positions.
    fn local(&mut self) {
        let Self { spokes, team, parts, positions, turns, .. } = self;
        let mut slices: [&mut [Turn]; MOST_THREADS] = std::array::from_fn(|_| Default::default());
        let mut rest = &mut turns[..];
        for (slice, part) in slices.iter_mut().zip(parts.iter()) {
            (*slice, rest) = rest.split_at_mut(part.vertices.len());
        }
        let (spokes, positions, ranges) = (&*spokes, &positions[..], &parts[..]);
        team.for_each(&mut slices[..ranges.len()], |p, slice| {
            spokes.fit(positions, ranges[p].vertices.clone(), slice);
        });
    }

    /// All positions from the present rotations.
    fn global(&mut self) -> Result<Solved, SolveError> {
        let Self { spokes, team, parts, turns, rhs, pull, problem, solution, positions, factor } = self;
        let free = problem.dirichlet.free();
        let Some(factor) = factor else { return Ok(Solved::default()) };
        let mut slices: [&mut [f64]; MOST_THREADS] = std::array::from_fn(|_| Default::default());
        let mut rest = &mut rhs[..];
        for (slice, part) in slices.iter_mut().zip(parts.iter()) {
            (*slice, rest) = rest.split_at_mut(SPACE * part.rows.len());
        }
        let (spokes, turns, ranges, pulls) = (&*spokes, &turns[..], &parts[..], &pull[..]);
        team.for_each(&mut slices[..ranges.len()], |p, slice| {
            let rows = ranges[p].rows.clone();
            spokes.gather(turns, &free[rows.clone()], slice.as_chunks_mut().0);
            slice.iter_mut().zip(&pulls[SPACE * rows.start..]).for_each(|(b, pull)| *b += pull);
        });
        let n = free.len();
        let rhs = Columns::new(&rhs[..], n, SPACE);
        let solved = factor.solve(rhs, Columns::new(&mut solution[..], n, SPACE))?;
        for (&v, &[x, y, z]) in free.iter().zip(solution.as_chunks().0) {
            positions[v as usize] = [x, y, z, 0.0];
        }
        Ok(solved)
    }
}

fn check_finite(points: &[[f64; 3]]) -> Result<(), SolveError> {
    match points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(row) => Err(SolveError::NonFinite { row }),
        None => Ok(()),
    }
}

/// Consecutive vertices for each thread with about the same number of spokes; `free` is ascending.
fn parts(starts: &[u32], free: &[u32], threads: usize) -> Vec<Part> {
    let n = starts.len() - 1;
    let work = |v: usize| starts[v] as usize + v; // a vertex costs about as much as a spoke besides its spokes
    let cut = |t: usize| match t {
        0 => 0,
        t if t == threads => n,
        t => {
            let goal = work(n) * t / threads;
            let (mut low, mut high) = (0, n);
            while low < high {
                let middle = usize::midpoint(low, high);
                if work(middle) < goal { low = middle + 1 } else { high = middle }
            }
            low
        }
    };
    (0..threads)
        .map(|t| {
            let vertices = cut(t)..cut(t + 1);
            let row = |v: usize| free.partition_point(|&f| (f as usize) < v);
            Part { rows: row(vertices.start)..row(vertices.end), vertices }
        })
        .collect()
}
