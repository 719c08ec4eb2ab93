//! Fields of smoke tracers on bricks.
//!
//! *Method*: f(x) = Σ_j f_j s³ W(x − x_j, h), the sum of [mcg03] with one volume s³ for all: diverging
//! tracers make thin smoke, and converging ones dense smoke. Filled as it was seeded, s apart, the field is
//! the tracers' value. W is the cubic spline of [monaghan92], as for the density of liquids.
//!
//! Every brick gathers the tracers around it in a fixed order, so the bytes do not depend on threads.
//!
//! Symbols: s → `spacing` [m], h → `radius` [m], W(r) = 8/(π h³) K(r/h).
//!
//! Limits: where tracers lie farther apart than h there are gaps between them.

use super::{
    fill::{around, rows},
    kernel::kernel,
    sorted_particles::SortedParticles,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, MAX_BRICK, NodeMask},
    math::Vec3,
    par,
};
use std::{collections::BTreeSet, f64::consts::PI};

/// Parameters of the fields of tracers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TracerFieldParams {
    /// Distance at which tracers were seeded [m].
    pub spacing: f32,
    /// Support of the kernel [m].
    pub radius: f32,
    /// Distance between nodes [m].
    pub voxel: f32,
    /// Nodes along each axis beyond the kernel that [`TracerFields::near`] reaches.
    pub padding: u32,
}

/// Fields on bricks, 512 nodes each.
#[derive(Clone, Debug)]
pub(crate) struct TracerFields<const N: usize> {
    /// The bricks that the padded kernels overlap.
    pub bricks: Bricks,
    /// The values at the nodes, field by field.
    pub values: [Vec<f32>; N],
    /// The nodes that a kernel reaches.
    pub reached: Vec<NodeMask>,
    /// The nodes in the box of a padded kernel.
    pub near: Vec<NodeMask>,
    /// Tracers too far from the origin for any brick, which are left out.
    pub too_far: usize,
}

/// The fields of tracers at `positions` [m] with these `values`.
///
/// # Panics
/// If there are not as many values as positions, or a length of `params` is not above zero and finite.
pub(crate) fn tracer_fields<const N: usize>(
    positions: &[Vec3],
    values: [&[f32]; N],
    params: &TracerFieldParams,
) -> TracerFields<N> {
    let TracerFieldParams { spacing, radius, voxel, padding } = *params;
    assert!([spacing, radius, voxel].iter().all(|v| *v > 0.0 && v.is_finite()), "valid {params:?}");
    assert!(values.iter().all(|values| values.len() == positions.len()), "values for every tracer");
    // Tracers too far away are left out: their brick coordinates would overflow.
    let limit = f64::from(MAX_BRICK) * BRICK as f64 * f64::from(voxel);
    let kept: Vec<usize> =
        (0..positions.len()).filter(|&i| positions[i].iter().all(|&v| f64::from(v).abs() < limit)).collect();
    let too_far = positions.len() - kept.len();
    let positions: Vec<Vec3> = kept.iter().map(|&i| positions[i]).collect();
    let values = values.map(|values| kept.iter().map(|&i| values[i]).collect::<Vec<f32>>());

    let reach = radius / voxel;
    let bricks = bricks_in_reach(&positions, voxel, reach + padding as f32);
    let peak = f64::from(spacing).powi(3) * 8.0 / (PI * f64::from(radius).powi(3));
    let gather = Gather {
        particles: SortedParticles::new(&positions, radius.max(voxel)),
        values: &values,
        voxel,
        reach,
        padding: padding as f32,
        peak: peak as f32,
    };
    let mut fields = std::array::from_fn(|_| vec![0.0; bricks.len() * BRICK_NODES]);
    let made = par::map(bricks.len(), |brick| gather.brick(bricks.coords()[brick]));
    let mut masks = [Vec::with_capacity(bricks.len()), Vec::with_capacity(bricks.len())];
    for (brick, (sums, reached, near)) in made.into_iter().enumerate() {
        for (field, sums) in fields.iter_mut().zip(sums.iter()) {
            field[brick * BRICK_NODES..][..BRICK_NODES].copy_from_slice(sums);
        }
        masks[0].push(reached);
        masks[1].push(near);
    }
    let [reached, near] = masks;
    TracerFields { bricks, values: fields, reached, near, too_far }
}

