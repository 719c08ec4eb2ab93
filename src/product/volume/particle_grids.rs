//! Grids of particles: density as fog, level set, velocity.

use crate::{
    cache::WrittenFile,
    control::CancelToken,
    export::{
        ExportError,
        vdb::{self, Class, Grid, VolumeGrid, VolumeParams},
    },
    field::{Density, DensityParams, Velocity, density_of_radii, velocity},
    frame::Stream,
    grid::{Bricks, NodeMask, SparseGrid, masks_of},
    mesh::{RadiusScales, SurfaceError, SurfaceParams, positions},
    par,
    sdf::{SdfParams, SignedDistance, from_density},
};
use std::path::Path;

/// The grids of one stream of particles.
pub(super) struct ParticleGrids {
    /// Distance between nodes [m].
    voxel: f32,
    /// The bricks of the density.
    bricks: Bricks,
    /// The density as a fraction of filled space [–], 0 to 1, and its active nodes.
    fog: Option<(Vec<f32>, Vec<NodeMask>)>,
    /// The distance to the surface [m], where it was found, and bricks that lie deeper inside.
    surface: Option<(SignedDistance, Vec<NodeMask>, Vec<[i32; 3]>)>,
    /// The velocities on the bricks of the density.
    velocity: Option<Velocity>,
    pub(super) stats: ParticleGridStats,
}

/// What the grids lack of the particles.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ParticleGridStats {
    /// Bricks of the density.
    pub(super) bricks: usize,
    /// Particles that no brick can hold, left out.
    pub(super) too_far: usize,
    /// Particles between the nodes, without effect.
    pub(super) unseen: usize,
    /// Particles left out because there are more in their place than any liquid has.
    pub(super) clustered: usize,
    /// Nodes where the density was above 1.
    pub(super) over_one: usize,
    /// Nodes with a density and no velocity.
    pub(super) without_velocity: usize,
}

impl ParticleGrids {
    /// The `requested` grids of `particles` that are `spacing` [m] apart at rest. `cancel` is checked after every pass.
    /// Without velocities there is no velocity grid.
    ///
    /// # Errors
    /// If cancelled, or if positions are missing or not finite.
    pub(super) fn new(
        particles: &Stream,
        spacing: f32,
        params: &SurfaceParams,
        requested: &[VolumeGrid],
        cancel: &CancelToken,
    ) -> Result<Self, SurfaceError> {
        let go_on = || if cancel.is_cancelled() { Err(SurfaceError::Interrupted) } else { Ok(()) };
        let positions = positions(particles)?;
        let radii = RadiusScales::of(particles, spacing, params)?;
        let SurfaceParams { voxel, kernel_radius, anisotropy, distance, .. } = *params;
        let distance = SdfParams::from(distance.unwrap_or_default());
        // A level set needs what is near the surface, the others everything.
        let whole = requested.iter().any(|&grid| grid != VolumeGrid::Surface);
        let params = DensityParams { spacing, kernel_radius, voxel, anisotropy, whole };
        let scales = radii.as_ref().map(|radii| &*radii.values);
        let mut field = density_of_radii(positions, scales, &params);
        go_on()?;
        let mut stats = ParticleGridStats {
            bricks: field.grid.bricks.len(),
            too_far: field.too_far,
            unseen: field.unseen,
            clustered: field.clustered,
            ..ParticleGridStats::default()
        };

        let surface = requested.contains(&VolumeGrid::Surface).then(|| surface(&field, &distance));
        go_on()?;
        let is_dense = masks_of(&field.grid.values, |&v| v > 0.0);
        let velocities = particles.vec3("velocity").filter(|_| requested.contains(&VolumeGrid::Velocity));
        let velocity = velocities.map(|velocities| {
            let found = velocity(positions, velocities, &params, &field.grid.bricks);
            stats.without_velocity = count(&is_dense, &found.reached);
            found
        });
        go_on()?;
        if requested.contains(&VolumeGrid::Density) {
            stats.over_one = clamp_to_one(&mut field.grid.values);
        }
        let SparseGrid { voxel, bricks, values, .. } = field.grid;
        let fog = requested.contains(&VolumeGrid::Density).then_some((values, is_dense));
        Ok(Self { voxel, bricks, fog, surface, velocity, stats })
    }

    /// The grids that were made.
    pub(super) fn names(&self) -> Vec<VolumeGrid> {
        let there = |grid: &VolumeGrid| match grid {
            VolumeGrid::Density => self.fog.is_some(),
            VolumeGrid::Surface => self.surface.is_some(),
            VolumeGrid::Velocity => self.velocity.is_some(),
            VolumeGrid::Temperature | VolumeGrid::VectorPotential => false,
        };
        VolumeGrid::ALL.into_iter().filter(there).collect()
    }

