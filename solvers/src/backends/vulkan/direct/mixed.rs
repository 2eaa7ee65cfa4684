//! `mixed` on a device without f64, or one that is the CPU: sweeps in f32 there, residuals in f64 on the CPU
//! (J. H. Wilkinson, "Rounding Errors in Algebraic Processes", 1963, section 3.4).
use super::frames::Frames;
use super::handle::together;
use super::tables::Tables;
use crate::backend::{Factor, Footprint, Phase, Solved};
use crate::backends::framechol::engine::{groups, power_of_two};
use crate::backends::framechol::first_bad_row;
use crate::backends::framechol::gather::Group;
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};
use crate::sparse::{FullPattern, SymmetricCsr};
use std::sync::atomic::{AtomicU64, Ordering};

/// Most sweep pairs of a solve.
pub(super) const MOST_PAIRS: u32 = 5;
/// Those of a usual one.
const USUAL_PAIRS: u64 = 2;
/// Backward error at which refinement stops: a fifth of what the class promises (5e-12), in a smaller norm of A.
pub(super) const ENOUGH: f64 = 1e-12;
/// Relative size that the error after the last pair may have, estimated as the last step times the contraction seen: a
/// tenth of what the class promises (2e-9).
pub(super) const SMALL: f64 = 2e-10;

/// The frames with what refinement needs.
pub struct HostRefined {
    frames: Frames<Tables<f32>>,
    ordering: &'static str,
    matrix: Rows,
    /// Its largest diagonal entry: a lower bound of its norm.
    norm: f64,
    /// n x k for the widest group each: residual, step, solution.
    residual: Vec<f64>,
    step: Vec<f64>,
    solution: Vec<f64>,
}

/// All entries of a symmetric matrix, row by row: threads share the rows.
struct Rows {
    pattern: FullPattern,
    /// Of the stored triangle.
    values: Vec<f64>,
}

impl Rows {
    fn new(matrix: &SymmetricCsr) -> Self {
        Self { pattern: matrix.full_pattern(), values: vec![0.0; matrix.stored()] }
    }

    fn bytes(&self) -> u64 {
        let FullPattern { starts, columns, source } = &self.pattern;
        (4 * (starts.len() + columns.len() + source.len()) + 8 * self.values.len()) as u64
    }

    /// Rows `first..` of b - A x, k columns each; returns the largest absolute value. `b` is those rows of n x `wide`, from its
    /// column `from` on.
    fn residual<const K: usize>(
        &self,
        first: usize,
        (b, wide, from): (&[f64], usize, usize),
        x: &[f64],
        out: &mut [f64],
    ) -> f64 {
        let FullPattern { starts, columns, source } = &self.pattern;
        let (x, mut most) = (x.as_chunks::<K>().0, [0.0_f64; K]);
        for (i, (out, b)) in out.as_chunks_mut::<K>().0.iter_mut().zip(b.chunks_exact(wide)).enumerate() {
            let mut row = *b[from..].first_chunk::<K>().expect("K columns");
            let range = starts[first + i] as usize..starts[first + i + 1] as usize;
            for (&j, &entry) in columns[range.clone()].iter().zip(&source[range]) {
                let (value, x) = (self.values[entry as usize], &x[j as usize]);
                (0..K).for_each(|c| row[c] -= value * x[c]);
            }
            (0..K).for_each(|c| most[c] = larger(most[c], row[c].abs()));
            *out = row;
        }
        most.into_iter().fold(0.0, larger)
    }
}

/// The larger of two numbers that are not negative; NaN wins.
fn larger(a: f64, b: f64) -> f64 {
    if b <= a { a } else { b }
}

/// A largest absolute value found by several threads: the bits of numbers that are not negative are ordered as they are.
struct Largest(AtomicU64);

impl Largest {
    fn add(&self, value: f64) {
        self.0.fetch_max(value.to_bits(), Ordering::Relaxed);
    }

    fn get(self) -> f64 {
        f64::from_bits(self.0.into_inner())
    }
}

impl Factor for HostRefined {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.frames.core.rows(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let mut all = Solved { device_ns: Some(0), ..Solved::default() };
        for group in groups(k, self.frames.widest()) {
            let (finite, solved) = self.refine(rhs, &mut x, group)?;
            if !finite {
                return Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) });
            }
            all = together(all, solved);
        }
        Ok(all)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.frames.core.factorise(values)?;
        self.renew(values);
        Ok(())
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(self.frames.device_phases()?)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.frames.core.symbolic().order)
    }

    fn footprint(&self) -> Footprint {
        let (of_one, matrix) = (self.frames.footprint(self.ordering), self.matrix.bytes());
        let own = matrix + 24 * self.residual.len() as u64;
        Footprint {
            host_bytes: of_one.host_bytes.map(|bytes| bytes + own),
            bytes_per_solve: of_one.bytes_per_solve.map(|bytes| USUAL_PAIRS * (bytes + matrix)),
            dispatches: of_one.dispatches.map(|count| USUAL_PAIRS * count),
            ..of_one
        }
    }
}

