//! L1: the Laplacian and the mass matrix of a mesh, against their definitions and their properties. No solver.

use super::finding::{Findings, Level, Outcome};
use super::noise::noise;
use super::subject::Discretisation;
use lapsolve::columns::Columns;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::range::within_range;
use lapsolve::residual::compensated_residual;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::vector::{cross, dot, norm, sub};

/// Row sums may be this many eps of the sum of absolute values: one rounding per stored entry of a row, and some.
const ROW_SUM_EPS: f64 = 8.0;
/// Entries of triangles above [`FAT`] degrees, relative to the larger diagonal entry.
const FAT_LIMIT: f64 = 1e-12;
/// Entries of thinner triangles: a formula loses 1 / angle digits or more.
const THIN_LIMIT: f64 = 1e-8;
/// Degrees.
const FAT: f64 = 1.0;
/// How negative x'Ax may be, relative to |A| |x|^2: rounding of the product.
const SEMI_DEFINITE: f64 = 1e-13;
/// Relative difference of masses and areas on fat triangles.
const MASS_LIMIT: f64 = 1e-12;

/// All checks of this level, on the mesh in a unit in which plain formulas neither overflow nor underflow.
pub fn check(mesh: &TriangleMesh, discretisation: &Discretisation, findings: &mut Findings) {
    let mesh = &mesh.with_positions(within_range(mesh.positions()).into_owned()).expect("finite still");
    let l = (discretisation.laplacian)(mesh);
    if l.n() != mesh.positions().len() {
        return findings.note(
            Level::Matrix,
            "one row per vertex",
            Outcome::Failed,
            format!("{} rows", l.n()),
        );
    }
    row_sums(&l, findings);
    entries(mesh, &l, findings);
    semi_definite(&l, findings);
    scaling(mesh, &l, discretisation, findings);
    for (kind, check) in [(Mass::Barycentric, "barycentric mass"), (Mass::Voronoi, "voronoi mass")] {
        masses(mesh, &(discretisation.mass)(mesh, kind), kind, check, findings);
    }
}

fn row_sums(l: &SymmetricCsr, findings: &mut Findings) {
    let n = l.n();
    let (ones, zeros, mut sums) = (vec![1.0; n], vec![0.0; n], vec![0.0; n]);
    compensated_residual(
        l,
        Columns::new(&ones, n, 1),
        Columns::new(&zeros, n, 1),
        Columns::new(&mut sums, n, 1),
    );
    let absolute = l.absolute_row_sums();
    let worst = sums.iter().zip(&absolute).map(|(s, a)| if *s == 0.0 { 0.0 } else { s.abs() / a });
    let worst = worst.fold(0.0, f64::max) / f64::EPSILON;
    findings.at_most(Level::Matrix, "row sums", worst, ROW_SUM_EPS, "eps of the absolute row sum");
}

/// A corner with its angle's cotangent and the triangle's smallest angle.
struct Corner {
    ends: (u32, u32),
    cotangent: f64,
    fat: bool,
}

/// Every corner of positive area by the plain definition: cot = (u . v) / |u x v| of the edges leaving it.
fn corners(mesh: &TriangleMesh) -> impl Iterator<Item = Corner> {
    mesh.triangles().iter().enumerate().filter(|(t, _)| !mesh.is_zero_area(*t)).flat_map(|(_, &triangle)| {
        let p = triangle.map(|v| mesh.positions()[v as usize]);
        let measured = [0, 1, 2].map(|c| {
            let (u, v) = (sub(p[(c + 1) % 3], p[c]), sub(p[(c + 2) % 3], p[c]));
            let (sine, cosine) = (norm(cross(u, v)), dot(u, v));
            (cosine / sine, sine.atan2(cosine))
        });
        let fat = measured.iter().all(|m| m.1 > FAT.to_radians());
        [0, 1, 2].map(|c| Corner {
            ends: (triangle[(c + 1) % 3], triangle[(c + 2) % 3]),
            cotangent: measured[c].0,
            fat,
        })
    })
}

fn entries(mesh: &TriangleMesh, l: &SymmetricCsr, findings: &mut Findings) {
    let mut triplets = Vec::new();
    let mut thin = vec![false; l.n()];
    for corner in corners(mesh) {
        let (i, j) = (corner.ends.0.min(corner.ends.1), corner.ends.0.max(corner.ends.1));
        let half = 0.5 * corner.cotangent;
        triplets.extend([(i, j, -half), (i, i, half), (j, j, half)]);
        thin[i as usize] |= !corner.fat;
        thin[j as usize] |= !corner.fat;
    }
    let expected = match SymmetricCsr::from_triplets(l.n(), &triplets) {
        Ok(expected) => expected,
        Err(error) => return findings.note(Level::Matrix, "entries", Outcome::Skipped, error.to_string()),
    };
    if expected.row_starts() != l.row_starts() || expected.columns() != l.columns() {
        return findings.note(Level::Matrix, "entries", Outcome::Failed, "an entry is missing or too many");
    }
    let (mut worst_fat, mut worst_thin) = (0.0f64, 0.0f64);
    for i in 0..l.n() {
        let (columns, values) = l.row(i);
        for ((&j, &value), &known) in columns.iter().zip(values).zip(expected.row(i).1) {
            let scale = expected.diagonal(i).abs().max(expected.diagonal(j as usize).abs());
            let error = if value == known { 0.0 } else { (value - known).abs() / scale };
            let worst = if thin[i] || thin[j as usize] { &mut worst_thin } else { &mut worst_fat };
            *worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
        }
    }
    findings.at_most(Level::Matrix, "entries", worst_fat, FAT_LIMIT, "angles above 1 degree");
    if thin.contains(&true) {
        findings.at_most(
            Level::Matrix,
            "entries at slivers",
            worst_thin,
            THIN_LIMIT,
            "an angle below 1 degree",
        );
    }
}

