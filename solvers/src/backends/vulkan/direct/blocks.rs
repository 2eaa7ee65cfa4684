//! The tree of dense blocks in the order in which the device works on it: level by level.
use crate::backends::framechol::symbolic::{Part, Symbolic};
use crate::ordering::{NONE, inverse};

/// Lanes of a tile: rows of a block that are worked on side by side.
pub const LANES: usize = 8;

/// Blocks, numbered as the supernodes they are, and where their rows lie in the device's vectors.
///
/// A block has w *pivots* and r rows below. The device's vectors are
/// - y, one element per pivot, level after level, block after block (a pivot's place here is its *slot*);
/// - the fronts, w + r elements per reached block: X y of its pivots, then its updates -M y of the rows below.
///
/// A block is *reached* where it or one below it in the tree has a row of the right-hand side that may not be zero; the
/// forward sweep leaves out the others, whose y and updates are zero.
pub struct Blocks {
    /// Blocks of every level: `order[level_starts[l]..level_starts[l + 1]]`, the reached ones first; leaves of the tree have
    /// level 0.
    pub order: Vec<u32>,
    /// Start of every level in `order`.
    pub level_starts: Vec<u32>,
    /// Whether the forward sweep reaches a block.
    pub reached: Vec<bool>,
    /// First slot of every block.
    pub slot: Vec<u32>,
    /// First element of every reached block in the fronts.
    pub front: Vec<u32>,
    /// Elements of all fronts.
    pub fronts: u32,
    /// Matrix row of every slot.
    pub rows: Vec<u32>,
    /// Matrix rows below the pivots of every block: `below[below_starts[s]..below_starts[s + 1]]`.
    pub below: Vec<u32>,
    /// Start of every block in `below`.
    pub below_starts: Vec<u32>,
    /// What is added to an element: `sources[source_starts[e]..source_starts[e + 1]]` are elements of the fronts; e counts
    /// the fronts first, then the slots.
    pub sources: Vec<u32>,
    /// Start of every element in `sources`.
    pub source_starts: Vec<u32>,
}

impl Blocks {
    /// Arranges the supernodes of an analysis for one thread. `active`: the only matrix rows where a right-hand side is not
    /// zero; all of them where there is no such list.
    pub fn new(symbolic: &Symbolic, active: Option<&[u32]>) -> Self {
        let part = &symbolic.parts[0];
        let reached = active.map_or_else(|| vec![true; part.len()], |rows| reach(symbolic, rows));
        let (mut order, level_starts) = levels(part);
        for level in level_starts.windows(2) {
            order[level[0] as usize..level[1] as usize].sort_by_key(|&s| !reached[s as usize]); // stable
        }
        let (mut slot, mut front) = (vec![0; part.len()], vec![0; part.len()]);
        let (mut slots, mut fronts) = (0_u32, 0_u32);
        let mut rows = Vec::with_capacity(part.pivots());
        for &s in &order {
            let s = s as usize;
            let shape = part.shape(s);
            (slot[s], front[s]) = (slots, fronts);
            slots += shape.width as u32;
            fronts += if reached[s] { (shape.width + shape.below) as u32 } else { 0 };
            rows.extend_from_slice(&symbolic.order[part.starts[s] as usize..part.starts[s + 1] as usize]);
        }
        let below = part.rows.iter().map(|&position| symbolic.order[position as usize]).collect();
        let mut out = Self {
            order,
            level_starts,
            reached,
            slot,
            front,
            fronts,
            rows,
            below,
            below_starts: part.row_starts.clone(),
            sources: Vec::new(),
            source_starts: Vec::new(),
        };
        out.connect(part);
        out
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.level_starts.len() - 1
    }

    /// Blocks of level `l`.
    pub fn level(&self, l: usize) -> &[u32] {
        &self.order[self.level_starts[l] as usize..self.level_starts[l + 1] as usize]
    }

    /// Blocks of level `l` that the forward sweep reaches.
    pub fn reached(&self, l: usize) -> &[u32] {
        let level = self.level(l);
        &level[..level.partition_point(|&s| self.reached[s as usize])]
    }