impl HostRefined {
    /// From the frames of a factor that is in place, and the matrix.
    pub fn new(frames: Frames<Tables<f32>>, matrix: &SymmetricCsr, ordering: &'static str) -> Self {
        let vector = || vec![0.0; matrix.n() * frames.widest()];
        let (residual, step, solution) = (vector(), vector(), vector());
        let mut refined =
            Self { frames, ordering, matrix: Rows::new(matrix), norm: 0.0, residual, step, solution };
        refined.renew(matrix.values());
        refined
    }

    /// Takes the matrix' values.
    fn renew(&mut self, values: &[f64]) {
        self.matrix.values.copy_from_slice(values);
        // Diagonal entries are among them, and in a positive definite matrix one is the largest entry.
        self.norm = values.iter().fold(0.0, |most, v| v.max(most));
    }

    /// Solves for a group of columns; (whether the solution is finite, what to report).
    fn refine(
        &mut self,
        rhs: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), SolveError> {
        let (n, k) = (rhs.n(), group.count);
        let own = Group { from: 0, count: k };
        let (mut residual, mut right_hand_side) = (0.0, 0.0);
        let (mut pairs, mut last_step, mut device_ns) = (0, 0.0, Some(0));
        while pairs < MOST_PAIRS {
            let mut scale = 1.0 / power_of_two(residual);
            if pairs == 0 {
                right_hand_side = self.frames.load(rhs, group, 1.0);
                scale = 1.0 / power_of_two(right_hand_side);
                if !(1.0 / 65_536.0..=65_536.0).contains(&scale) {
                    self.frames.load(rhs, group, scale);
                } else {
                    scale = 1.0; // near enough
                }
                residual = right_hand_side;
            } else {
                self.frames.load(Columns::new(&self.residual[..n * k], n, k), own, scale);
            }
            if !(residual > 0.0 && residual.is_finite()) {
                break;
            }
            device_ns = device_ns.zip(self.frames.run(own)?).map(|(a, b)| a + b);
            let mut step = Columns::new(&mut self.step[..n * k], n, k);
            if !self.frames.store(&mut step, own, self.frames.core.scale / scale)? {
                residual = f64::NAN;
                break;
            }
            let (step_size, solution);
            (step_size, solution, residual) = self.advance(rhs, group, pairs == 0);
            pairs += 1;
            let backward = residual / (self.norm * solution + right_hand_side);
            let contraction = if pairs == 1 { 1.0 } else { step_size / last_step };
            last_step = step_size;
            if pairs >= 2 && backward <= ENOUGH && contraction * step_size <= SMALL * solution {
                break;
            }
        }
        self.write(x, group, pairs > 0);
        Ok((residual.is_finite(), Solved { iterations: Some(pairs), device_ns, ..Solved::default() }))
    }

    /// solution += step (or := the first one), residual := rhs - A solution. Returns their largest absolute values: (step,
    /// solution, residual).
    fn advance(&mut self, rhs: Columns<&[f64]>, group: Group, first: bool) -> (f64, f64, f64) {
        let (n, k, wide) = (rhs.n(), group.count, rhs.k());
        let Self { frames, matrix, residual, step, solution, .. } = self;
        let [steps, solutions, residuals] = [const { Largest(AtomicU64::new(0)) }; 3];
        frames.team.for_each_run(&mut solution[..n * k], k, |rows, solution| {
            let (mut longest, mut most) = (0.0, 0.0);
            for (x, d) in solution.iter_mut().zip(&step[rows.start * k..rows.end * k]) {
                *x = if first { *d } else { *x + d };
                (longest, most) = (larger(longest, d.abs()), larger(most, x.abs()));
            }
            steps.add(longest);
            solutions.add(most);
        });
        frames.team.for_each_run(&mut residual[..n * k], k, |rows, out| {
            let b = (&rhs.slice()[rows.start * wide..rows.end * wide], wide, group.from);
            let (i, x) = (rows.start, &solution[..n * k]);
            residuals.add(match k {
                1 => matrix.residual::<1>(i, b, x, out),
                2 => matrix.residual::<2>(i, b, x, out),
                3 => matrix.residual::<3>(i, b, x, out),
                4 => matrix.residual::<4>(i, b, x, out),
                5 => matrix.residual::<5>(i, b, x, out),
                6 => matrix.residual::<6>(i, b, x, out),
                7 => matrix.residual::<7>(i, b, x, out),
                _ => matrix.residual::<8>(i, b, x, out),
            });
        });
        (steps.get(), solutions.get(), residuals.get())
    }

    /// The solution, or zeros where there is none, to a group of columns of `x`.
    fn write(&mut self, x: &mut Columns<&mut [f64]>, group: Group, solved: bool) {
        let (k, solution, wide) = (group.count, &self.solution, x.k());
        self.frames.team.for_each_run(x.data_mut(), wide, |rows, x| {
            for (x, i) in x.chunks_exact_mut(wide).zip(rows) {
                let x = &mut x[group.from..group.from + k];
                if solved { x.copy_from_slice(&solution[i * k..(i + 1) * k]) } else { x.fill(0.0) }
            }
        });
    }
}
