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
    ([86.0, 86.0], [5.4, 6.0], [2.6, 2.4], [3.8, 4.2], 2.0),
    ([89.5, 89.5], [13.6, 15.0], [7.0, 6.6], [8.8, 9.2], 1.9),
    ([94.0, 94.0], [16.2, 17.6], [9.4, 8.8], [10.6, 11.0], 1.7),
    ([100.0, 100.0], [16.6, 17.4], [10.6, 9.6], [10.6, 11.0], 1.6),
    ([107.0, 107.0], [15.6, 14.4], [11.0, 9.2], [9.2, 8.4], 1.5),
    ([113.0, 113.5], [15.2, 12.6], [11.0, 8.5], [9.0, 7.8], 1.5),
    ([121.0, 121.0], [16.2, 13.4], [11.0, 8.7], [10.4, 9.0], 1.5),
    ([129.0, 129.0], [17.4, 14.4], [10.8, 8.8], [12.2, 10.8], 1.5),
    ([135.0, 135.0], [18.0, 15.2], [9.8, 8.2], [12.6, 11.2], 1.5),
    ([140.0, 140.0], [17.0, 14.8], [8.2, 7.0], [11.6, 10.4], 1.6),
    ([144.5, 144.5], [13.4, 11.6], [6.0, 5.2], [9.6, 8.6], 1.8),
    ([149.0, 149.0], [8.0, 6.8], [4.2, 3.8], [7.4, 6.6], 2.0),
];

const NECK: &[TrunkRow] = &[
    ([146.0, 146.0], [7.6, 6.0], [4.0, 3.2], [7.6, 6.4], 2.0),
    ([152.0, 152.0], [6.4, 5.0], [5.2, 4.4], [6.6, 5.6], 2.0),
    ([157.5, 157.5], [6.0, 4.8], [6.0, 5.2], [5.8, 5.0], 2.0),
    ([163.0, 163.0], [6.0, 5.0], [6.6, 6.0], [6.4, 6.0], 2.0),
];

/// Chin to forehead; the cranium is an ellipsoid of its own.
const FACE: &[TrunkRow] = &[
    ([157.9, 158.3], [3.7, 2.9], [8.5, 7.7], [1.0, 1.0], 1.8),
    ([159.9, 160.3], [5.0, 4.1], [9.3, 8.5], [2.0, 2.0], 1.7),
    ([162.8, 163.0], [6.2, 5.4], [9.3, 8.7], [4.0, 4.0], 1.7),
    ([166.5, 166.5], [6.9, 6.4], [9.1, 8.7], [6.0, 6.0], 1.8),
    ([170.4, 170.4], [7.0, 6.6], [9.7, 9.2], [7.0, 7.0], 1.9),
    ([173.0, 173.0], [6.6, 6.2], [8.8, 8.6], [7.0, 7.0], 2.0),
    ([175.5, 175.5], [5.4, 5.2], [6.8, 6.8], [6.0, 6.0], 2.0),
];

/// A ring of a limb: place along its axis (0 to 1), then centre (side, front), radii outer, inner, front, back as
/// male numbers, then the factor that makes the radii female.
type LimbRow = (f64, [f64; 6], f64);