/// The limit of [`tracer_fields`] for ever finer voxels, at `points` [m] themselves: the sum over tracers at
/// `positions` [m], seeded `spacing` [m] apart, with `values` and a kernel of `radius` [m].
///
/// # Panics
/// If there are not as many values as positions, or a length is not above zero.
pub(crate) fn tracer_fields_at(
    points: &[Vec3],
    positions: &[Vec3],
    values: &[f32],
    spacing: f32,
    radius: f32,
) -> Vec<f32> {
    assert!(spacing > 0.0 && radius > 0.0 && positions.len() == values.len(), "valid tracers");
    let particles = SortedParticles::new(positions, radius);
    let peak = (f64::from(spacing).powi(3) * 8.0 / (PI * f64::from(radius).powi(3))) as f32;
    par::map(points.len(), |i| {
        let (x, reach) = (points[i], Vec3::repeat(radius));
        let mut sum = 0.0;
        particles.cells.for_each_stretch(x - reach, x + reach, |places| {
            for place in places {
                let value = values[particles.cells.order()[place] as usize];
                sum += peak * value * kernel((particles.at(place) - x).norm() / radius);
            }
        });
        sum
    })
}

/// The bricks with a node within `reach` voxels of a point along every axis.
fn bricks_in_reach(positions: &[Vec3], voxel: f32, reach: f32) -> Bricks {
    let found = par::map_chunks(positions.len(), 1 << 14, |range| {
        let mut coords = BTreeSet::new();
        for x in &positions[range] {
            let brick = |v: f32, by: f32| ((v / voxel + by).floor() as i32).div_euclid(BRICK as i32);
            let (low, high) = (x.map(|v| brick(v, -reach)), x.map(|v| brick(v, reach)));
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    coords.extend((low.x..=high.x).map(|x| [x, y, z]));
                }
            }
        }
        coords.into_iter().collect::<Vec<_>>()
    });
    Bricks::new(found.concat())
}

struct Gather<'a, const N: usize> {
    particles: SortedParticles,
    values: &'a [Vec<f32>; N],
    voxel: f32,
    /// h [voxels].
    reach: f32,
    /// [voxels].
    padding: f32,
    /// Contribution of a tracer with value 1 at its own position.
    peak: f32,
}

/// A brick's fields, and its nodes that are reached, and near.
type Brick<const N: usize> = (Box<[[f32; BRICK_NODES]; N]>, NodeMask, NodeMask);

impl<const N: usize> Gather<'_, N> {
    fn brick(&self, coord: [i32; 3]) -> Brick<N> {
        let mut sums = Box::new([[0.0; BRICK_NODES]; N]);
        let (mut reached, mut near) = (NodeMask::default(), NodeMask::default());
        let (low, high) = around(coord, self.voxel, (self.reach + self.padding) * self.voxel);
        self.particles.cells.for_each_stretch(low, high, |places| {
            for place in places {
                let x = self.particles.at(place);
                let p = [0, 1, 2].map(|axis| {
                    (f64::from(x[axis]) / f64::from(self.voxel) - f64::from(coord[axis]) * BRICK as f64)
                        as f32
                });
                cover(p, self.reach + self.padding, &mut near);
                let tracer = self.particles.cells.order()[place] as usize;
                let value = std::array::from_fn(|field| self.peak * self.values[field][tracer]);
                self.splat(p, value, &mut sums, &mut reached);
            }
        });
        (sums, reached, near)
    }

    /// Adds one tracer at `p` [voxels from the brick's first node].
    fn splat(
        &self,
        p: [f32; 3],
        value: [f32; N],
        sums: &mut [[f32; BRICK_NODES]; N],
        reached: &mut NodeMask,
    ) {
        let inverse = 1.0 / self.reach;
        let dx2: [f32; BRICK] = std::array::from_fn(|x| (x as f32 - p[0]).powi(2));
        let (first_z, last_z) = rows(p[2], self.reach);
        let (first_y, last_y) = rows(p[1], self.reach);
        for (z, layer) in reached.iter_mut().enumerate().take(last_z).skip(first_z) {
            let dz2 = (z as f32 - p[2]).powi(2);
            for y in first_y..last_y {
                let row2 = dz2 + (y as f32 - p[1]).powi(2);
                let weights = dx2.map(|d2| kernel((d2 + row2).sqrt() * inverse));
                let start = BRICK * (y + BRICK * z);
                for (sums, value) in sums.iter_mut().zip(value) {
                    for (sum, weight) in sums[start..start + BRICK].iter_mut().zip(weights) {
                        *sum += weight * value;
                    }
                }
                let row = weights.iter().enumerate().map(|(x, &w)| u64::from(w > 0.0) << x).sum::<u64>();
                *layer |= row << (BRICK * y);
            }
        }
    }
}

