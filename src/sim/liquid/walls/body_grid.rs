//! A coarse grid over the bodies among the solids.
//!
//! *Method*: each body is in all cells that its bounding box, enlarged by the reach, overlaps. Those of a cell are compared by their
//! bounding balls.

use crate::{math::Vec3, solid::Pose};

/// Most cells along an axis, so that a large body among small ones is not in too many.
const MAX_CELLS: f32 = 24.0;

/// Cells over bodies.
#[derive(Debug, Default)]
pub(super) struct BodyGrid {
    /// Lower corner [m], cells per metre, and their numbers along the axes.
    low: Vec3,
    inv_cell: f32,
    count: [usize; 3],
    /// Bodies of cell k: `members[starts[k]..starts[k + 1]]`, ascending; without cells all of them.
    pub(super) starts: Vec<u32>,
    pub(super) members: Vec<u32>,
    /// Poses of the movers when the grid was built.
    pub(super) built_at: Vec<Pose>,
    /// Bounding balls of the bodies at their current poses: centres and radii [m].
    pub(super) balls: Vec<(Vec3, f32)>,
}

impl BodyGrid {
    /// Bodies that may be closer to `x` than the reach of the grid, ascending.
    #[inline(always)]
    pub(super) fn cell(&self, x: Vec3) -> &[u32] {
        if self.starts.is_empty() {
            return &self.members;
        }
        let place = (x - self.low) * self.inv_cell;
        let [nx, ny, nz] = self.count;
        let is_inside = place.x >= 0.0
            && place.y >= 0.0
            && place.z >= 0.0
            && place.x < nx as f32
            && place.y < ny as f32
            && place.z < nz as f32;
        if !is_inside {
            return &[];
        }
        let cell = (place.z as usize * ny + place.y as usize) * nx + place.x as usize;
        &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Puts bodies with bounding `boxes` into cells.
    pub(super) fn rebuild(&mut self, boxes: &[(Vec3, Vec3)], has_cells: bool) {
        self.starts.clear();
        self.members.clear();
        if !has_cells {
            self.members.extend(0..boxes.len() as u32);
            return;
        }
        let (first_low, first_high) = boxes[0];
        let (low, high) =
            boxes.iter().fold((first_low, first_high), |(low, high), b| (low.inf(&b.0), high.sup(&b.1)));
        let mean = boxes.iter().map(|(low, high)| (high - low).max()).sum::<f32>() / boxes.len() as f32;
        let cell = (mean / 2.0).max((high - low).max() / MAX_CELLS);
        (self.low, self.inv_cell) = (low, 1.0 / cell);
        for axis in 0..3 {
            self.count[axis] = ((high[axis] - low[axis]) / cell) as usize + 1;
        }
        let [nx, ny, nz] = self.count;
        let inv_cell = self.inv_cell;
        let cells = move |(box_low, box_high): &(Vec3, Vec3)| {
            let at = |x: &Vec3, axis: usize, count: usize| {
                (((x[axis] - low[axis]) * inv_cell).max(0.0) as usize).min(count - 1)
            };
            let span = |axis, count| at(box_low, axis, count)..=at(box_high, axis, count);
            let (x, y) = (span(0, nx), span(1, ny));
            span(2, nz).flat_map(move |k| {
                let x = x.clone();
                y.clone().flat_map(move |j| x.clone().map(move |i| (k * ny + j) * nx + i))
            })
        };
        // Sorted by counting: sizes of cells, their ends, and members from the last to the first.
        self.starts.resize(nx * ny * nz + 1, 0);
        for cell in boxes.iter().flat_map(cells) {
            self.starts[cell] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.members.resize(end as usize, 0);
        for (body, b) in boxes.iter().enumerate().rev() {
            for cell in cells(b) {
                self.starts[cell] -= 1;
                self.members[self.starts[cell] as usize] = body as u32;
            }
        }
    }
}
