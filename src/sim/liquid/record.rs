//! Records of the liquid: its seeding, and every frame.

use crate::sim::force::ForceRecord;
use serde::{Deserialize, Serialize};

/// Report of the liquid's seeding.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct LiquidSeeds {
    /// Number of particles.
    pub particles: u32,
    /// Particles skipped because they were in a solid, or closer to one than half a spacing.
    pub skipped_in_solids: u32,
    /// Particles skipped because a particle of an earlier source was closer than 0.9 spacings.
    pub skipped_overlapping: u32,
    /// Largest dynamic viscosity of a source [Pa·s]; 0 without, and after a restart.
    pub viscosity: f64,
    /// Dynamic viscosity with which eddies fade in the solver itself, at the speed of falling through the liquid's height [Pa·s].
    pub solver_viscosity: f64,
    /// That speed [m/s].
    pub speed: f64,
    /// Whether the rows of resting liquid can hold rigid bodies, as viscosity keeps them and the kernel is narrow; not after a restart.
    pub rows_hold_bodies: bool,
    /// The smallest of the bodies that start inside liquid and are few spacings thick, if viscosity does not slow them; none after a restart.
    pub submerged_body: Option<SubmergedBody>,
    /// The sources without particles, in order; none after a restart.
    pub empty_sources: Vec<EmptySource>,
    /// Colliders so thin that liquid on one side acts on liquid on the other, in order; none after a restart.
    pub thin_solids: Vec<ThinSolid>,
    /// Largest coordinate of a particle in magnitude, where it is so large that single precision stops slow motion [m]; 0 otherwise and
    /// after a restart.
    pub far_from_origin: f64,
    /// Largest coordinate at which it does not [m].
    pub precise_distance: f64,
    /// The nozzles of the emitters, in order; none after a restart.
    pub nozzles: Vec<NozzleReport>,
    /// Outflows thinner than a spacing, in order; none after a restart.
    pub thin_outflows: Vec<u32>,
    /// Largest speed that `cfl` and `max_substeps` allow without gravity [m/s].
    pub allowed_speed: f64,
}

/// The smallest of the rigid bodies that start inside the liquid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct SubmergedBody {
    /// Index of the body.
    pub index: u32,
    /// Number of the others.
    pub others: u32,
    /// Inner radius over the spacing.
    pub spacings: f64,
}

/// The nozzle of an emitter at the start of a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct NozzleReport {
    /// Particles in a layer.
    pub columns: u32,
    /// Area of its cross-section: that of the particles [m²].
    pub area: f64,
    /// Area of the outline of its shape, as seen against the flow [m²].
    pub outline_area: f64,
    /// Columns that begin in a solid, or closer to one than half a spacing.
    pub in_solids: u32,
    /// Columns that end at a solid within the reach of the kernel.
    pub at_wall: u32,
    /// Columns that begin in an outflow or outside of the domain.
    pub in_outflow: u32,
    /// Largest speed of the liquid in it over the shot [m/s].
    pub max_speed: f64,
}

/// Particles that entered and left during a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct FlowRecord {
    /// Particles that each emitter emitted.
    pub emitted: Vec<u64>,
    /// Particles that each emitter did not emit because their place was in a solid.
    pub blocked_by_solids: Vec<u64>,
    /// Particles that each emitter did not emit because another particle was in their place.
    pub blocked_by_liquid: Vec<u64>,
    /// Particles that left a nozzle early because it led them into a solid.
    pub released_early: u64,
    /// Particles that each outflow removed.
    pub removed: Vec<u64>,
    /// Particles that left through each open side of the domain: lower and upper x, y, z.
    pub left_by_side: [u64; 6],
    /// Particles that left the domain where no side is open. They were removed.
    pub left_by_accident: u64,
    /// Work of the nozzles on the liquid [J]. The liquid's energy may rise by it.
    pub nozzle_work: f64,
    /// Particles at the frame's end.
    pub present: u64,
    /// Sums since the start of the shot.
    pub totals: FlowTotals,
}

/// Particles that entered and left since the start of a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct FlowTotals {
    /// Particles at the start.
    pub initial: u64,
    /// Emitted particles.
    pub emitted: u64,
    /// Particles removed by outflows and open sides.
    pub removed: u64,
    /// Particles that left the domain where no side is open.
    pub left_by_accident: u64,
}

impl FlowTotals {
    /// Names of the numbers in the header of a cached frame, in order.
    pub(in crate::sim) const NAMES: [&'static str; 4] =
        ["initial_particles", "emitted_particles", "removed_particles", "lost_particles"];

    /// The numbers in the order of [`Self::NAMES`].
    pub(super) fn values(&self) -> [u64; 4] {
        [self.initial, self.emitted, self.removed, self.left_by_accident]
    }

    /// The totals of numbers in the order of [`Self::NAMES`].
    pub(in crate::sim) fn of([initial, emitted, removed, left_by_accident]: [u64; 4]) -> Self {
        Self { initial, emitted, removed, left_by_accident }
    }
}

/// A collider thinner than the kernel reaches between particles that rest on both of its sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct ThinSolid {
    /// Index of the collider or rigid body in the preset, from 0.
    pub index: u32,
    /// Whether it is a rigid body.
    pub is_body: bool,
    /// Largest thickness of the collider [m].
    pub thickness: f64,
    /// Thickness from which on the collider separates liquids [m].
    pub sufficient_thickness: f64,
}

/// A source that holds no particle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct EmptySource {
    /// Index of the source in the preset, from 0.
    pub index: u32,
    /// Particles skipped, in solids or because of earlier sources; 0 if the source is too small or too thin.
    pub skipped: u32,
    /// Volume of the source, in particles.
    pub volume: f64,
    /// Spacing at which the source has particles [m]; `None` if none was found, or if all were skipped.
    pub sufficient_spacing: Option<f64>,
}

