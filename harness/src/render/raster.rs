//! Triangles to pixels.

use super::camera::Camera;
use super::colour::{Colour, Style};
use super::image::Image;
use crate::vector::{Vector, add, add_scaled, area_normal, dot, normalize, scale};
use lapsolve::mesh::TriangleMesh;
use rayon::prelude::*;

/// Rows of the image that one thread renders at a time.
const BAND: usize = 32;
/// Light from the viewer's upper left, weaker light from the lower right, and light from everywhere.
const KEY: f64 = 0.62;
const FILL: f64 = 0.16;
const AMBIENT: f64 = 0.26;
/// Radius of a marked vertex, in parts of the smaller side of the image.
const DOT: f64 = 0.006;

/// A triangle after projection to samples.
struct Projected {
    corners: [Vector; 3],
    /// Linear intensities (red, green, blue) at the corners.
    light: [Vector; 3],
}

struct Scene {
    triangles: Vec<Projected>,
    dots: Vec<Vector>,
    dot_radius: f64,
    mark: Vector,
    background: Vector,
}

/// Draws a mesh. Triangles without area in the picture leave no trace; both sides of a triangle are lit alike, so
/// that a mesh with mixed orientation still shows its shape.
///
/// Cost: every vertex once, every triangle once per band of the picture, then the samples it covers.
pub fn draw(mesh: &TriangleMesh, style: &Style<'_>, camera: &Camera) -> Image {
    let samples = style.samples.clamp(1, 8);
    let (width, height) = style.size;
    let scene = project(mesh, style, camera, samples);
    let mut image = Image::new(width, height, style.background);
    image.pixels_mut().par_chunks_mut(width * BAND).enumerate().for_each(|(band, rows)| {
        Band::new(width * samples, rows.len() / width * samples, band * BAND * samples, scene.background)
            .draw(&scene)
            .average(samples, rows);
    });
    image
}

fn project(mesh: &TriangleMesh, style: &Style<'_>, camera: &Camera, samples: usize) -> Scene {
    let (width, height) = (style.size.0 * samples, style.size.1 * samples);
    let view: Vec<Vector> = mesh.positions().par_iter().map(|&p| camera.view(p)).collect();
    let screen: Vec<Vector> = view.par_iter().map(|&p| camera.project(p, width, height)).collect();
    let colours = style.colouring.of_vertices(view.len());
    let normals = vertex_normals(mesh, &view);
    let mut marked = vec![false; mesh.triangles().len()];
    for &t in style.marked_triangles {
        if let Some(mark) = marked.get_mut(t as usize) {
            *mark = true;
        }
    }
    let light = |t: [u32; 3], marked: bool| {
        let own = triangle_normal(t, &view);
        let side = if own[2] < 0.0 { -1.0 } else { 1.0 };
        t.map(|v| {
            let normal = normals[v as usize];
            let normal = if style.flat || normal == [0.0; 3] { normalize(own) } else { normal };
            scale(shade(scale(side, normal)), linear(if marked { style.mark } else { colours[v as usize] }))
        })
    };
    let triangles = mesh
        .triangles()
        .par_iter()
        .zip(&marked)
        .map(|(&t, &marked)| Projected { corners: t.map(|v| screen[v as usize]), light: light(t, marked) })
        .collect();
    let dots = style.marked_vertices.iter().filter_map(|&v| screen.get(v as usize).copied()).collect();
    let dot_radius = (DOT * width.min(height) as f64).max(1.5);
    Scene { triangles, dots, dot_radius, mark: linear(style.mark), background: linear(style.background) }
}

fn triangle_normal(t: [u32; 3], view: &[Vector]) -> Vector {
    let [a, b, c] = t.map(|v| view[v as usize]);
    area_normal(a, b, c)
}

/// Unit normals at the vertices, area-weighted; zero where there is none.
fn vertex_normals(mesh: &TriangleMesh, view: &[Vector]) -> Vec<Vector> {
    let mut normals = vec![[0.0; 3]; view.len()];
    for &t in mesh.triangles() {
        let normal = triangle_normal(t, view);
        for v in t {
            normals[v as usize] = add(normals[v as usize], normal);
        }
    }
    normals.into_iter().map(normalize).collect()
}