    /// Writes the grids to `path` with a key; returns its size and checksum.
    ///
    /// # Errors
    /// As [`vdb::write`].
    pub(super) fn write(
        &self,
        path: &Path,
        params: &VolumeParams,
        key: u64,
    ) -> Result<WrittenFile, ExportError> {
        let Self { voxel, bricks, .. } = self;
        let grid = |which: VolumeGrid, class, bricks, active| Grid {
            name: which.name(),
            class,
            voxel: *voxel,
            bricks,
            active,
        };
        let mut grids = Vec::new();
        if let Some((values, active)) = &self.fog {
            grids.push(grid(VolumeGrid::Density, Class::FogVolume(values), bricks, active.as_slice()));
        }
        if let Some((SignedDistance { grid: distance, band, .. }, active, inside)) = &self.surface {
            let class = Class::LevelSet { values: &distance.values, half_width: *band, inside };
            grids.push(grid(VolumeGrid::Surface, class, &distance.bricks, active));
        }
        if let Some(Velocity { values, reached }) = &self.velocity {
            grids.push(grid(VolumeGrid::Velocity, Class::Vector(values), bricks, reached));
        }
        vdb::write(&grids, path, params, key)
    }
}

/// The distance to the surface of a density, the nodes it was found for, and the density's bricks deeper inside.
fn surface(field: &Density, params: &SdfParams) -> (SignedDistance, Vec<NodeMask>, Vec<[i32; 3]>) {
    let distance = from_density(&field.grid, field.threshold, params);
    let active = masks_of(&distance.grid.values, |v| v.abs() < distance.band);
    // A brick that the band does not reach is on one side as a whole.
    let coords = field.grid.bricks.coords().iter().enumerate();
    let inside = coords
        .filter(|(brick, _)| field.grid.brick(*brick)[0] >= field.threshold)
        .filter(|(_, coord)| distance.grid.bricks.find(**coord).is_none())
        .map(|(_, coord)| coord)
        .chain(field.grid.filled.coords().iter().filter(|&&coord| distance.grid.bricks.find(coord).is_none()))
        .copied()
        .collect();
    (distance, active, inside)
}

/// How many nodes are in `a` and not in `b`.
fn count(a: &[NodeMask], b: &[NodeMask]) -> usize {
    let words = a.as_flattened().iter().zip(b.as_flattened());
    words.map(|(a, b)| (a & !b).count_ones() as usize).sum()
}

/// Limits values to 1, and counts those that were above.
fn clamp_to_one(values: &mut [f32]) -> usize {
    let over = par::map_chunks(values.len(), par::CHUNK, |range| {
        values[range].iter().filter(|&&value| value > 1.0).count()
    });
    par::update(values, |_, value| *value = value.min(1.0));
    over.into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{field::density, frame::StreamKind, math::Vec3};

    /// A block of 24³ particles 0.1 m apart, whose centre lies deep inside.
    fn block() -> Stream {
        let n = 24;
        let point = |i: i32| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * 0.1;
        let positions: Vec<Vec3> = (0..n * n * n).map(point).collect();
        Stream::new("particles", StreamKind::Particles, positions.len()).with("position", positions)
    }

    #[test]
    fn a_level_set_lists_the_bricks_deeper_inside() {
        let particles = block();
        let params = SurfaceParams::default();
        let grids = |requested: &[VolumeGrid]| {
            ParticleGrids::new(&particles, 0.1, &params, requested, &CancelToken::new()).unwrap()
        };
        let alone = grids(&[VolumeGrid::Surface]);
        let all = grids(&[VolumeGrid::Density, VolumeGrid::Surface]);
        let (distance, _, mut inside) = alone.surface.unwrap();
        let (same, _, mut same_inside) = all.surface.unwrap();
        inside.sort_unstable();
        same_inside.sort_unstable();
        assert!(!inside.is_empty() && inside == same_inside, "{inside:?} {same_inside:?}");
        assert!(distance.grid.bricks.coords() == same.grid.bricks.coords());
        // The centre is 1.15 m from the origin, a brick is 0.4 m wide.
        assert!(inside.contains(&[2, 2, 2]), "{inside:?}");

        // With every brick of the density: each is in the band, or inside exactly if its nodes are.
        let whole = DensityParams {
            spacing: 0.1,
            kernel_radius: params.kernel_radius,
            voxel: params.voxel,
            anisotropy: params.anisotropy,
            whole: true,
        };
        let field = density(particles.vec3("position").unwrap(), &whole);
        for (brick, coord) in field.grid.bricks.coords().iter().enumerate() {
            let in_band = distance.grid.bricks.find(*coord).is_some();
            let is_inside = inside.binary_search(coord).is_ok();
            assert!(!(in_band && is_inside), "{coord:?} is both");
            if !in_band {
                let nodes = field.grid.brick(brick);
                let dense = nodes.iter().all(|&v| v >= field.threshold);
                let thin = nodes.iter().all(|&v| v < field.threshold);
                assert!(dense || thin, "the band reaches {coord:?}");
                assert_eq!(is_inside, dense, "{coord:?}");
            }
        }
        // Nothing is inside that holds no particle.
        assert!(inside.iter().all(|coord| field.grid.bricks.find(*coord).is_some()));
    }
}
