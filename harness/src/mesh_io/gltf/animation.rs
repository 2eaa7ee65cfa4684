//! Animated glTF: moving nodes, morph targets and skins, as positions of the mesh's own vertices over time.
//!
//! The vertices are those that the mesh reader gives, in its order: the scene is walked in the same way and equal positions
//! of a node are one vertex, which moves as the first of them does. The first animation of the file counts.

use ::gltf::animation::{Interpolation, Property};
use ::gltf::{Animation, Document, Mesh, Node, Semantic};
use std::collections::HashMap;

use super::accessor;
use super::buffers::Buffers;
use super::transform::Transform;
use super::{LARGEST, roots, triangle_corners};
use crate::file::{Fault, Place};
use crate::mesh_io::builder::MeshBuilder;
use crate::mesh_io::frames::Frames;
use crate::mesh_io::weld::Welder;

/// Most numbers of all frames together: 4 GiB.
const MOST: usize = 1 << 29;
/// Keys farther apart than this rate are sampled at [`RATE`]: they are poses to be blended, not frames.
const SPARSE: f64 = 15.0;
/// Samples per second of sparse keys.
const RATE: f64 = 30.0;

/// A part of the scene: the vertices of one node.
struct Part {
    node: usize,
    rest: Vec<[f64; 3]>,
    /// One displacement per vertex for each target that is not empty.
    targets: Vec<Vec<[f64; 3]>>,
    /// Joint (index into the skin's) and weight, several per vertex; empty without a skin.
    influences: Vec<Vec<(usize, f64)>>,
    skin: Option<usize>,
}

/// A sampled property of a node.
struct Track {
    node: usize,
    property: Property,
    times: Vec<f64>,
    values: Vec<f64>,
    width: usize,
    interpolation: Interpolation,
}

/// Positions over time and frames per second.
pub(super) fn frames(document: &Document, buffers: &Buffers) -> Result<(Frames, f64), Fault> {
    let animation = document
        .animations()
        .next()
        .ok_or_else(|| Fault::new("holds no animation", "export it with its animation"))?;
    let order = order(document)?;
    let parts = parts(document, &order, buffers)?;
    let vertices: usize = parts.iter().map(|part| part.rest.len()).sum();
    let tracks = tracks(&animation, document, buffers)?;
    let (times, rate) = times(&tracks)?;
    if vertices == 0 || times.len().saturating_mul(3 * vertices) > MOST {
        let problem = format!("has {} frames of {vertices} vertices, too many to hold", times.len());
        return Err(Fault::new(problem, "export fewer frames or a coarser mesh"));
    }
    let inverse_binds = inverse_binds(document, buffers)?;
    let mut positions = Vec::with_capacity(times.len() * vertices);
    for &time in &times {
        let state = State::at(document, &order, &tracks, time);
        for part in &parts {
            part.pose(document, &state, &inverse_binds, &mut positions);
        }
    }
    match positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(at) => {
            let problem = format!("moves vertex {} to a place that is not finite", at % vertices);
            Err(Fault::new(problem, "repair the animation"))
        }
        None => Ok((Frames::new(vertices, positions), rate)),
    }
}

