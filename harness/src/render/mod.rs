//! Pictures of meshes: a small software renderer with depth buffer, smooth shading and PNG output.
//!
//! [`draw`] turns a mesh seen by a [`Camera`] into an [`Image`]; [`contact_sheet`] puts many images into one;
//! [`animation::write_apng`] plays them. Nothing depends on a display, a font or a graphics driver.

pub mod animation;
mod camera;
mod colour;
mod image;
mod raster;
mod sheet;

pub use camera::{Camera, Up, View};
pub use colour::{Colour, Colouring, Style, viridis};
pub use image::Image;
pub use raster::draw;
pub use sheet::contact_sheet;
