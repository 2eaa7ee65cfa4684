//! The papers' pipelines around the solvers: skeleton motions, templates that move, what is written of the result.
//!
//! ```text
//! mesh sequence | glTF | BVH -> clip, bvh | figure -> limbs, fit -> rig   a template in every frame
//! correspondences                                                        file, known, or proposed
//! lapsolve::workload::transfer                                           the target in every frame
//! figures, sink, glb                                                     statistics, GLB, PLY, NPY
//! ```

pub mod angles;
mod body_frame;
pub mod bvh;
pub mod clip;
pub mod correspondences;
pub mod figures;
pub mod fit;
pub mod glb;
pub mod joints;
pub mod limbs;
pub mod names;
pub mod rig;
pub mod sink;

pub use body_frame::BodyFrame;
