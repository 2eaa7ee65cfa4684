//! The motion of a mesh that comes without a template: it twists about its longest axis, there and back.

use super::harmonic::place_between;
use crate::mesh::TriangleMesh;

/// Frames of the motion, one period: as many as VA's first sequence has.
pub const FRAMES: u32 = 156;

/// Frame of the largest twist, from which `poisson` takes its right-hand side.
pub const EXTREME_FRAME: u32 = FRAMES / 4;

/// Rotation at the ends of the axis in the extreme frame: 60 degrees.
const ANGLE: f64 = std::f64::consts::FRAC_PI_3;

/// A twist about the longest axis of a mesh's bounding box (the first of equally long ones), through the box' centre.
#[derive(Clone, Debug)]
pub struct Twist {
    reference: Vec<[f64; 3]>,
    axis: usize,
    low: [f64; 3],
    high: [f64; 3],
}

impl Twist {
    /// The twist of `mesh`, its positions being the reference pose.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let (low, high) = mesh.bounding_box();
        let half_length = |i: usize| 0.5 * high[i] - 0.5 * low[i];
        let axis = (1..3).fold(0, |best, i| if half_length(i) > half_length(best) { i } else { best });
        Self { reference: mesh.positions().to_vec(), axis, low, high }
    }

    /// Positions in frame `k`: each vertex turned by 60 deg x sin(2 pi k / 156) x s about the axis (right-handed), with s in
    /// [-1, 1] its place along the axis. `positions` (one per vertex) is overwritten.
    ///
    /// # Panics
    /// If the number of positions differs.
    pub fn frame(&self, k: u32, positions: &mut [[f64; 3]]) {
        assert_eq!(positions.len(), self.reference.len(), "positions: one per vertex");
        let phase = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(FRAMES);
        let amplitude = ANGLE * phase.sin();
        let (a, b, c) = (self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3);
        let centre = |i: usize| 0.5 * self.low[i] + 0.5 * self.high[i];
        for (out, p) in positions.iter_mut().zip(&self.reference) {
            let (sin, cos) = (amplitude * place_between(self.low[a], self.high[a], p[a])).sin_cos();
            let (x, y) = (p[b] - centre(b), p[c] - centre(c));
            out[a] = p[a];
            out[b] = centre(b) + (cos * x - sin * y);
            out[c] = centre(c) + (sin * x + cos * y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_turn_against_each_other_by_sixty_degrees() {
        let positions =
            vec![[1.0, 0.0, -2.0], [1.0, 0.0, 2.0], [-1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]];
        let mesh =
            TriangleMesh::new(positions.clone(), vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]).expect("valid");
        let twist = Twist::of(&mesh);
        let mut moved = positions.clone();
        twist.frame(0, &mut moved);
        assert_eq!(moved, positions);
        twist.frame(EXTREME_FRAME, &mut moved);
        let h = 0.75f64.sqrt();
        for (vertex, expected) in [(0, [0.5, -h, -2.0]), (1, [0.5, h, 2.0]), (2, [-1.0, 0.0, 0.0])] {
            assert!((0..3).all(|i| (moved[vertex][i] - expected[i]).abs() < 1e-15), "{:?}", moved[vertex]);
        }
    }

    #[test]
    fn equally_long_axes_take_the_first() {
        let mesh = TriangleMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]], vec![[0, 1, 2]])
            .expect("valid");
        assert_eq!(Twist::of(&mesh).axis, 0);
    }
}
