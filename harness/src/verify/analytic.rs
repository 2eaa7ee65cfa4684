//! Cases whose answers are known on paper: sine modes of the five-point stencil, linear functions in the plane, harmonic
//! functions on a square, spherical harmonics, a trigonometric function on a torus.

use super::equations::Equations;
use super::finding::{Findings, Level, Outcome};
use super::noise::noise;
use super::subject::{Discretisation, NoAnswer, Subject};
use crate::shapes;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::vector::Vector;
use std::f64::consts::PI;

/// Least observed order in the mass norm or the maximum norm; theory says 2.
const ORDER: f64 = 1.8;
/// Least observed order in the energy norm; theory says 1, and 2 against the interpolant.
const ENERGY_ORDER: f64 = 0.9;
/// An error that counts as rounding.
const ROUNDING: f64 = 1e-11;
/// How far an error may be from the stored one, in both directions: a bug that keeps the order changes the constant.
const CONSTANT: f64 = 1.5;

fn shape(name: &str) -> TriangleMesh {
    shapes::generate(name).and_then(Result::ok).unwrap_or_else(|| panic!("{name} is a generated shape"))
}

/// Vertices of an n x n grid that are on its boundary, ascending.
fn boundary(n: usize) -> Vec<u32> {
    let outside = |&v: &u32| {
        let (x, y) = (v as usize % n, v as usize / n);
        x == 0 || y == 0 || x == n - 1 || y == n - 1
    };
    (0..(n * n) as u32).filter(outside).collect()
}

