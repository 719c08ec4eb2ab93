//! From the tracers and vortons of a frame to the grids of a volume file.

use super::volume::SmokeFrame;
use crate::{
    export::{
        ExportError,
        vdb::{self, Class, Grid, VolumeGrid, VolumeParams},
    },
    field::{Carried, CarriedParams, carried},
    grid::{BRICK_NODES, is_set, node_of},
    math::Vec3,
    mesh::SurfaceParams,
    sim::{smoke::FrameAir, vortex::OutOfRange},
};
use std::path::Path;

/// Nodes that velocities reach beyond the smoke at most: faster smoke is blurred no farther.
const MOST_PADDING: f32 = 48.0;

/// The grids of the smoke of a frame.
pub(super) struct SmokeGrids {
    voxel: f32,
    wanted: Vec<VolumeGrid>,
    carried: Carried<2>,
    /// 512 a brick [m/s]; empty if not wanted.
    velocity: Vec<Vec3>,
    pub(super) stats: SmokeStats,
}

/// What happened on the way.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SmokeStats {
    /// Bricks of all grids.
    pub(super) bricks: usize,
    /// Tracers that no brick can hold, left out.
    pub(super) too_far: usize,
    /// Whether smoke moves farther in a frame than velocities reach beyond it.
    pub(super) short: bool,
}

/// Why the grids of a frame cannot be made.
#[derive(Debug)]
pub(super) enum NoGrids {
    /// A channel is not there.
    Missing(&'static str),
    /// The air's velocity cannot be found.
    OutOfRange(OutOfRange),
    /// The user stops the job.
    Interrupted,
}

impl SmokeGrids {
    /// The grids of the `smoke` of a frame, which is shown for `shutter` [s] of its own time at most. `keep_going` is asked after
    /// every pass.
    ///
    /// # Errors
    /// [`NoGrids`].
    pub(super) fn new(
        smoke: &SmokeFrame<'_>,
        shutter: f32,
        params: &SurfaceParams,
        keep_going: &dyn Fn() -> bool,
    ) -> Result<Self, NoGrids> {
        let SmokeFrame { tracers, air, spacing, wanted, slower } = *smoke;
        let go_on = || if keep_going() { Ok(()) } else { Err(NoGrids::Interrupted) };
        let positions = tracers.vec3("position").ok_or(NoGrids::Missing("position"))?;
        let [density, temperature] =
            ["density", "temperature"].map(|name| tracers.f32(name).ok_or(NoGrids::Missing(name)));
        let voxel = params.voxel * spacing;
        let air = air.filter(|_| wanted.contains(&VolumeGrid::Velocity));
        let wanted: Vec<VolumeGrid> =
            wanted.iter().copied().filter(|&grid| grid != VolumeGrid::Velocity || air.is_some()).collect();

        // As far as the fastest smoke moves while the shutter is open, velocities reach beyond it.
        let mut stats = SmokeStats::default();
        let mut padding = 0;
        if let Some(air) = air {
            let speeds = air.velocity(positions).map_err(NoGrids::OutOfRange)?;
            let fastest = speeds.iter().map(|v| v.norm()).fold(0.0, f32::max);
            let nodes = (fastest * shutter / voxel).ceil() + 1.0;
            stats.short = nodes > MOST_PADDING;
            padding = nodes.min(MOST_PADDING) as u32;
        }
        go_on()?;
        let radius = params.kernel_radius * spacing;
        let fields = CarriedParams { spacing, radius, voxel, padding };
        let carried = carried(positions, [density?, temperature?], &fields);
        go_on()?;
        let velocity = match air {
            Some(air) => velocities(&carried, voxel, air, slower as f32).map_err(NoGrids::OutOfRange)?,
            None => Vec::new(),
        };
        (stats.bricks, stats.too_far) = (carried.bricks.len(), carried.too_far);
        Ok(Self { voxel, wanted, carried, velocity, stats })
    }

    /// Which grids there are.
    pub(super) fn names(&self) -> &[VolumeGrid] {
        &self.wanted
    }

    /// Writes the grids to `path` with a key; returns the file's size [bytes].
    ///
    /// # Errors
    /// As [`vdb::write`].
    pub(super) fn write(&self, path: &Path, params: &VolumeParams, key: u64) -> Result<u64, ExportError> {
        let Carried { bricks, values: [density, temperature], reached, near, .. } = &self.carried;
        let grid = |&which: &VolumeGrid| {
            let (class, active) = match which {
                VolumeGrid::Density => (Class::FogVolume(density), reached),
                VolumeGrid::Temperature => (Class::FogVolume(temperature), reached),
                VolumeGrid::Velocity => (Class::Vector(&self.velocity), near),
                VolumeGrid::Surface => unreachable!("smoke has no surface"),
            };
            Grid { name: which.name(), class, voxel: self.voxel, bricks, active }
        };
        let grids: Vec<Grid> = self.wanted.iter().map(grid).collect();
        vdb::write(&grids, path, params, key)
    }
}

/// The air's velocity over `slower` at the nodes near smoke, zero elsewhere.
fn velocities(
    carried: &Carried<2>,
    voxel: f32,
    air: &FrameAir,
    slower: f32,
) -> Result<Vec<Vec3>, OutOfRange> {
    let near = (0..carried.bricks.len()).flat_map(|brick| {
        let mask = carried.near[brick];
        (0..BRICK_NODES).filter(move |&place| is_set(&mask, place)).map(move |place| (brick, place))
    });
    let near: Vec<(usize, usize)> = near.collect();
    let at = |&(brick, place): &(usize, usize)| {
        Vec3::from(node_of(carried.bricks.coords()[brick], place).map(|v| v as f32)) * voxel
    };
    let found = air.velocity(&near.iter().map(at).collect::<Vec<_>>())?;
    let mut values = vec![Vec3::zeros(); carried.bricks.len() * BRICK_NODES];
    for ((brick, place), velocity) in near.into_iter().zip(found) {
        values[brick * BRICK_NODES + place] = velocity / slower;
    }
    Ok(values)
}