/// Nodes of the scene in the order of the mesh reader, each with its parent.
fn order(document: &Document) -> Result<Vec<(usize, Option<usize>)>, Fault> {
    let mut seen = vec![false; document.nodes().len()];
    let mut order = Vec::new();
    let mut pending: Vec<(Node<'_>, Option<usize>)> = Vec::new();
    for root in roots(document) {
        pending.push((root, None));
        while let Some((node, parent)) = pending.pop() {
            if std::mem::replace(&mut seen[node.index()], true) {
                let place = Place::Element("node", node.index());
                return Err(Fault::at(place, "is reached twice", "nodes must form trees"));
            }
            order.push((node.index(), parent));
            let children: Vec<_> = node.children().collect();
            pending.extend(children.into_iter().rev().map(|child| (child, Some(node.index()))));
        }
    }
    Ok(order)
}

fn parts(
    document: &Document,
    order: &[(usize, Option<usize>)],
    buffers: &Buffers,
) -> Result<Vec<Part>, Fault> {
    let nodes: Vec<Node<'_>> = document.nodes().collect();
    let mut parts = Vec::new();
    for &(index, _) in order {
        let node = &nodes[index];
        if let Some(mesh) = node.mesh() {
            parts.push(Part::new(node, &mesh, buffers)?);
        }
    }
    Ok(parts)
}

impl Part {
    fn new(node: &Node<'_>, mesh: &Mesh<'_>, buffers: &Buffers) -> Result<Self, Fault> {
        let place = Place::Element("node", node.index());
        let skin = node.skin().map(|skin| skin.index());
        let joints = node.skin().map_or(0, |skin| skin.joints().count());
        let mut part =
            Self { node: node.index(), rest: Vec::new(), targets: Vec::new(), influences: Vec::new(), skin };
        let (mut welder, mut builder) = (Welder::default(), MeshBuilder::default());
        for primitive in mesh.primitives().filter(|p| triangle_corners(p.mode()).is_some()) {
            let positions = primitive
                .get(&Semantic::Positions)
                .ok_or_else(|| Fault::at(place, "shows a primitive without POSITION", "export it again"))?;
            let positions = accessor::positions(&positions, buffers)?;
            let before = part.rest.len();
            let mut kept = Vec::new();
            for (v, &p) in positions.iter().enumerate() {
                if welder.vertex(p, p, &mut builder) as usize == part.rest.len() {
                    part.rest.push(p);
                    kept.push(v);
                }
            }
            if part.rest.len() > LARGEST {
                return Err(Fault::at(place, "has too many vertices", "split the scene"));
            }
            for (k, target) in primitive.morph_targets().enumerate() {
                if part.targets.len() <= k {
                    part.targets.push(vec![[0.0; 3]; before]);
                }
                part.targets[k].resize(before, [0.0; 3]);
                if let Some(displaced) = target.positions() {
                    let displaced =
                        same_count(accessor::positions(&displaced, buffers)?, positions.len(), place)?;
                    part.targets[k].extend(kept.iter().map(|&v| displaced[v]));
                }
            }
            part.targets.iter_mut().for_each(|target| target.resize(part.rest.len(), [0.0; 3]));
            if skin.is_some() {
                let all = influences(&primitive, buffers, positions.len(), joints, place)?;
                part.influences.extend(kept.iter().map(|&v| all[v].clone()));
            }
        }
        Ok(part)
    }

    fn pose(&self, document: &Document, state: &State, binds: &[Vec<Transform>], out: &mut Vec<[f64; 3]>) {
        let weights = state.weights.get(&self.node).cloned().unwrap_or_else(|| {
            let node = document.nodes().nth(self.node);
            let of_mesh = |node: &Node<'_>| node.mesh().and_then(|mesh| mesh.weights().map(<[f32]>::to_vec));
            let given = node.as_ref().and_then(|n| n.weights().map(<[f32]>::to_vec).or_else(|| of_mesh(n)));
            given.unwrap_or_default().into_iter().map(f64::from).collect()
        });
        let active: Vec<(usize, f64)> = weights
            .iter()
            .copied()
            .enumerate()
            .filter(|&(k, w)| w != 0.0 && k < self.targets.len())
            .collect();
        let joints: Vec<Transform> = match self.skin {
            Some(skin) => {
                let skin = document.skins().nth(skin).expect("a node's skin is one of the document's");
                let own = skin.joints().zip(&binds[skin.index()]);
                own.map(|(joint, bind)| state.worlds[joint.index()].then(bind)).collect()
            }
            None => Vec::new(),
        };
        let world = &state.worlds[self.node];
        for v in 0..self.rest.len() {
            let mut p = self.rest[v];
            for &(k, w) in &active {
                (0..3).for_each(|i| p[i] += w * self.targets[k][v][i]);
            }
            out.push(match self.influences.get(v) {
                Some(influences) if self.skin.is_some() => {
                    influences.iter().fold([0.0; 3], |sum, &(j, w)| {
                        let moved = joints[j].apply(p);
                        std::array::from_fn(|i| sum[i] + w * moved[i])
                    })
                }
                _ => world.apply(p),
            });
        }
    }
}

fn same_count(displaced: Vec<[f64; 3]>, count: usize, place: Place) -> Result<Vec<[f64; 3]>, Fault> {
    if displaced.len() == count {
        return Ok(displaced);
    }
    let problem = format!("has a morph target of {} positions for {count} vertices", displaced.len());
    Err(Fault::at(place, problem, "export it again"))
}

/// Joints and normalised weights of every vertex, all sets together.
fn influences(
    primitive: &::gltf::Primitive<'_>,
    buffers: &Buffers,
    count: usize,
    joints: usize,
    place: Place,
) -> Result<Vec<Vec<(usize, f64)>>, Fault> {
    let broken = |problem: &str| Fault::at(place, problem.to_owned(), "export its skin again");
    let mut all: Vec<Vec<(usize, f64)>> = vec![Vec::new(); count];
    for set in 0.. {
        let (Some(indices), Some(weights)) =
            (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
        else {
            break;
        };
        let (indices, weights) =
            (accessor::numbers(&indices, buffers, 4)?, accessor::numbers(&weights, buffers, 4)?);
        if indices.len() != 4 * count || weights.len() != 4 * count {
            return Err(broken("has not as many joints and weights as vertices"));
        }
        for (at, (&joint, &weight)) in indices.iter().zip(&weights).enumerate() {
            if weight != 0.0 {
                if joint as usize >= joints {
                    return Err(broken("has a vertex that follows a joint its skin does not have"));
                }
                all[at / 4].push((joint as usize, weight));
            }
        }
    }
    for own in &mut all {
        let sum: f64 = own.iter().map(|&(_, w)| w).sum();
        if !(sum > 0.0) {
            return Err(broken("has a vertex without a weight"));
        }
        own.iter_mut().for_each(|(_, w)| *w /= sum);
    }
    Ok(all)
}

fn inverse_binds(document: &Document, buffers: &Buffers) -> Result<Vec<Vec<Transform>>, Fault> {
    document
        .skins()
        .map(|skin| {
            let joints = skin.joints().count();
            let Some(accessor) = skin.inverse_bind_matrices() else {
                return Ok(vec![Transform::IDENTITY; joints]);
            };
            let numbers = accessor::numbers(&accessor, buffers, 16)?;
            if numbers.len() < 16 * joints {
                let place = Place::Element("skin", skin.index());
                return Err(Fault::at(place, "has fewer bind matrices than joints", "export it again"));
            }
            Ok(numbers.as_chunks::<16>().0.iter().map(Transform::of_matrix).collect())
        })
        .collect()
}

fn tracks(animation: &Animation<'_>, document: &Document, buffers: &Buffers) -> Result<Vec<Track>, Fault> {
    let mut tracks = Vec::new();
    for (index, channel) in animation.channels().enumerate() {
        let place = Place::Element("channel", index);
        let broken = |problem: &str| Fault::at(place, problem.to_owned(), "export the animation again");
        let (node, property, sampler) =
            (channel.target().node(), channel.target().property(), channel.sampler());
        let times = accessor::numbers(&sampler.input(), buffers, 1)?;
        let ascending = times.windows(2).all(|pair| pair[0] < pair[1]) && times.iter().all(|t| t.is_finite());
        if times.is_empty() || !ascending {
            return Err(broken("has times that do not ascend"));
        }
        let per_key = match sampler.interpolation() {
            Interpolation::CubicSpline => 3,
            _ => 1,
        };
        let width = match property {
            Property::Translation | Property::Scale => 3,
            Property::Rotation => 4,
            Property::MorphTargetWeights => {
                let mesh = document.nodes().nth(node.index()).and_then(|node| node.mesh());
                let targets =
                    mesh.and_then(|mesh| mesh.primitives().map(|p| p.morph_targets().count()).max());
                match targets {
                    Some(targets) if targets > 0 => targets,
                    _ => continue, // moves nothing that is there
                }
            }
        };
        let components = if property == Property::MorphTargetWeights { 1 } else { width };
        let values = accessor::numbers(&sampler.output(), buffers, components)?;
        if values.len() != times.len() * per_key * width {
            return Err(broken("has not one value per time"));
        }
        tracks.push(Track {
            node: node.index(),
            property,
            times,
            values,
            width,
            interpolation: sampler.interpolation(),
        });
    }
    match tracks.is_empty() {
        true => Err(Fault::new("holds an animation that moves nothing", "export it with its animation")),
        false => Ok(tracks),
    }
}

/// The times of frames and their rate: those of the channel with the most keys, or [`RATE`] where keys are sparse.
fn times(tracks: &[Track]) -> Result<(Vec<f64>, f64), Fault> {
    let densest = tracks.iter().max_by_key(|track| track.times.len()).expect("a channel");
    let first = tracks.iter().map(|track| track.times[0]).fold(f64::INFINITY, f64::min);
    let last = tracks.iter().map(|track| track.times[track.times.len() - 1]).fold(0.0, f64::max);
    let (keys, length) = (densest.times.len(), last - first);
    if keys == 1 || !(length > 0.0) {
        return Ok((vec![first], RATE));
    }
    let own = densest.times[keys - 1] - densest.times[0];
    let rate = (keys - 1) as f64 / own;
    if rate >= SPARSE && own > 0.5 * length {
        return Ok((densest.times.clone(), rate));
    }
    let count = (length * RATE).floor();
    if !(count < 1e6) {
        return Err(Fault::new(format!("holds an animation of {length:.0} seconds"), "export a part of it"));
    }
    Ok(((0..=count as usize).map(|k| first + k as f64 / RATE).collect(), RATE))
}

impl Track {
    /// The value at `time`, held before the first and after the last key.
    fn at(&self, time: f64) -> Vec<f64> {
        let next = self.times.partition_point(|&t| t <= time);
        let cubic = self.interpolation == Interpolation::CubicSpline;
        let per_key = if cubic { 3 } else { 1 };
        // In-tangent, value and out-tangent of a cubic key; the value alone of others.
        let key = |k: usize, part: usize| &self.values[(k * per_key + part) * self.width..][..self.width];
        let value = usize::from(cubic);
        if next == 0 {
            return key(0, value).to_vec();
        }
        let last = self.times.len() - 1;
        if next > last {
            return key(last, value).to_vec();
        }
        let (a, b) = (next - 1, next);
        let step = self.times[b] - self.times[a];
        let s = (time - self.times[a]) / step;
        match self.interpolation {
            Interpolation::Step => key(a, value).to_vec(),
            Interpolation::Linear if self.property == Property::Rotation => slerp(key(a, 0), key(b, 0), s),
            Interpolation::Linear => {
                (0..self.width).map(|i| key(a, 0)[i] * (1.0 - s) + key(b, 0)[i] * s).collect()
            }
            Interpolation::CubicSpline => {
                let (s2, s3) = (s * s, s * s * s);
                (0..self.width)
                    .map(|i| {
                        (2.0 * s3 - 3.0 * s2 + 1.0) * key(a, 1)[i]
                            + step * (s3 - 2.0 * s2 + s) * key(a, 2)[i]
                            + (3.0 * s2 - 2.0 * s3) * key(b, 1)[i]
                            + step * (s3 - s2) * key(b, 0)[i]
                    })
                    .collect()
            }
        }
    }
}

/// Spherical interpolation of unit quaternions by the shorter way.
fn slerp(a: &[f64], b: &[f64], s: f64) -> Vec<f64> {
    let cos: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
    let (sign, cos) = if cos < 0.0 { (-1.0, -cos) } else { (1.0, cos) };
    let angle = cos.clamp(-1.0, 1.0).acos();
    let (u, v) = match angle.sin() {
        sin if sin > 1e-6 => (((1.0 - s) * angle).sin() / sin, (s * angle).sin() / sin),
        _ => (1.0 - s, s),
    };
    a.iter().zip(b).map(|(x, y)| u * x + sign * v * y).collect()
}

/// The scene at one time.
struct State {
    worlds: Vec<Transform>,
    weights: HashMap<usize, Vec<f64>>,
}

impl State {
    fn at(document: &Document, order: &[(usize, Option<usize>)], tracks: &[Track], time: f64) -> Self {
        let nodes: Vec<Node<'_>> = document.nodes().collect();
        let mut moved: HashMap<usize, [Option<Vec<f64>>; 3]> = HashMap::new();
        let mut weights = HashMap::new();
        for track in tracks {
            let value = track.at(time);
            let slot = match track.property {
                Property::Translation => 0,
                Property::Rotation => 1,
                Property::Scale => 2,
                Property::MorphTargetWeights => {
                    weights.insert(track.node, value);
                    continue;
                }
            };
            moved.entry(track.node).or_default()[slot] = Some(value);
        }
        let mut worlds = vec![Transform::IDENTITY; nodes.len()];
        for &(index, parent) in order {
            let local = match moved.get(&index) {
                Some(parts) => Transform::moved(&nodes[index], parts),
                None => Transform::of(&nodes[index]),
            };
            worlds[index] = parent.map_or(local, |parent| worlds[parent].then(&local));
        }
        Self { worlds, weights }
    }
}
