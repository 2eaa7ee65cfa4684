//! L5: what every solution does, whatever the mesh: constants stay, extremes lie on the constraints, superpositions add,
//! names of vertices do not matter, new values are really used.

use super::finding::{Findings, Level, Outcome};
use super::noise::shuffled;
use super::reference::largest_difference;
use super::subject::{NoAnswer, Subject};
use lapsolve::backend::PrepareOptions;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::workload::harmonic::{Constraints, DEFAULT_CONSTRAINTS, default_values};

/// Rounding that the maximum principle and constants allow a direct f64 solver.
const EXACT: f64 = 1e-12;

/// A check records what it finds, or says why there is no answer to look at.
type Check<'a> = fn(&Field<'a>, &Subject, &mut Findings) -> Result<(), NoAnswer>;

/// The harmonic workload of a mesh, with default constraints.
pub struct Field<'a> {
    mesh: &'a TriangleMesh,
    l: SymmetricCsr,
    fixed: Vec<u32>,
}

impl<'a> Field<'a> {
    /// With the Laplacian that `subject` uses.
    pub fn of(mesh: &'a TriangleMesh, subject: &Subject) -> Self {
        let l = subject.laplacian(mesh);
        let fixed = Constraints::sample(mesh, &l, DEFAULT_CONSTRAINTS).default_set();
        Self { mesh, l, fixed }
    }

    /// All checks of this level on a harmonic field.
    pub fn check(&self, subject: &Subject, must_converge: bool, findings: &mut Findings) {
        let checks: [(&'static str, Check<'a>); 6] = [
            ("constant stays constant", Self::constant),
            ("maximum principle", Self::maximum_principle),
            ("superposition", Self::superposition),
            ("vertex names", Self::vertex_names),
            ("new values are used", Self::new_values),
            ("repeatable", Self::repeatable),
        ];
        for (check, run) in checks {
            if !subject.takes(self.mesh.positions().len() - self.fixed.len().min(self.mesh.positions().len()))
            {
                findings.note(Level::Behaviour, check, Outcome::Skipped, "more unknowns than it takes");
            } else if let Err(no) = run(self, subject, findings) {
                no.record(findings, Level::Behaviour, check, must_converge);
            }
        }
    }

    fn problem(&self) -> Result<Dirichlet, NoAnswer> {
        Ok(Dirichlet::new(self.l.clone(), Some(self.mesh.positions()), &self.fixed)?)
    }

    fn solve(&self, subject: &Subject, values: &[f64], k: usize) -> Result<Vec<f64>, NoAnswer> {
        subject.harmonic(&self.problem()?, Columns::new(values, self.fixed.len(), k))
    }

    /// What the class allows, at best [`EXACT`].
    fn limit(subject: &Subject) -> f64 {
        if subject.exact { EXACT } else { subject.limits.harmonic }
    }

    /// Condition and slivers make even a direct solver lose digits; the limit of its class still holds.
    fn constant(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        let field = self.solve(subject, &vec![3.0; self.fixed.len()], 1)?;
        let problem = self.problem()?;
        let present = problem.free().iter().chain(problem.fixed());
        let worst = present.map(|&v| (field[v as usize] / 3.0 - 1.0).abs()).fold(0.0, f64::max);
        findings.at_most(Level::Behaviour, "constant stays constant", worst, subject.limits.harmonic, "");
        Ok(())
    }

    /// min g <= u <= max g where no off-diagonal entry is positive; elsewhere on the intrinsic Delaunay triangulation.
    fn maximum_principle(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        let plain = is_m_matrix(&self.l);
        let (l, which) = match plain {
            true => (self.l.clone(), "plain weights"),
            false => (
                Laplacian::assemble(self.mesh, Weights::IntrinsicDelaunay).into_matrix(),
                "intrinsic Delaunay",
            ),
        };
        let fixed = match plain {
            true => self.fixed.clone(),
            // Zero-area triangles take part there, so components and unused vertices may differ.
            false => Constraints::sample(self.mesh, &l, DEFAULT_CONSTRAINTS).default_set(),
        };
        let values = default_values(self.mesh, &fixed);
        let problem = Dirichlet::new(l, Some(self.mesh.positions()), &fixed)?;
        let field = subject.harmonic(&problem, Columns::new(&values, fixed.len(), 4))?;
        let mut worst = 0.0f64;
        for c in 0..4 {
            let column = values.iter().skip(c).step_by(4).copied();
            let (low, high) =
                (column.clone().fold(f64::INFINITY, f64::min), column.fold(f64::NEG_INFINITY, f64::max));
            for &v in problem.free() {
                let u = field[4 * v as usize + c];
                worst = if u.is_nan() { f64::INFINITY } else { worst.max(low - u).max(u - high) };
            }
        }
        findings.at_most(Level::Behaviour, "maximum principle", worst, Self::limit(subject), which);
        Ok(())
    }

