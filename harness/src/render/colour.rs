//! What a mesh looks like: colours, colour maps, highlights.

use crate::vector::lerp;

/// 8-bit sRGB: red, green, blue.
pub type Colour = [u8; 3];

/// How the surface is coloured. Slices hold one entry per vertex.
#[derive(Clone, Copy, Debug)]
pub enum Colouring<'a> {
    /// One colour everywhere.
    Plain(Colour),
    /// A scalar through [`viridis`], from the smallest to the largest finite value or over the range given.
    Scalar {
        /// One value per vertex; grey where it is not finite.
        values: &'a [f64],
        /// The values at the two ends of the map.
        range: Option<(f64, f64)>,
    },
    /// Unit quaternions (w, x, y, z): rotation axis times sine of half the angle as red, green, blue about grey.
    Rotation(&'a [[f64; 4]]),
}

/// Everything about a picture except the mesh and the camera.
#[derive(Clone, Copy, Debug)]
pub struct Style<'a> {
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// Samples per pixel along each side (1 to 8); 3 gives smooth outlines.
    pub samples: usize,
    /// Colour where there is no surface.
    pub background: Colour,
    /// Colour of the surface.
    pub colouring: Colouring<'a>,
    /// Vertices to mark with a dot, for example constraints.
    pub marked_vertices: &'a [u32],
    /// Triangles to paint in the marking colour.
    pub marked_triangles: &'a [u32],
    /// The marking colour.
    pub mark: Colour,
    /// One normal per triangle instead of interpolated ones: shows the triangulation.
    pub flat: bool,
}

impl Default for Style<'_> {
    fn default() -> Self {
        Self {
            size: (800, 800),
            samples: 3,
            background: [255, 255, 255],
            colouring: Colouring::Plain([204, 184, 168]),
            marked_vertices: &[],
            marked_triangles: &[],
            mark: [213, 94, 0], // vermilion of the colour-blind-safe palette of Okabe and Ito
            flat: false,
        }
    }
}

/// Eleven samples, evenly spaced, of the viridis map (van der Walt and Smith 2015, released into the public domain):
/// perceptually uniform and readable with all common colour deficiencies.
const VIRIDIS: [[f64; 3]; 11] = [
    [68.0, 1.0, 84.0],
    [72.0, 36.0, 117.0],
    [65.0, 68.0, 135.0],
    [53.0, 95.0, 141.0],
    [42.0, 120.0, 142.0],
    [33.0, 145.0, 140.0],
    [34.0, 168.0, 132.0],
    [68.0, 191.0, 112.0],
    [122.0, 209.0, 81.0],
    [189.0, 223.0, 38.0],
    [253.0, 231.0, 37.0],
];

/// The viridis colour at t in [0, 1]; grey if t is NaN.
pub fn viridis(t: f64) -> Colour {
    if t.is_nan() {
        return [128; 3];
    }
    let place = t.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let from = (place as usize).min(VIRIDIS.len() - 2);
    lerp(VIRIDIS[from], VIRIDIS[from + 1], place - from as f64).map(|x| x.round() as u8)
}

impl Colouring<'_> {
    /// The colour of every vertex; missing entries of a slice are grey.
    pub(super) fn of_vertices(&self, vertices: usize) -> Vec<Colour> {
        match *self {
            Colouring::Plain(colour) => vec![colour; vertices],
            Colouring::Scalar { values, range } => {
                let (low, high) = range.unwrap_or_else(|| finite_range(values));
                // Halves first: the difference of two huge values must not overflow.
                let width = 0.5 * high - 0.5 * low;
                let place = |x: f64| if width > 0.0 { (0.5 * x - 0.5 * low) / width } else { 0.5 };
                let colour = |x: f64| viridis(if x.is_finite() { place(x) } else { f64::NAN });
                (0..vertices).map(|v| colour(values.get(v).copied().unwrap_or(f64::NAN))).collect()
            }
            Colouring::Rotation(quaternions) => {
                let channel = |x: f64| (127.5 + 127.5 * x.clamp(-1.0, 1.0)).round() as u8;
                (0..vertices)
                    .map(|v| {
                        quaternions.get(v).map_or([128; 3], |q| {
                            let sign = if q[0] < 0.0 { -1.0 } else { 1.0 }; // q and -q are one rotation
                            [q[1], q[2], q[3]].map(|x| channel(sign * x))
                        })
                    })
                    .collect()
            }
        }
    }
}

fn finite_range(values: &[f64]) -> (f64, f64) {
    let finite = values.iter().copied().filter(|x| x.is_finite());
    finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalar_colours_span_the_map_and_mark_what_is_not_finite() {
        let values = [-1e308, 0.0, 1e308, f64::NAN, f64::INFINITY];
        let colours = Colouring::Scalar { values: &values, range: None }.of_vertices(6);
        assert_eq!(colours[0], viridis(0.0));
        assert_eq!(colours[1], viridis(0.5));
        assert_eq!(colours[2], viridis(1.0));
        assert_eq!(colours[3..], [[128; 3]; 3]);
    }

    #[test]
    fn constant_field_is_the_middle_of_the_map() {
        assert_eq!(Colouring::Scalar { values: &[7.0], range: None }.of_vertices(1), [viridis(0.5)]);
    }
}
