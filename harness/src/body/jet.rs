//! Forward-mode derivatives: a value together with its gradient in space.

use crate::vector::{Vector, add, add_scaled, scale, sub};
use std::ops::{Add, Mul, Neg, Sub};

/// A function value and its gradient with respect to the point in space, to first order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet {
    pub(super) value: f64,
    pub(super) gradient: Vector,
}

impl Jet {
    pub(super) fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; 3] }
    }

    /// h(self), given the value and the derivative of h at self.value.
    pub(super) fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, gradient: scale(derivative, self.gradient) }
    }

    pub(super) fn square(self) -> Self {
        self.chain(self.value * self.value, 2.0 * self.value)
    }

    /// Square root; the gradient is zero where the value is.
    pub(super) fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }

    pub(super) fn reciprocal(self) -> Self {
        let inverse = 1.0 / self.value;
        self.chain(inverse, -inverse * inverse)
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, gradient: add(self.gradient, other.gradient) }
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, gradient: sub(self.gradient, other.gradient) }
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let gradient = add_scaled(scale(other.value, self.gradient), self.value, other.gradient);
        Self { value: self.value * other.value, gradient }
    }
}

impl Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

/// Smooth minimum of a and b: exactly min(a, b) where they differ by `width` or more, twice continuously
/// differentiable, below min(a, b) by at most width / 6.
pub(super) fn smooth_min(a: Jet, b: Jet, width: f64) -> Jet {
    let difference = a.value - b.value;
    let (low, sign) = if difference < 0.0 { (a, 1.0) } else { (b, -1.0) };
    let overlap = 1.0 - difference.abs() / width;
    if overlap <= 0.0 {
        return low;
    }
    let cubic = overlap * overlap * overlap;
    // d/d(difference) of -width/6 overlap^3 is overlap^2/2 with the sign that raises the nearer one's share.
    let slope = 0.5 * overlap * overlap * sign;
    let gradient = add_scaled(low.gradient, -slope, sub(a.gradient, b.gradient));
    Jet { value: low.value - width / 6.0 * cubic, gradient }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_min_has_the_gradient_of_its_own_values() {
        let at = |x: f64| {
            let a = Jet { value: x * x, gradient: [2.0 * x, 0.0, 0.0] };
            let b = Jet { value: 1.0 - x, gradient: [-1.0, 0.0, 0.0] };
            smooth_min(a, b, 0.5)
        };
        for i in 0..100 {
            let (x, h) = (0.01 * f64::from(i), 1e-6);
            let slope = (at(x + h).value - at(x - h).value) / (2.0 * h);
            assert!((at(x).gradient[0] - slope).abs() < 1e-8, "at x = {x}");
        }
    }
}