/// Sets the nodes of a brick within `reach` of `p` along every axis.
fn cover(p: [f32; 3], reach: f32, mask: &mut NodeMask) {
    let [(x0, x1), (y0, y1), (z0, z1)] = p.map(|p| rows(p, reach));
    let row = (x0..x1).map(|x| 1_u64 << x).sum::<u64>();
    let layer = (y0..y1).map(|y| row << (BRICK * y)).sum::<u64>();
    mask[z0.min(BRICK)..z1.max(z0.min(BRICK))].iter_mut().for_each(|word| *word |= layer);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{SparseGrid, is_set, node_of};

    const PARAMS: TracerFieldParams =
        TracerFieldParams { spacing: 0.1, radius: 0.2, voxel: 0.05, padding: 5 };

    fn block() -> Vec<Vec3> {
        (0..1000)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| 0.1 * v as f32 - 0.37))
            .map(Vec3::from)
            .collect()
    }

    #[test]
    fn smoke_as_seeded_has_the_tracers_value_and_conserves_its_sum() {
        let positions = block();
        let values: Vec<f32> = vec![0.7; positions.len()];
        let found = tracer_fields(&positions, [&values], &PARAMS);
        let sum: f64 = found.values[0].iter().map(|&v| f64::from(v) * f64::from(PARAMS.voxel).powi(3)).sum();
        assert!((sum / 0.7 - 1.0).abs() < 1e-3, "{sum}");
        let grid = SparseGrid::of(PARAMS.voxel, found.bricks.clone(), found.values[0].clone());
        let middle = grid.trilinear(Vec3::repeat(0.08));
        assert!((middle / 0.7 - 1.0).abs() < 0.03, "{middle}");
        // Twice as far apart, an eighth as dense.
        let far: Vec<Vec3> = positions.iter().map(|x| x * 2.0).collect();
        let thin = tracer_fields(&far, [&values], &TracerFieldParams { radius: 0.4, ..PARAMS });
        let grid = SparseGrid::of(PARAMS.voxel, thin.bricks, thin.values[0].clone());
        assert!((grid.trilinear(Vec3::repeat(0.16)) * 8.0 / 0.7 - 1.0).abs() < 0.03);
    }

    #[test]
    fn finer_voxels_converge_to_the_sums_at_points() {
        let positions = block();
        let values: Vec<f32> = (0..positions.len()).map(|i| (i % 7) as f32).collect();
        // No position relative to the nodes is more frequent than others.
        let off = |i: usize| Vec3::from([0.0137, 0.0211, 0.0293].map(|step| (step * i as f32) % 0.1));
        let points: Vec<Vec3> = positions.iter().enumerate().step_by(7).map(|(i, x)| x + off(i)).collect();
        let exact = tracer_fields_at(&points, &positions, &values, PARAMS.spacing, PARAMS.radius);
        let error = [0.1, 0.05, 0.025].map(|voxel| {
            let found = tracer_fields(&positions, [&values], &TracerFieldParams { voxel, ..PARAMS });
            let [field] = found.values;
            let grid = SparseGrid::of(voxel, found.bricks, field);
            let off = points.iter().zip(&exact).map(|(&x, &exact)| (grid.trilinear(x) - exact).abs());
            off.sum::<f32>() / exact.iter().sum::<f32>()
        });
        // A quarter for each halving of the voxel.
        assert!(error[0] < 0.2 && error[1] < 0.4 * error[0] && error[2] < 0.4 * error[1], "{error:?}");
    }

    #[test]
    fn masks_hold_the_nodes_in_reach_and_near() {
        let positions = [Vec3::new(0.013, -0.22, 0.4), Vec3::new(1.0, 0.02, -0.3)];
        let found = tracer_fields(&positions, [&[1.0, 2.0][..], &[3.0, 0.0]], &PARAMS);
        let (mut reached, mut near) = (0, 0);
        for (brick, &coord) in found.bricks.coords().iter().enumerate() {
            for place in 0..BRICK_NODES {
                let x = Vec3::from(node_of(coord, place).map(|v| v as f32)) * PARAMS.voxel;
                let exact: f32 = positions
                    .iter()
                    .zip([1.0, 2.0])
                    .map(|(p, v)| v * kernel((x - p).norm() / PARAMS.radius) / PI as f32)
                    .sum();
                let found_here = found.values[0][brick * BRICK_NODES + place];
                assert!((found_here - exact).abs() < 1e-5, "{found_here} {exact}");
                assert_eq!(is_set(&found.reached[brick], place), found_here > 0.0);
                let box_distance = positions.iter().map(|p| (x - p).amax()).fold(f32::MAX, f32::min);
                if (box_distance - 0.45).abs() > 1e-5 {
                    assert_eq!(is_set(&found.near[brick], place), box_distance < 0.45, "{x}");
                }
                reached += usize::from(is_set(&found.reached[brick], place));
                near += usize::from(is_set(&found.near[brick], place));
            }
        }
        assert!(reached > 300 && (2 * 17 * 17 * 17..=2 * 19 * 19 * 19).contains(&near), "{reached} {near}");
    }
}
