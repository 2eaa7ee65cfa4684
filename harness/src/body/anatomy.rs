//! The parts of a body: their rings in centimetres of a body 180 cm tall, male and female numbers side by side.
//!
//! The measures are ours, set by eye against the usual anthropometric breadths and girths of adults.

use super::build::Proportions;
use super::loft::{Frame, Loft, Ring};
use super::skeleton::Joints;
use crate::vector::{Vector, add, norm, sub};

/// How a part changes the solid made so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Operation {
    /// Union.
    Join,
    /// Subtraction.
    Carve,
}

/// Which chain of bones a part follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Chain {
    Trunk,
    LeftArm,
    RightArm,
    LeftLeg,
    RightLeg,
}

/// One solid of the union.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) loft: Loft,
    pub(super) operation: Operation,
    /// Width of the smooth transition to the parts before it, in metres.
    pub(super) blend: f64,
    pub(super) chain: Chain,
    /// Edge length of the mesh here relative to the trunk's.
    pub(super) detail: f64,
}

type Pair = [f64; 2];

/// A ring: along, half width, front radius, back radius, each male and female; then roundness.
type TrunkRow = (Pair, Pair, Pair, Pair, f64);

/// Along = height above the ground. Front and back are measured from the plane z = 0.
const TORSO: &[TrunkRow] = &[
    ([83.5, 83.0], [5.0, 5.5], [3.4, 3.4], [4.6, 5.0], 2.0),
    ([88.0, 88.0], [13.0, 14.0], [7.2, 7.0], [8.4, 9.0], 1.8),
    ([94.0, 94.0], [17.4, 18.8], [9.8, 9.4], [11.0, 11.6], 1.6),
    ([100.0, 100.0], [17.2, 18.0], [10.8, 10.0], [11.0, 11.5], 1.5),
    ([107.0, 107.0], [15.8, 14.8], [11.0, 9.4], [9.2, 8.4], 1.4),
    ([113.0, 113.5], [15.3, 12.8], [11.0, 8.6], [9.0, 7.8], 1.4),
    ([121.0, 121.0], [16.3, 13.6], [11.2, 8.8], [10.4, 9.0], 1.4),
    ([129.0, 129.0], [17.6, 14.8], [11.4, 9.2], [12.2, 10.8], 1.3),
    ([136.0, 136.0], [18.2, 15.6], [10.6, 8.8], [12.6, 11.2], 1.3),
    ([141.5, 141.5], [17.6, 15.4], [8.6, 7.4], [11.6, 10.4], 1.5),
    ([146.0, 146.0], [14.6, 12.6], [6.2, 5.4], [9.6, 8.6], 1.8),
    ([149.5, 149.5], [9.0, 7.6], [4.4, 4.0], [7.4, 6.6], 2.0),
];

const NECK: &[TrunkRow] = &[
    ([146.0, 146.0], [7.6, 6.0], [4.0, 3.2], [7.6, 6.4], 2.0),
    ([152.0, 152.0], [6.4, 5.0], [5.2, 4.4], [6.6, 5.6], 2.0),
    ([157.5, 157.5], [6.0, 4.8], [6.0, 5.2], [5.8, 5.0], 2.0),
    ([163.0, 163.0], [6.0, 5.0], [6.6, 6.0], [6.4, 6.0], 2.0),
];

/// Chin to forehead; the cranium is an ellipsoid of its own.
const FACE: &[TrunkRow] = &[
    ([157.6, 158.0], [3.0, 2.4], [9.4, 8.6], [0.0, 0.0], 1.8),
    ([159.8, 160.0], [4.6, 3.8], [9.9, 9.2], [2.0, 2.0], 1.8),
    ([163.0, 163.0], [6.1, 5.4], [9.6, 9.0], [4.0, 4.0], 1.9),
    ([167.0, 167.0], [6.8, 6.3], [9.4, 9.0], [6.0, 6.0], 1.9),
    ([170.5, 170.5], [7.1, 6.7], [9.6, 9.3], [7.0, 7.0], 1.9),
    ([174.0, 174.0], [6.6, 6.4], [9.2, 9.2], [7.0, 7.0], 2.0),
];

