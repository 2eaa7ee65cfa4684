//! The shape of one triangle: cotangents, area, and when it counts as having none.

use crate::range::times_power_of_two;
use crate::vector::{Vector, cross, dot, norm, sub};

/// A triangle counts as zero-area where 2 area <= this x (longest edge)^2, that is where its height is below 1e-8 of its
/// longest edge. Its cotangents exceed 1e8, which would leave fewer than eight of sixteen digits to its neighbours.
pub const ZERO_AREA: f64 = 1e-8;

/// What assembly needs to know of a triangle that has an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// (cot a_c) / 2 for the angle at each corner c.
    pub half_cotangents: [f64; 3],
    /// Twice the area.
    pub double_area: f64,
}

/// Shape of the triangle with these corners; `None` where it has zero area ([`ZERO_AREA`]) or a coordinate is not finite.
///
/// cot a_c = (u . v) / |u x v| with u, v the edges leaving corner c. The denominator is the same for all corners; it is
/// taken from the two shorter edges, which loses the fewest digits in a needle.
#[inline(always)]
pub fn shape(p: [Vector; 3]) -> Option<Shape> {
    // Edge c runs opposite to corner c, all in one direction of rotation.
    let edges = [sub(p[2], p[1]), sub(p[0], p[2]), sub(p[1], p[0])];
    let squared = [dot(edges[0], edges[0]), dot(edges[1], edges[1]), dot(edges[2], edges[2])];
    let first_is_longest = squared[0] >= squared[1] && squared[0] >= squared[2];
    let (u, v, longest) = if first_is_longest {
        (edges[1], edges[2], squared[0])
    } else if squared[1] >= squared[2] {
        (edges[2], edges[0], squared[1])
    } else {
        (edges[0], edges[1], squared[2])
    };
    if !(1e-140..1e140).contains(&longest) {
        return shape_out_of_range(p); // its square is not safely a number
    }
    let double_area = norm(cross(u, v));
    if !(double_area > ZERO_AREA * longest) {
        return None; // or it is NaN
    }
    let factor = -0.5 / double_area; // minus: the edges run round, u . v needs them both leaving the corner
    let half_cotangents = [
        factor * dot(edges[1], edges[2]),
        factor * dot(edges[2], edges[0]),
        factor * dot(edges[0], edges[1]),
    ];
    Some(Shape { half_cotangents, double_area })
}

/// The same for a triangle scaled by the power of two that makes its longest edge about 1.
#[cold]
fn shape_out_of_range(p: [Vector; 3]) -> Option<Shape> {
    // Halved first, so that the difference of two huge coordinates is finite.
    let half = p.map(|q| q.map(|x| 0.5 * x));
    let edges = [sub(half[2], half[1]), sub(half[0], half[2])];
    let largest = edges.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if largest == 0.0 || !p.as_flattened().iter().all(|x| x.is_finite()) {
        return None; // scaling helps neither
    }
    let exponent = -(largest.log2().floor() as i32) - 1;
    let scaled = shape(p.map(|q| q.map(|x| times_power_of_two(x, exponent))))?;
    Some(Shape { double_area: times_power_of_two(scaled.double_area, -2 * exponent), ..scaled })
}

/// Half cotangents and double area from the edge lengths, `lengths[c]` opposite to corner c: Heron's formula in Kahan's
/// order, stable for needles. The triangle inequality must hold.
pub fn shape_from_lengths(lengths: [f64; 3]) -> Shape {
    let mut sorted = lengths;
    sorted.sort_by(|a, b| b.total_cmp(a));
    let [a, b, c] = sorted;
    let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    let double_area = 0.5 * product.max(0.0).sqrt();
    let [l0, l1, l2] = lengths;
    // 2 u . v = (l1 - l0)(l1 + l0) + l2^2 keeps the digits that l1^2 - l0^2 would lose.
    let half = |opposite: f64, x: f64, y: f64| 0.25 * ((x - opposite) * (x + opposite) + y * y) / double_area;
    Shape { half_cotangents: [half(l0, l1, l2), half(l1, l2, l0), half(l2, l0, l1)], double_area }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_isosceles_triangle() {
        let shape = shape([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]).expect("has an area");
        assert_eq!(shape.double_area, 4.0);
        assert_eq!(shape.half_cotangents, [0.0, 0.5, 0.5]);
    }

    #[test]
    fn zero_area_means_a_height_below_1e_8_of_the_longest_edge() {
        for size in [1.0, 1e-300, 1e300] {
            let with_height =
                |h: f64| shape([[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.5 * size, h * size, 0.0]]);
            assert_eq!(with_height(0.99e-8), None);
            assert!(with_height(1.01e-8).is_some());
            assert_eq!(shape([[size; 3]; 3]), None);
        }
    }

    #[test]
    fn a_triangle_at_no_finite_place_has_no_shape() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for at in 0..9 {
                let mut corners = [[0.1, 0.2, 0.3], [1.4, -0.2, 0.5], [0.6, 1.1, -0.4]];
                corners.as_flattened_mut()[at] = bad;
                assert_eq!(shape(corners), None, "{corners:?}");
            }
        }
    }

    #[test]
    fn size_changes_no_bit_of_the_cotangents() {
        let p = [[0.1, 0.2, 0.3], [1.4, -0.2, 0.5], [0.6, 1.1, -0.4]];
        let reference = shape(p).expect("has an area");
        for exponent in [-1000, -400, 400, 1020] {
            let scaled = shape(p.map(|q| q.map(|x| times_power_of_two(x, exponent)))).expect("has an area");
            assert_eq!(scaled.half_cotangents, reference.half_cotangents, "2^{exponent}");
        }
        let s = 2f64.powi(400);
        assert_eq!(
            shape(p.map(|q| q.map(|x| x * s))).map(|r| r.double_area),
            Some(reference.double_area * s * s)
        );
    }

    #[test]
    fn needle_keeps_its_digits_far_from_the_origin_of_its_edges() {
        // Apex angle 1e-7: the cross product of the two long edges would lose seven digits.
        let h = 1e7;
        let shape = shape([[h, 0.3, 0.7], [0.0, -0.2, 0.7], [0.0, 0.8, 0.7]]).expect("has an area");
        assert!((shape.double_area / h - 1.0).abs() < 4.0 * f64::EPSILON);
        let exact = 0.5 * (h * h - 0.25) / h;
        assert!((shape.half_cotangents[0] / exact - 1.0).abs() < 8.0 * f64::EPSILON);
    }

    #[test]
    fn lengths_give_the_same_shape() {
        let p = [[0.1, 0.2, 0.3], [1.4, -0.2, 0.5], [0.6, 1.1, -0.4]];
        let by_points = shape(p).expect("has an area");
        let lengths = [norm(sub(p[2], p[1])), norm(sub(p[0], p[2])), norm(sub(p[1], p[0]))];
        let by_lengths = shape_from_lengths(lengths);
        assert!((by_points.double_area - by_lengths.double_area).abs() < 1e-14);
        for c in 0..3 {
            assert!((by_points.half_cotangents[c] - by_lengths.half_cotangents[c]).abs() < 1e-14);
        }
    }
}
