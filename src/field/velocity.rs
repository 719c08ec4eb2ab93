//! Velocities of particles on the nodes of a density's bricks.
//!
//! *Method*: the normalised kernel sum [shepard68], v(x) = Σ_j W_j v_j / Σ_j W_j with the density's kernel,
//! so that a node has a velocity where it has a density.
//! *Departs from the paper*: the weight has compact support instead of a singularity at the samples.
//!
//! Symbols: v_j → `velocities` [m/s]; W_j = K(|x − x_j|/h) [–].
//!
//! Limits: as a mean it is nowhere faster than the fastest particle, and it smooths over h.

use super::{
    DensityParams,
    fill::{around, rows},
    kernel::kernel,
    sorted_particles::SortedParticles,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, NodeMask, mask_of},
    math::Vec3,
    par,
};

/// Velocities on bricks.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Velocity {
    /// 512 values per brick [m/s]; zero where no particle is in reach.
    pub values: Vec<Vec3>,
    /// The nodes with a particle in reach, one mask per brick.
    pub reached: Vec<NodeMask>,
}

/// The velocities at the nodes of `bricks`, of particles at `positions` [m] with `velocities` [m/s].
///
/// # Panics
/// If there are not as many velocities as positions, or a parameter is not above zero and finite.
pub fn velocity(
    positions: &[Vec3],
    velocities: &[Vec3],
    params: &DensityParams,
    bricks: &Bricks,
) -> Velocity {
    assert_eq!(positions.len(), velocities.len(), "one velocity a particle");
    let valid = |v: f32| v > 0.0 && v.is_finite();
    assert!(valid(params.spacing) && valid(params.kernel_radius) && valid(params.voxel), "valid {params:?}");
    let sampling = Sampling {
        particles: SortedParticles::new(positions, params.kernel_radius * params.spacing),
        voxel: params.voxel * params.spacing,
        reach: params.kernel_radius / params.voxel,
        velocities,
    };
    let mut values = vec![Vec3::zeros(); bricks.len() * BRICK_NODES];
    let mut reached = vec![[0; BRICK_NODES / 64]; bricks.len()];
    let mut slots: Vec<_> = values.chunks_mut(BRICK_NODES).zip(&mut reached).collect();
    par::for_chunks(&mut slots, 1, |brick, slot| {
        let (values, reached) = &mut slot[0];
        **reached = sampling.gather(bricks.coords()[brick], values);
    });
    Velocity { values, reached }
}

/// Particles whose velocities are interpolated.
struct Sampling<'a> {
    particles: SortedParticles,
    /// Distance between nodes [m].
    voxel: f32,
    /// h [voxels].
    reach: f32,
    /// By the particles' indices [m/s].
    velocities: &'a [Vec3],
}

impl Sampling<'_> {
    /// Writes the velocities at the nodes of the brick at `coord` and returns which nodes have one.
    fn gather(&self, coord: [i32; 3], values: &mut [Vec3]) -> NodeMask {
        // Σ W and Σ W v, component by component.
        let mut sums = [[0.0; BRICK_NODES]; 4];
        let (low, high) = around(coord, self.voxel, self.reach * self.voxel);
        self.particles.cells.for_each_stretch(low, high, |places| {
            for place in places {
                let x = self.particles.at(place);
                let p = [0, 1, 2].map(|axis| {
                    (f64::from(x[axis]) / f64::from(self.voxel) - f64::from(coord[axis]) * BRICK as f64)
                        as f32
                });
                let particle = self.particles.cells.order()[place] as usize;
                splat(p, self.velocities[particle], self.reach, &mut sums);
            }
        });
        for (node, value) in values.iter_mut().enumerate() {
            let weight = sums[0][node];
            if weight > 0.0 {
                *value = Vec3::new(sums[1][node], sums[2][node], sums[3][node]) / weight; // v(x), [shepard68]
            }
        }
        mask_of(&sums[0], |&weight| weight > 0.0)
    }
}