fn semi_definite(l: &SymmetricCsr, findings: &mut Findings) {
    const VECTORS: usize = 32;
    let n = l.n();
    let x = noise(n * VECTORS, 1);
    let mut y = vec![0.0; n * VECTORS];
    l.multiply(Columns::new(&x, n, VECTORS), Columns::new(&mut y, n, VECTORS));
    let norm = l.infinity_norm();
    let mut worst = 0.0f64;
    for c in 0..VECTORS {
        let column = |block: &[f64]| (0..n).map(|i| block[i * VECTORS + c]).collect::<Vec<_>>();
        let (x, y) = (column(&x), column(&y));
        let energy: f64 = x.iter().zip(&y).map(|(a, b)| a * b).sum();
        let size: f64 = x.iter().map(|a| a * a).sum();
        worst = worst.max(-energy / (norm * size));
    }
    findings.at_most(Level::Matrix, "semi-definite", worst, SEMI_DEFINITE, "-x'Lx of 32 random vectors");
}

/// L does not depend on the unit of length: powers of two change no bit.
fn scaling(mesh: &TriangleMesh, l: &SymmetricCsr, discretisation: &Discretisation, findings: &mut Findings) {
    for (check, factor) in [("scaled up", 2f64.powi(27)), ("scaled down", 2f64.powi(-27))] {
        let positions = mesh.positions().iter().map(|p| p.map(|x| x * factor)).collect();
        let same =
            mesh.with_positions(positions).is_ok_and(|scaled| &(discretisation.laplacian)(&scaled) == l);
        let differs = if same { 0.0 } else { 1.0 };
        findings.at_most(Level::Matrix, check, differs, 0.0, "L of the mesh in another unit, bit by bit");
    }
}

/// Masses by their definition: a third of each triangle, or its part nearer to the corner, from squared edges.
fn masses(mesh: &TriangleMesh, found: &[f64], kind: Mass, check: &'static str, findings: &mut Findings) {
    if found.len() != mesh.positions().len() {
        return findings.note(Level::Matrix, check, Outcome::Failed, format!("{} masses", found.len()));
    }
    let mut expected = vec![0.0; found.len()];
    for (t, triangle) in mesh.triangles().iter().enumerate().filter(|(t, _)| !mesh.is_zero_area(*t)) {
        for (&v, share) in triangle.iter().zip(shares(mesh.corners(t), kind)) {
            expected[v as usize] += share;
        }
    }
    let mut thin = vec![false; found.len()];
    for corner in corners(mesh).filter(|corner| !corner.fat) {
        thin[corner.ends.0 as usize] = true;
        thin[corner.ends.1 as usize] = true;
    }
    let error =
        |v: usize| if found[v] == expected[v] { 0.0 } else { (found[v] - expected[v]).abs() / expected[v] };
    let worst = (0..found.len()).filter(|&v| !thin[v]).map(error);
    let worst = worst.fold(0.0, |m: f64, e| if e.is_nan() { f64::INFINITY } else { m.max(e) });
    findings.at_most(Level::Matrix, check, worst, MASS_LIMIT, "by definition, angles above 1 degree");
    let (sum, area) = (found.iter().sum::<f64>(), expected.iter().sum::<f64>());
    let off = if sum == area { 0.0 } else { (sum - area).abs() / area };
    findings.at_most(Level::Matrix, check, off, THIN_LIMIT, "sum against the area");
}

fn shares(p: [[f64; 3]; 3], kind: Mass) -> [f64; 3] {
    let area = 0.5 * norm(cross(sub(p[1], p[0]), sub(p[2], p[0])));
    if kind == Mass::Barycentric {
        return [area / 3.0; 3];
    }
    let square = |a: usize, b: usize| dot(sub(p[a], p[b]), sub(p[a], p[b]));
    let opposite = [square(1, 2), square(2, 0), square(0, 1)];
    let cosine = |c: usize| opposite[(c + 1) % 3] + opposite[(c + 2) % 3] - opposite[c]; // x 2 |u| |v|
    if let Some(obtuse) = (0..3).find(|&c| cosine(c) < 0.0) {
        return [0, 1, 2].map(|c| if c == obtuse { 0.5 * area } else { 0.25 * area });
    }
    // Each edge gives |e|^2 cot / 8 to both of its ends; cot c = cosine(c) / (4 area).
    let along = |c: usize| opposite[c] * cosine(c) / (32.0 * area);
    [along(1) + along(2), along(2) + along(0), along(0) + along(1)]
}
