//! The constrained vertices of a harmonic field, and the matrix that they leave.
//!
//! The pattern is that of the whole Laplacian, whatever is constrained: a constrained vertex becomes a *unit row*, its
//! diagonal alone, so that sets of constraints share one symbolic factorisation. Matrix and coupling are those of the set
//! at the last [`Constraints::refresh`], the *base*; edits since then change the set alone.
use crate::dirichlet::{Dirichlet, components};
use crate::error::EditError;
use crate::sparse::SymmetricCsr;

/// What a vertex is to the system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Unknown.
    Free,
    /// Given.
    Fixed,
    /// On no triangle: a unit row with a zero right-hand side, so its field is zero.
    Absent,
}

/// A Laplacian and its constrained vertices.
pub struct Constraints {
    laplacian: SymmetricCsr,
    kind: Vec<Kind>,
    /// Lowest vertex of the component of every vertex.
    component: Vec<u32>,
    fixed: Vec<u32>,
    /// Constrained vertices of the base, ascending.
    base: Vec<u32>,
    /// Values of the base's matrix with unit rows, by stored entry of the Laplacian.
    values: Vec<f64>,
    /// The base's L_FC: (free vertex, row among the constraints, stored entry), sorted.
    coupling: Vec<(u32, u32, u32)>,
    /// Row among the constraints of every constrained vertex; 0 for others.
    row: Vec<u32>,
}

impl Constraints {
    /// The constraints of `problem`.
    pub fn new(problem: &Dirichlet) -> Self {
        let laplacian = problem.laplacian().clone();
        let mut kind = vec![Kind::Absent; laplacian.n()];
        problem.free().iter().for_each(|&v| kind[v as usize] = Kind::Free);
        problem.fixed().iter().for_each(|&v| kind[v as usize] = Kind::Fixed);
        let component = components(&laplacian);
        let values = vec![0.0; laplacian.stored()];
        let (fixed, coupling, row) = (problem.fixed().to_vec(), Vec::new(), vec![0; laplacian.n()]);
        let base = fixed.clone();
        let mut out = Self { laplacian, kind, component, fixed, base, values, coupling, row };
        out.refresh();
        out
    }

    /// Pattern and values of the full Laplacian.
    pub fn laplacian(&self) -> &SymmetricCsr {
        &self.laplacian
    }

    /// Constrained vertices, ascending.
    pub fn fixed(&self) -> &[u32] {
        &self.fixed
    }

    /// Constrained vertices of the base, ascending.
    pub fn base(&self) -> &[u32] {
        &self.base
    }

    /// Values of the base's matrix with unit rows, by stored entry of the Laplacian.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The base's L_FC: (free vertex, row among the base's constraints, stored entry of the Laplacian), sorted.
    pub fn coupling(&self) -> &[(u32, u32, u32)] {
        &self.coupling
    }

    /// New values of the Laplacian; the set in force becomes the base. No allocation where it is that already.
    pub fn update_values(&mut self, values: &[f64]) {
        self.laplacian.values_mut().copy_from_slice(values);
        self.refresh();
    }

    /// Removes and adds constrained vertices; the base stays. On an error nothing has changed.
    pub fn edit(&mut self, add: &[u32], remove: &[u32]) -> Result<(), EditError> {
        let before = self.kind.clone();
        let outcome = self.change(add, remove);
        if outcome.is_err() {
            self.kind = before;
        } else {
            self.fixed =
                (0..self.kind.len() as u32).filter(|&v| self.kind[v as usize] == Kind::Fixed).collect();
        }
        outcome
    }

    fn change(&mut self, add: &[u32], remove: &[u32]) -> Result<(), EditError> {
        for (list, from, to, action) in
            [(remove, Kind::Fixed, Kind::Free, "removed"), (add, Kind::Free, Kind::Fixed, "added")]
        {
            for &vertex in list {
                match self.kind.get_mut(vertex as usize) {
                    Some(kind) if *kind == from => *kind = to,
                    _ => return Err(EditError::Vertex { vertex, action }),
                }
            }
        }
        let mut held = vec![false; self.kind.len()];
        for v in 0..self.kind.len() {
            held[self.component[v] as usize] |= self.kind[v] == Kind::Fixed;
        }
        match remove.iter().find(|&&v| !held[self.component[v as usize] as usize]) {
            Some(&vertex) => Err(EditError::Unconstrained { vertex }),
            None => Ok(()),
        }
    }

    /// Makes the set in force the base: matrix values and coupling. One pass over the Laplacian.
    pub fn refresh(&mut self) {
        self.base.clone_from(&self.fixed);
        let n = self.kind.len();
        let largest = (0..n).map(|v| self.laplacian.diagonal(v)).fold(0.0, f64::max);
        self.fixed.iter().enumerate().for_each(|(row, &v)| self.row[v as usize] = row as u32);
        self.coupling.clear();
        for i in 0..n {
            for entry in self.laplacian.row_range(i) {
                let (j, value) = (self.laplacian.columns()[entry] as usize, self.laplacian.values()[entry]);
                self.values[entry] = match (self.kind[i], self.kind[j]) {
                    (Kind::Free, Kind::Free) => value,
                    // Any positive number serves; one like the others keeps the scaling of the matrix.
                    _ if i == j => largest,
                    _ => 0.0,
                };
                match (self.kind[i], self.kind[j]) {
                    (Kind::Free, Kind::Fixed) => self.coupling.push((i as u32, self.row[j], entry as u32)),
                    (Kind::Fixed, Kind::Free) => self.coupling.push((j as u32, self.row[i], entry as u32)),
                    _ => {}
                }
            }
        }
        self.coupling.sort_unstable();
    }
}

/// An elimination order of all vertices from one of the free ones: each other vertex goes right before the last of its
/// neighbours, which a separator between them would hold; vertices without free neighbours go first.
pub fn extend_order(problem: &Dirichlet, order: &[u32]) -> Vec<u32> {
    let laplacian = problem.laplacian();
    let n = laplacian.n();
    // Free vertices at 2, 4, 6, ...; the others at odd numbers between them.
    let mut place = vec![0_u64; n];
    for (k, &row) in order.iter().enumerate() {
        place[problem.free()[row as usize] as usize] = 2 * k as u64 + 2;
    }
    let mut extended = place.clone();
    for i in 0..n {
        for &j in &laplacian.row(i).0[1..] {
            for (v, w) in [(i, j as usize), (j as usize, i)] {
                if place[v] == 0 && place[w] > 0 {
                    extended[v] = extended[v].max(place[w] - 1);
                }
            }
        }
    }
    let mut all: Vec<u32> = (0..n as u32).collect();
    all.sort_by_key(|&v| (extended[v as usize], v));
    all
}