const LEG: &[LimbRow] = &[
    (0.00, [0.0, 0.0, 7.2, 7.6, 8.3, 9.0], 1.05),
    (0.09, [0.0, 0.0, 8.1, 8.0, 9.2, 9.4], 1.06),
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
    let torso = upright(p, TORSO, -1.0, [3.0, 3.0]);
    let trapezius = capsule(
        p,
        [[2.5, 151.0, -3.5], [2.2, 151.0, -3.5]],
        [[16.0, 143.0, -3.0], [14.0, 143.0, -3.0]],
        [4.6, 3.8],
    );
    let breast = ellipsoid(p, [[8.0, 132.0, 5.0], [7.2, 129.0, 5.6]], [[8.0, 5.6, 5.4], [6.0, 6.0, 5.8]]);
    let buttock = ellipsoid(p, [[7.6, 93.0, -6.0], [7.8, 92.5, -6.2]], [[8.2, 9.0, 7.4], [8.8, 9.4, 8.0]]);
    let neck = upright(p, NECK, 0.0, [3.0, 3.0]);
    let part = |loft, detail, blend| trunk_part(loft, detail, p.one(blend));
    let mut parts = vec![part(torso, 1.0, 1.0)];
    parts.extend(both(part(trapezius, 0.9, 6.0)));
    parts.extend(both(part(breast, 0.9, 4.5)));
    parts.extend(both(part(buttock, 1.0, 4.0)));
    parts.push(part(neck, 0.8, 5.0));
    parts
}

fn head(p: &Proportions) -> Vec<Part> {
    let same = |v: Vector| [v, v];
    let cranium = ellipsoid(p, same([0.0, 170.3, -0.6]), [[7.6, 9.7, 9.8], [7.4, 9.7, 9.6]]);
    // The male knot lies inside the head.
    let knot = ellipsoid(p, [[0.0, 171.0, -4.5], [0.0, 175.0, -10.6]], [[2.8, 2.8, 2.8], [3.4, 3.4, 2.8]]);
    let eye_socket = ellipsoid(p, same([3.3, 168.8, 10.9]), same([2.0, 1.3, 1.8]));
    let nose = capsule(p, same([0.0, 169.0, 8.4]), [[0.0, 165.2, 10.0], [0.0, 165.4, 9.4]], [1.0, 1.45]);
    let mouth = ellipsoid(p, [[0.0, 162.3, 8.7], [0.0, 162.6, 8.0]], same([2.4, 1.1, 1.2]));
    let ear = ellipsoid(p, same([7.0, 168.2, -0.8]), [[1.1, 2.9, 1.8], [1.0, 2.6, 1.6]]);
    let part = |loft, detail, blend| trunk_part(loft, detail, p.one(blend));
    let mut parts = vec![
        part(cranium, 0.65, 2.0),
        part(upright(p, FACE, 2.0, [1.3, 2.0]), 0.6, 2.5),
        part(knot, 0.65, 1.5),
    ];
    parts.extend(both(Part { operation: Operation::Carve, ..part(eye_socket, 0.5, 1.6) }));
    parts.push(part(nose, 0.5, 1.4));
    parts.push(part(mouth, 0.5, 1.2));
    parts.extend(both(part(ear, 0.5, 1.2)));
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
        part(limb(p, hand, norm(sub(tips, wrist)), HAND, [1.5, 1.6]), 0.45, 1.0),
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

/// An upright ellipsoid: centre and radii (side, height, depth), male and female.
fn ellipsoid(p: &Proportions, centre: [Vector; 2], radii: [Vector; 2]) -> Loft {
    let centre = p.point(centre);
    let frame = Frame::looking(centre, add(centre, [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
    let [side, height, depth] = p.point(radii);
    let ring = Ring { along: 0.0, shape: [0.0, 0.0, side, side, depth, depth], roundness: 2.0 };
    Loft::new(frame, &[ring], [height, height])
}

/// A round part between two points (male and female) with a radius at each.
fn capsule(p: &Proportions, from: [Vector; 2], to: [Vector; 2], radii: [f64; 2]) -> Loft {
    let (from, to) = (p.point(from), p.point(to));
    let ring = |along: f64, radius: f64| {
        let r = p.one(radius);
        Ring { along, shape: [0.0, 0.0, r, r, r, r], roundness: 2.0 }
    };
    let rings = [ring(0.0, radii[0]), ring(norm(sub(to, from)), radii[1])];
    Loft::new(Frame::looking(from, to, [0.0, 0.0, 1.0]), &rings, radii.map(|r| p.one(r)))
}