/// Sine modes on an n x n grid with fixed boundary: L_FF is the five-point stencil and u = sin(p pi x) sin(q pi y) its
/// eigenvector for 4 - 2 cos(p pi h) - 2 cos(q pi h), h = 1 / (n - 1). No discretisation error: what is off is the solver's.
pub fn sine_modes(
    n: usize,
    subjects: &[Subject],
    discretisation: &Discretisation,
    trusted: &[Entry],
    findings: &mut Findings,
) {
    let case = format!("grid:{n}");
    findings.about(&case, None);
    let mesh = shape(&case);
    let problem =
        match Dirichlet::new((discretisation.laplacian)(&mesh), Some(mesh.positions()), &boundary(n)) {
            Ok(problem) => problem,
            Err(error) => {
                return findings.note(
                    Level::Matrix,
                    "five-point stencil",
                    Outcome::Failed,
                    error.to_string(),
                );
            }
        };
    let system = problem.system().expect("a grid of 3 x 3 or more has an inside");
    let modes = [(1, 1), (2, 3), (n / 2, n / 3)];
    let h = 1.0 / (n - 1) as f64;
    let value = |p: usize, x: f64| (p as f64 * PI * x).sin();
    let mut modes_at = Vec::new();
    for &v in problem.free() {
        let [x, y, _] = mesh.positions()[v as usize];
        modes_at.extend(modes.map(|(p, q)| value(p, x) * value(q, y)));
    }
    let eigenvalue =
        |(p, q): (usize, usize)| 4.0 - 2.0 * (p as f64 * PI * h).cos() - 2.0 * (q as f64 * PI * h).cos();
    let eigenvalues = modes.map(eigenvalue);
    let rows = system.n();
    let mut product = vec![0.0; 3 * rows];
    system.matrix().multiply(Columns::new(&modes_at, rows, 3), Columns::new(&mut product, rows, 3));
    let rhs: Vec<f64> = modes_at.iter().enumerate().map(|(at, u)| eigenvalues[at % 3] * u).collect();
    let off = product.iter().zip(&rhs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    // Spacings are differences of coordinates around 1: each loses log2(n) bits.
    let rounding = 64.0 * n as f64 * f64::EPSILON;
    findings.at_most(
        Level::Matrix,
        "five-point stencil",
        off,
        rounding,
        "L u = lambda u for three sine modes",
    );
    let equations =
        Equations::system("sine modes", system.clone(), rhs, 3, Some(1.0), trusted).ill_conditioned();
    equations.ask(&case, subjects, true, findings);
    for subject in subjects.iter().filter(|s| s.takes(rows)) {
        findings.about(&case, Some(&subject.id));
        compare_modes(subject, system, &modes_at, &eigenvalues, findings);
    }
}

/// The answer to lambda u against u itself: an error that the reference solution shared would show here.
fn compare_modes(
    subject: &Subject,
    system: &System,
    modes: &[f64],
    eigenvalues: &[f64; 3],
    findings: &mut Findings,
) {
    let rhs: Vec<f64> = modes.iter().enumerate().map(|(at, u)| eigenvalues[at % 3] * u).collect();
    match subject.solve(system, Columns::new(&rhs, system.n(), 3)) {
        Ok(x) => {
            let off = super::reference::largest_difference(&x, modes);
            findings.at_most(
                Level::Forward,
                "sine modes",
                off,
                subject.limits.poisson.max(1e-9),
                "against the formula",
            );
        }
        Err(no) => no.record(findings, Level::Forward, "sine modes", true),
    }
}

/// A flat mesh with irregular triangles: the inside of an n x n grid moved by up to 0.3 spacings.
fn irregular_square(n: usize) -> TriangleMesh {
    let grid = shape(&format!("grid:{n}"));
    let fixed = boundary(n);
    let moves = noise(2 * n * n, 5);
    let size = 0.3 / (n - 1) as f64;
    let mut positions = grid.positions().to_vec();
    for v in (0..(n * n) as u32).filter(|v| fixed.binary_search(v).is_err()) {
        let v = v as usize;
        positions[v][0] += size * moves[2 * v];
        positions[v][1] += size * moves[2 * v + 1];
    }
    grid.with_positions(positions).expect("finite")
}

/// Linear functions on a flat mesh: L x = 0 inside, and the field of linear values on the boundary is linear.
pub fn linear_precision(
    n: usize,
    subjects: &[Subject],
    discretisation: &Discretisation,
    findings: &mut Findings,
) {
    let case = format!("irregular square, {n} x {n} vertices");
    let mesh = irregular_square(n);
    let l = (discretisation.laplacian)(&mesh);
    let fixed = boundary(n);
    findings.about(&case, None);
    let value = |v: usize| {
        let [x, y, _] = mesh.positions()[v];
        [1.0, x, 0.3 + 2.0 * x - y]
    };
    let vertices = n * n;
    let linear: Vec<f64> = (0..vertices).flat_map(value).collect();
    let mut product = vec![0.0; 3 * vertices];
    l.multiply(Columns::new(&linear, vertices, 3), Columns::new(&mut product, vertices, 3));
    let inside = (0..vertices).filter(|v| fixed.binary_search(&(*v as u32)).is_err());
    let sums = l.absolute_row_sums();
    let off = inside.flat_map(|v| [0, 1, 2].map(|c| product[3 * v + c].abs() / sums[v])).fold(0.0, f64::max);
    findings.at_most(
        Level::Matrix,
        "linear precision",
        off,
        1e-13,
        "L x = 0 at inner vertices, of the absolute row sum",
    );
    let problem = match Dirichlet::new(l, Some(mesh.positions()), &fixed) {
        Ok(problem) => problem,
        Err(error) => {
            return findings.note(Level::Forward, "linear precision", Outcome::Failed, error.to_string());
        }
    };
    let g: Vec<f64> = fixed.iter().flat_map(|&v| value(v as usize)).collect();
    for subject in subjects.iter().filter(|s| s.takes(problem.free().len())) {
        findings.about(&case, Some(&subject.id));
        match subject.harmonic(&problem, Columns::new(&g, fixed.len(), 3)) {
            Ok(field) => {
                let off = super::reference::largest_difference(&field, &linear) / 2.3; // largest |g|
                findings.at_most(
                    Level::Forward,
                    "linear precision",
                    off,
                    subject.limits.harmonic,
                    "of the largest |g|",
                );
            }
            Err(no) => no.record(findings, Level::Forward, "linear precision", true),
        }
    }
}

/// A continuous problem with its solution: how to discretise it on a mesh and what should come out.
struct Continuous {
    check: &'static str,
    /// Coarse, fine.
    meshes: [&'static str; 2],
    /// Least order and error on the fine mesh of each quantity, as measured when the check was written. An error of 0 stands
    /// for one that is rounding only: it has no order.
    expected: &'static [(f64, f64)],
    solve: fn(&TriangleMesh, &Discretisation, &Subject) -> Result<Vec<f64>, NoAnswer>,
}

/// e^x cos y from its values on the boundary of the unit square.
const HARMONIC_ON_SQUARE: Continuous = Continuous {
    check: "harmonic function on a square",
    meshes: ["grid:17", "grid:33"],
    expected: &[(ORDER, 1.775e-5)],
    solve: |mesh, discretisation, subject| {
        let n = (mesh.positions().len() as f64).sqrt() as usize;
        let exact: Vec<f64> = mesh.positions().iter().map(|p| p[0].exp() * p[1].cos()).collect();
        let fixed = boundary(n);
        let problem = Dirichlet::new((discretisation.laplacian)(mesh), Some(mesh.positions()), &fixed)?;
        let g: Vec<f64> = fixed.iter().map(|&v| exact[v as usize]).collect();
        let field = subject.harmonic(&problem, Columns::new(&g, fixed.len(), 1))?;
        Ok(vec![super::reference::largest_difference(&field, &exact)])
    },
};

/// -Laplacian u = l (l + 1) u on the unit sphere for one spherical harmonic of each degree l = 1 ... 4.
const SPHERE_POISSON: Continuous = Continuous {
    check: "spherical harmonics",
    meshes: ["sphere:3", "sphere:4"],
    expected: &[
        (ORDER, 2.400e-5),
        (ORDER, 1.440e-3),
        (ORDER, 3.138e-3),
        (ORDER, 6.563e-3),
        (ENERGY_ORDER, 1.659e-4),
        (ENERGY_ORDER, 1.587e-3),
        (ENERGY_ORDER, 3.229e-3),
        (ENERGY_ORDER, 6.635e-3),
    ],
    solve: |mesh, discretisation, subject| {
        let mass = (discretisation.mass)(mesh, Mass::Voronoi);
        let exact: Vec<f64> = mesh.positions().iter().flat_map(|&p| spherical_harmonics(p)).collect();
        let mut rhs: Vec<f64> =
            (0..exact.len()).map(|at| mass[at / 4] * DEGREES[at % 4] * exact[at]).collect();
        remove_mean(&mut rhs, None, &mass); // solvable: the right-hand side sums to zero
        let n = mesh.positions().len();
        let l = (discretisation.laplacian)(mesh);
        let problem = discretisation.grounded(l.clone(), mesh.positions())?;
        let system = problem.system().ok_or_else(|| NoAnswer::Failed("nothing is free".into()))?;
        let mut b = vec![0.0; 4 * system.n()];
        problem.gather(Columns::new(&rhs, n, 4), Columns::new(&mut b, system.n(), 4));
        let rows = subject.solve(system, Columns::new(&b, system.n(), 4))?;
        let mut u = vec![0.0; 4 * n];
        let zeros = vec![0.0; 4 * problem.fixed().len()];
        let grounded = Columns::new(&zeros[..], problem.fixed().len(), 4);
        problem.scatter(Columns::new(&rows, system.n(), 4), grounded, Columns::new(&mut u, n, 4));
        let mut error: Vec<f64> = u.iter().zip(&exact).map(|(u, e)| u - e).collect();
        remove_mean(&mut error, Some(&mass), &mass);
        let by_mass = (0..4).map(|c| mass_norm(&error, c, &mass) / mass_norm(&exact, c, &mass));
        let (of_error, of_exact) = (energies(&l, &error), energies(&l, &exact));
        Ok(by_mass.chain((0..4).map(|c| (of_error[c] / of_exact[c]).sqrt())).collect())
    },
};

/// The Rayleigh quotients y'Ly / y'My of spherical harmonics: eigenvalues l (l + 1), no solver.
const SPHERE_EIGENVALUES: Continuous = Continuous {
    check: "eigenvalues of the sphere",
    meshes: ["sphere:3", "sphere:4"],
    // Degree 1 is exact: L x is normal to the sphere and M x, too.
    expected: &[(ORDER, 0.0), (ORDER, 1.423e-3), (ORDER, 3.121e-3), (ORDER, 6.335e-3)],
    solve: |mesh, discretisation, _| {
        let l = (discretisation.laplacian)(mesh);
        let mass = (discretisation.mass)(mesh, Mass::Voronoi);
        let y: Vec<f64> = mesh.positions().iter().flat_map(|&p| spherical_harmonics(p)).collect();
        let energies = energies(&l, &y);
        let quotient = |c: usize| energies[c] / mass_norm(&y, c, &mass).powi(2);
        Ok((0..4).map(|c| (quotient(c) / DEGREES[c] - 1.0).abs()).collect())
    },
};

/// u - Laplacian u = f on a torus for u = sin(theta) cos(phi).
const TORUS_SCREENED: Continuous = Continuous {
    check: "manufactured solution on a torus",
    meshes: ["torus:22", "torus:44"],
    expected: &[(ORDER, 5.469e-4)],
    solve: |mesh, discretisation, subject| {
        let (l, mass) = ((discretisation.laplacian)(mesh), (discretisation.mass)(mesh, Mass::Voronoi));
        let values: Vec<[f64; 2]> = mesh.positions().iter().map(|&p| torus_solution(p)).collect();
        let mut matrix = l;
        matrix.add_diagonal(&mass);
        let system = System::new(matrix, Some(mesh.positions().to_vec()))
            .map_err(|error| NoAnswer::Failed(error.to_string()))?;
        let b: Vec<f64> = values.iter().zip(&mass).map(|(v, m)| m * v[1]).collect();
        let u = subject.solve(&system, Columns::new(&b, b.len(), 1))?;
        let exact: Vec<f64> = values.iter().map(|v| v[0]).collect();
        let error: Vec<f64> = u.iter().zip(&exact).map(|(u, e)| u - e).collect();
        let norm = |block: &[f64]| block.iter().zip(&mass).map(|(x, m)| m * x * x).sum::<f64>().sqrt();
        Ok(vec![norm(&error) / norm(&exact)])
    },
};

/// Order and size of the discretisation error of every continuous problem.
pub fn convergence(subjects: &[Subject], findings: &mut Findings) {
    for problem in [HARMONIC_ON_SQUARE, SPHERE_EIGENVALUES, SPHERE_POISSON, TORUS_SCREENED] {
        let meshes = problem.meshes.map(shape);
        for subject in subjects {
            findings.about(problem.meshes.join(" and "), Some(&subject.id));
            if !subject.takes(meshes[1].positions().len()) {
                findings.note(
                    Level::Discretisation,
                    problem.check,
                    Outcome::Skipped,
                    "more unknowns than it takes",
                );
                continue;
            }
            let errors = (problem.solve)(&meshes[0], &subject.discretisation, subject).and_then(|coarse| {
                Ok((coarse, (problem.solve)(&meshes[1], &subject.discretisation, subject)?))
            });
            match errors {
                Ok((coarse, fine)) => problem.judge(&coarse, &fine, findings),
                Err(no) => no.record(findings, Level::Discretisation, problem.check, true),
            }
        }
    }
}

impl Continuous {
    fn judge(&self, coarse: &[f64], fine: &[f64], findings: &mut Findings) {
        let larger = |m: f64, x: f64| if x.is_nan() { f64::INFINITY } else { m.max(x) };
        let (mut missing, mut factor) = (f64::NEG_INFINITY, 0.0);
        for ((&coarse, &fine), &(order, stored)) in coarse.iter().zip(fine).zip(self.expected) {
            if stored == 0.0 {
                factor = larger(factor, fine / ROUNDING);
            } else {
                missing = larger(missing, order - (coarse / fine).log2());
                factor = larger(factor, (fine / stored).max(stored / fine));
            }
        }
        let errors: Vec<String> = fine.iter().map(|f| format!("{f:.3e}")).collect();
        findings.at_most(Level::Discretisation, self.check, missing, 0.0, "missing to the least order");
        let note = format!("factor to the stored errors; they are {}", errors.join(" "));
        findings.at_most(Level::Discretisation, self.check, factor, CONSTANT, note);
    }
}

/// l (l + 1) of [`spherical_harmonics`].
const DEGREES: [f64; 4] = [2.0, 6.0, 12.0, 20.0];

/// Harmonic polynomials of degree 1 to 4: z, xy, xyz and the zonal one.
fn spherical_harmonics([x, y, z]: Vector) -> [f64; 4] {
    [z, x * y, x * y * z, (35.0 * z.powi(4) - 30.0 * z * z + 3.0) / 8.0]
}

/// u and u - Laplacian u for u = sin(theta) cos(phi) on the torus of radii 1 and r, whose metric is
/// r^2 dtheta^2 + w^2 dphi^2, w = 1 + r cos(theta):
/// -Laplacian u = cos(phi) (sin cos / (r w) + sin / r^2 + sin / w^2), sin and cos of theta.
fn torus_solution([x, y, z]: Vector) -> [f64; 2] {
    const R: f64 = 0.4;
    let w = x.hypot(y);
    let (sin, cos, cos_phi) = (z / R, (w - 1.0) / R, x / w);
    let u = sin * cos_phi;
    [u, u + cos_phi * (sin * cos / (R * w) + sin / (R * R) + sin / (w * w))]
}

/// Makes the mean of each of four columns zero: subtracts the same (scaled by `share`) from every row. `weights` say what
/// the mean is of; without, the sum is made zero.
fn remove_mean(block: &mut [f64], weights: Option<&[f64]>, share: &[f64]) {
    let total: f64 = share.iter().sum();
    for c in 0..4 {
        let weight = |i: usize| weights.map_or(1.0, |w| w[i]);
        let sum: f64 = (0..share.len()).map(|i| weight(i) * block[4 * i + c]).sum();
        for i in 0..share.len() {
            block[4 * i + c] -= sum / total * if weights.is_some() { 1.0 } else { share[i] };
        }
    }
}

/// x' L x of each of four columns.
fn energies(l: &SymmetricCsr, block: &[f64]) -> [f64; 4] {
    let n = l.n();
    let mut product = vec![0.0; 4 * n];
    l.multiply(Columns::new(block, n, 4), Columns::new(&mut product, n, 4));
    std::array::from_fn(|c| (0..n).map(|i| block[4 * i + c] * product[4 * i + c]).sum())
}

/// sqrt(x' M x) of column c of a block with four.
fn mass_norm(block: &[f64], c: usize, mass: &[f64]) -> f64 {
    mass.iter().enumerate().map(|(i, m)| m * block[4 * i + c].powi(2)).sum::<f64>().sqrt()
}
