//! A procedural human of any size, for those who have no scan at hand.
//!
//! A body is the zero set of a smooth union of about twenty solids along a skeleton ([`Skeleton`]), polygonised once
//! and then refined or coarsened to the wanted number of triangles. Three builds share one anatomy: a template that
//! walks ([`walk()`]) and two targets that differ from it in stature, breadth and sex. The meshes are closed, of one
//! component and genus 0, oriented outwards, with the irregular triangles of a scan.
//!
//! Coordinates are metres, y up, the body stands on y = 0 and faces +z; its left is +x.
//!
//! Every number comes from `+ - * / sqrt` in f64 and integer arithmetic in a fixed order, with `libm` for sine and
//! cosine, so that a body is the same to the last bit on every machine and for every number of threads.

mod anatomy;
mod build;
mod correspondences;
mod gait;
mod half_edges;
mod jet;
mod loft;
mod order;
mod polygonise;
pub mod pose;
mod remesh;
mod skeleton;
mod surface;
mod walk;
mod weights;

pub use build::Build;
pub use correspondences::correspondences;
pub use skeleton::{Bone, Skeleton};
pub use walk::{Walk, walk};
pub use weights::BONES;

use build::Proportions;
use half_edges::HalfEdges;
use lapsolve::mesh::TriangleMesh;
use surface::Surface;

/// Fewest and most triangles of a body.
pub const TRIANGLES: std::ops::RangeInclusive<usize> = 1_000..=2_000_000;

/// Spacing of the lattice of the first mesh, in metres: fine enough to keep thumbs and ears apart from what is next to
/// them.
const SPACING: f64 = 0.0125;

/// A human body in its reference pose; [`Body::new`] makes it.
#[derive(Clone, Debug)]
pub struct Body {
    /// Which one.
    pub build: Build,
    /// The surface, in metres.
    pub mesh: TriangleMesh,
    /// Joints and bones inside it.
    pub skeleton: Skeleton,
    surface: Surface,
}

impl Body {
    /// A body of `triangles` triangles, rounded down to an even number (a closed mesh has no other).
    ///
    /// Cost: about 10^5 triangles are made and thinned first, whatever the number asked for; then O(n log n).
    ///
    /// # Panics
    /// If `triangles` is outside [`TRIANGLES`].
    pub fn new(build: Build, triangles: usize) -> Self {
        assert!(TRIANGLES.contains(&triangles), "a body has {TRIANGLES:?} triangles, not {triangles}");
        let seed = 0x0b0d_1e50 + build as u64;
        let proportions = Proportions::new(build);
        let surface = Surface::new(&proportions);
        let (positions, faces) = polygonise::polygonise(&surface, SPACING, seed);
        let detail = positions.iter().map(|&p| surface.detail(p)).collect();
        let mut mesh =
            HalfEdges::new(positions, detail, &faces).expect("the first mesh is a closed manifold");
        remesh::remesh(&mut mesh, &surface, triangles / 2 * 2, seed);
        let (positions, faces) = mesh.into_arrays();
        let (positions, faces) = order::along_morton_curve(&positions, &faces);
        let mesh = TriangleMesh::new(positions, faces).expect("a body is finite");
        Self { build, mesh, skeleton: Skeleton::new(&proportions), surface }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{cross, dot};
    use lapsolve::topology::Topology;

    const BUILDS: [Build; 3] = [Build::Template, Build::Male, Build::Female];

    #[test]
    fn bodies_are_closed_manifolds_of_genus_0_with_the_wanted_number_of_triangles() {
        for build in BUILDS {
            for triangles in [1_000, 1_001, 20_000, 100_000] {
                let mesh = Body::new(build, triangles).mesh;
                assert_eq!(mesh.triangles().len(), triangles / 2 * 2);
                let found = Topology::of(&mesh);
                assert!(found.is_manifold() && found.is_closed(), "{build:?} {triangles}: {found:?}");
                assert_eq!((found.components, found.clashing_edges.count), (1, 0), "{build:?} {triangles}");
                // Euler: n - m/2 = 2 for a sphere, with no vertex unused.
                assert_eq!(mesh.positions().len(), triangles / 2 + 2, "{build:?} {triangles}");
                let volume = signed_volume(&mesh);
                assert!((0.04..0.12).contains(&volume), "{build:?} {triangles}: {volume} cubic metres");
            }
        }
    }

    #[test]
    fn bodies_and_walk_have_the_same_bits_everywhere() {
        // A change here changes every result keyed by a body's checksum: say so in the changelog.
        for (build, triangles, expected) in [
            (Build::Template, 20_000, "733e08eeab621f18"),
            (Build::Male, 50_000, "926c0fb00cf7ca91"),
            (Build::Female, 1_000, "df9975aed84bcd1e"),
        ] {
            assert_eq!(hex(&Body::new(build, triangles).mesh), expected, "{build:?} {triangles}");
        }
        let template = Body::new(Build::Template, 2_000);
        let posed = template.mesh.with_positions(walk(&template, 156).positions(39)).unwrap();
        assert_eq!(hex(&posed), "6c9ac5ba14b9a289");
    }

    /// First eight bytes of the mesh's SHA-256.
    fn hex(mesh: &TriangleMesh) -> String {
        crate::mesh_io::checksum(mesh)[..8].iter().map(|b| format!("{b:02x}")).collect()
    }

    fn signed_volume(mesh: &TriangleMesh) -> f64 {
        let at = |v: u32| mesh.positions()[v as usize];
        mesh.triangles().iter().map(|&[a, b, c]| dot(at(a), cross(at(b), at(c))) / 6.0).sum()
    }
}