/// Adds one particle at `p` [voxels from the brick's first node] that moves with `v`.
#[inline]
fn splat(p: [f32; 3], v: Vec3, reach: f32, sums: &mut [[f32; BRICK_NODES]; 4]) {
    // A particle whose sphere misses the brick's box of nodes contributes nothing.
    let far = p.map(|v| v - v.clamp(0.0, (BRICK - 1) as f32));
    let reach2 = reach * reach;
    if far[0] * far[0] + far[1] * far[1] + far[2] * far[2] >= reach2 {
        return;
    }

    // Rows that the sphere overlaps are computed completely, as for the density.
    let inverse = 1.0 / reach;
    let dx2: [f32; BRICK] = std::array::from_fn(|x| (x as f32 - p[0]).powi(2));
    let (first_z, last_z) = rows(p[2], reach);
    let (first_y, last_y) = rows(p[1], reach);
    for z in first_z..last_z {
        let dz2 = (z as f32 - p[2]).powi(2);
        for y in first_y..last_y {
            let row2 = dz2 + (y as f32 - p[1]).powi(2);
            if row2 + far[0] * far[0] >= reach2 {
                continue;
            }
            let weights = dx2.map(|d2| kernel((d2 + row2).sqrt() * inverse));
            let start = BRICK * (y + BRICK * z);
            for (sum, factor) in sums.iter_mut().zip([1.0, v.x, v.y, v.z]) {
                for (sum, weight) in sum[start..start + BRICK].iter_mut().zip(weights) {
                    *sum += weight * factor;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::density;
    use super::*;
    use crate::grid::{SparseGrid, is_set, node_of};

    const PARAMS: DensityParams =
        DensityParams { spacing: 0.1, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: true };

    fn block() -> Vec<Vec3> {
        (0..900)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| 0.1 * v as f32 - 0.37))
            .map(|[x, y, z]| Vec3::new(x + 0.03 * (17.0 * y).sin(), y + 0.03 * (23.0 * z).sin(), z))
            .collect()
    }

    #[test]
    fn every_node_holds_the_mean_over_all_particles() {
        let positions = block();
        let velocities: Vec<Vec3> = positions.iter().map(|x| Vec3::new(x.y, -x.x, x.z * x.z)).collect();
        let field = density(&positions, &PARAMS).grid;
        let found = velocity(&positions, &velocities, &PARAMS, &field.bricks);
        let grid = SparseGrid { values: found.values.iter().map(|v| v.x).collect(), ..field.clone() };
        for (index, value) in found.values.iter().enumerate().step_by(7) {
            let (brick, place) = (index / BRICK_NODES, index % BRICK_NODES);
            let x = grid.position(node_of(grid.bricks.coords()[brick], place));
            let (mut sum, mut weights) = (Vec3::zeros(), 0.0);
            for (y, v) in positions.iter().zip(&velocities) {
                let weight = kernel((x - y).norm() / (PARAMS.kernel_radius * PARAMS.spacing));
                sum += v * weight;
                weights += weight;
            }
            assert_eq!(is_set(&found.reached[brick], place), field.values[index] > 0.0);
            // At the rim the weight is only rounding.
            if weights > 1e-6 {
                assert!((value - sum / weights).norm() < 2e-3, "{value} for {}", sum / weights);
            }
        }
    }

    #[test]
    fn uniform_motion_gives_a_uniform_velocity() {
        let positions = block();
        let all = Vec3::new(0.7, -120.0, 1e-3);
        let field = density(&positions, &PARAMS).grid;
        let found = velocity(&positions, &vec![all; positions.len()], &PARAMS, &field.bricks);
        for (index, value) in found.values.iter().enumerate() {
            let expected = if field.values[index] > 0.0 { all } else { Vec3::zeros() };
            assert!((value - expected).norm() <= 1e-6 * expected.norm(), "{value}");
        }
    }

    #[test]
    fn bytes_do_not_depend_on_threads() {
        let positions = block();
        let bricks = density(&positions, &PARAMS).grid.bricks;
        let run = |threads| {
            let found = par::with_threads(threads, || velocity(&positions, &positions, &PARAMS, &bricks));
            (
                found.values.iter().flat_map(|v| [v.x, v.y, v.z].map(f32::to_bits)).collect::<Vec<_>>(),
                found.reached,
            )
        };
        let one = run(1);
        for threads in [2, 3, 8] {
            assert!(run(threads) == one, "{threads} threads");
        }
    }
}
