//! Linear-blend skinning: a surface that follows rigid motions by weights.

use crate::columns::Columns;
use crate::rigid::Rigid;
use crate::vector::Vector;
use rayon::prelude::*;

/// Vertices of one parallel piece: some 50 us of work.
const CHUNK: usize = 4096;

/// x'_i = sum_j w_ij T_j x_i, with the weights of every vertex stored together.
#[derive(Clone, Debug)]
pub struct Skin {
    rest: Vec<Vector>,
    /// Start of the influences of every vertex; n + 1.
    starts: Vec<u32>,
    /// Bone and weight.
    influences: Vec<(u32, f64)>,
    bones: usize,
    /// The motions as matrices, refreshed by every pose.
    rows: Vec<[[f64; 4]; 3]>,
}

impl Skin {
    /// Keeps for every vertex of `rest` at most `most` bones, those of the largest weights in `weights` (n x bones; ties: the
    /// lower bone), scaled so that their sum stays what the whole row's was. `most` = the number of bones keeps the weights as
    /// they are; four are what file formats and graphics hardware take. Vertices whose weights are all zero stay where
    /// they are in every pose.
    ///
    /// # Panics
    /// If `weights` has not one row per vertex, or `most` is 0.
    pub fn new(rest: &[Vector], weights: Columns<&[f64]>, most: usize) -> Self {
        assert_eq!(weights.n(), rest.len(), "weights: one row per vertex");
        assert!(most > 0, "most: at least one bone");
        let (mut starts, mut influences) = (vec![0], Vec::new());
        let mut row: Vec<(u32, f64)> = Vec::new();
        for v in 0..rest.len() {
            row.clear();
            row.extend((0..).zip(weights.row(v).iter().copied()).filter(|&(_, w)| w != 0.0));
            let whole: f64 = row.iter().map(|&(_, w)| w).sum();
            if row.len() > most {
                row.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs())); // stable: ties stay in the order of the bones
                row.truncate(most);
                let kept: f64 = row.iter().map(|&(_, w)| w).sum();
                let factor = whole / kept;
                row.iter_mut().for_each(|(_, w)| *w *= if factor.is_finite() { factor } else { 1.0 });
                row.sort_by_key(|&(bone, _)| bone);
            }
            influences.extend_from_slice(&row);
            starts.push(influences.len() as u32);
        }
        let rows = vec![Rigid::IDENTITY.rows(); weights.k()];
        Self { rest: rest.to_vec(), starts, influences, bones: weights.k(), rows }
    }

    /// Bones and weights of vertex `v`, ascending by bone.
    pub fn influences(&self, v: usize) -> &[(u32, f64)] {
        &self.influences[self.starts[v] as usize..self.starts[v + 1] as usize]
    }

    /// Number of bones.
    pub fn bones(&self) -> usize {
        self.bones
    }

    /// Positions in the pose where bone j moves by `motions[j]` (see
    /// [`Skeleton::motions`](super::Skeleton::motions)). Runs on the current rayon pool, without an allocation of its own;
    /// the result has the same bits for any number of threads. About 30 flops per influence.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn pose(&mut self, motions: &[Rigid], positions: &mut [Vector]) {
        assert_eq!(motions.len(), self.bones, "motions: one per bone");
        assert_eq!(positions.len(), self.rest.len(), "positions: one per vertex");
        self.rows.iter_mut().zip(motions).for_each(|(rows, motion)| *rows = motion.rows());
        let this = &*self;
        positions.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for (i, x) in out.iter_mut().enumerate() {
                *x = this.blend(chunk * CHUNK + i);
            }
        });
    }

    fn blend(&self, v: usize) -> Vector {
        let [x, y, z] = self.rest[v];
        let influences = self.influences(v);
        if influences.is_empty() {
            return self.rest[v];
        }
        let mut sum = [0.0; 3];
        for &(bone, weight) in influences {
            for (s, row) in sum.iter_mut().zip(&self.rows[bone as usize]) {
                *s += weight * (row[0] * x + row[1] * y + row[2] * z + row[3]);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::about_axis;

    const REST: [Vector; 3] = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
    const WEIGHTS: [f64; 9] = [0.6, 0.3, 0.1, 0.0, 0.25, 0.75, 0.0, 0.0, 0.0];

    #[test]
    fn blends_moves_rigidly_and_leaves_unweighted_vertices() {
        let mut skin = Skin::new(&REST, Columns::new(&WEIGHTS, 3, 3), 3);
        let (turn, shift) = (
            Rigid { rotation: about_axis(2, 1.1), translation: [0.5, 0.0, 0.0] },
            Rigid::translation([0.0, 4.0, 0.0]),
        );
        let mut x = [[9.0; 3]; 3];
        skin.pose(&[turn; 3], &mut x);
        for v in 0..2 {
            let expected = turn.apply(REST[v]);
            assert!(x[v].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15));
        }
        assert_eq!(x[2], REST[2]);
        skin.pose(&[Rigid::IDENTITY, shift, Rigid::IDENTITY], &mut x);
        assert!((x[0][1] - 1.2).abs() < 1e-15 && (x[1][1] - 3.0).abs() < 1e-15, "{x:?}");
    }

    #[test]
    fn fewer_influences_keep_the_largest_and_the_sum() {
        let skin = Skin::new(&REST, Columns::new(&WEIGHTS, 3, 3), 2);
        let kept = skin.influences(0);
        assert!(kept.len() == 2 && kept[0].0 == 0 && kept[1].0 == 1, "{kept:?}");
        assert!((kept[0].1 - 2.0 / 3.0).abs() < 1e-15 && (kept[1].1 - 1.0 / 3.0).abs() < 1e-15);
        assert_eq!(skin.influences(1), [(1, 0.25), (2, 0.75)]);
        assert!(skin.influences(2).is_empty());
    }
}
