//! From the first mesh to one with the wanted number of triangles: longest edges are split or shortest ones
//! collapsed in rounds, each followed by Delaunay flips and relaxation along the surface.

use super::half_edges::{HalfEdge, HalfEdges, next, previous};
use super::surface::Surface;
use crate::statistics::random::Random;
use crate::vector::{Vector, add, add_scaled, area_normal, dot, norm, normalize, scale, sub};
use rayon::prelude::*;

/// Random factor on the lengths that are compared: gives a scan's mixture of sizes and valences.
const UNEVENNESS: f64 = 0.25;
/// The first mesh has slivers; of so many of its triangles one is kept.
const CLEANING: usize = 4;
/// How far, in mean edges at the vertex, the last step shakes each vertex along the surface.
const SHAKE: f64 = 0.1;

/// Changes `mesh` to exactly `triangles` (even) triangles with vertices on the surface.
pub(super) fn remesh(mesh: &mut HalfEdges, surface: &Surface, triangles: usize, seed: u64) {
    let mut random = Random::new(seed);
    improve(mesh, surface, 2);
    let clean = mesh.triangle_count() / CLEANING / 2 * 2;
    if triangles > clean {
        approach(mesh, surface, clean, &mut random); // rids the first mesh of its slivers
    }
    approach(mesh, surface, triangles, &mut random);
    improve(mesh, surface, 3);
    shake(mesh, surface, &mut random);
}

/// Splits or collapses edges in rounds until the mesh has `triangles` triangles.
fn approach(mesh: &mut HalfEdges, surface: &Surface, triangles: usize, random: &mut Random) {
    while mesh.triangle_count() != triangles {
        let before = mesh.triangle_count();
        if before < triangles {
            split_longest(mesh, surface, (triangles - before) / 2, random);
            improve(mesh, surface, 1);
        } else {
            collapse_shortest(mesh, surface, (before - triangles) / 2, random);
            flip_to_delaunay(mesh);
        }
        assert_ne!(mesh.triangle_count(), before, "no edge can be split or collapsed any more");
    }
}

/// Length of an edge over the length wanted there.
fn relative_length(mesh: &HalfEdges, h: HalfEdge) -> f64 {
    let [a, b] = mesh.ends(h);
    let wanted = 0.5 * (mesh.detail[a as usize] + mesh.detail[b as usize]);
    norm(sub(mesh.position(a), mesh.position(b))) / wanted
}

/// The third of all edges with the smallest `sign` times relative length times a random factor near 1, in this order:
/// `sign` -1 gives the longest. A round that went on to the other edges would even out the wanted differences.
fn ranked(mesh: &HalfEdges, sign: f64, random: &mut Random) -> Vec<(f64, HalfEdge)> {
    let mut edges: Vec<_> = mesh
        .edges()
        .map(|h| (sign * relative_length(mesh, h) * (1.0 + UNEVENNESS * random.signed_unit()), h))
        .collect();
    let order = |a: &(f64, HalfEdge), b: &(f64, HalfEdge)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    let third = edges.len() / 3;
    edges.select_nth_unstable_by(third, order);
    edges.truncate(third);
    edges.par_sort_unstable_by(order);
    edges
}

/// Splits up to `count` edges, the longest first; each triangle is cut at most once.
fn split_longest(mesh: &mut HalfEdges, surface: &Surface, count: usize, random: &mut Random) {
    let mut cut = vec![false; mesh.half_edge_slots() / 3];
    let mut chosen: Vec<HalfEdge> = ranked(mesh, -1.0, random)
        .into_iter()
        .map(|(_, h)| h)
        .filter(|&h| {
            let both = [h, mesh.twin(h)].map(|h| h as usize / 3);
            let free = both.iter().all(|&t| !cut[t]);
            if free {
                both.iter().for_each(|&t| cut[t] = true);
            }
            free
        })
        .take(count)
        .collect();
    chosen.sort_unstable(); // new vertices and triangles follow the order of the old ones: memory stays coherent
    let middles: Vec<Vector> = chosen
        .par_iter()
        .map(|&h| {
            let [a, b] = mesh.ends(h);
            let limit = 0.3 * norm(sub(mesh.position(a), mesh.position(b)));
            surface.project(mesh.midpoint(h), 1, limit)
        })
        .collect();
    for (h, p) in chosen.into_iter().zip(middles) {
        mesh.split(h, p);
    }
}

/// Collapses up to `count` edges, the shortest first, where the topology and the orientation allow; the
/// neighbourhood of a collapsed edge rests until the next round.
fn collapse_shortest(mesh: &mut HalfEdges, surface: &Surface, count: usize, random: &mut Random) {
    const LARGEST_TURN: f64 = 0.3; // cosine: about 70 degrees
    let mut resting = vec![false; mesh.positions.len()];
    let mut left = count;
    for (_, h) in ranked(mesh, 1.0, random) {
        if left == 0 {
            break;
        }
        let ends = mesh.ends(h);
        if !mesh.is_alive(h) || ends.iter().any(|&v| resting[v as usize]) || !mesh.can_collapse(h) {
            continue;
        }
        let limit = norm(sub(mesh.position(ends[0]), mesh.position(ends[1])));
        let p = surface.project(mesh.midpoint(h), 2, limit);
        if mesh.turn_of_collapse(h, p) < LARGEST_TURN {
            continue;
        }
        for v in ends {
            mesh.neighbours(v).for_each(|w| resting[w as usize] = true);
        }
        mesh.collapse(h, p);
        left -= 1;
    }
}

