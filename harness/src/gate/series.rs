//! The differences of one cell, couple by couple.

use super::couple::{Couple, Side};

/// What the couples of a cell gave, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// ln(head / base) of each couple.
    pub differences: Vec<f64>,
    /// The same of the control kernel.
    pub control: Vec<f64>,
    /// Couples that other processes disturbed.
    pub contended: Vec<bool>,
}

impl Series {
    /// The series of `measure` between two sides over `couples`; those without both sides are left out.
    pub fn of(couples: &[Couple], over: Side, under: Side, measure: usize) -> Self {
        let mut series = Self::default();
        for couple in couples {
            let both = couple.difference(over, under, measure).zip(couple.control(over, under));
            if let Some((difference, control)) = both {
                series.differences.push(difference);
                series.control.push(control);
                series.contended.push(couple.contended);
            }
        }
        series
    }

    /// The first `couples` of them: what a look sees.
    pub fn first(&self, couples: usize) -> Self {
        Self {
            differences: self.differences[..couples].to_vec(),
            control: self.control[..couples].to_vec(),
            contended: self.contended[..couples].to_vec(),
        }
    }
}
