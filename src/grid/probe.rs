//! Reading a sparse grid at places that are near each other.
//!
//! *Method*: what [`SparseGrid::trilinear`] does, with the last brick looked up in each of eight slots, one for every
//! parity of its coordinates: the bricks around a place never share a slot.

use super::{BRICK, BRICK_NODES, SparseGrid, offset};
use crate::math::Vec3;

/// Reads a grid; remembers the bricks around the last place.
pub(crate) struct Probe<'a> {
    grid: &'a SparseGrid,
    slots: [Slot<'a>; 8],
}

/// A brick that was looked up.
#[derive(Clone, Copy)]
struct Slot<'a> {
    coord: [i32; 3],
    /// Values of the brick, or the value of every node of a missing one.
    values: Result<&'a [f32; BRICK_NODES], f32>,
}

impl<'a> Probe<'a> {
    /// Nothing is remembered yet.
    pub(crate) fn new(grid: &'a SparseGrid) -> Self {
        // No node has a coordinate this low.
        Self { grid, slots: [Slot { coord: [i32::MIN; 3], values: Err(0.0) }; 8] }
    }

    /// The number at `x` [m], linear between the eight nodes around it: the bits of [`SparseGrid::trilinear`].
    pub(crate) fn trilinear(&mut self, x: Vec3) -> f32 {
        let at = [0, 1, 2].map(|axis| f64::from(x[axis]) / f64::from(self.grid.voxel));
        let below = at.map(f64::floor);
        let node = below.map(|v| v as i32);
        let t = [0, 1, 2].map(|axis| (at[axis] - below[axis]) as f32);
        let coord = node.map(|i| i.div_euclid(BRICK as i32));
        let local = node.map(|i| i.rem_euclid(BRICK as i32) as usize);
        let values = self.brick(coord);
        let inner = local.iter().all(|&i| i + 1 < BRICK);
        (0..8).fold(0.0, |sum, corner| {
            let upper = [0, 1, 2].map(|axis| corner >> axis & 1);
            let weight: f32 =
                [0, 1, 2].map(|d| if upper[d] == 1 { t[d] } else { 1.0 - t[d] }).iter().product();
            let value = if inner {
                values.map_or_else(|all| all, |values| values[offset([0, 1, 2].map(|d| local[d] + upper[d]))])
            } else {
                let node: [i32; 3] = std::array::from_fn(|d| node[d].saturating_add(upper[d] as i32));
                let place = offset(node.map(|i| i.rem_euclid(BRICK as i32) as usize));
                self.brick(node.map(|i| i.div_euclid(BRICK as i32)))
                    .map_or_else(|all| all, |values| values[place])
            };
            sum + weight * value
        })
    }

    /// The values of the brick at `coord`, or what every node there stands for.
    fn brick(&mut self, coord: [i32; 3]) -> Result<&'a [f32; BRICK_NODES], f32> {
        let slot = &mut self.slots[coord.iter().fold(0, |slot, c| slot << 1 | (c & 1) as usize)];
        if slot.coord != coord {
            let values = self.grid.bricks.find(coord).and_then(|brick| self.grid.brick(brick).first_chunk());
            let all = || f32::from(u8::from(self.grid.filled.find(coord).is_some()));
            *slot = Slot { coord, values: values.ok_or_else(all) };
        }
        slot.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Bricks;

    #[test]
    fn a_probe_has_the_values_of_the_grid() {
        let (low, high) = (Vec3::new(-3.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 1.0));
        let mut grid = SparseGrid::sample(0.25, low, high, |x| (x.x * 3.1 + x.y - 2.0 * x.z).sin());
        grid.filled = Bricks::new(vec![[1, 0, 0], [1, 1, 0], [0, 0, 2]]);
        let mut probe = Probe::new(&grid);
        let mut seen = 0;
        for i in 0..20_000 {
            // A walk in small steps, through all that is there and beyond it.
            let s = i as f32 / 20_000.0;
            let x = Vec3::new(s * 9.0 - 5.0, 3.0 * (s * 40.0).sin(), 2.5 + 3.0 * (s * 170.0).cos());
            assert_eq!(probe.trilinear(x).to_bits(), grid.trilinear(x).to_bits(), "{x}");
            seen += usize::from(probe.trilinear(x) != 0.0);
        }
        assert!(seen > 2000, "{seen}");
        assert_eq!(probe.trilinear(Vec3::new(1e9, 0.0, f32::MAX)), 0.0);
    }
}
