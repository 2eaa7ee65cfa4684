//! One body part as an implicit solid: rings of four radii along a straight axis, with rounded ends.

use super::jet::Jet;
use crate::vector::{Vector, cross, dot, normalize, sub};

/// Local axes of a part, perpendicular unit vectors: `side` (away from the body's midline), `along`, `front`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) origin: Vector,
    pub(super) side: Vector,
    pub(super) along: Vector,
    pub(super) front: Vector,
}

impl Frame {
    /// The frame at `from` that looks to `to`; `front` is made perpendicular to it.
    pub(super) fn looking(from: Vector, to: Vector, front: Vector) -> Self {
        let along = normalize(sub(to, from));
        let side = normalize(cross(front, along));
        Self { origin: from, side, along, front: cross(along, side) }
    }

    /// The mirror image in the plane x = 0.
    pub(super) fn mirrored(self) -> Self {
        let flip = |v: Vector| [-v[0], v[1], v[2]];
        Self {
            origin: flip(self.origin),
            side: flip(self.side),
            along: flip(self.along),
            front: flip(self.front),
        }
    }

    /// Local coordinates (side, along, front) of a point.
    pub(super) fn local(&self, p: Vector) -> Vector {
        let p = sub(p, self.origin);
        [dot(p, self.side), dot(p, self.along), dot(p, self.front)]
    }

    /// The point with these local coordinates.
    pub(super) fn world(&self, [side, along, front]: Vector) -> Vector {
        std::array::from_fn(|i| {
            self.origin[i] + side * self.side[i] + along * self.along[i] + front * self.front[i]
        })
    }
}

/// Cross-section of a part at one place of its axis, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    /// Place on the axis.
    pub(super) along: f64,
    /// Centre (side, front), then the radii towards outside, inside, front and back.
    pub(super) shape: [f64; 6],
    /// 2 is an ellipse, 0 a rounded rectangle (x^4 + z^4 = 1).
    pub(super) roundness: f64,
}

const QUANTITIES: usize = 7;

/// Cubic Hermite piece between two rings: quantity q at u = along - start is c0 + u (c1 + u (c2 + u c3)).
#[derive(Clone, Debug)]
struct Piece {
    start: f64,
    coefficients: [[f64; 4]; QUANTITIES],
}

/// A part: rings interpolated by cubics along the axis, closed by half ellipsoids at both ends.
#[derive(Clone, Debug)]
pub(super) struct Loft {
    pub(super) frame: Frame,
    pieces: Vec<Piece>,
    start: f64,
    end: f64,
    caps: [f64; 2],
}

impl Loft {
    /// At least one ring, ascending along the axis; `caps` are the lengths of the rounded ends. One ring is an
    /// ellipsoid, two are a capsule.
    pub(super) fn new(frame: Frame, rings: &[Ring], caps: [f64; 2]) -> Self {
        let pieces = if rings.len() == 1 { vec![constant(&rings[0])] } else { hermite(rings) };
        Self { frame, pieces, start: rings[0].along, end: rings[rings.len() - 1].along, caps }
    }

    pub(super) fn mirrored(&self) -> Self {
        Self { frame: self.frame.mirrored(), ..self.clone() }
    }

    /// Distance from the surface along the ray from the axis, negative inside. It is never less than the true
    /// distance outside, has the same sign, and is exact for a round part.
    pub(super) fn distance(&self, p: Vector) -> Jet {
        let frame = &self.frame;
        let [side, along, front] = frame.local(p);
        let along = Jet { value: along, gradient: frame.along };
        let [c_side, c_front, outer, inner, ahead, behind, round] = self.shape_at(along);
        let x = Jet { value: side, gradient: frame.side } - c_side;
        let z = Jet { value: front, gradient: frame.front } - c_front;
        let u = (x * if x.value > 0.0 { outer } else { inner }.reciprocal()).square();
        let v = (z * if z.value > 0.0 { ahead } else { behind }.reciprocal()).square();
        let mut ratio = (u.square() + v.square() + round * u * v).sqrt(); // squares of radius over ring radius
        let mut radius = x.square() + z.square();
        if let Some((over, cap)) = self.overshoot(along) {
            ratio = ratio + over.square() * Jet::constant(1.0 / (cap * cap));
            radius = radius + over.square();
        }
        let (ratio, radius) = (ratio.sqrt(), radius.sqrt());
        if ratio.value < 1e-9 {
            return Jet::constant(-outer.value); // on the axis, where no ray is defined
        }
        radius - radius * ratio.reciprocal()
    }

