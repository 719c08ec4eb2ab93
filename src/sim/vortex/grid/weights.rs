//! Deposit of vortons on the nodes of a grid, and interpolation from nodes to points.
//!
//! *Method*: [essmann95]'s cubic splines over four nodes along each axis. They keep the strength and the
//! impulse of the vortons, and their transform is divided out. [monaghan85]'s M₄′ keeps the angular impulse
//! too, but its aliasing error is larger: splines damp waves above the Nyquist frequency of the grid by one
//! power more.
//!
//! Vortons are sorted by the plane of nodes below them along z. A plane of nodes adds the deposits of the
//! four planes of vortons around it in their order, so the number of threads does not change the result.

use super::uniform::{UniformGrid, VectorField};
use crate::math::elementary::sin;
use crate::{
    math::Vec3,
    par::{self, Groups},
};

/// Points per interpolation task: most of them may be next to one plane of nodes.
const POINTS_PER_TASK: usize = 1 << 10;

/// The weights of the nodes −1, 0, 1, 2 of a point between nodes 0 and 1.
#[inline(always)]
fn weights(t: f32) -> [f32; 4] {
    let near = |t: f32| 2.0 / 3.0 + t * t * (0.5 * t - 1.0);
    let far = |t: f32| (2.0 - t) * (2.0 - t) * (2.0 - t) * (1.0 / 6.0);
    [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
}

/// The transform of the weights at θ: deposit and interpolation multiply by its square, for each axis.
pub(super) fn transform(theta: f64) -> f64 {
    let u = theta / 2.0;
    let s = if u == 0.0 { 1.0 } else { sin(u) / u };
    s.powi(4)
}

/// Groups points by the plane of nodes below them.
pub(super) fn by_plane(grid: &UniformGrid, points: &[Vec3]) -> Groups {
    Groups::new(points.len(), grid.cells[2], |i| [grid.cell(points[i]).0[2] as u32])
}

/// Adds the strengths of vortons to the nodes around them. Every vorton is at least two cells from the
/// boundary.
pub(super) fn deposit(field: &mut VectorField, position: &[Vec3], strength: &[Vec3]) {
    let grid = field.grid;
    let planes = by_plane(&grid, position);
    let [x, y, z] = &mut field.values;
    par::map_chunks_mut([x, y, z].map(|v| &mut v[..]), grid.plane(), |first, mut values| {
        let plane = first / grid.plane();
        for below in plane.saturating_sub(2)..=(plane + 1).min(grid.cells[2] - 1) {
            let k = plane + 1 - below;
            for &i in planes.of(below) {
                let (at, t) = grid.cell(position[i as usize]);
                let [wx, wy, wz] = t.map(weights);
                let g = strength[i as usize] * wz[k];
                for (j, wy) in wy.iter().enumerate() {
                    let from = (at[1] + j - 1) * grid.row() + at[0] - 1;
                    for (values, g) in values.iter_mut().zip(g.iter()) {
                        for (value, wx) in values[from..from + 4].iter_mut().zip(wx) {
                            *value += wx * (wy * g);
                        }
                    }
                }
            }
        }
    });
}

/// Interpolates `fields` at points, each at least two cells from the boundary, in the order of `planes`.
pub(super) fn interpolate<const N: usize>(
    fields: &[VectorField; N],
    points: &[Vec3],
    planes: &Groups,
) -> Vec<[Vec3; N]> {
    let grid = fields[0].grid;
    let mut out = par::repeated([Vec3::zeros(); N], planes.len());
    par::for_chunks(&mut out, POINTS_PER_TASK, |first, out| {
        for (&i, out) in planes.all()[first..].iter().zip(out) {
            let (at, t) = grid.cell(points[i as usize]);
            let [wx, wy, wz] = t.map(weights);
            for (k, wz) in wz.iter().enumerate() {
                for (j, wy) in wy.iter().enumerate() {
                    let from = grid.index([at[0] - 1, at[1] + j - 1, at[2] + k - 1]);
                    let w = wz * wy;
                    for (field, out) in fields.iter().zip(out.iter_mut()) {
                        for (values, out) in field.values.iter().zip(out.iter_mut()) {
                            let row = &values[from..from + 4];
                            *out += w * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
                        }
                    }
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_keep_their_first_two_moments() {
        // The second moment is not kept: it is ⅓ everywhere.
        for t in [0.0, 0.1, 0.37, 0.5, 0.93] {
            let w = weights(t);
            for (power, expected) in [(0, 1.0), (1, 0.0), (2, 1.0 / 3.0)] {
                let moment: f32 = (0..4).map(|k| w[k] * (k as f32 - 1.0 - t).powi(power)).sum();
                assert!((moment - expected).abs() < 1e-6, "{t} {power}: {moment}");
            }
        }
    }

    #[test]
    fn the_transform_of_the_weights_is_their_sum_over_waves() {
        for theta in [0.0_f64, 0.3, 1.0, 2.0, 3.1] {
            // ∫ W cos θt dt: cells of the weights at 0 <= t < 1, by the midpoint rule.
            let n = 2000;
            let cell = |i: usize| {
                let t = (i as f64 + 0.5) / n as f64;
                let w = weights(t as f32);
                (0..4).map(|k| f64::from(w[k]) * (theta * (k as f64 - 1.0 - t)).cos()).sum::<f64>()
            };
            let whole = (0..n).map(cell).sum::<f64>() / n as f64;
            assert!((whole - transform(theta)).abs() < 1e-6, "{theta}");
        }
    }

    #[test]
    fn deposit_keeps_strength_and_impulse_and_linear_fields_are_interpolated_exactly() {
        let grid = UniformGrid { low: Vec3::new(-1.0, 2.0, 0.5), spacing: 0.25, cells: [9, 11, 8] };
        let position: Vec<Vec3> = (0..40)
            .map(|i| grid.low + Vec3::from_fn(|k, _| 0.5 + 0.031 * ((i * (7 + k)) % 29) as f32))
            .collect();
        let strength: Vec<Vec3> = (0..40).map(|i| Vec3::new(1.0, (i % 3) as f32, -0.1 * i as f32)).collect();
        let mut field = VectorField::new(grid);
        deposit(&mut field, &position, &strength);
        let (mut sum, mut impulse) = (Vec3::zeros(), Vec3::zeros());
        let mut wave = VectorField::new(grid);
        let linear = |x: Vec3| Vec3::new(x.x - x.y, 1.0 + x.z, x.x - 2.0 * x.y);
        for z in 0..=8 {
            for y in 0..=11 {
                for x in 0..=9 {
                    let at = [x, y, z];
                    sum += field.at(at);
                    impulse += grid.node(at).cross(&field.at(at));
                    wave.set(at, linear(grid.node(at)));
                }
            }
        }
        let whole: Vec3 = strength.iter().sum();
        let exact: Vec3 = position.iter().zip(&strength).map(|(x, g)| x.cross(g)).sum();
        assert!((sum - whole).norm() < 1e-4 && (impulse - exact).norm() < 1e-3);
        let planes = by_plane(&grid, &position);
        let found = interpolate(&[wave], &position, &planes);
        for (&i, [found]) in planes.all().iter().zip(&found) {
            assert!((found - linear(position[i as usize])).norm() < 1e-4);
        }
    }
}