    /// Number of slots.
    pub fn slots(&self) -> usize {
        self.rows.len()
    }

    /// Which elements of children's fronts are added to which elements of their parents.
    fn connect(&mut self, part: &Part) {
        let elements = self.fronts as usize + self.slots();
        let mut starts = vec![0_u32; elements + 1];
        self.each_link(part, |target, _| starts[target as usize + 1] += 1);
        for e in 0..elements {
            starts[e + 1] += starts[e];
        }
        let mut next = starts.clone();
        let mut sources = vec![0; starts[elements] as usize];
        self.each_link(part, |target, source| {
            sources[next[target as usize] as usize] = source;
            next[target as usize] += 1;
        });
        (self.sources, self.source_starts) = (sources, starts);
    }

    /// Calls `link(target, source)` for every row of every reached block with a parent, children in ascending order.
    fn each_link(&self, part: &Part, mut link: impl FnMut(u32, u32)) {
        for c in (0..part.len()).filter(|&c| part.parent[c] != NONE && self.reached[c]) {
            let p = part.parent[c] as usize;
            let (first, end, rows) = (part.starts[p], part.starts[p + 1], part.rows(p));
            let width = end - first;
            let source = self.front[c] + part.shape(c).width as u32;
            let mut at = 0; // both lists ascend
            for (source, &row) in (source..).zip(part.rows(c)) {
                let target = if row < end {
                    self.fronts + self.slot[p] + (row - first)
                } else {
                    while rows[at] != row {
                        at += 1;
                    }
                    self.front[p] + width + at as u32
                };
                link(target, source);
            }
        }
    }
}

/// Whether each block holds one of the matrix rows `active`, or is above one that does.
fn reach(symbolic: &Symbolic, active: &[u32]) -> Vec<bool> {
    let part = &symbolic.parts[0];
    let position = inverse(&symbolic.order);
    let mut reached = vec![false; part.len()];
    for &row in active {
        let mut s = part.starts.partition_point(|&start| start <= position[row as usize]) as u32 - 1;
        while s != NONE && !std::mem::replace(&mut reached[s as usize], true) {
            s = part.parent[s as usize];
        }
    }
    reached
}

/// Blocks by height above the leaves: all of a level's children lie below it.
fn levels(part: &Part) -> (Vec<u32>, Vec<u32>) {
    let mut height = vec![0_u32; part.len()];
    let mut starts = vec![0_u32; 1];
    for s in 0..part.len() {
        let own = height[s] as usize;
        if starts.len() < own + 2 {
            starts.resize(own + 2, 0);
        }
        starts[own + 1] += 1;
        if part.parent[s] != NONE {
            let (own, above) = (height[s], &mut height[part.parent[s] as usize]);
            *above = (*above).max(own + 1);
        }
    }
    for l in 1..starts.len() {
        starts[l] += starts[l - 1];
    }
    let mut next = starts.clone();
    let mut order = vec![0; part.len()];
    for (s, &h) in height.iter().enumerate() {
        order[next[h as usize] as usize] = s as u32;
        next[h as usize] += 1;
    }
    (order, starts)
}

/// What a sweep pair spends on a block of `width` pivots and `below` rows, in picoseconds on lavapipe.
///
/// Counted for tiles of two rows per lane: their start and end, and sixteen multiply-adds with the reading of a vector per
/// column; then the vectors: y and x of a pivot, the front's elements, the index of a row.
pub fn sweep_cost(width: u64, below: u64) -> u64 {
    const PER_TILE: u64 = 60_000;
    const PER_COLUMN: u64 = 22_000;
    const PER_PIVOT: u64 = 20_000;
    const PER_ROW: u64 = 12_000;
    let height = 2 * LANES as u64;
    let (forward, backward) = ((width + below).div_ceil(height), width.div_ceil(height));
    let triangle = (width * (width + height)).div_ceil(2 * height); // columns of the tiles of X, of X^T as well
    let rectangle = width * below / height + below * backward;
    PER_TILE * (forward + backward)
        + PER_COLUMN * (2 * triangle + rectangle)
        + PER_PIVOT * width
        + PER_ROW * below
}
