//! A skeleton motion's joints placed inside a figure.
//!
//! Limbs get their joints on the middle line of the mesh's own limbs, at the shares of the body height that anthropometry
//! gives (Drillis and Contini 1966), so that the proportions of whoever was captured do not matter; the trunk is placed
//! between hips, shoulders and crown. What carries over from the motion is the directions of bones, not their lengths.

use super::body_frame::BodyFrame;
use super::clip::Clip;
use super::limbs::{Figure, Tip};
use super::names::{self, Side};
use lapsolve::rotation::{IDENTITY, Quaternion, normalised, product, rotate};
use lapsolve::vector::{Vector, add, cross, distance_squared, dot, norm, scale, sub};
use lapsolve::workload::transfer::alignment::Similarity;
use thiserror::Error;

/// Shares of the body height from the finger tips to wrist, elbow and shoulder.
const ARM: [f64; 3] = [0.106, 0.248, 0.41];
/// Shares of the body height from the toes to ankle, knee and hip.
const LEG: [f64; 3] = [0.13, 0.366, 0.63];

/// Why a skeleton cannot be placed by itself.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FitError {
    /// A limb of the skeleton is not there.
    #[error("the motion's skeleton has no {0}")]
    NoLimb(&'static str),
    /// A limb of the mesh has no middle.
    #[error("the mesh's {0} could not be followed")]
    NoMiddle(&'static str),
}

/// A skeleton inside a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Where every joint is.
    pub joints: Vec<Vector>,
    /// Where the bones of joints end that carry no joint.
    pub ends: Vec<Option<Vector>>,
    /// From the axes of the motion to those of the mesh.
    pub axes: Quaternion,
    /// Units of the mesh in one unit of the motion.
    pub scale: f64,
    /// For every joint the rotation from the motion's bones, when nothing turns, to those in the mesh.
    pub alignments: Vec<Quaternion>,
    /// Up in the mesh.
    pub up: Vector,
}

impl Fitted {
    /// Places the joints of `clip` in `figure`.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn in_figure(clip: &Clip, figure: &Figure) -> Result<Self, FitError> {
        let skeleton = Skeleton::of(clip);
        let limbs = skeleton.limbs(clip)?;
        let axes = skeleton.frame.rotation_to(&figure.frame);
        let scale = figure.height / skeleton.height;
        let mut joints: Vec<Option<Vector>> = vec![None; clip.joints.len()];
        let mut ends = vec![None; clip.joints.len()];
        let mut roots = [[0.0; 3]; 4];
        for ((limb, root), (tip, shares)) in limbs.iter().zip(&mut roots).zip(LIMBS) {
            let places = limb.in_mesh(figure, tip, shares)?;
            *root = places[0];
            limb.place(&places, &mut joints, &mut ends);
        }
        let trunk = Trunk::new(&skeleton, &limbs, figure, &roots, axes, scale);
        for j in 0..joints.len() {
            if joints[j].is_none() && skeleton.is_trunk(clip, j, &limbs) {
                joints[j] = Some(trunk.place(skeleton.rest[j]));
                ends[j] = skeleton.ends[j].map(|end| trunk.place(end));
            }
        }
        Ok(Self::complete(clip, &skeleton, joints, ends, axes, scale, figure.frame.up))
    }

    /// Joints whose places are all known; `up` is the axis of the mesh that points up.
    pub fn given(clip: &Clip, joints: &[Vector], up: usize) -> Self {
        let skeleton = Skeleton::of(clip);
        let axes = skeleton.frame.rotation_to(&BodyFrame::standing(up));
        let extent = |points: &mut dyn Iterator<Item = f64>| {
            let (low, high) =
                points.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
            high - low
        };
        let of_mesh = extent(&mut joints.iter().map(|p| p[up]));
        let of_clip = extent(&mut skeleton.rest.iter().map(|&p| dot(p, skeleton.frame.up)));
        let ratio = of_mesh / of_clip;
        let scale = if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 };
        let joints: Vec<_> = joints.iter().copied().map(Some).collect();
        let none = vec![None; joints.len()];
        Self::complete(clip, &skeleton, joints, none, axes, scale, BodyFrame::standing(up).up)
    }

    /// Places what is left by its offset from its parent, and aligns all bones.
    fn complete(
        clip: &Clip,
        skeleton: &Skeleton,
        joints: Vec<Option<Vector>>,
        ends: Vec<Option<Vector>>,
        axes: Quaternion,
        scale: f64,
        up: Vector,
    ) -> Self {
        let mut fitted =
            Self { joints: vec![[0.0; 3]; joints.len()], ends, axes, scale, alignments: Vec::new(), up };
        let known = |j: usize| joints[j].is_some();
        for (j, joint) in clip.joints.iter().enumerate() {
            let alignment = match joint.parent {
                Some(parent) => fitted.alignments[parent],
                None => IDENTITY,
            };
            let hanging = |offset: Vector, from: &Self, alignment| {
                scaled(from.scale, rotate(alignment, rotate(from.axes, offset)))
            };
            fitted.joints[j] = joints[j].unwrap_or_else(|| match joint.parent {
                Some(parent) => add(fitted.joints[parent], hanging(joint.offset, &fitted, alignment)),
                None => [0.0; 3],
            });
            // Directions to what this joint carries, where their places are known already.
            let at = fitted.joints[j];
            let mut pairs: Vec<(Vector, Vector)> = (j + 1..clip.joints.len())
                .filter(|&c| clip.joints[c].parent == Some(j) && known(c))
                .filter_map(|c| Some((clip.joints[c].offset, sub(joints[c]?, at))))
                .collect();
            pairs.extend(joint.end.zip(fitted.ends[j]).map(|(end, place)| (end, sub(place, at))));
            pairs.retain(|(from, to)| norm(*from) > 0.0 && norm(*to) > 0.0);
            let turned: Vec<_> = pairs.iter().map(|&(from, to)| (rotate(axes, from), to)).collect();
            fitted.alignments.push(between(&turned).unwrap_or(alignment));
            if fitted.ends[j].is_none() {
                let own = fitted.alignments[j];
                fitted.ends[j] = skeleton.leaf_end(clip, j).map(|end| add(at, hanging(end, &fitted, own)));
            }
        }
        fitted
    }
}

