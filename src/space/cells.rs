//! Particles ordered by the cell they lie in.

use crate::{
    math::Vec3,
    par::{self, Radix},
};
use std::ops::Range;

/// Particles sorted into cells; only occupied cells are stored.
///
/// Cells have the requested edge along y and z, and a quarter of it along x: a query then reads nine stretches
/// of 2¼ edges instead of 3, and a quarter fewer particles. Cells that differ only in x form a row, so a query
/// looks for nine rows and for two cells in each.
#[derive(Debug, Default)]
pub struct CellGrid {
    cell: f32,
    /// Occupied rows, ascending.
    rows: Vec<CellRow>,
    /// The x of every occupied cell, row after row, ascending within a row.
    cells: Vec<i32>,
    /// `order[start[c]..start[c + 1]]` are the particles of cell `c`; empty until the first build.
    start: Vec<u32>,
    order: Vec<u32>,
    radix: Radix,
}

/// The occupied cells of one z and one y.
#[derive(Clone, Copy, Debug)]
struct CellRow {
    z: i32,
    y: i32,
    /// First cell of the row, which ends where the next row begins.
    first: u32,
}

/// A cell's (z, y, x).
type Coordinates = [i32; 3];

/// A row of cells near that of a cell, and the range of it that matters.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    z: i32,
    y: i32,
    /// Cells to either side along x.
    x: i32,
}

/// The rows that hold all that is no further from a particle than one edge, …
pub(crate) const ONE_EDGE: [Reach; 9] = reaches(1);

/// … and two edges.
pub(crate) const TWO_EDGES: [Reach; 25] = reaches(2);

/// The rows that hold all that is no further from a particle than some `edges`, in order of z and y.
const fn reaches<const ROWS: usize>(edges: i32) -> [Reach; ROWS] {
    let side = 2 * edges + 1;
    assert!(ROWS as i32 == side * side);
    let mut rows = [Reach { z: 0, y: 0, x: 0 }; ROWS];
    let mut row = 0;
    while row < ROWS {
        let (z, y) = (row as i32 / side - edges, row as i32 % side - edges);
        // What is in it is at least so many edges away along z and along y.
        let dz = if z == 0 { 0 } else { z.abs() - 1 };
        let dy = if y == 0 { 0 } else { y.abs() - 1 };
        let left = ALONG_X * ALONG_X * (edges * edges - dz * dz - dy * dy);
        let mut x = 0;
        while x * x < left {
            x += 1;
        }
        rows[row] = Reach { z, y, x };
        row += 1;
    }
    rows
}

/// Cells along x in one edge. At 1 a third more candidates are tested; at 8 the cells themselves cost more than
/// they save.
pub(super) const ALONG_X: i32 = 4;

/// Positions further out share the outermost cells, which keeps a cell's neighbours in range.
const OUTERMOST: i32 = i32::MAX - 4 * ALONG_X;

/// Particles a task turns into rows and cells at once.
const TASK: usize = 1 << 13;

impl CellGrid {
    /// Sorts `positions` (finite, fewer than 2³²) into cells of edge `cell` [m], `cell` > 0.
    ///
    /// # Panics
    /// If there are 2³² positions or more.
    pub fn new(positions: &[Vec3], cell: f32) -> Self {
        let mut grid = Self::default();
        grid.rebuild(positions, cell);
        grid
    }