/// Light that a surface with this normal (right, up, towards the viewer) sends to the viewer.
fn shade(normal: Vector) -> f64 {
    let key = dot(normal, normalize([-0.5, 0.6, 0.75])).max(0.0);
    let fill = dot(normal, normalize([0.8, -0.1, 0.5])).max(0.0);
    AMBIENT + KEY * key + FILL * fill
}

/// sRGB to linear intensity in [0, 1].
fn linear(colour: Colour) -> Vector {
    colour.map(|c| {
        let c = f64::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
    })
}

/// The inverse of [`linear`].
fn encode(light: Vector) -> Colour {
    light.map(|x| {
        let x = x.clamp(0.0, 1.0);
        let c = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 };
        (255.0 * c).round() as u8
    })
}

/// Some full rows of samples.
struct Band {
    width: usize,
    height: usize,
    /// Row of the picture at which the band begins, in samples.
    top: usize,
    depth: Vec<f64>,
    light: Vec<[f32; 3]>,
}

impl Band {
    fn new(width: usize, height: usize, top: usize, background: Vector) -> Self {
        let light = vec![background.map(|x| x as f32); width * height];
        Self { width, height, top, depth: vec![f64::NEG_INFINITY; width * height], light }
    }

    fn draw(mut self, scene: &Scene) -> Self {
        for triangle in &scene.triangles {
            self.triangle(triangle);
        }
        for &centre in &scene.dots {
            self.dot(centre, scene.dot_radius, scene.mark);
        }
        self
    }

    /// Samples whose centres lie in [low, high], as a range of columns and of rows of this band; empty if none.
    fn covered(&self, low: [f64; 2], high: [f64; 2]) -> [std::ops::Range<usize>; 2] {
        let range = |low: f64, high: f64, first: usize, count: usize| {
            let from = (low - 0.5).ceil() - first as f64;
            let to = (high - 0.5).floor() - first as f64 + 1.0;
            from.clamp(0.0, count as f64) as usize..to.clamp(0.0, count as f64) as usize
        };
        [range(low[0], high[0], 0, self.width), range(low[1], high[1], self.top, self.height)]
    }

    fn triangle(&mut self, triangle: &Projected) {
        let [a, b, c] = triangle.corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 {
            return;
        }
        let extreme = |i: usize, pick: fn(f64, f64) -> f64| pick(pick(a[i], b[i]), c[i]);
        let [columns, rows] = self.covered(
            [extreme(0, f64::min), extreme(1, f64::min)],
            [extreme(0, f64::max), extreme(1, f64::max)],
        );
        let side = |p: Vector, q: Vector, x: f64, y: f64| {
            ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area
        };
        for row in rows {
            let y = (self.top + row) as f64 + 0.5;
            for column in columns.clone() {
                let x = column as f64 + 0.5;
                let weights = [side(b, c, x, y), side(c, a, x, y), side(a, b, x, y)];
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let depth = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                let sample = row * self.width + column;
                if depth > self.depth[sample] {
                    self.depth[sample] = depth;
                    self.light[sample] = blend(&triangle.light, weights);
                }
            }
        }
    }

    /// A disc, hidden by what is nearer than its centre by more than a small tolerance.
    fn dot(&mut self, centre: Vector, radius: f64, light: Vector) {
        const TOLERANCE: f64 = 0.01; // zoomed units: the whole scene is about 2 deep
        let [x, y, depth] = centre;
        let [columns, rows] = self.covered([x - radius, y - radius], [x + radius, y + radius]);
        for row in rows {
            for column in columns.clone() {
                let (dx, dy) = (column as f64 + 0.5 - x, (self.top + row) as f64 + 0.5 - y);
                let sample = row * self.width + column;
                if dx * dx + dy * dy <= radius * radius && depth + TOLERANCE > self.depth[sample] {
                    self.light[sample] = light.map(|x| x as f32);
                }
            }
        }
    }