/// Delaunay flips, then vertices move along the surface to the middle of their neighbours, `rounds` times; flips
/// come last.
fn improve(mesh: &mut HalfEdges, surface: &Surface, rounds: usize) {
    flip_to_delaunay(mesh);
    for _ in 0..rounds {
        relax(mesh, surface);
        flip_to_delaunay(mesh);
    }
}

/// Flips edges whose two opposite angles add up to more than a straight angle, where that does not fold the
/// surface; then looks again at the edges around, at most `SWEEPS` times in all.
fn flip_to_delaunay(mesh: &mut HalfEdges) {
    const SWEEPS: usize = 4;
    let slots = 0..mesh.half_edge_slots() as u32;
    let one_per_edge = |h: &HalfEdge| mesh.is_alive(*h) && *h < mesh.twin(*h);
    let mut candidates: Vec<HalfEdge> =
        slots.into_par_iter().filter(one_per_edge).filter(|&h| is_obtuse(mesh, h)).collect();
    for _ in 0..SWEEPS {
        let mut around = Vec::new();
        for h in candidates {
            if is_obtuse(mesh, h) && can_flip(mesh, h) {
                mesh.flip(h);
                around.extend([h, mesh.twin(h)].into_iter().flat_map(|h| [next(h), previous(h)]));
            }
        }
        candidates = around;
    }
}

/// True if the two angles opposite to the edge add up to more than a straight angle.
fn is_obtuse(mesh: &HalfEdges, h: HalfEdge) -> bool {
    let [a, b] = mesh.ends(h);
    let (a, b) = (mesh.position(a), mesh.position(b));
    let apex = |h: HalfEdge| mesh.position(mesh.opposite(h));
    cotangent(a, b, apex(h)) + cotangent(a, b, apex(mesh.twin(h))) < -1e-9 // rounding must not turn a square's diagonal for ever
}

/// True if the flipped edge is new and no triangle turns by more than 60 degrees.
fn can_flip(mesh: &HalfEdges, h: HalfEdge) -> bool {
    let g = mesh.twin(h);
    let [a, b] = mesh.ends(h).map(|v| mesh.position(v));
    let (c, d) = (mesh.opposite(h), mesh.opposite(g));
    let (pc, pd) = (mesh.position(c), mesh.position(d));
    let (n1, n2) = (mesh.normal(h), mesh.normal(g));
    let (m1, m2) = (area_normal(pd, pc, a), area_normal(pc, pd, b));
    let agree = |m: Vector, n: Vector| dot(m, n) > 0.5 * norm(m) * norm(n);
    agree(n1, n2) && agree(m1, n1) && agree(m2, n1) && agree(m1, m2) && mesh.neighbours(c).all(|v| v != d)
}

/// Cotangent of the angle at `apex` opposite to the edge (a, b).
fn cotangent(a: Vector, b: Vector, apex: Vector) -> f64 {
    let (u, v) = (sub(a, apex), sub(b, apex));
    dot(u, v) / norm(area_normal(apex, a, b)).max(f64::MIN_POSITIVE)
}

/// Moves every vertex most of the way to the mean of its neighbours, along the surface only.
fn relax(mesh: &mut HalfEdges, surface: &Surface) {
    const SHARE: f64 = 0.7;
    move_along(mesh, surface, |_, centre, p, _| scale(SHARE, sub(centre, p)));
}

/// Random displacement of every vertex along the surface.
fn shake(mesh: &mut HalfEdges, surface: &Surface, random: &mut Random) {
    let offsets: Vec<Vector> =
        mesh.positions.iter().map(|_| std::array::from_fn(|_| SHAKE * random.signed_unit())).collect();
    move_along(mesh, surface, |v, _, _, edge| scale(edge, offsets[v as usize]));
}

/// Displaces every vertex by the tangential part of `step(vertex, mean of neighbours, position, mean edge)` and
/// projects it. Reads only the old positions, so that the order of work does not matter.
fn move_along<F>(mesh: &mut HalfEdges, surface: &Surface, step: F)
where
    F: Fn(u32, Vector, Vector, f64) -> Vector + Sync,
{
    let moved = (0..mesh.positions.len() as u32)
        .into_par_iter()
        .map(|v| {
            let p = mesh.position(v);
            let (mut sum, mut normal, mut length, mut count) = ([0.0; 3], [0.0; 3], 0.0, 0.0);
            for h in mesh.around(v) {
                let q = mesh.position(mesh.ends(h)[1]);
                sum = add(sum, q);
                length += norm(sub(q, p));
                normal = add(normal, mesh.normal(h));
                count += 1.0;
            }
            if count == 0.0 {
                return p; // a removed vertex
            }
            let (normal, edge) = (normalize(normal), length / count);
            let wish = step(v, scale(1.0 / count, sum), p, edge);
            let tangential = add_scaled(wish, -dot(wish, normal), normal);
            surface.project(add(p, tangential), 1, 0.3 * edge)
        })
        .collect();
    mesh.positions = moved;
}
