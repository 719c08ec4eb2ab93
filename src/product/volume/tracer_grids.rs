//! Grids of tracers: density, temperature, and the velocity and vector potential of the air.

use crate::{
    cache::WrittenFile,
    control::CancelToken,
    export::{
        ExportError,
        vdb::{self, Class, Grid, VolumeGrid, VolumeParams},
    },
    field::{TracerFieldParams, TracerFields, tracer_fields},
    frame::Stream,
    grid::{BRICK_NODES, is_set, node_of},
    math::Vec3,
    mesh::SurfaceParams,
    sim::{smoke::FrameAir, vortex::OutOfRange},
};
use std::path::Path;

/// The largest number of nodes that velocities reach beyond the smoke: faster smoke is blurred no farther.
const MAX_PADDING: f32 = 48.0;

/// The tracers of a frame.
pub(super) struct TracerFrame<'a> {
    pub(super) tracers: &'a Stream,
    pub(super) air: Option<&'a FrameAir>,
    /// Distance at which the tracers were seeded [m].
    pub(super) spacing: f32,
    /// The requested grids.
    pub(super) grids: &'a [VolumeGrid],
    /// Time as shown over time as simulated [–].
    pub(super) slowdown: f64,
}

/// The grids of the tracers of a frame.
pub(super) struct TracerGrids {
    voxel: f32,
    names: Vec<VolumeGrid>,
    fields: TracerFields<2>,
    /// 512 a brick [m/s]; empty if not wanted.
    velocity: Vec<Vec3>,
    /// 512 a brick [m²/s]; empty if not wanted.
    potential: Vec<Vec3>,
    pub(super) stats: TracerGridStats,
}

/// What the grids lack of the tracers.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TracerGridStats {
    /// Bricks of all grids.
    pub(super) bricks: usize,
    /// Tracers that no brick can hold, left out.
    pub(super) too_far: usize,
    /// Whether smoke moves farther in a frame than velocities reach beyond it.
    pub(super) truncated: bool,
}

/// Why the grids of a frame cannot be made.
#[derive(Debug)]
pub(super) enum TracerGridError {
    /// A channel is missing.
    Missing(&'static str),
    /// The air's velocity cannot be computed.
    OutOfRange(OutOfRange),
    /// The job is cancelled.
    Interrupted,
}

impl TracerGrids {
    /// The grids of the tracers of a `frame`, which is shown for at most `shutter` [s] of its own time. `cancel` is checked
    /// after every pass.
    ///
    /// # Errors
    /// [`TracerGridError`].
    pub(super) fn new(
        frame: &TracerFrame<'_>,
        shutter: f32,
        params: &SurfaceParams,
        cancel: &CancelToken,
    ) -> Result<Self, TracerGridError> {
        let TracerFrame { tracers, air, spacing, grids, slowdown } = *frame;
        let go_on = || if cancel.is_cancelled() { Err(TracerGridError::Interrupted) } else { Ok(()) };
        let positions = tracers.vec3("position").ok_or(TracerGridError::Missing("position"))?;
        let [density, temperature] =
            ["density", "temperature"].map(|name| tracers.f32(name).ok_or(TracerGridError::Missing(name)));
        let voxel = params.voxel * spacing;
        let air = air.filter(|_| grids.iter().any(|grid| grid.is_of_air()));
        let names: Vec<VolumeGrid> =
            grids.iter().copied().filter(|grid| !grid.is_of_air() || air.is_some()).collect();

        // As far as the fastest smoke moves while the shutter is open, velocities reach beyond it.
        let mut stats = TracerGridStats::default();
        let mut padding = 0;
        if let Some(air) = air {
            let speeds = air.velocity(positions).map_err(TracerGridError::OutOfRange)?;
            let fastest = speeds.iter().map(|v| v.norm()).fold(0.0, f32::max);
            let nodes = (fastest * shutter / voxel).ceil() + 1.0;
            stats.truncated = nodes > MAX_PADDING;
            padding = nodes.min(MAX_PADDING) as u32;
        }
        go_on()?;
        let radius = params.kernel_radius * spacing;
        let fields = TracerFieldParams { spacing, radius, voxel, padding };
        let fields = tracer_fields(positions, [density?, temperature?], &fields);
        go_on()?;
        // Both are slower where the smoke is shown slower: the potential's curl is the velocity.
        let near = |which, find: fn(&FrameAir, &[Vec3]) -> Result<Vec<Vec3>, OutOfRange>| match air {
            Some(air) if names.contains(&which) => {
                near_smoke(&fields, voxel, slowdown as f32, |x| find(air, x))
                    .map_err(TracerGridError::OutOfRange)
            }
            _ => Ok(Vec::new()),
        };
        let velocity = near(VolumeGrid::Velocity, FrameAir::velocity)?;
        go_on()?;
        let potential = near(VolumeGrid::VectorPotential, FrameAir::vector_potential)?;
        (stats.bricks, stats.too_far) = (fields.bricks.len(), fields.too_far);
        Ok(Self { voxel, names, fields, velocity, potential, stats })
    }

    /// The grids that were made.
    pub(super) fn names(&self) -> &[VolumeGrid] {
        &self.names
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
        let TracerFields { bricks, values: [density, temperature], reached, near, .. } = &self.fields;
        let grid = |&which: &VolumeGrid| {
            let (class, active) = match which {
                VolumeGrid::Density => (Class::FogVolume(density), reached),
                VolumeGrid::Temperature => (Class::FogVolume(temperature), reached),
                VolumeGrid::Velocity => (Class::Vector(&self.velocity), near),
                VolumeGrid::VectorPotential => (Class::Vector(&self.potential), near),
                VolumeGrid::Surface => unreachable!("smoke has no surface"),
            };
            Grid { name: which.name(), class, voxel: self.voxel, bricks, active }
        };
        let grids: Vec<Grid> = self.names.iter().map(grid).collect();
        vdb::write(&grids, path, params, key)
    }
}

/// What `find` returns at the nodes near smoke, over `slowdown`; zero elsewhere.
fn near_smoke(
    fields: &TracerFields<2>,
    voxel: f32,
    slowdown: f32,
    find: impl FnOnce(&[Vec3]) -> Result<Vec<Vec3>, OutOfRange>,
) -> Result<Vec<Vec3>, OutOfRange> {
    let near = (0..fields.bricks.len()).flat_map(|brick| {
        let mask = fields.near[brick];
        (0..BRICK_NODES).filter(move |&place| is_set(&mask, place)).map(move |place| (brick, place))
    });
    let near: Vec<(usize, usize)> = near.collect();
    let at = |&(brick, place): &(usize, usize)| {
        Vec3::from(node_of(fields.bricks.coords()[brick], place).map(|v| v as f32)) * voxel
    };
    let found = find(&near.iter().map(at).collect::<Vec<_>>())?;
    let mut values = vec![Vec3::zeros(); fields.bricks.len() * BRICK_NODES];
    for ((brick, place), value) in near.into_iter().zip(found) {
        values[brick * BRICK_NODES + place] = value / slowdown;
    }
    Ok(values)
}