    /// How far beyond the first or last ring, with the length of the cap there.
    fn overshoot(&self, along: Jet) -> Option<(Jet, f64)> {
        if along.value < self.start {
            Some((along - Jet::constant(self.start), self.caps[0]))
        } else if along.value > self.end {
            Some((along - Jet::constant(self.end), self.caps[1]))
        } else {
            None
        }
    }

    fn shape_at(&self, along: Jet) -> [Jet; QUANTITIES] {
        let inside = along.value.clamp(self.start, self.end);
        let moves = inside == along.value;
        let piece = self.pieces.iter().rev().find(|p| inside >= p.start).unwrap_or(&self.pieces[0]);
        let u = inside - piece.start;
        let mut shape = [Jet::constant(0.0); QUANTITIES];
        for (quantity, &[a, b, c, d]) in shape.iter_mut().zip(&piece.coefficients) {
            let slope = if moves { b + u * (2.0 * c + u * 3.0 * d) } else { 0.0 };
            *quantity = along.chain(a + u * (b + u * (c + u * d)), slope);
        }
        shape
    }

    /// (place along the axis, side, front) of a point, the last two relative to the ring's centre and radii: the
    /// same three numbers name the same anatomical place in the corresponding part of another build.
    pub(super) fn anatomical(&self, p: Vector) -> Vector {
        let [side, along, front] = self.frame.local(p);
        let shape = self.shape_at(Jet::constant(along)).map(|q| q.value);
        let [x, z] = [side - shape[0], front - shape[1]];
        let length = (self.end - self.start).max(self.caps[0] + self.caps[1]);
        [
            (along - self.start) / length,
            x / if x > 0.0 { shape[2] } else { shape[3] },
            z / if z > 0.0 { shape[4] } else { shape[5] },
        ]
    }

    /// The inverse of [`Self::anatomical`].
    pub(super) fn place(&self, [t, x, z]: Vector) -> Vector {
        let length = (self.end - self.start).max(self.caps[0] + self.caps[1]);
        let along = self.start + t * length;
        let shape = self.shape_at(Jet::constant(along)).map(|q| q.value);
        let side = shape[0] + x * if x > 0.0 { shape[2] } else { shape[3] };
        let front = shape[1] + z * if z > 0.0 { shape[4] } else { shape[5] };
        self.frame.world([side, along, front])
    }

    /// A box that contains the part: the axis-aligned hull of its local box with the largest radii.
    pub(super) fn bounding_box(&self) -> (Vector, Vector) {
        let mut local = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let steps = 8 * self.pieces.len();
        for i in 0..=steps {
            let along = self.start + (self.end - self.start) * i as f64 / steps as f64;
            let s = self.shape_at(Jet::constant(along)).map(|q| q.value);
            let low = [s[0] - s[3], along - self.caps[0], s[1] - s[5]];
            let high = [s[0] + s[2], along + self.caps[1], s[1] + s[4]];
            for axis in 0..3 {
                local[0][axis] = local[0][axis].min(low[axis]);
                local[1][axis] = local[1][axis].max(high[axis]);
            }
        }
        let mut bounds = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let p = self.frame.world(std::array::from_fn(|axis| local[corner >> axis & 1][axis]));
            for axis in 0..3 {
                bounds.0[axis] = bounds.0[axis].min(p[axis]);
                bounds.1[axis] = bounds.1[axis].max(p[axis]);
            }
        }
        bounds
    }
}

fn quantities(ring: &Ring) -> [f64; QUANTITIES] {
    let s = ring.shape;
    [s[0], s[1], s[2], s[3], s[4], s[5], ring.roundness]
}

fn constant(ring: &Ring) -> Piece {
    Piece { start: ring.along, coefficients: quantities(ring).map(|q| [q, 0.0, 0.0, 0.0]) }
}

/// Cubic Hermite pieces through the rings. Slopes inside are those of the chord between the neighbours; at both
/// ends they are zero, so that the caps join without a crease.
fn hermite(rings: &[Ring]) -> Vec<Piece> {
    let last = rings.len() - 1;
    let slope = |i: usize, q: usize| {
        if i == 0 || i == last {
            return 0.0;
        }
        let (before, after) = (&rings[i - 1], &rings[i + 1]);
        (quantities(after)[q] - quantities(before)[q]) / (after.along - before.along)
    };
    (0..last)
        .map(|i| {
            let h = rings[i + 1].along - rings[i].along;
            let coefficients = std::array::from_fn(|q| {
                let (from, to) = (quantities(&rings[i])[q], quantities(&rings[i + 1])[q]);
                let (a, b, chord) = (slope(i, q), slope(i + 1, q), (to - from) / h);
                [from, a, (3.0 * chord - 2.0 * a - b) / h, (a + b - 2.0 * chord) / (h * h)]
            });
            Piece { start: rings[i].along, coefficients }
        })
        .collect()
}
