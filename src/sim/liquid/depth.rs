//! Depth of the liquid, whose surface waves bound the substep.
//!
//! *Method*: in a substep longer than a wave of speed √(g H) takes through a spacing, the pressure of a column of height H at rest
//! moves particles by more than a spacing, and the linearised density constraint no longer holds: water of 30 layers of 2 mm at rest at 24 frames a
//! second swelled by 7 % in its first frame with 8 substeps. H is the largest volume of liquid in a column along gravity over its cross section.
//! Limits: liquid that falls freely has no pressure, but counts; it moves about as fast soon.

use super::Liquid;
use crate::{math::Vec3, par};

/// Width of a column in spacings: wide enough that the packing does not matter, narrow enough for jets.
const COLUMN_WIDTH: f32 = 4.0;

/// Where columns start, in columns: between the rows of seeding lattices, which would else fall on either side.
const COLUMN_SHIFT: f32 = 0.0625;

/// Largest depth [m] of particles at `x`, `spacing` [m] apart, along `gravity`; 0 without gravity.
fn depth(x: &[Vec3], gravity: Vec3, spacing: f32) -> f64 {
    let Some(down) = gravity.try_normalize(0.0).filter(|_| !x.is_empty()) else { return 0.0 };
    let side = down.cross(&Vec3::ith(down.iamin(), 1.0)).normalize();
    let sides = [side, down.cross(&side)];
    let column =
        |x: &Vec3| sides.map(|side| (side.dot(x) / (COLUMN_WIDTH * spacing) + COLUMN_SHIFT).floor() as i32);
    let mut columns = vec![[0; 2]; x.len()];
    par::fill(&mut columns, |i| column(&x[i]));
    par::sort_by_key(&mut columns, |&column| column);
    let fullest = columns.chunk_by(|a, b| a == b).map(<[_]>::len).max().unwrap_or(0);
    fullest as f64 * f64::from(spacing) / f64::from(COLUMN_WIDTH * COLUMN_WIDTH)
}

impl Liquid {
    /// Speed of surface waves on the deepest liquid, √(g H) [m/s].
    pub(super) fn wave_speed(&self) -> f64 {
        let gravity = self.steady_acceleration();
        (f64::from(gravity.norm()) * depth(&self.x, gravity, self.params.spacing)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_depth_is_that_of_the_deepest_column_along_gravity() {
        // 12 x 12 particles, 10 high in one part and 30 high in the other, with rows at and between the edges of columns, also where these
        // are rounded.
        for (spacing, offset, first) in
            [(0.1, 0.0, 0.0), (0.1, 0.5, 0.0), (0.003, 0.0, -191.0), (0.003, 0.5, -191.0)]
        {
            let place = |k: u32| {
                let (column, z) = (k % 144, k / 144);
                let cell = Vec3::new((column % 12) as f32, (column / 12) as f32, z as f32);
                (column % 12 < 8 || z < 10)
                    .then(|| (cell.add_scalar(offset) * spacing).add_scalar(4.0 * first * spacing))
            };
            let x: Vec<Vec3> = (0..144 * 30).filter_map(place).collect();
            for (gravity, expected) in [
                ([0.0, 0.0, -9.81], 30.0),
                ([0.0, 0.0, 1e-3], 30.0),
                ([-9.81, 0.0, 0.0], 12.0),
                ([0.0, 5.0, 0.0], 12.0),
                ([0.0; 3], 0.0),
            ] {
                let layers = depth(&x, gravity.into(), spacing) / f64::from(spacing);
                assert!((layers - expected).abs() < 1e-5, "{gravity:?}, {spacing}, {offset}: {layers}");
            }
        }
        assert_eq!(depth(&[], Vec3::z(), 0.1), 0.0);
    }
}
