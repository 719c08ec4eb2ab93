//! What the liquid reports of its seeding and of a frame.

use serde::{Deserialize, Serialize};

/// What seeding the liquid did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LiquidSeeds {
    /// Particles.
    pub particles: u32,
    /// Particles left out because they lay in a solid, or closer to one than half a spacing.
    pub skipped_in_solids: u32,
    /// Particles left out because an earlier source had already put one closer than 0.9 spacings.
    pub skipped_overlapping: u32,
}

/// How often a limit changed a result, summed over the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Clamps {
    /// Particle corrections shortened to half a spacing, over all iterations.
    pub corrections: u64,
    /// Substeps after which velocities were scaled down because the mechanical energy exceeded the shot's first and the
    /// work of moving solids.
    pub energy: u64,
    /// Substeps in which vorticity confinement was scaled down to stay bounded.
    pub confinement: u64,
    /// Times the accelerated solver found its iteration running away and slowed it.
    pub momentum: u32,
    /// Particles that still touched a solid after the last collision pass, over all iterations.
    pub contacts: u64,
}

/// What happened to the liquid in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LiquidRecord {
    /// Substeps taken.
    pub substeps: u32,
    /// Solver iterations, over all substeps.
    pub iterations: u32,
    /// Substeps that ended at `max_iterations` above the target `density_dev`; 0 with fixed `iterations`.
    pub unconverged: u32,
    /// Mean over all particles of the constraint's error at the frame's end [1]: max(C, 0) for
    /// `constraint = "compression"`, |C| for `"equality"`, with C = ρ/ρ₀ − 1. This is what `density_dev` bounds.
    pub density_dev_avg: f64,
    /// Largest constraint error at the frame's end [1].
    pub density_dev_max: f64,
    /// Mean of |C|, dilation and compression alike, over the particles whose neighbourhood is filled [1].
    pub bulk_dev_avg: f64,
    /// ½ Σ m v² at the frame's end [J].
    pub kinetic_energy: f64,
    /// −Σ m g·x at the frame's end [J]; the zero is at the world's origin.
    pub potential_energy: f64,
    /// Energy that vorticity confinement added during the frame [J].
    pub confinement_energy: f64,
    /// Work of moving solids on the liquid during the frame [J]: what the liquid's energy may rise by.
    pub solid_work: f64,
    /// Limits that changed a result.
    pub clamps: Clamps,
    /// Neighbour lists built again within a substep because particles had moved farther than the skin.
    pub list_rebuilds: u32,
    /// Substeps longer than the CFL rule allows, because of `max_substeps`.
    pub cfl_capped: u32,
    /// Particles whose centre lies inside a solid at the frame's end.
    pub particles_inside_solids: u32,
}
