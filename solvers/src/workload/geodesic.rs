//! `geodesic`: distances along a surface by the heat method (Crane, Weischedel and Wardetzky 2013).
//!
//! ```text
//! (M + t L) u = delta           heat after time t, 1 at the sources        one factor
//! X = -grad u / |grad u|        per triangle
//! L phi = -div X                grounded                                   another one
//! ```
//! with t = (mean edge)^2 and M the lumped barycentric mass; -div X at vertex i is the sum of w_ij X . (x_i - x_j) over the
//! edges of its triangles, w_ij half the cotangent opposite to the edge, so that X = grad phi solves it exactly. In every
//! component phi is shifted so that its mean over the sources there is 0; a component without a source, and a vertex on no
//! triangle of positive area, is infinitely far away. Heat falls by a factor e every mean edge or so: far from the source u is
//! tiny, and only f64 and a direct factor, which loses no *relative* accuracy there, keep its direction.
//!
//! # Default input of a mesh that comes alone
//! [`default_sources`]: the vertex of smallest (x, y, z) of every component.
//!
//! # Right when
//! phi = 0 at a single source; phi is the distance on planes and the arc on spheres, to a few percent that shrink with the edges;
//! on closed meshes equal to `igl.heat_geodesics`, which takes Voronoi masses, and to potpourri3d with `use_robust=False`,
//! which solves (L + 1e-6 I) phi = -div X instead of grounding: [`GeodesicProblem::shifted`].

