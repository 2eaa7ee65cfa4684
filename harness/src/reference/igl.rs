//! libigl: Laplacian, lumped masses and a harmonic field.

use std::collections::HashMap;

use lapsolve::backend::{Backend, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mass::{self, Mass};
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;

use super::python::MeshFile;
use super::{Agreement, CompareError, Python, ReferenceError};

/// Smallest angle, in degrees, from which libigl's numbers agree to [`FAT_LIMIT`]. It computes from edge lengths and loses
/// about eps / angle^2 of a triangle's area; ours come from coordinates.
const FAT_DEGREES: f64 = 1.0;
/// Limit where all angles are above [`FAT_DEGREES`].
const FAT_LIMIT: f64 = 1e-12;
/// Limit for entries of L at thinner triangles, in eps / angle^2 of the smallest angle.
const THIN_LIMIT: f64 = 2.0;
/// Limit for masses at thinner triangles, whose area is a small part of them.
const THIN_MASS_LIMIT: f64 = 1e-8;
/// Below this smallest angle, in degrees, eps / angle^2 is above 1e-9: rounding alone makes L uncertain by more than
/// harmonic fields may be off.
const UNCERTAIN_DEGREES: f64 = 0.03;
/// Limit of harmonic fields on meshes with such an angle. On the 871K-triangle dragon libigl's field is 2.4e-9 off the
/// solution of its own equations, and that one 2e-9 off the solution of ours.
const UNCERTAIN_LIMIT: f64 = 1e-8;
/// Relative difference of total areas.
const AREA_LIMIT: f64 = 1e-12;

/// What libigl computes for a mesh, in its numbering.
#[derive(Clone, Debug)]
pub struct IglValues {
    /// Rows (i, j, L_ij), i <= j, sorted.
    pub laplacian: Vec<[f64; 3]>,
    /// Barycentric masses.
    pub barycentric: Vec<f64>,
    /// Voronoi masses.
    pub voronoi: Vec<f64>,
    /// Constrained vertices, ascending.
    pub constrained: Vec<u32>,
    /// Their values, |C| x k.
    pub constraints: Vec<f64>,
    /// The harmonic field, n x k.
    pub field: Vec<f64>,
    /// Versions of the tools.
    pub versions: String,
}

impl IglValues {
    /// Runs libigl on `mesh` with the default constraints of the `harmonic` workload.
    ///
    /// # Errors
    /// [`ReferenceError`].
    pub fn compute(python: &Python, mesh: &TriangleMesh) -> Result<Self, ReferenceError> {
        let answer = python.run("igl_reference.py", MeshFile::Mesh(mesh), |_| Ok(Vec::new()))?;
        let n = mesh.positions().len();
        let field = answer.array("field", Some(n))?;
        let k = field.len() / n.max(1);
        let constraints = answer.array("constraints", None)?;
        let rows = constraints.chunks_exact(k + 1);
        Ok(Self {
            laplacian: answer
                .array("laplacian", None)?
                .chunks_exact(3)
                .map(|row| [row[0], row[1], row[2]])
                .collect(),
            barycentric: answer.array("mass_barycentric", Some(n))?,
            voronoi: answer.array("mass_voronoi", Some(n))?,
            constrained: rows.clone().map(|row| row[0] as u32).collect(),
            constraints: rows.flat_map(|row| row[1..].to_vec()).collect(),
            field,
            versions: answer.versions(),
        })
    }

    /// Columns of the field.
    pub fn columns(&self) -> usize {
        self.constraints.len() / self.constrained.len().max(1)
    }
}

/// Everything of lapsolve that libigl has too, against its values; `backend` solves the harmonic field, whose limit is
/// `harmonic_limit` of the largest |g|, or wider on meshes whose needles make the equations themselves uncertain.
///
/// # Errors
/// [`CompareError`] where the backend cannot solve.
pub fn compare(
    mesh: &TriangleMesh,
    theirs: &IglValues,
    backend: &dyn Backend,
    harmonic_limit: f64,
) -> Result<Vec<Agreement>, CompareError> {
    let laplacian = Laplacian::assemble(mesh, Weights::Plain);
    let mut agreements = compare_laplacian(mesh, &laplacian, laplacian.matrix(), theirs);
    let thinnest = Thinnest::of(mesh, &laplacian);
    agreements.extend(compare_masses(&thinnest, &mass::lumped(mesh, Mass::Barycentric), &theirs.barycentric));
    agreements.extend(compare_masses(&thinnest, &mass::lumped(mesh, Mass::Voronoi), &theirs.voronoi));
    let problem = Dirichlet::new(laplacian.into_matrix(), Some(mesh.positions()), &theirs.constrained)?;
    let (n, k) = (mesh.positions().len(), theirs.columns());
    let mut handle = backend.prepare_harmonic(&problem, &PrepareOptions::columns(k), &mut |_| {})?;
    let mut field = vec![0.0; n * k];
    let constraints = Columns::new(&theirs.constraints[..], theirs.constrained.len(), k);
    handle.solve(constraints, Columns::new(&mut field[..], n, k))?;
    let uncertain = thinnest.least() < UNCERTAIN_DEGREES.to_radians();
    let limit = if uncertain { harmonic_limit.max(UNCERTAIN_LIMIT) } else { harmonic_limit };
    agreements.push(compare_fields(&field, theirs, limit));
    Ok(agreements)
}

/// Every entry that either side stores. `laplacian` tells the zero-area triangles, `l` is what is compared.
pub fn compare_laplacian(
    mesh: &TriangleMesh,
    laplacian: &Laplacian,
    l: &SymmetricCsr,
    theirs: &IglValues,
) -> Vec<Agreement> {
    let thinnest = Thinnest::of(mesh, laplacian);
    let mut fat = Agreement::new("L, all angles above 1 degree", FAT_LIMIT);
    let mut thin = Agreement::new("L, thinner, in eps / angle^2", THIN_LIMIT);
    let mut diagonal = vec![0.0; mesh.positions().len()];
    for &[i, _, value] in theirs.laplacian.iter().filter(|row| row[0] == row[1]) {
        diagonal[i as usize] = value;
    }
    for (i, j, ours, theirs) in Union::new(l, &theirs.laplacian) {
        let scale = diagonal[i as usize].max(diagonal[j as usize]);
        let place = || format!("entry ({i}, {j})");
        match thinnest.at(i, j) {
            Some(angle) => thin.add(ours, theirs, scale * f64::EPSILON / (angle * angle), place),
            None => fat.add(ours, theirs, scale, place),
        }
    }
    [fat, thin].into_iter().filter(|agreement| agreement.compared > 0).collect()
}

/// Masses vertex by vertex, and their sum.
fn compare_masses(thinnest: &Thinnest, ours: &[f64], theirs: &[f64]) -> Vec<Agreement> {
    let mut fat = Agreement::new("mass, all angles above 1 degree", FAT_LIMIT);
    let mut thin = Agreement::new("mass, thinner", THIN_MASS_LIMIT);
    for (i, (&ours, &theirs)) in ours.iter().zip(theirs).enumerate() {
        let agreement = if thinnest.at(i as u32, i as u32).is_some() { &mut thin } else { &mut fat };
        agreement.add(ours, theirs, theirs, || format!("vertex {i}"));
    }
    let mut area = Agreement::new("total area", AREA_LIMIT);
    let total: f64 = theirs.iter().sum();
    area.add(ours.iter().sum(), total, total, || "sum of masses".into());
    [fat, thin, area].into_iter().filter(|agreement| agreement.compared > 0).collect()
}

/// The harmonic field at every vertex, relative to the largest |g|.
pub fn compare_fields(ours: &[f64], theirs: &IglValues, limit: f64) -> Agreement {
    let mut agreement = Agreement::new("harmonic field", limit);
    let scale = theirs.constraints.iter().fold(0.0, |most: f64, g| most.max(g.abs()));
    let k = theirs.columns();
    for (at, (&ours, &theirs)) in ours.iter().zip(&theirs.field).enumerate() {
        agreement.add(ours, theirs, scale, || format!("vertex {}, column {}", at / k, at % k));
    }
    agreement
}

/// The smallest angle, in radians, of the triangles that make an entry; only those below [`FAT_DEGREES`] are kept.
struct Thinnest {
    angles: HashMap<(u32, u32), f64>,
}

impl Thinnest {
    fn of(mesh: &TriangleMesh, laplacian: &Laplacian) -> Self {
        let mut angles = HashMap::new();
        let x = mesh.positions();
        for (t, corners) in mesh.triangles().iter().enumerate() {
            let angle = smallest_angle(corners.map(|v| x[v as usize]));
            if angle > FAT_DEGREES.to_radians() || laplacian.zero_area().binary_search(&(t as u32)).is_ok() {
                continue;
            }
            for (&i, &j) in corners.iter().flat_map(|i| corners.iter().map(move |j| (i, j))) {
                let least = angles.entry((i.min(j), i.max(j))).or_insert(angle);
                *least = angle.min(*least);
            }
        }
        Self { angles }
    }

    fn least(&self) -> f64 {
        self.angles.values().copied().fold(f64::INFINITY, f64::min)
    }

    /// `None` where all are above [`FAT_DEGREES`].
    fn at(&self, i: u32, j: u32) -> Option<f64> {
        self.angles.get(&(i.min(j), i.max(j))).copied()
    }
}

/// In radians, from cross and dot products: accurate for needles.
fn smallest_angle(corners: [[f64; 3]; 3]) -> f64 {
    let angle = |c: usize| {
        let [p, q, r] = [corners[c], corners[(c + 1) % 3], corners[(c + 2) % 3]];
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|a| q[a] - p[a]), std::array::from_fn(|a| r[a] - p[a]));
        let cross: [f64; 3] =
            std::array::from_fn(|a| u[(a + 1) % 3] * v[(a + 2) % 3] - u[(a + 2) % 3] * v[(a + 1) % 3]);
        let dot: f64 = (0..3).map(|a| u[a] * v[a]).sum();
        cross.iter().map(|c| c * c).sum::<f64>().sqrt().atan2(dot)
    };
    angle(0).min(angle(1)).min(angle(2))
}

