//! Factor a mesh Laplacian once, solve it in every frame.
pub mod mesh;
pub mod ordering;