    /// Does what [`CellGrid::new`] does, in the memory of the grid before.
    ///
    /// # Panics
    /// If there are 2³² positions or more.
    pub fn rebuild(&mut self, positions: &[Vec3], cell: f32) {
        let count = u32::try_from(positions.len()).expect("fewer than 2³² particles");
        self.cell = cell;
        self.order.resize(positions.len(), 0);
        let index_bits = u32::BITS - count.leading_zeros();
        let frame = Frame::around(positions, cell);
        if index_bits + frame.bits() <= u64::BITS {
            // Cell and index fit into one number: the digits of the cell sort it.
            let mut radix = std::mem::take(&mut self.radix);
            radix.sort(positions.len(), index_bits, frame.bits(), |i| {
                frame.key(coordinates(positions[i], cell)) << index_bits | i as u64
            });
            let index = (1_u64 << index_bits) - 1;
            self.lay_out(
                |place| (radix.get(place) & index) as u32,
                |place| frame.coordinates(radix.get(place) >> index_bits),
            );
            self.radix = radix;
        } else {
            // Particles hundreds of kilometres apart: compare whole keys.
            let mut keys = vec![0_u128; positions.len()];
            par::fill(&mut keys, |i| wide_key(coordinates(positions[i], cell)) << 32 | i as u128);
            par::sort(&mut keys);
            self.lay_out(|place| keys[place] as u32, |place| wide_coordinates(keys[place] >> 32));
        }
    }

    /// Fills in order, rows and cells from the index and the cell at every place of the order.
    fn lay_out(
        &mut self,
        index: impl Fn(usize) -> u32 + Sync,
        coordinates: impl Fn(usize) -> Coordinates + Sync,
    ) {
        par::fill(&mut self.order, &index);
        let count = self.order.len();
        // A row begins where z or y change, a cell where anything does.
        let parts = par::map_chunks(count, TASK, |range| {
            let (mut rows, mut cells, mut start) = (Vec::new(), Vec::new(), Vec::new());
            let mut last = (range.start > 0).then(|| coordinates(range.start - 1));
            for place in range {
                let now = coordinates(place);
                if last != Some(now) {
                    let [z, y, x] = now;
                    if last.is_none_or(|[before_z, before_y, _]| [before_z, before_y] != [z, y]) {
                        rows.push(CellRow { z, y, first: cells.len() as u32 });
                    }
                    cells.push(x);
                    start.push(place as u32);
                    last = Some(now);
                }
            }
            (rows, cells, start)
        });
        let Self { rows, cells, start, .. } = self;
        rows.clear();
        cells.clear();
        start.clear();
        cells.reserve_exact(parts.iter().map(|(_, cells, _)| cells.len()).sum());
        start.reserve_exact(cells.capacity() + 1);
        for (part_rows, part_cells, part_start) in parts {
            let before = cells.len() as u32;
            rows.extend(part_rows.into_iter().map(|row| CellRow { first: row.first + before, ..row }));
            cells.extend(part_cells);
            start.extend(part_start);
        }
        start.push(count as u32);
    }

    /// Notes that the particles have been sorted into the grid's order, which then becomes the identity.
    pub fn settle(&mut self) {
        par::fill(&mut self.order, |place| place as u32);
    }

    /// The particles' indices in cell order: the order that keeps neighbours close in memory.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// A particle of the fullest cell, the first of the lowest such cell, and how many are in it; `None` without
    /// particles. A list of neighbours holds at most as many as the cells within reach.
    pub fn fullest(&self) -> Option<(usize, usize)> {
        let inside = |c: usize| self.start[c + 1] - self.start[c];
        let (cell, _) = par::max(self.cells.len(), |c| inside(c) as f32)?;
        Some((self.order[self.start[cell] as usize] as usize, inside(cell) as usize))
    }

    /// The places of the order that every occupied cell holds.
    pub fn occupied(&self) -> impl Iterator<Item = Range<usize>> {
        self.start.windows(2).map(|ends| ends[0] as usize..ends[1] as usize)
    }

    /// Particles in a cell with edge `cell` [m] on a cubic seeding lattice of `spacing` [m].
    pub fn particles_per_cell(cell: f32, spacing: f32) -> f32 {
        (cell / spacing).powi(3) / ALONG_X as f32
    }

