//! The surface of a body: the zero set of a smooth union of its parts, standing on the ground.

use super::anatomy::{Chain, Operation, Part, parts};
use super::build::Proportions;
use super::jet::{Jet, smooth_min};
use crate::vector::{Vector, add_scaled, dot, normalize};

/// Value far from every part, in metres.
const FAR: f64 = 0.2;
/// Rounding of the edge between foot and ground, in metres.
const SOLE: f64 = 0.008;

/// An implicit body.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub(super) parts: Vec<Part>,
    boxes: Vec<[Vector; 2]>,
}

impl Surface {
    pub(super) fn new(p: &Proportions) -> Self {
        let parts = parts(p);
        let boxes = parts.iter().map(reach).collect();
        Self { parts, boxes }
    }

    /// Negative inside, zero on the surface, about the distance in metres near it; y >= 0 everywhere inside.
    pub(super) fn at(&self, p: Vector) -> Jet {
        let mut solid = Jet::constant(FAR);
        for (part, _) in self.near(p) {
            let distance = part.loft.distance(p);
            solid = match part.operation {
                Operation::Join => smooth_min(solid, distance, part.blend),
                Operation::Carve => -smooth_min(-solid, distance, part.blend),
            };
        }
        let above_ground = Jet { value: p[1], gradient: [0.0, 1.0, 0.0] };
        -smooth_min(-solid, above_ground, SOLE)
    }

    fn near(&self, p: Vector) -> impl Iterator<Item = (&Part, usize)> {
        let inside = move |[low, high]: &[Vector; 2]| (0..3).all(|i| p[i] >= low[i] && p[i] <= high[i]);
        self.parts.iter().zip(0..).filter(move |&(_, i)| inside(&self.boxes[i]))
    }

    /// Index of the part whose own surface is nearest: the part that p belongs to.
    pub(super) fn owner(&self, p: Vector) -> Option<usize> {
        self.near(p)
            .filter(|(part, _)| part.operation == Operation::Join)
            .map(|(part, i)| (part.loft.distance(p).value.abs(), i))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, i)| i)
    }

    /// Smallest distance to the parts of a chain.
    pub(super) fn distance_to(&self, chain: Chain, p: Vector) -> f64 {
        let joined = |part: &&Part| part.chain == chain && part.operation == Operation::Join;
        let distances = self.parts.iter().filter(joined).map(|part| part.loft.distance(p).value);
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Unit outward normal of the level set through p.
    pub(super) fn normal(&self, p: Vector) -> Vector {
        normalize(self.at(p).gradient)
    }

    /// Wanted edge length at p relative to the trunk's: that of the parts around, the nearer the more.
    pub(super) fn detail(&self, p: Vector) -> f64 {
        const FADE: f64 = 0.03; // metres over which one part's detail gives way to another's
        let (mut sum, mut weights) = (0.0, 1e-9);
        for (part, _) in self.near(p) {
            let away = part.loft.distance(p).value.max(0.0) / FADE;
            let weight = 1.0 / (1.0 + away * away * away * away) / (part.detail * part.detail);
            sum += weight * part.detail;
            weights += weight;
        }
        if sum > 0.0 { sum / weights } else { 1.0 }
    }

    /// One or more Newton steps along the gradient onto the surface, each at most `limit` metres long.
    pub(super) fn project(&self, mut p: Vector, steps: usize, limit: f64) -> Vector {
        for _ in 0..steps {
            let f = self.at(p);
            let slope = dot(f.gradient, f.gradient);
            if slope > 1e-6 {
                let length = f.value.abs() / slope.sqrt();
                let shorten = if length > limit { limit / length } else { 1.0 };
                p = add_scaled(p, -shorten * f.value / slope, f.gradient);
            }
        }
        p
    }

    /// The box around all parts.
    pub(super) fn bounding_box(&self) -> [Vector; 2] {
        let mut hull = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for part in &self.parts {
            let (low, high) = part.loft.bounding_box();
            for i in 0..3 {
                hull[0][i] = hull[0][i].min(low[i]);
                hull[1][i] = hull[1][i].max(high[i]);
            }
        }
        hull
    }
}

/// Where a part can change the union: its box, widened by the blend and by 3 cm, so that near the surface a part
/// that is left out is farther away than its transition reaches.
fn reach(part: &Part) -> [Vector; 2] {
    let margin = part.blend + 0.03;
    let (low, high) = part.loft.bounding_box();
    [low.map(|x| x - margin), high.map(|x| x + margin)]
}
