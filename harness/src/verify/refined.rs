//! A backend whose every solve is refined in twice the precision: whole workloads can be run with it for reference.

use super::reference::{Trusted, refine, second_order};
use lapsolve::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use lapsolve::columns::Columns;
use lapsolve::error::{PrepareError, SolveError};
use lapsolve::registry::Entry;
use lapsolve::system::System;

/// The first direct f64 backend of a list, with every solve refined until its residual asks for no change.
pub struct Refined {
    trusted: Trusted,
    other_order: bool,
}

impl Refined {
    /// Takes a backend for systems of `n` unknowns; with `other_order` it eliminates in another order than its own.
    ///
    /// # Errors
    /// That there is none, in words.
    pub fn choose(backends: &[Entry], n: usize, other_order: bool) -> Result<Self, String> {
        Ok(Self { trusted: Trusted::choose(backends, n)?, other_order })
    }

    /// How its answers are made, for the record.
    pub fn description(&self) -> String {
        format!("{}, refined with a double-double residual", self.trusted.id)
    }
}

impl Backend for Refined {
    fn describe(&self) -> Description {
        self.trusted.backend.describe()
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let order = self.other_order.then(|| second_order(system));
        let options = PrepareOptions { max_columns: options.max_columns, order: order.as_deref() };
        let factor = self.trusted.backend.prepare(system, &options, on)?;
        Ok(Box::new(RefinedFactor { factor, system: system.clone() }))
    }
}

struct RefinedFactor {
    factor: Box<dyn Factor>,
    system: System,
}

impl Factor for RefinedFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (solution, _) = refine(&mut *self.factor, &self.system, rhs)?;
        x.data_mut().copy_from_slice(&solution);
        Ok(Solved::default())
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.system.update_values(values)?;
        self.factor.update_values(values, on)
    }

    fn footprint(&self) -> Footprint {
        self.factor.footprint()
    }
}
