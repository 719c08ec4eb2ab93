//! Particles ordered by the cell they lie in.

use crate::{math::Vec3, par};

/// Particles sorted into cells; only occupied cells are stored.
///
/// Cells are as long as asked for along y and z, and a quarter of it along x: a query then reads nine stretches
/// of 2¼ edges instead of 3, and a quarter fewer particles.
#[derive(Debug)]
pub struct CellGrid {
    cell: f32,
    /// Occupied cells, ascending.
    cells: Vec<CellKey>,
    /// `order[start[c]..start[c + 1]]` are the particles of cell `c`.
    start: Vec<u32>,
    order: Vec<u32>,
}

/// A cell's coordinates (z, y, x), 32 bits each, shifted to be positive so that they sort as one number.
type CellKey = u128;

/// Cells along x in one edge. At 1 a third more candidates are tested; at 8 the cells themselves cost more than
/// they save.
const ALONG_X: i64 = 4;

/// The cell at the world's origin.
const ZERO: i64 = 1 << 31;

impl CellGrid {
    /// Sorts `positions` (finite, fewer than 2³²) into cells of edge `cell` [m], `cell` > 0.
    ///
    /// # Panics
    /// If there are 2³² positions or more.
    pub fn new(positions: &[Vec3], cell: f32) -> Self {
        let count = u32::try_from(positions.len()).expect("fewer than 2³² particles");
        let mut keys = vec![0_u128; positions.len()];
        par::fill(&mut keys, |i| key(coordinates(positions[i], cell)) << 32 | i as u128);
        // Particles rarely leave their order between two searches, and checking costs a hundredth of sorting.
        if !keys.is_sorted() {
            par::sort(&mut keys);
        }
        let (mut cells, mut start) = (Vec::new(), Vec::new());
        for (place, &key) in keys.iter().enumerate() {
            if cells.last() != Some(&(key >> 32)) {
                cells.push(key >> 32);
                start.push(place as u32);
            }
        }
        start.push(count);
        let mut order = vec![0; keys.len()];
        par::fill(&mut order, |place| keys[place] as u32);
        Self { cell, cells, start, order }
    }

    /// The particles' indices in cell order: the order that keeps neighbours close in memory.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The edge of a cell [m].
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Calls `f(index, squared distance)` for every particle closer to `x` than `radius` (≤ the cell's edge),
    /// in cell order. `positions` are those that were sorted.
    pub fn for_each_within(&self, positions: &[Vec3], x: Vec3, radius: f32, mut f: impl FnMut(usize, f32)) {
        debug_assert!(radius <= self.cell);
        let mut from = 0;
        for [first, last] in rows(coordinates(x, self.cell)) {
            // Rows ascend, so each search starts where the last one ended.
            from += self.cells[from..].partition_point(|&cell| cell < first);
            let to = advanced(&self.cells, from, last + 1);
            for &j in &self.order[self.start[from] as usize..self.start[to] as usize] {
                let r2 = (positions[j as usize] - x).norm_squared();
                if r2 < radius * radius {
                    f(j as usize, r2);
                }
            }
        }
    }

    /// How many cells are occupied.
    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The places in `order` that the particles of cell `c` take.
    pub(super) fn places(&self, c: usize) -> std::ops::Range<usize> {
        self.start[c] as usize..self.start[c + 1] as usize
    }

    /// For cell `c`, the nine stretches of `order` that hold its own and its neighbours' particles. `ends` keeps
    /// what the previous, smaller cell found (zeros at first), so that a sweep over cells costs a step a row.
    pub(super) fn stretches(&self, c: usize, ends: &mut [[usize; 2]; 9]) -> [[u32; 2]; 9] {
        let rows = rows(split(self.cells[c]));
        std::array::from_fn(|row| {
            let [from, to] = &mut ends[row];
            *from = advanced(&self.cells, *from, rows[row][0]);
            *to = advanced(&self.cells, *to, rows[row][1] + 1);
            [self.start[*from], self.start[*to]]
        })
    }
}

/// The first place from `at` on whose cell is not below `bound`: by steps that double and a bisection, so that a
/// near place costs little.
fn advanced(cells: &[CellKey], mut at: usize, bound: CellKey) -> usize {
    let mut step = 1;
    while cells.get(at + step - 1).is_some_and(|&cell| cell < bound) {
        at += step;
        step *= 2;
    }
    let end = (at + step).min(cells.len());
    at + cells[at..end].partition_point(|&cell| cell < bound)
}

/// The first and the last cell of the nine rows around a cell, ascending.
fn rows([z, y, x]: [i64; 3]) -> [[CellKey; 2]; 9] {
    std::array::from_fn(|row| {
        let (z, y) = (z + row as i64 / 3 - 1, y + row as i64 % 3 - 1);
        [key([z, y, x - ALONG_X]), key([z, y, x + ALONG_X])]
    })
}

/// The cell that holds `x`, as (z, y, x). Positions beyond 2³¹ − 8 cells share the outermost ones, which keeps
/// a cell's neighbours in range.
fn coordinates(x: Vec3, cell: f32) -> [i64; 3] {
    let outermost = ZERO - 2 * ALONG_X;
    let edge = f64::from(cell);
    let index = |v: f32, edge: f64| ((f64::from(v) / edge).floor() as i64).clamp(-outermost, outermost);
    [index(x.z, edge), index(x.y, edge), index(x.x, edge / ALONG_X as f64)]
}

/// A cell as one number.
fn key(coordinates: [i64; 3]) -> CellKey {
    let [z, y, x] = coordinates.map(|v| (v + ZERO) as u128);
    z << 64 | y << 32 | x
}

/// The coordinates behind a key.
fn split(key: CellKey) -> [i64; 3] {
    [64, 32, 0].map(|shift| i64::from((key >> shift) as u32) - ZERO)
}