fn scaled(s: f64, v: Vector) -> Vector {
    scale(s, v)
}

/// The rotation that carries directions to directions as nearly as possible; the shortest one for a single pair.
fn between(pairs: &[(Vector, Vector)]) -> Option<Quaternion> {
    let unit = |v: Vector| scale(1.0 / norm(v), v);
    match pairs {
        [] => None,
        &[(from, to)] => {
            let (from, to) = (unit(from), unit(to));
            let [x, y, z] = cross(from, to);
            // Opposite directions have no shortest rotation: any one about an axis across.
            let across = if from[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
            let [a, b, c] = cross(from, across);
            normalised([1.0 + dot(from, to), x, y, z], 1e-6).or_else(|| normalised([0.0, a, b, c], 1e-6))
        }
        _ => {
            // Each pair and its mirror image: their mean is zero, so that only a rotation is fitted.
            let both = |&(from, to): &(Vector, Vector)| {
                let (from, to) = (unit(from), unit(to));
                [(from, to), (from.map(|x| -x), to.map(|x| -x))]
            };
            let fitted = Similarity::between(&pairs.iter().flat_map(both).collect::<Vec<_>>());
            match fitted.rotation {
                IDENTITY => between(&pairs[..1]), // collinear directions
                rotation => Some(rotation),
            }
        }
    }
}

/// Left and right arm, left and right leg.
const LIMBS: [(Tip, [f64; 3]); 4] =
    [(Tip::LeftHand, ARM), (Tip::RightHand, ARM), (Tip::LeftFoot, LEG), (Tip::RightFoot, LEG)];
const LIMB_NAMES: [&str; 4] = ["left hand", "right hand", "left foot", "right foot"];

/// The motion's skeleton when nothing turns.
struct Skeleton {
    rest: Vec<Vector>,
    ends: Vec<Option<Vector>>,
    frame: BodyFrame,
    height: f64,
}

/// The joints of a limb, from shoulder or hip to the tip.
struct Limb {
    /// Joint of each point, none for the end of the last bone; and where it is.
    points: Vec<(Option<usize>, Vector)>,
    /// Index of elbow or knee, and of wrist or ankle, within `points`.
    bends: [usize; 2],
    name: &'static str,
}

impl Skeleton {
    fn of(clip: &Clip) -> Self {
        let rest = clip.rest();
        let ends: Vec<Option<Vector>> =
            clip.joints.iter().zip(&rest).map(|(joint, &at)| joint.end.map(|end| add(at, end))).collect();
        let points = || rest.iter().chain(ends.iter().flatten());
        let extent = |axis: usize| {
            let high = points().fold(f64::NEG_INFINITY, |m, p| m.max(p[axis]));
            high - points().fold(f64::INFINITY, |m, p| m.min(p[axis]))
        };
        let up = if extent(2) > extent(1) { 2 } else { 1 };
        let side = |side: Side| {
            let own =
                clip.joints.iter().zip(&rest).filter(|(joint, _)| names::side(&joint.name) == Some(side));
            own.map(|(_, p)| p[0]).sum::<f64>()
        };
        let mirrored = side(Side::Left) < side(Side::Right);
        let frame = BodyFrame::with_left(up, [if mirrored { -1.0 } else { 1.0 }, 0.0, 0.0]);
        let height = extent(up);
        Self { height: if height > 0.0 { height } else { 1.0 }, rest, ends, frame }
    }

    /// The end of a joint that carries no other.
    fn leaf_end(&self, clip: &Clip, j: usize) -> Option<Vector> {
        clip.joints[j].end
    }

    /// Joints without children, and where their bones end.
    fn leaves(&self, clip: &Clip) -> Vec<(usize, Vector)> {
        let is_leaf = |&j: &usize| clip.joints.iter().all(|joint| joint.parent != Some(j));
        let end = |j: usize| (j, self.ends[j].unwrap_or(self.rest[j]));
        (0..clip.joints.len()).filter(is_leaf).map(end).collect()
    }

    /// The four limbs.
    fn limbs(&self, clip: &Clip) -> Result<[Limb; 4], FitError> {
        let leaves = self.leaves(clip);
        let aside = |p: Vector| dot(sub(p, self.rest[0]), self.frame.left);
        let above = |p: Vector| dot(p, self.frame.up);
        let mut found = [None; 4];
        for (k, sign) in [1.0, -1.0].into_iter().enumerate() {
            let own: Vec<_> =
                leaves.iter().copied().filter(|&(_, p)| sign * aside(p) > 0.01 * self.height).collect();
            let hand = own.iter().copied().max_by(|a, b| (sign * aside(a.1)).total_cmp(&(sign * aside(b.1))));
            let foot = own.iter().copied().min_by(|a, b| above(a.1).total_cmp(&above(b.1)));
            found[k] = hand.map(|(j, _)| j);
            found[2 + k] = foot.filter(|f| Some(f.0) != hand.map(|h| h.0)).map(|(j, _)| j);
        }
        let leaf = |k: usize| found[k].ok_or(FitError::NoLimb(LIMB_NAMES[k]));
        let limb = |k: usize| Limb::of(self, clip, leaf(k)?, leaf(k ^ 1)?, k);
        Ok([limb(0)?, limb(1)?, limb(2)?, limb(3)?])
    }

    /// Whether joint `j` hangs on no limb.
    fn is_trunk(&self, clip: &Clip, j: usize, limbs: &[Limb; 4]) -> bool {
        path(clip, j).iter().all(|&on| limbs.iter().all(|limb| limb.points[0].0 != Some(on)))
    }
}

/// From the root to joint `j`.
fn path(clip: &Clip, j: usize) -> Vec<usize> {
    let mut path: Vec<usize> = std::iter::successors(Some(j), |&j| clip.joints[j].parent).collect();
    path.reverse();
    path
}

impl Limb {
    fn of(skeleton: &Skeleton, clip: &Clip, leaf: usize, other: usize, k: usize) -> Result<Self, FitError> {
        let (own, other) = (path(clip, leaf), path(clip, other));
        let shared = own.iter().zip(&other).take_while(|(a, b)| a == b).count();
        let mut points: Vec<(Option<usize>, Vector)> =
            own[shared..].iter().map(|&j| (Some(j), skeleton.rest[j])).collect();
        points.extend(skeleton.ends[leaf].map(|end| (None, end)));
        // Points at the place of the one before add nothing to the shape; they follow it.
        let apart = |i: usize| distance_squared(points[i].1, points[i - 1].1).sqrt() > 1e-6 * skeleton.height;
        let corners: Vec<usize> = (0..points.len()).filter(|&i| i == 0 || apart(i)).collect();
        let name = LIMB_NAMES[k];
        if corners.len() < 3 {
            return Err(FitError::NoLimb(name));
        }
        let length = |c: usize| distance_squared(points[corners[c]].1, points[corners[c + 1]].1).sqrt();
        let is_first = |c: &usize| {
            // The joint itself or one at the same place.
            let end = corners.get(c + 1).copied().unwrap_or(points.len());
            let named = |&(joint, _): &(Option<usize>, Vector)| {
                joint.is_some_and(|j| names::begins_limb(&clip.joints[j].name, k < 2))
            };
            points[corners[*c]..end].iter().any(named)
        };
        let candidates = || 0..corners.len() - 2;
        let longest = |a: &usize, b: &usize| {
            let pair = |c: usize| length(c).min(length(c + 1));
            pair(*a).total_cmp(&pair(*b))
        };
        let first = candidates().find(is_first).or_else(|| candidates().max_by(longest));
        let first = first.ok_or(FitError::NoLimb(name))?;
        let begin = corners[first];
        let bends = [corners[first + 1] - begin, corners[first + 2] - begin];
        Ok(Self { points: points.split_off(begin), bends, name })
    }

    /// Shoulder, elbow, wrist and tip (or hip, knee, ankle and toes) in the mesh.
    fn in_mesh(&self, figure: &Figure, tip: Tip, shares: [f64; 3]) -> Result<[Vector; 4], FitError> {
        let at = |share: f64| figure.centre(tip, share * figure.height).ok_or(FitError::NoMiddle(self.name));
        Ok([at(shares[2])?, at(shares[1])?, at(shares[0])?, figure.tip(tip)])
    }

    /// Spreads the limb's points over the three pieces between `places`, by their lengths.
    fn place(&self, places: &[Vector; 4], joints: &mut [Option<Vector>], ends: &mut [Option<Vector>]) {
        let knots = [0, self.bends[0], self.bends[1], self.points.len() - 1];
        for piece in 0..3 {
            let (from, to) = (knots[piece], knots[piece + 1]);
            let length = |a: usize, b: usize| {
                (a..b).map(|i| distance_squared(self.points[i].1, self.points[i + 1].1).sqrt()).sum::<f64>()
            };
            let whole = length(from, to);
            for i in from..=to {
                let share = if whole > 0.0 { length(from, i) / whole } else { 0.0 };
                let place = add(places[piece], scale(share, sub(places[piece + 1], places[piece])));
                match self.points[i].0 {
                    Some(j) => joints[j] = Some(place),
                    None => {
                        if let Some(j) = self.points[..i].iter().rev().find_map(|point| point.0) {
                            ends[j] = Some(place);
                        }
                    }
                }
            }
        }
    }
}

/// Where trunk, neck and head go: along the line from the hips over the shoulders to the crown.
struct Trunk {
    /// Middle of the hips, middle of the shoulders, crown: in the motion and in the mesh.
    from: [Vector; 3],
    to: [Vector; 3],
    axes: Quaternion,
    scale: f64,
}

impl Trunk {
    fn new(
        skeleton: &Skeleton,
        limbs: &[Limb; 4],
        figure: &Figure,
        roots: &[Vector; 4],
        axes: Quaternion,
        size: f64,
    ) -> Self {
        let middle = |a: Vector, b: Vector| scale(0.5, add(a, b));
        let own = |k: usize| limbs[k].points[0].1;
        let points = || skeleton.rest.iter().chain(skeleton.ends.iter().flatten()).copied();
        let lowest = [f64::NEG_INFINITY; 3];
        let higher = |best: Vector, p: Vector| {
            let above = |p: Vector| if p == lowest { f64::NEG_INFINITY } else { dot(p, skeleton.frame.up) };
            if above(p) > above(best) { p } else { best }
        };
        let shoulders = middle(own(0), own(1));
        let crown = points().fold(lowest, higher);
        // Arms that are raised when nothing turns must not pass for the head.
        let along = dot(sub(crown, shoulders), skeleton.frame.up).max(0.05 * skeleton.height);
        let crown = add(shoulders, scale(along, skeleton.frame.up));
        Self {
            from: [middle(own(2), own(3)), shoulders, crown],
            to: [middle(roots[2], roots[3]), middle(roots[0], roots[1]), figure.tip(Tip::Head)],
            axes,
            scale: size,
        }
    }

    fn place(&self, p: Vector) -> Vector {
        let share = |piece: usize| {
            let along = sub(self.from[piece + 1], self.from[piece]);
            dot(sub(p, self.from[piece]), along) / dot(along, along).max(f64::MIN_POSITIVE)
        };
        let piece = usize::from(share(0) > 1.0);
        let share = share(piece);
        let along = sub(self.from[piece + 1], self.from[piece]);
        let across = sub(p, add(self.from[piece], scale(share, along)));
        let base = add(self.to[piece], scale(share, sub(self.to[piece + 1], self.to[piece])));
        add(base, scale(self.scale, rotate(self.axes, across)))
    }
}

/// The rotation of joint `j`'s bone in the mesh, for the motion's rotation `turned` in its own axes.
impl Fitted {
    /// R = B G B^-1 A^-1: back to the motion's rest direction, then as the motion turns, in the mesh's axes.
    pub fn rotation(&self, j: usize, turned: Quaternion) -> Quaternion {
        use lapsolve::rotation::conjugate;
        let in_mesh = product(product(self.axes, turned), conjugate(self.axes));
        product(in_mesh, conjugate(self.alignments[j]))
    }
}