use super::sampling::lowest_point;
use super::vertex_system::VertexSystem;
use crate::backend::{Backend, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::dirichlet::components;
use crate::error::{PrepareError, SolveError};
use crate::laplacian::{Laplacian, Weights};
use crate::mass::{Mass, lumped};
use crate::mesh::TriangleMesh;
use crate::poisson::{Poisson, PoissonError};
use crate::sparse::SymmetricCsr;
use crate::system::SystemError;
use crate::vector::{Vector, cross, distance_squared, dot, scale, sub};
use thiserror::Error;

/// Why distances cannot be prepared.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GeodesicError {
    /// M + t L is not acceptable.
    #[error(transparent)]
    System(#[from] SystemError),
    /// L is not acceptable, or the backend cannot prepare it.
    #[error(transparent)]
    Poisson(#[from] PoissonError),
    /// The backend cannot prepare M + t L.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// A source does not exist or is on no triangle of positive area.
    #[error(
        "source {vertex} is no vertex of a triangle of positive area; the mesh has {vertices} vertices (0-based)"
    )]
    Source {
        /// The index.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// There is no source.
    #[error("distances need at least one source")]
    NoSource,
}

/// The two systems of a mesh.
#[derive(Clone, Debug)]
pub struct GeodesicProblem {
    heat: VertexSystem,
    laplacian: Laplacian,
    positions: Vec<Vector>,
    /// Lowest vertex of the component of every vertex.
    component: Vec<u32>,
    /// Row of every vertex in `heat`; u32::MAX where it has none.
    row: Vec<u32>,
    time: f64,
    shift: Option<f64>,
}

impl GeodesicProblem {
    /// Assembles both systems. `mass` says how areas are shared among vertices: barycentric as in the paper's own code, Voronoi
    /// as in libigl.
    ///
    /// # Errors
    /// [`GeodesicError::System`].
    pub fn new(mesh: &TriangleMesh, mass: Mass) -> Result<Self, GeodesicError> {
        let laplacian = Laplacian::assemble(mesh, Weights::Plain);
        let matrix = laplacian.matrix();
        let time = mean_edge(matrix, mesh.positions()).powi(2);
        let mut heat = matrix.clone();
        heat.values_mut().iter_mut().for_each(|v| *v *= time);
        heat.add_diagonal(&lumped(mesh, mass));
        let heat = VertexSystem::new(heat, mesh.positions())?;
        let mut row = vec![u32::MAX; matrix.n()];
        heat.vertices().iter().enumerate().for_each(|(i, &v)| row[v as usize] = i as u32);
        let component = components(matrix);
        Ok(Self { heat, positions: mesh.positions().to_vec(), component, row, time, shift: None, laplacian })
    }

    /// The same with (L + `shift` I) phi = -div X in place of the grounded system. It bends phi: by 5e-4 of the diagonal on 4,000
    /// vertices at the usual 1e-6, and more on larger meshes, because the smallest eigenvalues of L fall like 1 / n.
    ///
    /// # Panics
    /// If `shift` is not positive and finite.
    #[must_use]
    pub fn shifted(self, shift: f64) -> Self {
        assert!(shift > 0.0 && shift.is_finite(), "shift: positive and finite");
        Self { shift: Some(shift), ..self }
    }

    /// Number of vertices of the mesh.
    pub fn vertices(&self) -> usize {
        self.row.len()
    }

    /// M + t L over the vertices that have a mass.
    pub fn heat(&self) -> &VertexSystem {
        &self.heat
    }

    /// t, in squared file units.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Checks that every source is a vertex with an equation.
    ///
    /// # Errors
    /// [`GeodesicError::Source`] naming the first one that is not; [`GeodesicError::NoSource`].
    pub fn check_sources(&self, sources: &[u32]) -> Result<(), GeodesicError> {
        let vertices = self.row.len();
        let known = |v: &&u32| self.row.get(**v as usize).is_some_and(|&row| row != u32::MAX);
        match sources.iter().find(|v| !known(v)) {
            Some(&vertex) => Err(GeodesicError::Source { vertex, vertices }),
            None if sources.is_empty() => Err(GeodesicError::NoSource),
            None => Ok(()),
        }
    }
}

/// Mean length of the edges of triangles of positive area, each counted once.
fn mean_edge(laplacian: &SymmetricCsr, positions: &[Vector]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for i in 0..laplacian.n() {
        for &j in &laplacian.row(i).0[1..] {
            sum += distance_squared(positions[i], positions[j as usize]).sqrt();
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// The vertex of smallest x, then y, then z of every component, ascending.
pub fn default_sources(mesh: &TriangleMesh) -> Vec<u32> {
    let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
    let (coupled, component) = (laplacian.coupled_rows(), components(&laplacian));
    let mut present: Vec<u32> =
        (0..laplacian.n() as u32).filter(|&v| !laplacian.is_absent(v as usize, &coupled)).collect();
    present.sort_by_key(|&v| component[v as usize]);
    let same = |a: &u32, b: &u32| component[*a as usize] == component[*b as usize];
    let lowest = |group: &[u32]| lowest_point(group.iter().map(|&v| (v, mesh.positions()[v as usize])));
    let mut sources: Vec<u32> = present.chunk_by(same).filter_map(lowest).collect();
    sources.sort_unstable();
    sources
}

/// Prepared distances: both factors and all buffers. A query allocates nothing.
pub struct Geodesic {
    problem: GeodesicProblem,
    heat: Box<dyn Factor>,
    second: Second,
    /// delta and u, one per row of the heat system.
    delta: Vec<f64>,
    heated: Vec<f64>,
    /// -div X, one per vertex.
    divergence: Vec<f64>,
    /// Per component (its lowest vertex): sum of phi over the sources, and their number.
    shifts: Vec<(f64, f64)>,
}

/// The system of phi.
enum Second {
    Grounded(Box<Poisson>),
    /// Over the rows of the heat system, with buffers for -div X and phi.
    Shifted(Box<dyn Factor>, Vec<f64>, Vec<f64>),
}

impl Geodesic {
    /// Prepares both systems on `backend`; the elimination order of the first serves both.
    ///
    /// # Errors
    /// [`GeodesicError`] with what the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        problem: &GeodesicProblem,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, GeodesicError> {
        let heat = backend.prepare(problem.heat.system(), &PrepareOptions::columns(1), on)?;
        let order = heat.permutation().map(<[u32]>::to_vec);
        let second = Second::prepare(backend, problem, order, on)?;
        let (rows, vertices) = (problem.heat.vertices().len(), problem.positions.len());
        Ok(Self {
            problem: problem.clone(),
            heat,
            second,
            delta: vec![0.0; rows],
            heated: vec![0.0; rows],
            divergence: vec![0.0; vertices],
            shifts: vec![(0.0, 0.0); vertices],
        })
    }

    /// The problem that was prepared.
    pub fn problem(&self) -> &GeodesicProblem {
        &self.problem
    }

    /// Distances from the nearest of `sources` to every vertex, in file units; infinite where there is none.
    ///
    /// # Errors
    /// As [`Factor::solve`].
    ///
    /// # Panics
    /// If a source is not acceptable ([`GeodesicProblem::check_sources`]) or the length does not fit.
    pub fn solve(&mut self, sources: &[u32], distances: &mut [f64]) -> Result<Solved, SolveError> {
        let n = self.problem.positions.len();
        assert_eq!(distances.len(), n, "distances: one per vertex");
        if let Err(error) = self.problem.check_sources(sources) {
            panic!("sources: {error}");
        }
        self.delta.fill(0.0);
        self.heated.fill(0.0); // no initial guess: a query does not depend on the one before
        distances.fill(0.0);
        sources.iter().for_each(|&v| self.delta[self.problem.row[v as usize] as usize] = 1.0);
        let rows = self.delta.len();
        let first = self
            .heat
            .solve(Columns::new(&self.delta[..], rows, 1), Columns::new(&mut self.heated[..], rows, 1))?;
        self.diverge();
        let rows = self.problem.heat.vertices();
        let second = self.second.solve(&self.divergence, rows, distances)?;
        self.shift(sources, distances);
        Ok(Solved { iterations: first.iterations.max(second.iterations), ..second })
    }

    /// What both factors hold; a query reads both.
    pub fn footprint(&self) -> Footprint {
        let (a, b) = (self.heat.footprint(), self.second.footprint());
        let sum = |x: Option<u64>, y: Option<u64>| Some(x? + y?);
        Footprint {
            host_bytes: sum(a.host_bytes, b.host_bytes),
            device_bytes: sum(a.device_bytes, b.device_bytes),
            factor_nonzeros: sum(a.factor_nonzeros, b.factor_nonzeros),
            factor_bytes: sum(a.factor_bytes, b.factor_bytes),
            bytes_per_solve: sum(a.bytes_per_solve, b.bytes_per_solve),
            factor_flops: sum(a.factor_flops, b.factor_flops),
            dispatches: sum(a.dispatches, b.dispatches),
            ordering: b.ordering,
        }
    }

    /// -div X, triangle by triangle. About 70 flops per triangle.
    fn diverge(&mut self) {
        let Self { problem, heated, divergence, .. } = self;
        divergence.fill(0.0);
        let laplacian = &problem.laplacian;
        for (triangle, weights) in laplacian.triangles().iter().zip(laplacian.corner_weights()) {
            if *weights == [0.0; 3] {
                continue; // zero area
            }
            let p = triangle.map(|v| problem.positions[v as usize]);
            let u = triangle.map(|v| heated[problem.row[v as usize] as usize]);
            let Some(x) = direction(&p, u) else { continue };
            for c in 0..3 {
                let (next, last) = ((c + 1) % 3, (c + 2) % 3);
                let flow = weights[last] * dot(x, sub(p[c], p[next]));
                divergence[triangle[c] as usize] += flow;
                divergence[triangle[next] as usize] -= flow;
            }
        }
    }

    fn shift(&mut self, sources: &[u32], distances: &mut [f64]) {
        let component = &self.problem.component;
        self.shifts.fill((0.0, 0.0));
        for &v in sources {
            let shift = &mut self.shifts[component[v as usize] as usize];
            *shift = (shift.0 + distances[v as usize], shift.1 + 1.0);
        }
        for (v, distance) in distances.iter_mut().enumerate() {
            let (sum, count) = self.shifts[component[v] as usize];
            *distance = if count > 0.0 { *distance - sum / count } else { f64::INFINITY };
        }
    }
}

impl Second {
    fn prepare(
        backend: &dyn Backend,
        problem: &GeodesicProblem,
        order: Option<Vec<u32>>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Self, GeodesicError> {
        let vertices = problem.heat.vertices();
        let mut matrix = problem.laplacian.matrix().clone();
        let Some(shift) = problem.shift else {
            let mut order: Option<Vec<u32>> =
                order.map(|rows| rows.iter().map(|&row| vertices[row as usize]).collect());
            if let Some(order) = &mut order {
                order.extend((0..matrix.n() as u32).filter(|&v| problem.row[v as usize] == u32::MAX));
            }
            let options = PrepareOptions { max_columns: 1, order: order.as_deref() };
            let poisson = Poisson::prepare(backend, matrix, Some(&problem.positions), &options, on)?;
            return Ok(Self::Grounded(Box::new(poisson)));
        };
        let diagonal: Vec<f64> =
            problem.row.iter().map(|&row| if row == u32::MAX { 0.0 } else { shift }).collect();
        matrix.add_diagonal(&diagonal);
        let system = VertexSystem::new(matrix, &problem.positions)?;
        let options = PrepareOptions { max_columns: 1, order: order.as_deref() };
        let factor = backend.prepare(system.system(), &options, on)?;
        Ok(Self::Shifted(factor, vec![0.0; vertices.len()], vec![0.0; vertices.len()]))
    }

    /// phi at all vertices from -div X at all vertices; `rows` are those with an equation.
    fn solve(&mut self, divergence: &[f64], rows: &[u32], phi: &mut [f64]) -> Result<Solved, SolveError> {
        let n = divergence.len();
        match self {
            Self::Grounded(poisson) => poisson.solve(Columns::new(divergence, n, 1), Columns::new(phi, n, 1)),
            Self::Shifted(factor, rhs, x) => {
                rhs.iter_mut().zip(rows).for_each(|(b, &v)| *b = divergence[v as usize]);
                let m = rows.len();
                let solved = factor.solve(Columns::new(&rhs[..], m, 1), Columns::new(&mut x[..], m, 1))?;
                phi.fill(0.0);
                x.iter().zip(rows).for_each(|(&x, &v)| phi[v as usize] = x);
                Ok(solved)
            }
        }
    }

    fn footprint(&self) -> Footprint {
        match self {
            Self::Grounded(poisson) => poisson.footprint(),
            Self::Shifted(factor, ..) => factor.footprint(),
        }
    }
}

/// -grad u / |grad u| on a triangle; `None` where u is constant.
fn direction(p: &[Vector; 3], u: [f64; 3]) -> Option<Vector> {
    // Heat far away is tiny: in units of its largest value here, squares are numbers.
    let largest = u.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let [a, b] = [1, 2].map(|c| (u[c] - u[0]) / largest);
    let (e1, e2) = (sub(p[1], p[0]), sub(p[2], p[0]));
    let normal = cross(e1, e2);
    // grad u = (a (e2 x n)' + b (n x e1)) / |n|^2, up to the positive factor that is normalised away.
    let gradient: Vector = {
        let (first, second) = (cross(e2, normal), cross(normal, e1));
        std::array::from_fn(|i| a * first[i] + b * second[i])
    };
    let size = dot(gradient, gradient).sqrt();
    (size > 0.0 && size.is_finite()).then(|| scale(-1.0 / size, gradient))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::{OpenOptions, find};

    fn backend() -> Box<dyn Backend> {
        (find("framechol-f64").expect("built in").open)(&OpenOptions::default()).expect("always there")
    }

    fn distances(mesh: &TriangleMesh, sources: &[u32]) -> Vec<f64> {
        let problem = GeodesicProblem::new(mesh, Mass::Barycentric).expect("usable");
        let mut geodesic = Geodesic::prepare(&*backend(), &problem, &mut |_| {}).expect("definite");
        let mut distances = vec![0.0; mesh.positions().len()];
        geodesic.solve(sources, &mut distances).expect("solves");
        distances
    }

    /// n x n squares of side 1 / n in the plane z = 0, diagonals in alternating directions.
    fn square(n: u32) -> TriangleMesh {
        let step = 1.0 / f64::from(n);
        let positions = (0..(n + 1) * (n + 1))
            .map(|v| [step * f64::from(v % (n + 1)), step * f64::from(v / (n + 1)), 0.0])
            .collect();
        let triangles = (0..n * n)
            .flat_map(|i| {
                let (x, y) = (i % n, i / n);
                let at = |dx: u32, dy: u32| (y + dy) * (n + 1) + x + dx;
                let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                if (x + y) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
            })
            .collect();
        TriangleMesh::new(positions, triangles).expect("valid")
    }

    /// Largest error of distances from `source`, relative to the largest distance.
    fn error(mesh: &TriangleMesh, source: u32, exact: impl Fn(Vector, Vector) -> f64) -> f64 {
        let found = distances(mesh, &[source]);
        let from = mesh.positions()[source as usize];
        assert!(found[source as usize].abs() < 1e-15);
        let expected: Vec<f64> = mesh.positions().iter().map(|&p| exact(from, p)).collect();
        let largest = expected.iter().fold(0.0_f64, |m, &d| m.max(d));
        found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest
    }

    #[test]
    fn plane_distances_are_straight_and_get_better() {
        let straight = |a: Vector, b: Vector| distance_squared(a, b).sqrt();
        let errors = [16, 64].map(|n| error(&square(n), (n / 2) * (n + 1) + n / 2, straight));
        assert!(errors[0] < 0.08 && errors[1] < 0.03 && errors[1] < 0.5 * errors[0], "{errors:?}");
    }

    #[test]
    fn a_gradient_is_reproduced_exactly() {
        // Heat that falls linearly along x: X = (1, 0, 0) everywhere, so phi = x up to a constant, to rounding.
        let mesh = square(8);
        let problem = GeodesicProblem::new(&mesh, Mass::Barycentric).expect("usable");
        let mut geodesic = Geodesic::prepare(&*backend(), &problem, &mut |_| {}).expect("definite");
        for scale in [1.0, 1e-250] {
            for (u, p) in geodesic.heated.iter_mut().zip(mesh.positions()) {
                *u = scale * (2.0 - p[0]);
            }
            geodesic.diverge();
            let mut phi = vec![0.0; 81];
            geodesic.second.solve(&geodesic.divergence, problem.heat.vertices(), &mut phi).expect("solves");
            for (value, p) in phi.iter().zip(mesh.positions()) {
                assert!((value - phi[0] - p[0]).abs() < 1e-12, "{value} {p:?}");
            }
        }
    }

    #[test]
    fn components_without_a_source_are_infinitely_far() {
        let one = square(4);
        let n = one.positions().len() as u32;
        let far = one.positions().iter().map(|&[x, y, z]| [x + 9.0, y, z]);
        let positions = one.positions().iter().copied().chain(far).chain([[5.0; 3]]).collect();
        let triangles =
            one.triangles().iter().copied().chain(one.triangles().iter().map(|t| t.map(|v| v + n))).collect();
        let mesh = TriangleMesh::new(positions, triangles).expect("valid");
        assert_eq!(default_sources(&mesh), [0, n]);
        let d = distances(&mesh, &[3]);
        assert!(
            d[..n as usize].iter().all(|x| x.is_finite())
                && d[n as usize..].iter().all(|x| *x == f64::INFINITY)
        );
        let both = distances(&mesh, &[0, n]);
        for v in 0..n as usize {
            assert!((both[v] - both[v + n as usize]).abs() < 1e-12, "{v}");
        }
        assert_eq!(both[2 * n as usize], f64::INFINITY);
        let problem = GeodesicProblem::new(&mesh, Mass::Voronoi).expect("usable");
        for bad in [2 * n, 2 * n + 1] {
            let error = problem.check_sources(&[0, bad]);
            assert_eq!(error, Err(GeodesicError::Source { vertex: bad, vertices: 2 * n as usize + 1 }));
        }
        assert_eq!(problem.check_sources(&[]), Err(GeodesicError::NoSource));
    }
}
