//! Frames of a direct solve: right-hand sides in, both sweeps in one submission, solutions out.
use super::number::Number;
use super::tables::{PLANE, Tables};
use crate::backends::framechol::gather::Group;
use crate::backends::vulkan::buffer::{Input, Output};
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::plan::Plan;
use crate::backends::vulkan::recorded::Recorded;
use crate::columns::Columns;

/// A factor with the host's side of its frames.
pub struct Frames<T: Number> {
    /// The factor.
    pub tables: Tables<T>,
    rhs: Input<T>,
    x: Output<T>,
    /// By planes less one.
    plans: Vec<Recorded>,
    /// Dispatches of one submission.
    dispatches: usize,
    clear: Recorded,
    /// Planes of the last frame.
    last: usize,
    n: usize,
}

/// Lists the steps of a frame.
fn list<T: Number>(plan: &mut Plan, tables: &Tables<T>, rhs: &Input<T>, x: &Output<T>, planes: usize) {
    rhs.upload(plan);
    plan.barrier();
    plan.phase(|| "upload".into());
    tables.sweep(plan, rhs.buffer(), x.buffer(), planes);
    x.download(plan);
    plan.phase(|| "download".into());
}

/// Planes for solves of up to `columns` columns.
pub fn planes(columns: usize) -> usize {
    if columns > PLANE { 2 } else { 1 }
}

impl<T: Number> Frames<T> {
    /// Records the frames of a factor for up to `max_columns` columns at once (at most eight), and runs them once: drivers
    /// compile kernels when they first run.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn new(tables: Tables<T>, n: usize, max_columns: usize) -> Result<Self, DeviceError> {
        let device = tables.device().clone();
        let most = planes(max_columns);
        let rhs = Input::<T>::new(&device, (n + 1) * PLANE * most)?;
        let x = Output::<T>::new(&device, (n + 1) * PLANE * most)?;
        let mut plan = Plan::new(&device);
        tables.clear(&mut plan);
        plan.clear(rhs.buffer());
        plan.clear(x.buffer());
        let mut clear = plan.record()?;
        clear.run()?;
        let (mut plans, mut dispatches) = (Vec::new(), 0);
        for planes in 1..=most {
            let mut plan = Plan::new(&device);
            plan.mark();
            list(&mut plan, &tables, &rhs, &x, planes);
            plan.mark();
            dispatches = plan.dispatches();
            let mut recorded = plan.record()?;
            recorded.run()?;
            plans.push(recorded);
        }
        Ok(Self { tables, rhs, x, plans, dispatches, clear, last: 1, n })
    }

    /// The last frame once more, phase by phase.
    ///
    /// # Errors
    /// Where memory does not suffice or the device fails.
    pub fn device_phases(&self) -> Result<Vec<(String, u64)>, DeviceError> {
        let mut plan = Plan::timed(self.tables.device());
        list(&mut plan, &self.tables, &self.rhs, &self.x, self.last);
        let mut recorded = plan.record()?;
        recorded.run()?;
        Ok(recorded.phases())
    }

    /// Dispatches of one submission.
    pub fn dispatches(&self) -> u64 {
        self.dispatches as u64
    }

    /// Most columns of a frame.
    pub fn widest(&self) -> usize {
        PLANE * self.plans.len()
    }

    /// A group of columns of `b`, times `scale`, becomes the right-hand side.
    pub fn load(&mut self, b: Columns<&[f64]>, group: Group, scale: f64) {
        let (n, host) = (self.n, self.rhs.host());
        match planes(group.count) {
            1 => load_rows(b, group, scale, &mut host.as_chunks_mut::<4>().0[..n]),
            _ => load_rows(b, group, scale, &mut host.as_chunks_mut::<8>().0[..n]),
        }
    }

    /// Both sweeps; returns the time on the device.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn run(&mut self, group: Group) -> Result<Option<u64>, DeviceError> {
        self.last = planes(group.count);
        let recorded = &mut self.plans[self.last - 1];
        recorded.run()?;
        Ok(recorded.device_ns())
    }

    /// Stores the solution times `scale` to a group of columns of `x`; returns whether all of it is finite.
    ///
    /// # Errors
    /// Where clearing the device's vectors fails, which is done where it is not.
    pub fn store(
        &mut self,
        x: &mut Columns<&mut [f64]>,
        group: Group,
        scale: f64,
    ) -> Result<bool, DeviceError> {
        let (n, host) = (self.n, self.x.host());
        let finite = match planes(group.count) {
            1 => store_rows(&host.as_chunks::<4>().0[..n], x, group, scale),
            _ => store_rows(&host.as_chunks::<8>().0[..n], x, group, scale),
        };
        if !finite {
            self.clear.run()?;
        }
        Ok(finite)
    }

    /// Bytes on the device: all that this handle allocated there.
    pub fn device_bytes(&self) -> u64 {
        let (numbers, indices) = self.tables.factor_bytes();
        numbers + indices + self.tables.vector_bytes() + self.rhs.buffer().bytes() + self.x.buffer().bytes()
    }
}

/// Runs `$body` with the constant `$c` equal to `$count`.
macro_rules! with_count {
    ($count:expr, $c:ident, $body:block) => {
        with_count!(@ $count, $c, $body, 1 2 3 4 5 6 7 8)
    };
    (@ $count:expr, $c:ident, $body:block, $($n:literal)*) => {
        match $count {
            $($n => { const $c: usize = $n; $body })*
            other => unreachable!("a group of {other} columns"),
        }
    };
}

fn load_rows<T: Number, const L: usize>(b: Columns<&[f64]>, group: Group, scale: f64, to: &mut [[T; L]]) {
    let (k, data) = (b.k(), b.slice());
    with_count!(group.count, C, {
        for (to, from) in to.iter_mut().zip(data.chunks_exact(k)) {
            let from = from[group.from..].first_chunk::<C>().expect("C columns");
            let mut row = [T::default(); L];
            for c in 0..C.min(L) {
                row[c] = T::from_f64(from[c] * scale);
            }
            *to = row;
        }
    });
}

fn store_rows<T: Number, const L: usize>(
    from: &[[T; L]],
    x: &mut Columns<&mut [f64]>,
    group: Group,
    scale: f64,
) -> bool {
    let k = x.k();
    let mut check = [0.0; L];
    with_count!(group.count, C, {
        for (from, to) in from.iter().zip(x.data_mut().chunks_exact_mut(k)) {
            let to = to[group.from..].first_chunk_mut::<C>().expect("C columns");
            for c in 0..C.min(L) {
                to[c] = from[c].to_f64() * scale;
                check[c] += 0.0 * to[c]; // NaN for an infinity or a NaN, and stays in the sum
            }
        }
    });
    check.iter().all(|&sum| sum == 0.0)
}