/// A ring of a limb: place along its axis (0 to 1), then centre (side, front), radii outer, inner, front, back as
/// male numbers, then the factor that makes the radii female.
type LimbRow = (f64, [f64; 6], f64);

const LEG: &[LimbRow] = &[
    (0.00, [0.0, 0.0, 8.4, 8.0, 9.2, 10.0], 1.05),
    (0.08, [0.0, 0.0, 8.8, 8.2, 9.6, 9.8], 1.06),
    (0.20, [0.0, 0.0, 8.6, 7.8, 9.8, 8.4], 1.02),
    (0.34, [0.0, 0.0, 7.4, 6.8, 8.8, 7.4], 0.97),
    (0.44, [0.0, 0.0, 6.1, 5.9, 7.2, 6.4], 0.94),
    (0.50, [0.0, 0.4, 5.5, 5.5, 6.0, 5.8], 0.93),
    (0.56, [0.0, 0.0, 5.2, 5.2, 5.4, 5.9], 0.93),
    (0.66, [0.2, -0.6, 5.4, 5.5, 5.0, 6.6], 0.92),
    (0.74, [0.2, -0.8, 5.0, 5.1, 4.8, 6.2], 0.91),
    (0.86, [0.0, -0.6, 3.7, 3.8, 4.2, 4.4], 0.90),
    (0.94, [0.0, -0.2, 3.3, 3.5, 3.8, 4.0], 0.90),
    (1.00, [0.0, 0.0, 3.3, 3.4, 3.8, 4.2], 0.90),
];

const ARM: &[LimbRow] = &[
    (0.00, [0.0, 0.0, 5.4, 5.4, 6.2, 6.2], 0.82),
    (0.14, [0.2, 0.0, 6.0, 5.2, 6.2, 6.0], 0.80),
    (0.28, [0.2, 0.3, 5.0, 4.7, 5.6, 5.2], 0.80),
    (0.42, [0.0, 0.4, 4.3, 4.3, 5.2, 4.6], 0.80),
    (0.52, [0.0, 0.2, 3.9, 3.9, 4.2, 4.2], 0.82),
    (0.58, [0.0, 0.2, 4.0, 3.8, 4.2, 4.3], 0.82),
    (0.67, [0.1, 0.2, 4.2, 3.8, 4.6, 4.4], 0.82),
    (0.80, [0.0, 0.1, 3.4, 3.1, 4.0, 3.7], 0.82),
    (0.92, [0.0, 0.0, 2.5, 2.2, 3.1, 3.0], 0.86),
    (1.00, [0.0, 0.0, 2.1, 1.9, 2.9, 2.9], 0.88),
];

/// Palm and closed fingers: thickness towards `side`, breadth towards `front`.
const HAND: &[LimbRow] = &[
    (0.00, [0.0, 0.0, 2.0, 1.8, 2.8, 2.8], 0.90),
    (0.16, [0.0, 0.0, 1.9, 1.8, 3.7, 3.5], 0.90),
    (0.42, [0.0, 0.0, 1.7, 1.7, 4.4, 4.1], 0.90),
    (0.54, [0.0, 0.0, 1.5, 1.5, 4.3, 4.0], 0.90),
    (0.74, [-0.4, 0.0, 1.3, 1.3, 3.9, 3.6], 0.92),
    (0.92, [-0.9, 0.2, 1.1, 1.1, 3.1, 2.9], 0.95),
];

/// Heel to toes; `front` is up.
const FOOT: &[LimbRow] = &[
    (0.00, [0.0, 3.0, 2.6, 2.6, 2.6, 3.4], 0.90),
    (0.14, [0.0, 3.4, 3.3, 3.3, 4.4, 4.2], 0.90),
    (0.32, [0.0, 3.4, 3.5, 3.5, 5.2, 4.2], 0.90),
    (0.50, [0.2, 2.8, 4.1, 4.0, 3.6, 3.6], 0.90),
    (0.72, [0.3, 2.0, 4.9, 4.7, 2.2, 2.8], 0.90),
    (0.88, [0.0, 1.4, 4.6, 4.4, 1.4, 2.2], 0.90),
    (1.00, [-0.6, 1.2, 3.4, 3.4, 1.1, 2.0], 0.90),
];