/// How often a limit changed a result, summed over the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Clamps {
    /// Particle corrections shortened to half a spacing, over all iterations.
    pub corrections: u64,
    /// Substeps after which velocities were scaled down because the energy, with that of the microrotation, exceeded the shot's first energy and
    /// the work of moving solids.
    pub energy: u64,
    /// Substeps in which vorticity confinement was scaled down to its bound.
    pub confinement: u64,
    /// Substeps in which the exchange of the micropolar model was scaled down to its bound.
    pub micropolar: u64,
    /// Number of times that the accelerated solver detected a diverging iteration and slowed it.
    pub momentum: u32,
    /// Particles still in contact with a solid after the last projection, over all iterations.
    pub contacts: u64,
}

/// Record of the liquid over a frame. It is the same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct LiquidRecord {
    /// Number of substeps.
    pub substeps: u32,
    /// Solver iterations, over all substeps.
    pub iterations: u32,
    /// Substeps that ended at `max_iterations` above the deviation at which they should stop, not above the smaller ones of the first
    /// substeps; 0 with fixed `iterations`.
    pub unconverged: u32,
    /// Iterations of the viscous solve, over all substeps.
    pub viscosity_iterations: u32,
    /// Viscous solves that ended at their `max_iterations` above `tolerance`.
    pub viscosity_unconverged: u32,
    /// Density solves before the viscous ones that ended at `max_iterations`: walls and viscosity then hold a part of the weight.
    pub pressure_unconverged: u32,
    /// Largest residual of a viscous solve, relative to the change of velocity [1].
    pub viscosity_residual: f64,
    /// Mean over all particles of the constraint's error at the frame's end [1]: max(C, 0) for
    /// `constraint = "compression"`, |C| for `"equality"`, with C = ρ/ρ₀ − 1, to which
    /// `"compression"` adds the density that a particle lacks at the free surface. This is what `density_dev` bounds in liquid at
    /// rest.
    pub density_dev_avg: f64,
    /// Largest constraint error at the frame's end [1].
    pub density_dev_max: f64,
    /// Compression of the bulk: mean of max(C, 0) over the particles whose neighbourhood is filled, at the frame's end [1].
    pub compression_avg: f64,
    /// Dilation of the bulk: mean of max(−C, 0) over the same particles [1].
    pub dilation_avg: f64,
    /// Particles whose neighbourhood is filled: those of the surface and of splashes are not.
    pub bulk_particles: u32,
    /// Volume of the liquid at the frame's end [m³]: spacing³ ρ₀/ρ for a particle of the bulk; for any other the mean of the
    /// bulk within the kernel's support, or spacing³.
    pub volume: f64,
    /// Volume over that of as many particles at rest, less one [1].
    pub volume_change: f64,
    /// Particles with fewer than five neighbours within the kernel's support.
    pub isolated: u32,
    /// Connected components of the particles that are closer than 1.5 spacings.
    pub components: u32,
    /// Kinetic energy ½ Σ m v² at the frame's end [J].
    pub kinetic_energy: f64,
    /// Potential energy −Σ m g·x at the frame's end [J]; zero at the world's origin.
    pub potential_energy: f64,
    /// Energy of the free surface, of cohesion and of wetting by `surface_tension` [J], where it was evaluated in the last
    /// substep; zero without the term. It may be negative.
    pub surface_energy: f64,
    /// Energy that vorticity confinement added during the frame [J].
    pub confinement_energy: f64,
    /// Kinetic energy ½ Σ m Θ ω² of the microrotation of `micropolar` at the frame's end [J]; zero without the term.
    pub microrotation_energy: f64,
    /// Energy that the micropolar exchange added to velocities and microrotation together during the frame [J]; negative if
    /// it removed some.
    pub micropolar_energy: f64,
    /// Work of moving solids on the liquid during the frame [J]. The liquid's energy may rise by it.
    pub solid_work: f64,
    /// Energy that friction on solids dissipated during the frame [J].
    pub friction_dissipation: f64,
    /// Limits that changed a result.
    pub clamps: Clamps,
    /// Neighbour lists rebuilt within a substep because particles had moved farther than the skin.
    pub list_rebuilds: u32,
    /// Substeps longer than the CFL rule allows, because of `max_substeps`.
    pub cfl_capped: u32,
    /// Particles whose centre lies inside a solid at the frame's end.
    pub particles_inside_solids: u32,
    /// Particles that entered and left; `None` without emitters, outflows and a domain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow: Option<FlowRecord>,
    /// Force fields; `None` without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forces: Option<ForceRecord>,
}

/// A figure of a frame: its name in the header of the cached frame, and its value.
type FrameFigure = (&'static str, fn(&LiquidRecord) -> f64);

/// The figures of a frame's end that the header of the cached frame holds, so that a cache is judged without its log.
pub(super) const FRAME_FIGURES: [FrameFigure; 8] = [
    ("density_dev_avg", |record| record.density_dev_avg),
    ("density_dev_max", |record| record.density_dev_max),
    ("compression_avg", |record| record.compression_avg),
    ("dilation_avg", |record| record.dilation_avg),
    ("volume", |record| record.volume),
    ("volume_change", |record| record.volume_change),
    ("isolated", |record| f64::from(record.isolated)),
    ("components", |record| f64::from(record.components)),
];

impl LiquidRecord {
    /// Density deviation of the bulk, compression and dilation together: the mean of |C| [1].
    pub fn bulk_dev_avg(&self) -> f64 {
        self.compression_avg + self.dilation_avg
    }
}