    /// The edge of a cell [m].
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Calls `f(index, squared distance)` for every particle closer to `x` than `radius` (≤ the cell's edge),
    /// in cell order. `positions` are those that were sorted.
    ///
    /// # Panics
    /// If `radius` is larger than a cell's edge.
    pub fn for_each_within(&self, positions: &[Vec3], x: Vec3, radius: f32, mut f: impl FnMut(usize, f32)) {
        assert!(radius <= self.cell, "neighbours are in adjacent cells");
        let [z, y, x_cell] = coordinates(x, self.cell);
        for row in self.rows_around(z, y, &ONE_EDGE) {
            let cells = &self.cells[row.clone()];
            let from = row.start + cells.partition_point(|&cell| cell < x_cell - ALONG_X);
            let to = advanced(&self.cells[..row.end], from, x_cell + ALONG_X + 1);
            for &j in &self.order[self.start[from] as usize..self.start[to] as usize] {
                let r2 = (positions[j as usize] - x).norm_squared();
                if r2 < radius * radius {
                    f(j as usize, r2);
                }
            }
        }
    }

    /// The nearest to `x` of the particles closer than `radius` (≤ the cell's edge) that `counts` allows; of several the first.
    pub fn nearest_within(
        &self,
        positions: &[Vec3],
        x: Vec3,
        radius: f32,
        counts: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let mut nearest: Option<(f32, usize)> = None;
        self.for_each_within(positions, x, radius, |j, r2| {
            if nearest.is_none_or(|nearest| (r2, j) < nearest) && counts(j) {
                nearest = Some((r2, j));
            }
        });
        nearest.map(|(_, j)| j)
    }

    /// The rows around (z, y) as ranges of cells, ascending; empty where there is no row.
    fn rows_around<const ROWS: usize>(
        &self,
        z: i32,
        y: i32,
        reaches: &[Reach; ROWS],
    ) -> [Range<usize>; ROWS] {
        let mut found = [const { 0..0 }; ROWS];
        let (mut at, mut layer) = (0, None);
        for (range, reach) in found.iter_mut().zip(reaches) {
            let row = (z + reach.z, y + reach.y);
            if layer.replace(reach.z) != Some(reach.z) {
                at = self.rows.partition_point(|other| (other.z, other.y) < row);
            }
            if self.rows.get(at).is_some_and(|other| (other.z, other.y) == row) {
                *range = self.rows[at].first as usize..self.row_end(at);
                at += 1;
            }
        }
        found
    }

    /// Calls `f(places of the order)` for stretches that together hold every particle in the box from `low` to `high`
    /// [m], and others of the same cells.
    pub fn for_each_stretch(&self, low: Vec3, high: Vec3, mut f: impl FnMut(Range<usize>)) {
        let ([low_z, low_y, low_x], [high_z, high_y, high_x]) =
            (coordinates(low, self.cell), coordinates(high, self.cell));
        for z in low_z..=high_z {
            let mut at = self.rows.partition_point(|row| (row.z, row.y) < (z, low_y));
            while let Some(row) = self.rows.get(at).filter(|row| row.z == z && row.y <= high_y) {
                let (first, end) = (row.first as usize, self.row_end(at));
                let from = first + self.cells[first..end].partition_point(|&x| x < low_x);
                let to = from + self.cells[from..end].partition_point(|&x| x <= high_x);
                if from < to {
                    f(self.start[from] as usize..self.start[to] as usize);
                }
                at += 1;
            }
        }
    }

    /// Where the cells of row `r` end.
    fn row_end(&self, r: usize) -> usize {
        self.rows.get(r + 1).map_or(self.cells.len(), |row| row.first as usize)
    }

    /// How many cells are occupied.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// Walks over the cells that hold the places `range` of the order, in groups of cells that span at most
    /// `span` cells of a row. For each it calls `f(the group's places within range, the stretches of the order that hold
    /// its own particles and all within `reaches`)`.
    pub fn for_each_group<const ROWS: usize>(
        &self,
        range: Range<usize>,
        span: i32,
        reaches: &[Reach; ROWS],
        mut f: impl FnMut(Range<usize>, &[[u32; 2]; ROWS]),
    ) {
        if range.is_empty() {
            return;
        }
        let mut cell = self.start.partition_point(|&start| start as usize <= range.start) - 1;
        let mut row = self.rows.partition_point(|row| row.first as usize <= cell) - 1;
        let mut place = range.start;
        while place < range.end {
            let row_end = self.row_end(row);
            // Where the stretches of the group before begin and end: the next ones lie further on.
            let around = self.rows_around(self.rows[row].z, self.rows[row].y, reaches);
            let mut ends = around.map(|r| [r.start, r.start, r.end]);
            while cell < row_end && place < range.end {
                let first = self.cells[cell];
                let mut last = first;
                while cell < row_end && self.cells[cell].abs_diff(first) < span as u32 {
                    last = self.cells[cell];
                    cell += 1;
                }
                let mut stretches = [[0; 2]; ROWS];
                for ((stretch, [from, to, end]), reach) in stretches.iter_mut().zip(&mut ends).zip(reaches) {
                    *from = advanced(&self.cells[..*end], *from, first - reach.x);
                    *to = advanced(&self.cells[..*end], *to, last + reach.x + 1);
                    *stretch = [self.start[*from], self.start[*to]];
                }
                let end = range.end.min(self.start[cell] as usize);
                f(place..end, &stretches);
                place = end;
            }
            row += 1;
        }
    }
}

/// The first place from `at` on whose cell is not below `bound`: by steps that double and a bisection, so that a
/// near place costs little.
#[inline]
fn advanced(cells: &[i32], mut at: usize, bound: i32) -> usize {
    let mut step = 1;
    while cells.get(at + step - 1).is_some_and(|&cell| cell < bound) {
        at += step;
        step *= 2;
    }
    if step == 1 {
        return at;
    }
    let end = (at + step - 1).min(cells.len());
    at + cells[at..end].partition_point(|&cell| cell < bound)
}

/// The box of cells that holds every particle, and the bits that number its cells.
#[derive(Clone, Copy, Debug)]
struct Frame {
    lowest: Coordinates,
    bits: [u32; 3],
}

impl Frame {
    fn around(positions: &[Vec3], cell: f32) -> Self {
        let parts = par::map_chunks(positions.len(), TASK, |range| {
            let first = positions[range.start];
            positions[range].iter().fold((first, first), |(low, high), x| (low.inf(x), high.sup(x)))
        });
        let Some((low, high)) = parts.into_iter().reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1))) else {
            return Self { lowest: [0; 3], bits: [0; 3] };
        };
        // Cells ascend with positions, so the box of the positions gives that of the cells.
        let (lowest, highest) = (coordinates(low, cell), coordinates(high, cell));
        let bits =
            std::array::from_fn(|axis| u32::BITS - highest[axis].abs_diff(lowest[axis]).leading_zeros());
        Self { lowest, bits }
    }

    fn bits(&self) -> u32 {
        self.bits.iter().sum()
    }

    /// A cell of the box as one number that sorts as (z, y, x) do.
    fn key(&self, cell: Coordinates) -> u64 {
        let [z, y, x] = std::array::from_fn(|axis| u64::from(cell[axis].abs_diff(self.lowest[axis])));
        let [_, y_bits, x_bits] = self.bits;
        (z << y_bits | y) << x_bits | x
    }

    /// The cell behind a key.
    fn coordinates(&self, key: u64) -> Coordinates {
        let [_, y_bits, x_bits] = self.bits;
        let parts =
            [key >> (y_bits + x_bits), key >> x_bits & ((1 << y_bits) - 1), key & ((1 << x_bits) - 1)];
        std::array::from_fn(|axis| self.lowest[axis].wrapping_add_unsigned(parts[axis] as u32))
    }
}