    /// Mean of each samples x samples block, encoded, into the rows of the image.
    fn average(&self, samples: usize, rows: &mut [Colour]) {
        let width = self.width / samples;
        for (index, pixel) in rows.iter_mut().enumerate() {
            let (x, y) = (index % width * samples, index / width * samples);
            let mut sum = [0.0; 3];
            for row in y..y + samples {
                for light in &self.light[row * self.width + x..][..samples] {
                    sum = add(sum, light.map(f64::from));
                }
            }
            *pixel = encode(scale(1.0 / (samples * samples) as f64, sum));
        }
    }
}

fn blend(light: &[Vector; 3], weights: [f64; 3]) -> [f32; 3] {
    let sum = add_scaled(add_scaled(scale(weights[0], light[0]), weights[1], light[1]), weights[2], light[2]);
    sum.map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{Colouring, Up, View};
    use super::*;

    const WHITE: Colour = [255; 3];

    fn style(size: usize) -> Style<'static> {
        Style { size: (size, size), samples: 2, ..Style::default() }
    }

    fn picture(mesh: &TriangleMesh, style: &Style<'_>) -> Image {
        draw(mesh, style, &Camera::framing(mesh, View::Front, Up::Y))
    }

    fn at(image: &Image, x: usize, y: usize) -> Colour {
        image.pixels()[y * image.width() + x]
    }

    fn square(z: f64) -> [[f64; 3]; 4] {
        [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]]
    }

    #[test]
    fn a_triangle_covers_half_of_its_box() {
        let mesh = TriangleMesh::new(square(0.0)[..3].to_vec(), vec![[0, 1, 2]]).unwrap();
        let image = picture(&mesh, &style(100));
        let covered = image.pixels().iter().filter(|&&p| p != WHITE).count() as f64;
        // Half of the picture, less the margin of 1.05 on every side.
        assert!((covered / (0.5 * 10_000.0 / (1.05 * 1.05)) - 1.0).abs() < 0.03, "{covered} pixels");
        assert_ne!(at(&image, 80, 80), WHITE);
        assert_eq!(at(&image, 20, 20), WHITE);
    }

    #[test]
    fn the_nearer_surface_hides_the_farther_in_any_order_and_projection() {
        let positions = [square(0.0), square(1.0)].concat();
        let (far, near) = ([[0, 1, 2], [0, 2, 3]], [[4, 5, 6], [4, 6, 7]]);
        let red_near = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let style = Style { colouring: Colouring::Scalar { values: &red_near, range: None }, ..style(64) };
        let mesh =
            |triangles: [[[u32; 3]; 2]; 2]| TriangleMesh::new(positions.clone(), triangles.concat()).unwrap();
        let (one, other) = (mesh([far, near]), mesh([near, far]));
        let camera = Camera::framing(&one, View::Front, Up::Y);
        for camera in [camera, camera.perspective(5.0)] {
            let image = draw(&one, &style, &camera);
            assert_eq!(image, draw(&other, &style, &camera));
            let [red, green, blue] = at(&image, 32, 32);
            assert!(red > 150 && green > 130 && blue < 90, "yellow is the upper end of the map");
        }
        let behind = draw(&one, &style, &Camera::framing(&one, View::Back, Up::Y));
        let [red, green, blue] = at(&behind, 32, 32);
        assert!(blue > red && red > green, "purple is the lower end of the map");
    }

    #[test]
    fn odd_meshes_draw_without_panic() {
        let huge: Vec<Vector> = square(0.5).iter().map(|&p| scale(1e308, p)).collect();
        let tiny: Vec<Vector> = square(0.5).iter().map(|&p| scale(1e-308, p)).collect();
        let two = vec![[0, 1, 2], [0, 2, 3]];
        let style = Style { marked_vertices: &[0, 99], marked_triangles: &[0, 99], ..style(40) };
        let image = picture(&TriangleMesh::new(huge, two.clone()).unwrap(), &style);
        assert_ne!(at(&image, 20, 20), WHITE);
        picture(&TriangleMesh::new(tiny, two.clone()).unwrap(), &style);
        for degenerate in
            [vec![[1.0; 3]; 4], vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]]
        {
            let mesh = TriangleMesh::new(degenerate, two.clone()).unwrap();
            let unmarked = Style { marked_vertices: &[], ..style };
            assert!(picture(&mesh, &unmarked).pixels().iter().all(|&p| p == WHITE));
        }
    }
}
