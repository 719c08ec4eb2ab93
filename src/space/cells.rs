//! Particles ordered by the cell they lie in.

use crate::math::Vec3;

/// Particles sorted into cubic cells; only occupied cells are stored.
#[derive(Debug)]
pub struct CellGrid {
    cell: f32,
    /// Occupied cells as (z, y, x), ascending.
    cells: Vec<[i32; 3]>,
    /// `order[start[c]..start[c + 1]]` are the particles of cell `c`.
    start: Vec<u32>,
    order: Vec<u32>,
}

impl CellGrid {
    /// Sorts `positions` (finite, fewer than 2³²) into cells of edge `cell` [m].
    pub fn new(positions: &[Vec3], cell: f32) -> Self {
        let mut keyed: Vec<([i32; 3], u32)> =
            positions.iter().enumerate().map(|(i, &x)| (cell_of(x, cell), i as u32)).collect();
        keyed.sort_unstable();
        let mut cells = Vec::new();
        let mut start = Vec::new();
        for (place, &(key, _)) in keyed.iter().enumerate() {
            if cells.last() != Some(&key) {
                cells.push(key);
                start.push(place as u32);
            }
        }
        start.push(keyed.len() as u32);
        Self { cell, cells, start, order: keyed.into_iter().map(|(_, i)| i).collect() }
    }

    /// The particles' indices in cell order: the order that keeps neighbours close in memory.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Calls `f(index, squared distance)` for every particle closer to `x` than `radius` (≤ the cell's edge),
    /// in cell order.
    pub fn for_each_within(&self, positions: &[Vec3], x: Vec3, radius: f32, mut f: impl FnMut(usize, f32)) {
        debug_assert!(radius <= self.cell);
        let [z, y, xc] = cell_of(x, self.cell);
        for dz in -1..=1 {
            for dy in -1..=1 {
                let row = [z.saturating_add(dz), y.saturating_add(dy)];
                let first = [row[0], row[1], xc.saturating_sub(1)];
                let last = [row[0], row[1], xc.saturating_add(1)];
                let mut c = self.cells.partition_point(|cell| *cell < first);
                while c < self.cells.len() && self.cells[c] <= last {
                    for &j in &self.order[self.start[c] as usize..self.start[c + 1] as usize] {
                        let r2 = (positions[j as usize] - x).norm_squared();
                        if r2 < radius * radius {
                            f(j as usize, r2);
                        }
                    }
                    c += 1;
                }
            }
        }
    }
}

/// The cell that holds `x`, as (z, y, x); positions beyond 2³¹ cells share the outermost one.
fn cell_of(x: Vec3, cell: f32) -> [i32; 3] {
    let index = |v: f32| (f64::from(v) / f64::from(cell)).floor() as i32;
    [index(x.z), index(x.y), index(x.x)]
}