    /// Column by column, and together, and summed: u(g + h) = u(g) + u(h).
    fn superposition(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        let g = default_values(self.mesh, &self.fixed);
        let rows = self.fixed.len();
        let column = |c: usize| g.iter().skip(c).step_by(4).copied();
        let three: Vec<f64> = column(0).zip(column(2)).flat_map(|(a, b)| [a, b, a + b]).collect();
        let together = self.solve(subject, &three, 3)?;
        let first = self.solve(subject, &column(0).collect::<Vec<_>>(), 1)?;
        let scale = three.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let (mut worst, n) = (0.0f64, first.len());
        for v in 0..n {
            let [a, b, sum] = [0, 1, 2].map(|c| together[3 * v + c]);
            let error = (a + b - sum).abs().max((a - first[v]).abs());
            worst = if error.is_nan() { f64::INFINITY } else { worst.max(error / scale) };
        }
        debug_assert_eq!(three.len(), 3 * rows);
        findings.at_most(
            Level::Behaviour,
            "superposition",
            worst,
            3.0 * subject.limits.harmonic,
            "columns alone and together",
        );
        Ok(())
    }

    /// The same mesh with its vertices shuffled has the same field.
    fn vertex_names(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        let n = self.mesh.positions().len();
        let old_of_new = shuffled(n, 7);
        let mut new_of_old = vec![0; n];
        (0..).zip(&old_of_new).for_each(|(new, &old)| new_of_old[old as usize] = new);
        let rename = |v: u32| new_of_old[v as usize];
        let positions = old_of_new.iter().map(|&v| self.mesh.positions()[v as usize]).collect();
        let triangles = self.mesh.triangles().iter().map(|t| t.map(rename)).collect();
        let mesh = TriangleMesh::new(positions, triangles).map_err(|e| NoAnswer::Failed(e.to_string()))?;
        let mut fixed: Vec<u32> = self.fixed.iter().map(|&v| rename(v)).collect();
        fixed.sort_unstable();
        let renamed = Field { mesh: &mesh, l: subject.laplacian(&mesh), fixed };
        // Values come from positions, so the renamed mesh has them in its own order.
        let ours = self.solve(subject, &default_values(self.mesh, &self.fixed), 4)?;
        let theirs = renamed.solve(subject, &default_values(&mesh, &renamed.fixed), 4)?;
        let back: Vec<f64> =
            (0..n).flat_map(|v| theirs[4 * new_of_old[v] as usize..][..4].to_vec()).collect();
        let worst = largest_difference(&ours, &back);
        findings.at_most(
            Level::Behaviour,
            "vertex names",
            worst,
            2.0 * subject.limits.harmonic,
            "shuffled vertices",
        );
        Ok(())
    }

    /// After `update_values` the handle answers for the new matrix: a stale factor would still know the old one.
    fn new_values(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        const CHECK: &str = "new values are used";
        let stretched = self.mesh.positions().iter().map(|&[x, y, z]| [x, 0.7 * y, 1.3 * z]).collect();
        let mesh = self.mesh.with_positions(stretched).map_err(|e| NoAnswer::Failed(e.to_string()))?;
        let other = subject.laplacian(&mesh);
        if other.columns() != self.l.columns() || other.row_starts() != self.l.row_starts() {
            findings.note(
                Level::Behaviour,
                CHECK,
                Outcome::Skipped,
                "stretching changes the pattern of this mesh",
            );
            return Ok(());
        }
        let values = default_values(self.mesh, &self.fixed);
        let (n, g) = (self.l.n(), Columns::new(&values[..], self.fixed.len(), 4));
        let problem = self.problem()?;
        let options = PrepareOptions::columns(4);
        let mut handle =
            subject.ask(|| Ok(subject.backend.prepare_harmonic(&problem, &options, &mut |_| {})?))?;
        let mut field = vec![0.0; 4 * n];
        subject.ask(|| Ok(handle.solve(g, Columns::new(&mut field, n, 4))?))?;
        subject.ask(|| Ok(handle.update_values(other.values(), &mut |_| {})?))?;
        field.fill(0.0);
        subject.ask(|| Ok(handle.solve(g, Columns::new(&mut field, n, 4))?))?;
        let fresh =
            Field { mesh: self.mesh, l: other, fixed: self.fixed.clone() }.solve(subject, &values, 4)?;
        let worst = largest_difference(&field, &fresh);
        findings.at_most(
            Level::Behaviour,
            CHECK,
            worst,
            2.0 * subject.limits.harmonic,
            "against a new handle",
        );
        Ok(())
    }

    /// The same solve twice on one handle gives the same bits.
    fn repeatable(&self, subject: &Subject, findings: &mut Findings) -> Result<(), NoAnswer> {
        let values = default_values(self.mesh, &self.fixed);
        let (n, g) = (self.l.n(), Columns::new(&values[..], self.fixed.len(), 4));
        let problem = self.problem()?;
        let options = PrepareOptions::columns(4);
        let mut handle =
            subject.ask(|| Ok(subject.backend.prepare_harmonic(&problem, &options, &mut |_| {})?))?;
        let mut fields = [vec![0.0; 4 * n], vec![0.0; 4 * n]];
        for field in &mut fields {
            subject.ask(|| Ok(handle.solve(g, Columns::new(field, n, 4))?))?;
        }
        let worst = largest_difference(&fields[0], &fields[1]);
        findings.at_most(Level::Behaviour, "repeatable", worst, 0.0, "one handle, the same input twice");
        Ok(())
    }
}

/// Whether no off-diagonal entry is positive.
pub fn is_m_matrix(l: &SymmetricCsr) -> bool {
    (0..l.n()).all(|i| l.row(i).1[1..].iter().all(|&v| v <= 0.0))
}