/// Walks the stored entries of both sides in order: (i, j, ours, theirs), zero where one side stores nothing.
struct Union<'a> {
    ours: Vec<(u32, u32, f64)>,
    theirs: &'a [[f64; 3]],
}

impl<'a> Union<'a> {
    fn new(l: &SymmetricCsr, theirs: &'a [[f64; 3]]) -> Self {
        let row = |i: usize| {
            let range = l.row_starts()[i] as usize..l.row_starts()[i + 1] as usize;
            l.columns()[range.clone()]
                .iter()
                .zip(&l.values()[range])
                .map(move |(&j, &value)| (i as u32, j, value))
        };
        let mut ours: Vec<_> = (0..l.n()).flat_map(row).collect();
        ours.reverse(); // taken from the end
        Self { ours, theirs }
    }
}

impl Iterator for Union<'_> {
    type Item = (u32, u32, f64, f64);

    fn next(&mut self) -> Option<Self::Item> {
        let their_place = self.theirs.first().map(|row| (row[0] as u32, row[1] as u32));
        let our_place = self.ours.last().map(|&(i, j, _)| (i, j));
        let place = [our_place, their_place].into_iter().flatten().min()?;
        let ours = self.ours.pop_if(|&mut (i, j, _)| (i, j) == place).map_or(0.0, |(_, _, value)| value);
        let theirs = match self.theirs.split_first() {
            Some((row, rest)) if their_place == Some(place) => {
                self.theirs = rest;
                row[2]
            }
            _ => 0.0,
        };
        Some((place.0, place.1, ours, theirs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_that_one_side_lacks_are_compared_with_zero() {
        let l = SymmetricCsr::from_triplets(2, &[(0, 0, 1.0), (0, 1, -1.0), (1, 1, 1.0)]).unwrap();
        let theirs = [[0.0, 0.0, 1.5], [1.0, 1.0, 2.0], [1.0, 2.0, 3.0]];
        let walked: Vec<_> = Union::new(&l, &theirs).collect();
        assert_eq!(walked, [(0, 0, 1.0, 1.5), (0, 1, -1.0, 0.0), (1, 1, 1.0, 2.0), (1, 2, 0.0, 3.0)]);
    }

    #[test]
    fn the_angle_of_a_needle_is_its_height_over_its_length() {
        let angle = smallest_angle([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]]);
        assert!((angle / 1e-9 - 1.0).abs() < 1e-12, "{angle}");
    }
}