/// All parts of a body, in the order in which they are joined.
pub(super) fn parts(p: &Proportions) -> Vec<Part> {
    let joints = Joints::new(p);
    [trunk(p), head(p), arms(p, &joints), legs(p, &joints)].concat()
}

fn trunk(p: &Proportions) -> Vec<Part> {
    let shoulder = p.of([17.0, 15.0]) / p.one(1.0);
    let trapezius = capsule(p, [2.5, 150.0, -3.5], [shoulder, 145.0, -2.8], [5.2, 4.6]);
    let buttock = ellipsoid(p, [7.8, 93.0, -6.5], [8.6, 9.0, 7.6]);
    let mut parts = vec![trunk_part(upright(p, TORSO, -1.0, [5.0, 3.0]), 1.0, p.one(1.0))];
    parts.extend(both(trunk_part(trapezius, 0.9, p.one(6.0))));
    parts.extend(both(trunk_part(buttock, 1.0, p.one(4.0))));
    parts.push(trunk_part(upright(p, NECK, 0.0, [3.0, 3.0]), 0.8, p.one(5.0)));
    parts
}

fn head(p: &Proportions) -> Vec<Part> {
    let cranium = ellipsoid(p, [0.0, 170.3, -0.6], [7.6, 9.7, 9.8]);
    let eye_socket = ellipsoid(p, [3.2, 169.0, 10.8], [2.0, 1.2, 1.6]);
    let nose = capsule(p, [0.0, 169.0, 8.4], [0.0, 165.2, 10.0], [1.0, 1.5]);
    let ear = ellipsoid(p, [7.0, 168.2, -0.8], [1.2, 2.9, 1.7]);
    let mut parts = vec![
        trunk_part(cranium, 0.65, p.one(2.0)),
        trunk_part(upright(p, FACE, 2.0, [1.2, 3.0]), 0.6, p.one(2.5)),
    ];
    parts.extend(both(Part { operation: Operation::Carve, ..trunk_part(eye_socket, 0.5, p.one(1.4)) }));
    parts.push(trunk_part(nose, 0.5, p.one(1.2)));
    parts.extend(both(trunk_part(ear, 0.5, p.one(1.2))));
    parts
}

fn arms(p: &Proportions, joints: &Joints) -> Vec<Part> {
    let [_, shoulder, _, wrist, tips] = joints.arm;
    let front = [0.0, 0.0, 1.0];
    let (arm, hand) = (Frame::looking(shoulder, wrist, front), Frame::looking(wrist, tips, front));
    let part = |loft, detail, blend| {
        both(Part { loft, operation: Operation::Join, blend: p.one(blend), chain: Chain::LeftArm, detail })
    };
    [
        part(limb(p, arm, norm(sub(wrist, shoulder)), ARM, [5.0, 1.5]), 0.8, 8.0),
        part(limb(p, hand, norm(sub(tips, wrist)), HAND, [1.5, 1.6]), 0.5, 1.0),
        part(thumb(p, &hand), 0.5, 1.2),
    ]
    .concat()
}

fn legs(p: &Proportions, joints: &Joints) -> Vec<Part> {
    let [hip, _, ankle, toes] = joints.leg;
    let leg = Frame::looking(hip, ankle, [0.0, 0.0, 1.0]);
    let heel = [ankle[0] - p.one(0.9), 0.0, p.one(-6.3)];
    let foot = Frame::looking(heel, [toes[0], 0.0, toes[2]], [0.0, 1.0, 0.0]);
    let part = |loft, detail, blend| {
        both(Part { loft, operation: Operation::Join, blend: p.one(blend), chain: Chain::LeftLeg, detail })
    };
    [
        part(limb(p, leg, norm(sub(ankle, hip)), LEG, [7.0, 3.5]), 0.9, 6.0),
        part(limb(p, foot, p.of([22.6, 21.6]), FOOT, [2.2, 1.6]), 0.65, 3.5),
    ]
    .concat()
}

