//! The density of particles on the nodes of bricks.

use super::{
    kernel::kernel,
    particle_kernel::{ParticleKernel, ParticleKernels},
    sorted_particles::SortedParticles,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, SparseGrid},
    math::Vec3,
    par,
    simd::{self, F32x8, LANES, Lanes, Pass},
};
use std::ops::Range;

/// Computes the bricks of `grid` that are `due`, without the rows that `interpolate_rows` sets: it returns a
/// mask of the others.
pub(super) fn compute(
    grid: &mut SparseGrid,
    due: &Bricks,
    particles: &SortedParticles,
    kernels: &ParticleKernels,
    interpolate_rows: &(impl Fn([i32; 3], &mut [f32; BRICK_NODES]) -> u64 + Sync),
) {
    let (bricks, voxel) = (&grid.bricks, grid.voxel);
    let reach = kernels.reach();
    par::for_chunks(&mut grid.values, BRICK_NODES, |start, values| {
        let coord = bricks.coords()[start / BRICK_NODES];
        if due.find(coord).is_none() {
            return;
        }
        // Sums are accumulated outside the grid: reading pages that were never written maps them twice, and
        // each time stops all threads.
        let mut sums = [0.0; BRICK_NODES];
        let rows = interpolate_rows(coord, &mut sums);
        let mut ranges = Vec::new();
        let (low, high) = around(coord, voxel, reach);
        particles.cells.for_each_stretch(low, high, |places| ranges.push(places));
        simd::dispatch(Fill { particles, kernels, ranges: &ranges, coord, voxel, rows, values: &mut sums });
        values.copy_from_slice(&sums);
    });
}

/// The box of a brick's nodes, extended by `reach` [m].
pub(super) fn around(coord: [i32; 3], voxel: f32, reach: f32) -> (Vec3, Vec3) {
    let node =
        |axis: usize, step: usize| (f64::from(coord[axis]) * BRICK as f64 + step as f64) * f64::from(voxel);
    let low = Vec3::from_fn(|axis, _| (node(axis, 0) - f64::from(reach)) as f32);
    let high = Vec3::from_fn(|axis, _| (node(axis, BRICK - 1) + f64::from(reach)) as f32);
    (low.map(f32::next_down), high.map(f32::next_up))
}

/// Computes the values of one brick.
struct Fill<'a> {
    particles: &'a SortedParticles,
    kernels: &'a ParticleKernels,
    ranges: &'a [Range<usize>],
    coord: [i32; 3],
    voxel: f32,
    /// The rows along x to compute, bit y + 8 z.
    rows: u64,
    values: &'a mut [f32; BRICK_NODES],
}

impl Pass for Fill<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let inverse = 1.0 / f64::from(self.voxel);
        let first = self.coord.map(|c| f64::from(c) * BRICK as f64);
        // In double precision, so that a particle far out keeps all of its own digits.
        let local = |x: &Vec3| [0, 1, 2].map(|axis| (f64::from(x[axis]) * inverse - first[axis]) as f32);
        for range in self.ranges {
            for place in range.clone() {
                match self.kernels {
                    ParticleKernels::Isotropic { radius, weights } => {
                        let p = local(&self.particles.at(place));
                        add_isotropic(p, radius / self.voxel, weights[place], self.rows, self.values);
                    }
                    ParticleKernels::Ellipsoids { kernels, .. } => {
                        let ellipsoid = &kernels[place];
                        add_ellipsoid(local(&ellipsoid.center), ellipsoid, self.voxel, self.values);
                    }
                }
            }
        }
    }
}