/// The cell that holds `x`.
#[inline]
fn coordinates(x: Vec3, cell: f32) -> Coordinates {
    let edge = f64::from(cell);
    let index = |v: f32, edge: f64| {
        let v = (f64::from(v) / edge).clamp(-f64::from(OUTERMOST), f64::from(OUTERMOST));
        let towards_zero = v as i32;
        towards_zero - i32::from(f64::from(towards_zero) > v) // ⌊v⌋ in fewer steps than `floor` takes
    };
    [index(x.z, edge), index(x.y, edge), index(x.x, edge / f64::from(ALONG_X))]
}

/// Any cell as one number that sorts as (z, y, x) do.
fn wide_key(cell: Coordinates) -> u128 {
    let [z, y, x] = cell.map(|v| u128::from(v.abs_diff(i32::MIN)));
    z << 64 | y << 32 | x
}

/// The cell behind a wide key.
fn wide_coordinates(key: u128) -> Coordinates {
    [64, 32, 0].map(|shift| i32::MIN.wrapping_add_unsigned((key >> shift) as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points without order in a box of `extent` [m].
    fn cloud(count: usize, extent: Vec3) -> Vec<Vec3> {
        let at = |i: usize, k: u64| {
            let bits = (i as u64 * 3 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            bits as f32 / (1 << 24) as f32 - 0.5
        };
        (0..count).map(|i| Vec3::new(at(i, 0), at(i, 1), at(i, 2)).component_mul(&extent)).collect()
    }

    #[test]
    fn the_nearest_is_the_first_of_those_as_near_that_count() {
        let at = |x: f32| Vec3::new(x, 0.0, 0.0);
        let positions = [at(0.3), at(0.1), at(-0.1), at(0.5)];
        let grid = CellGrid::new(&positions, 0.4);
        let nearest = |radius: f32, counts: &dyn Fn(usize) -> bool| {
            grid.nearest_within(&positions, Vec3::zeros(), radius, counts)
        };
        assert_eq!(nearest(0.4, &|_| true), Some(1));
        assert_eq!(nearest(0.4, &|j| j != 1), Some(2));
        assert_eq!(nearest(0.4, &|j| j == 0 || j == 3), Some(0));
        assert_eq!(nearest(0.05, &|_| true), None);
        assert_eq!(CellGrid::new(&[], 0.4).nearest_within(&[], Vec3::zeros(), 0.4, |_| true), None);
    }

    #[test]
    fn particles_are_in_the_order_of_their_cells_and_then_of_their_indices() {
        // From one cell, over boxes that fill 64 bits and one more, to positions that share the outermost cells.
        for extent in (-10..=127).map(|power| 2.0_f32.powi(power)) {
            for flat in [Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 0.0, 1.0)] {
                let positions = cloud(3000, flat * extent);
                let grid = CellGrid::new(&positions, 0.1);
                let mut expected: Vec<u32> = (0..3000).collect();
                expected.sort_by_key(|&i| (coordinates(positions[i as usize], 0.1), i));
                assert_eq!(grid.order(), expected, "{extent} m");
                assert!(grid.start.is_sorted() && grid.start.len() == grid.cells.len() + 1);
            }
        }
    }

    #[test]
    fn the_fullest_cell_is_found() {
        assert_eq!(CellGrid::new(&[], 0.1).fullest(), None);
        let mut positions = cloud(500, Vec3::new(1e3, 1e3, 1e3));
        let crowd = Vec3::new(3.03, 4.04, 5.05);
        [7, 8, 300].into_iter().for_each(|i| positions[i] = crowd);
        assert_eq!(CellGrid::new(&positions, 0.1).fullest(), Some((7, 3)));
    }

    #[test]
    fn a_cell_is_the_floor_of_its_position() {
        for v in [0.0, -0.0, 0.1, -0.1, 0.3, -0.3, 0.249_999_99, -0.25, 1e6, -1e6, 1e8, -1e8] {
            let [z, y, x] = coordinates(Vec3::new(v, v, v), 0.1);
            let expected = (f64::from(v) / f64::from(0.1_f32)).floor();
            assert!(f64::from(z) == expected && y == z, "{v}");
            assert_eq!(
                f64::from(x),
                (f64::from(v) / (f64::from(0.1_f32) / 4.0))
                    .floor()
                    .clamp(-OUTERMOST as f64, OUTERMOST as f64),
                "{v}"
            );
        }
        assert_eq!(coordinates(Vec3::new(3e38, -3e38, 1e30), 0.1), [OUTERMOST, -OUTERMOST, OUTERMOST]);
    }
}