/// A left part and its mirror image.
fn both(part: Part) -> [Part; 2] {
    let chain = match part.chain {
        Chain::LeftArm => Chain::RightArm,
        Chain::LeftLeg => Chain::RightLeg,
        other => other,
    };
    let mirrored = Part { loft: part.loft.mirrored(), chain, ..part.clone() };
    [part, mirrored]
}

fn trunk_part(loft: Loft, detail: f64, blend: f64) -> Part {
    Part { loft, operation: Operation::Join, blend, chain: Chain::Trunk, detail }
}

/// A part along the y axis; `lean` is the z (cm) of its axis, the rows measure front and back from z = 0.
fn upright(p: &Proportions, rows: &[TrunkRow], lean: f64, caps: [f64; 2]) -> Loft {
    let frame = Frame::looking([0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let lean = p.one(lean);
    let rings: Vec<Ring> = rows
        .iter()
        .map(|&(along, width, front, back, roundness)| {
            let width = p.of(width);
            let shape = [0.0, lean, width, width, p.of(front) - lean, p.of(back) + lean];
            Ring { along: p.of(along), shape, roundness }
        })
        .collect();
    Loft::new(frame, &rings, caps.map(|c| p.one(c)))
}

/// From the root of the palm forwards and down.
fn thumb(p: &Proportions, hand: &Frame) -> Loft {
    let from = hand.world([p.one(-0.4), p.one(4.0), p.one(2.4)]);
    let to = hand.world([p.one(-1.6), p.one(9.0), p.one(5.9)]);
    let radii = [p.of([1.6, 1.4]), p.of([1.15, 1.05])];
    let ring = |along: f64, r: f64| Ring { along, shape: [0.0, 0.0, r, r, r, r], roundness: 2.0 };
    let rings = [ring(0.0, radii[0]), ring(norm(sub(to, from)), radii[1])];
    Loft::new(Frame::looking(from, to, hand.front), &rings, radii)
}

fn limb(p: &Proportions, frame: Frame, length: f64, rows: &[LimbRow], caps: [f64; 2]) -> Loft {
    let rings: Vec<Ring> = rows
        .iter()
        .map(|&(t, male, female)| Ring {
            along: t * length,
            shape: male.map(|radius| p.of([radius, female * radius])),
            roundness: 2.0,
        })
        .collect();
    Loft::new(frame, &rings, caps.map(|c| p.of([c, 0.9 * c])))
}

/// An upright ellipsoid: centre and radii (side, height, depth).
fn ellipsoid(p: &Proportions, centre: Vector, [side, height, depth]: Vector) -> Loft {
    let centre = centre.map(|c| p.one(c));
    let frame = Frame::looking(centre, add(centre, [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
    let [side, height, depth] = [side, height, depth].map(|r| p.one(r));
    let ring = Ring { along: 0.0, shape: [0.0, 0.0, side, side, depth, depth], roundness: 2.0 };
    Loft::new(frame, &[ring], [height, height])
}

/// A round part between two points with a radius at each.
fn capsule(p: &Proportions, from: Vector, to: Vector, radii: [f64; 2]) -> Loft {
    let (from, to) = (from.map(|c| p.one(c)), to.map(|c| p.one(c)));
    let ring = |along: f64, radius: f64| {
        let r = p.one(radius);
        Ring { along, shape: [0.0, 0.0, r, r, r, r], roundness: 2.0 }
    };
    let rings = [ring(0.0, radii[0]), ring(norm(sub(to, from)), radii[1])];
    Loft::new(Frame::looking(from, to, [0.0, 0.0, 1.0]), &rings, radii.map(|r| p.one(r)))
}