/// Adds an isotropic kernel at `p` of radius `reach` [voxels from the brick's first node] to the selected
/// rows.
#[inline(always)]
fn add_isotropic(p: [f32; 3], reach: f32, weight: f32, row_masks: u64, values: &mut [f32; BRICK_NODES]) {
    const LAST: f32 = (BRICK - 1) as f32;
    let inverse = 1.0 / reach;
    // Squared distance of the brick's box of nodes along x [h].
    let far = ((p[0] - p[0].clamp(0.0, LAST)) * inverse).powi(2);
    if far >= 1.0 || p[1] + reach < 0.0 || p[1] - reach > LAST || p[2] + reach < 0.0 || p[2] - reach > LAST {
        return;
    }
    let mut dx2: F32x8 = [0.0; LANES];
    for (x, d2) in dx2.iter_mut().enumerate() {
        *d2 = ((x as f32 - p[0]) * inverse).powi(2);
    }
    let (first_z, last_z) = rows(p[2], reach);
    for z in first_z..last_z {
        let row_mask = (row_masks >> (BRICK * z)) as u8;
        let dz2 = ((z as f32 - p[2]) * inverse).powi(2);
        let left = 1.0 - far - dz2;
        if row_mask == 0 || left <= 0.0 {
            continue;
        }
        let (first_y, last_y) = rows(p[1], left.sqrt() * reach);
        for y in first_y..last_y {
            if row_mask >> y & 1 == 0 {
                continue;
            }
            let row2 = ((y as f32 - p[1]) * inverse).powi(2) + dz2;
            let start = BRICK * (y + BRICK * z);
            let row: &mut F32x8 = (&mut values[start..start + BRICK]).try_into().expect("a row of eight");
            for lane in 0..LANES {
                row[lane] += weight * kernel((dx2[lane] + row2).sqrt()); // φ += V_j W
            }
        }
    }
}

/// Adds an ellipsoid at `p` [voxels from the brick's first node].
#[inline(always)]
fn add_ellipsoid(p: [f32; 3], ellipsoid: &ParticleKernel, voxel: f32, values: &mut [f32; BRICK_NODES]) {
    const LAST: f32 = (BRICK - 1) as f32;
    let inverse = 1.0 / voxel;
    let (ex, ey, ez) =
        (ellipsoid.extents.x * inverse, ellipsoid.extents.y * inverse, ellipsoid.extents.z * inverse);
    // A particle whose box misses the brick's box of nodes contributes nothing.
    if p[0] + ex < 0.0
        || p[0] - ex > LAST
        || p[1] + ey < 0.0
        || p[1] - ey > LAST
        || p[2] + ez < 0.0
        || p[2] - ez > LAST
    {
        return;
    }
    let mut m = ellipsoid.matrix;
    for part in &mut m {
        *part *= voxel * voxel;
    }
    let [xx, yy, zz, xy, xz, yz] = m;
    let mut dx: F32x8 = [0.0; LANES];
    for (x, d) in dx.iter_mut().enumerate() {
        *d = x as f32 - p[0];
    }
    let half = -0.5 / xx;
    let (first_z, last_z) = rows(p[2], ez);
    let (first_y, last_y) = rows(p[1], ey);
    for z in first_z..last_z {
        let dz = z as f32 - p[2];
        for y in first_y..last_y {
            let dy = y as f32 - p[1];
            // q² along the row: (xx dx + b) dx + c. Rows that the ellipsoid overlaps are computed completely:
            // eight nodes without a branch cost less than a test of each.
            let b = 2.0 * (xy * dy + xz * dz);
            let c = yy * dy * dy + zz * dz * dz + 2.0 * yz * dy * dz;
            let nearest = (half * b).clamp(dx[0], dx[BRICK - 1]);
            if (xx * nearest + b) * nearest + c >= 1.0 {
                continue;
            }
            let start = BRICK * (y + BRICK * z);
            let row: &mut F32x8 = (&mut values[start..start + BRICK]).try_into().expect("a row of eight");
            for lane in 0..LANES {
                let q2 = ((xx * dx[lane] + b) * dx[lane] + c).max(0.0);
                row[lane] += ellipsoid.weight * kernel(q2.sqrt()); // φ += V_j W
            }
        }
    }
}

/// The range of rows 0..8 within `reach` of `p`.
#[inline(always)]
pub(super) fn rows(p: f32, reach: f32) -> (usize, usize) {
    let first = (p - reach).ceil().max(0.0) as usize;
    let last = (p + reach).floor().clamp(-1.0, (BRICK - 1) as f32) as i32;
    (first, (last + 1) as usize)
}
