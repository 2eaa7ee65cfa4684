//! The transfer of a mesh that comes alone, and the thinning of long lists of correspondences.

use super::marks::centroid;
use super::{TransferError, TransferProblem};
use crate::laplacian::Weights;
use crate::mesh::TriangleMesh;
use crate::workload::sampling::farthest_points;

/// Marks where nothing else is asked; VA's users set 30 to 200.
pub const DEFAULT_MARKS: usize = 64;

/// The mesh as its own template, [`default_marks`] being the marks; the motion is [`crate::workload::twist`].
///
/// # Errors
/// [`TransferError`]; `NoMarks` where no triangle has an area.
pub fn default_problem(mesh: &TriangleMesh) -> Result<TransferProblem, TransferError> {
    TransferProblem::new(mesh, mesh.clone(), &default_marks(mesh), Weights::Plain)
}

/// min([`DEFAULT_MARKS`], m) triangles by farthest-point sampling of the centroids of all triangles that have an area,
/// each paired with itself.
pub fn default_marks(mesh: &TriangleMesh) -> Vec<(u32, u32)> {
    let usable: Vec<u32> =
        (0..mesh.triangles().len() as u32).filter(|&t| !mesh.is_zero_area(t as usize)).collect();
    let centroids: Vec<[f64; 3]> = usable.iter().map(|&t| centroid(mesh.corners(t as usize))).collect();
    let pair = |i: u32| (usable[i as usize], usable[i as usize]);
    farthest_points(&centroids, DEFAULT_MARKS).into_iter().map(pair).collect()
}

/// At most `most` of `pairs`, by farthest-point sampling of the centroids of their target triangles, in the order of their
/// choice. Pairs with a triangle of zero area on either side are passed over (they cannot be marks).
///
/// # Errors
/// [`TransferError::OutOfRange`] naming the first pair that does not exist.
pub fn thinned(
    template: &TriangleMesh,
    target: &TriangleMesh,
    pairs: &[(u32, u32)],
    most: usize,
) -> Result<Vec<(u32, u32)>, TransferError> {
    for (pair, &(p, t)) in pairs.iter().enumerate() {
        for (side, mesh, triangle) in [("template", template, p), ("target", target, t)] {
            let triangles = mesh.triangles().len();
            if triangle as usize >= triangles {
                return Err(TransferError::OutOfRange { pair, side, triangle, triangles });
            }
        }
    }
    let usable: Vec<(u32, u32)> = pairs
        .iter()
        .copied()
        .filter(|&(p, t)| !template.is_zero_area(p as usize) && !target.is_zero_area(t as usize))
        .collect();
    let centroids: Vec<[f64; 3]> =
        usable.iter().map(|&(_, t)| centroid(target.corners(t as usize))).collect();
    Ok(farthest_points(&centroids, most).into_iter().map(|i| usable[i as usize]).collect())
}
