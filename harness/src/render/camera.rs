//! Where a mesh is looked at from.

use crate::vector::{Vector, cross, dot, normalize, scale, sub};
use lapsolve::mesh::TriangleMesh;

/// Where the viewer stands, named for a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// In front of it.
    #[default]
    Front,
    /// Behind it.
    Back,
    /// On its left side.
    Left,
    /// On its right side.
    #[value(alias = "side")]
    Right,
    /// Above it; its front is down in the picture.
    Top,
    /// In front, 35 degrees towards its left and a little above.
    ThreeQuarter,
}

/// Which axis points up. A body then faces +z (y up) or -y (z up), and its left is +x.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Up {
    /// The y axis, as in most animation data.
    #[default]
    Y,
    /// The z axis, as in most engineering data.
    Z,
}

impl View {
    /// From the scene towards the viewer, and what is up in the picture.
    fn axes(self, up: Up) -> (Vector, Vector) {
        let above = [0.0, 1.0, 0.0];
        let (towards_viewer, upwards) = match self {
            Self::Front => ([0.0, 0.0, 1.0], above),
            Self::Back => ([0.0, 0.0, -1.0], above),
            Self::Left => ([1.0, 0.0, 0.0], above),
            Self::Right => ([-1.0, 0.0, 0.0], above),
            Self::Top => (above, [0.0, 0.0, -1.0]),
            Self::ThreeQuarter => ([0.56, 0.2, 0.8], above),
        };
        let turned = |[x, y, z]: Vector| match up {
            Up::Y => [x, y, z],
            Up::Z => [x, -z, y],
        };
        (normalize(turned(towards_viewer)), turned(upwards))
    }
}

/// A camera: frame, extent and kind of projection. Made by [`Camera::framing`].
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    right: Vector,
    up: Vector,
    towards_viewer: Vector,
    centre: Vector,
    /// 1 / (largest half extent of the box): brings the scene to size 1 before anything is squared.
    zoom: f64,
    /// Half width and half height of what is framed, in zoomed units.
    half: [f64; 2],
    /// Distance of the viewer from the centre in zoomed units; parallel projection if none.
    distance: Option<f64>,
}

impl Camera {
    /// A parallel projection of the vertices that triangles use, with a small margin.
    pub fn framing(mesh: &TriangleMesh, view: View, up: Up) -> Self {
        Self::framing_box(mesh.bounding_box(), view, up)
    }

    /// A parallel projection of everything in the box (lowest and highest corner), with a small margin.
    pub fn framing_box((low, high): (Vector, Vector), view: View, up: Up) -> Self {
        const MARGIN: f64 = 1.05;
        let (towards_viewer, up) = view.axes(up);
        let right = normalize(cross(up, towards_viewer));
        let up = cross(towards_viewer, right);
        let centre: Vector = std::array::from_fn(|i| 0.5 * low[i] + 0.5 * high[i]);
        let half: Vector = std::array::from_fn(|i| 0.5 * high[i] - 0.5 * low[i]);
        let largest = half.iter().fold(0.0_f64, |a, &b| a.max(b));
        // The largest half extent can be zero (one point) or so small that its inverse overflows.
        let zoom = if largest > f64::MIN_POSITIVE { 1.0 / largest } else { 1.0 };
        let extent = |axis: Vector| {
            let half = scale(zoom, half);
            (0..3).map(|i| (axis[i] * half[i]).abs()).sum::<f64>().max(1e-3) * MARGIN
        };
        Self { right, up, towards_viewer, centre, zoom, half: [extent(right), extent(up)], distance: None }
    }

    /// Where this camera's frame is wider than it is high, by which factor: for images of matching shape.
    pub fn aspect(&self) -> f64 {
        self.half[0] / self.half[1]
    }

    /// The same view in perspective, from `extents` times the largest half extent away (at least 4, so that the
    /// whole scene lies in front of the viewer).
    pub fn perspective(self, extents: f64) -> Self {
        // The corner of the box is at most sqrt(3) from its centre.
        Self { distance: Some(extents.max(4.0)), ..self }
    }

    /// Coordinates right, up, towards the viewer, about the centre, in zoomed units.
    pub(super) fn view(&self, p: Vector) -> Vector {
        let p = sub(scale(self.zoom, p), scale(self.zoom, self.centre));
        [dot(p, self.right), dot(p, self.up), dot(p, self.towards_viewer)]
    }

    /// Pixel coordinates (x right, y down) and depth (larger is nearer, linear over the picture) of a point given by
    /// its [`Self::view`] in an image of this size.
    pub(super) fn project(&self, [mut x, mut y, mut depth]: Vector, width: usize, height: usize) -> Vector {
        if let Some(distance) = self.distance {
            let inverse = 1.0 / (distance - depth);
            (x, y, depth) = (x * distance * inverse, y * distance * inverse, inverse);
        }
        let (width, height) = (width as f64, height as f64);
        let pixels = (0.5 * width / self.half[0]).min(0.5 * height / self.half[1]);
        [0.5 * width + pixels * x, 0.5 * height - pixels * y, depth]
    }
}
