//! Parameters of a liquid.

use super::inflow::{LiquidDomain, LiquidEmitter, LiquidOutflow};
use crate::{math::Vec3, sim::setup::from_spacing, solid::Shape};
use serde::{Deserialize, Serialize};

/// [`LiquidParams::implicitness`] if the preset names none, without surface tension.
const IMPLICITNESS: f32 = 0.1;

/// Linear colour of sources that have none where others have one: white paint.
const NO_COLOR: [f32; 3] = [0.8; 3];

/// A liquid of particles, kept at rest density by position corrections ([pbf] Algorithm 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LiquidParams {
    /// Distance between particles at rest [m]: half the distance gives eight times the particles and finer splashes.
    /// Range: above 0.
    pub spacing: f32,
    /// Rest density ρ₀ [kg/m³]. It scales energies and coupling forces, but does not change the motion.
    /// Range: above 0.
    #[serde(default = "defaults::density")]
    pub density: f32,
    /// Support h of the smoothing kernels, in spacings. Below 1.8 neighbours are too few and free liquid swells (by 13 % at 1.2);
    /// above 2.5 still water swells (by 5 % at 2.8). 2.2 lets low waves run as fast as in theory, with a third more neighbours
    /// than 2; 2.5 lets small drops oscillate under `surface_tension`. More blurs detail, and the cost grows with its cube.
    /// Range: 1.8 to 2.5.
    #[serde(default = "defaults::kernel_radius")]
    pub kernel_radius: f32,
    /// Average density deviation of liquid at rest [1] ("0.5 %"). The iteration stops at it. Under gravity, with the accelerated solver,
    /// `compression` and `wendland`, a substep retains a part of the deviation, `density_dev` over 1 % and at most half, and stops at the
    /// rest. Excludes `iterations`; with neither in the preset
    /// it is 0.3 %. With `compression`, the deviation is the mean of max(C, 0) over all particles, where C is ρ/ρ₀ − 1 plus what a particle lacks at the
    /// free surface; with `equality`
    /// that of |ρ/ρ₀ − 1|; dilation that `compression` allows is reported, and does not count here. A larger value is faster and
    /// bouncier; above a few per cent the liquid visibly loses volume. Range: above 0, at most 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_dev: Option<f32>,
    /// Most iterations of a substep to reach `density_dev`; it takes at least 2, if this allows them. With too few, deep water
    /// bounces; the frame's record counts the substeps that ended above the target. Range: 1 to 100000.
    #[serde(default = "defaults::max_iterations")]
    pub max_iterations: u32,
    /// Fixed number of iterations of a substep, as in the paper (2–10), instead of `density_dev`. Range: 1 to 100000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// CFL number: largest displacement of a particle in a substep, in spacings, and of surface waves on the deepest liquid. A larger
    /// value is faster; above 1 thin colliders leak, splashes scatter, and deep liquid at rest swells. Range: above 0, at most 10.
    #[serde(default = "defaults::cfl")]
    pub cfl: f32,
    /// Fewest substeps of a frame. More substeps cost time and keep deep water from bouncing: 32 layers sag by 2 % and surge
    /// at 20 ms a substep, and hardly at 5 ms. Range: 1 to 10000.
    #[serde(default = "defaults::min_substeps")]
    pub min_substeps: u32,
    /// Most substeps of a frame; if the CFL rule or the surface tension needs more, the frame's record counts them in `cfl_capped`.
    /// Range: 1 to 10000.
    #[serde(default = "defaults::max_substeps")]
    pub max_substeps: u32,
    /// Solver of the density constraints.
    #[serde(default)]
    pub solver: SolverKind,
    /// Kernels of densities and gradients.
    #[serde(default)]
    pub kernel: Kernel,
    /// Density errors that are corrected.
    #[serde(default)]
    pub constraint: Constraint,
    /// Constraint softening ε of [pbf] Eq. 11, as a fraction of Σ|∇C|² on the filled seeding lattice. A larger value is calmer
    /// and converges less; with 0 particles jitter where they separate. Range: 0 to 1000.
    #[serde(default = "defaults::softening")]
    pub softening: f32,
    /// Implicitness θ of the directions of corrections, which the `accelerated` solver evaluates between the positions at the
    /// start of a substep (0) and the predicted ones (1, as in the paper, and always with `jacobi`, `equality` or `poly6_spiky`).
    /// With 1 the
    /// liquid loses energy in proportion to the substep: 13 % of a dam break's in its first second, with 0.1 9 %. With 0 nothing
    /// damps the modes of deep water. Under high pressure, and in substeps of many iterations, it rises to 1 by itself. Absent:
    /// 0.1, and with `surface_tension` 1, since slow drops and threads freeze at 0.1. Range: 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub implicitness: Option<f32>,
    /// Channels of cached particles in addition to `position`, `velocity` and `id`, for `surface.attributes` and other tools;
    /// empty: no more. They do not change the motion, but a cache without them must be simulated again to get them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<LiquidChannel>,
    /// The paper's artificial pressure, against clumping under `constraint = "equality"`, without which it is refused; absent:
    /// not applied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub artificial_pressure: Option<ArtificialPressure>,
    /// Surface tension and wetting; absent: not applied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface_tension: Option<SurfaceTension>,
    /// Vorticity confinement, returns energy that the solver dissipated to vortices; absent: not applied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vorticity: Option<VorticityConfinement>,
    /// Micropolar model: particles have an angular velocity of their own, which drives vortices; absent: not applied. Excludes
    /// `vorticity`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub micropolar: Option<Micropolar>,
    /// Viscosity in Pa·s, with liquid that sticks to solids; absent: not applied, and solids have the friction that they name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viscosity: Option<ImplicitViscosity>,
    /// XSPH viscosity, smooths velocities over neighbours; absent: not applied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub xsph: Option<Xsph>,
    /// Volumes of liquid at the start; at least one, or an emitter.
    #[serde(default)]
    pub source: Vec<LiquidSource>,
    /// Nozzles from which liquid flows while the shot runs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emitter: Vec<LiquidEmitter>,
    /// Volumes that remove liquid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outflow: Vec<LiquidOutflow>,
    /// The box in which the liquid is simulated; absent: unbounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub domain: Option<LiquidDomain>,
}

impl LiquidParams {
    /// A liquid of particles `spacing` [m] apart with the defaults of presets, still without a source.
    pub fn new(spacing: f32) -> Self {
        Self { density_dev: Some(Self::DEFAULT_DENSITY_DEV), ..from_spacing(spacing) }
    }

    /// Average density deviation of liquid at rest if a preset gives neither `density_dev` nor `iterations`.
    ///
    /// At 1 % a metre of water sags by a centimetre and bounces back; 0.1 % takes twice the iterations for a picture that
    /// hardly differs. See docs/decisions/006.
    pub const DEFAULT_DENSITY_DEV: f32 = 0.003;

    /// Whether the scheme is the one for which early directions and retained deviations were measured; with others water boils.
    pub(super) fn is_calibrated(&self) -> bool {
        self.solver == SolverKind::Accelerated
            && self.constraint == Constraint::Compression
            && self.kernel == Kernel::Wendland
    }

    /// θ of the first directions of a substep.
    pub(super) fn first_theta(&self) -> f32 {
        if !self.is_calibrated() {
            return 1.0;
        }
        let default = if self.surface_tension.is_some() { 1.0 } else { IMPLICITNESS };
        self.implicitness.unwrap_or(default)
    }

    /// The channels of cached particles that depend on the preset, in the order of frames.
    pub(super) fn frame_channels(&self) -> impl Iterator<Item = LiquidChannel> + '_ {
        let is_needed = |channel: &LiquidChannel| *channel == LiquidChannel::Source && self.needs_sources();
        LiquidChannel::ALL
            .into_iter()
            .filter(move |channel| self.channels.contains(channel) || is_needed(channel))
    }

    /// Whether particles have the number of their source, whatever `channels` names.
    pub(super) fn needs_sources(&self) -> bool {
        self.has_viscosity_by_source() || self.colors().is_some()
    }

    /// Linear colour of each source and, after them, of each emitter; `None` if none has one.
    pub(super) fn colors(&self) -> Option<Vec<Vec3>> {
        let sources = self.source.iter().map(|source| source.color);
        let colors: Vec<_> = sources.chain(self.emitter.iter().map(|emitter| emitter.color)).collect();
        let has_any = colors.iter().any(Option::is_some);
        has_any.then(|| colors.into_iter().map(|color| color.unwrap_or(NO_COLOR).into()).collect())
    }

    /// The same liquid without colours, which do not change its motion; frames have the sources all the same.
    pub(in crate::sim) fn without_colors(&self) -> Self {
        let mut without = self.clone();
        if without.colors().is_some() && !without.has_viscosity_by_source() {
            without.channels.push(LiquidChannel::Source);
        }
        without.source.iter_mut().for_each(|source| source.color = None);
        without.emitter.iter_mut().for_each(|emitter| emitter.color = None);
        without
    }

    /// Whether particles of a source are displaced from their seeding lattice.
    pub(super) fn has_jitter(&self) -> bool {
        self.source.iter().any(|source| source.jitter.is_some())
    }

    /// Whether a source or an emitter has its own viscosity.
    pub(super) fn has_viscosity_by_source(&self) -> bool {
        self.each_viscosity().any(|viscosity| viscosity.is_some())
    }

    /// Dynamic viscosity of each source and, after them, of each emitter [Pa·s]; empty without `liquid.viscosity`.
    pub(super) fn viscosities(&self) -> Vec<f32> {
        let Some(all) = &self.viscosity else { return Vec::new() };
        self.each_viscosity().map(|viscosity| viscosity.unwrap_or(all.dynamic)).collect()
    }

    fn each_viscosity(&self) -> impl Iterator<Item = Option<f32>> + '_ {
        let sources = self.source.iter().map(|source| source.viscosity);
        sources.chain(self.emitter.iter().map(|emitter| emitter.viscosity))
    }

    /// Average deviation of liquid at rest; `None`: a fixed number of iterations.
    pub(super) fn target(&self) -> Option<f64> {
        match (self.iterations, self.density_dev) {
            (Some(_), _) => None,
            (None, dev) => Some(f64::from(dev.unwrap_or(Self::DEFAULT_DENSITY_DEV))),
        }
    }
}

/// A channel that cached particles have only if the preset names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LiquidChannel {
    /// Seconds since the particle was seeded or emitted. With emitters, frames also have the channel `birth`, the time of that
    /// since the start of the shot [s].
    Age,
    /// Index of the particle's `[[liquid.source]]`, from 0; those of `[[liquid.emitter]]` follow. Frames have it in any case
    /// where a source or an emitter has its own viscosity or colour.
    Source,
    /// Dynamic viscosity of the particle's source [Pa·s]; needs the table `liquid.viscosity`.
    Viscosity,
}

impl LiquidChannel {
    /// All channels, in the order of frames.
    pub const ALL: [Self; 3] = [Self::Age, Self::Source, Self::Viscosity];

    /// Name of the channel in presets and in frames.
    pub fn name(self) -> &'static str {
        match self {
            Self::Age => "age",
            Self::Source => "source",
            Self::Viscosity => "viscosity",
        }
    }
}

/// Solver of the density constraints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SolverKind {
    /// Projected Jacobi iterations with momentum and a warm start: deep water takes at most a third of the iterations.
    #[default]
    Accelerated,
    /// The paper's Jacobi iterations.
    Jacobi,
}

/// Pair of a density kernel and a gradient kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Kernel {
    /// Wendland's C2 for both: corrections follow the gradient of the density, and water at rest stays at rest.
    #[default]
    Wendland,
    /// Poly6 for densities and Spiky for gradients, as in the paper: disordered water is a few per cent too dense, and
    /// jitters.
    Poly6Spiky,
}

/// Density errors that the solver corrects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Constraint {
    /// Compression only (C ≥ 0): splashes separate freely and volume is conserved. C includes the density that a particle
    /// lacks at the free surface, which keeps particles there from clustering. With the accelerated solver and Wendland's kernel the liquid
    /// bears a little tension inside, so that falling jets become thinner.
    #[default]
    Compression,
    /// Compression and dilation (C = 0), as in the paper, to be used with `artificial_pressure`: the surface contracts, and a
    /// drop of 15 particles across loses 7 to 12 % of its volume.
    Equality,
}

/// Artificial pressure s_corr, [pbf] Eq. 13, for `constraint = "equality"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct ArtificialPressure {
    /// The paper's k, as an acceleration: at 0.1, two particles half a spacing apart repel with about ten g. A smaller value
    /// lets surfaces clump under `constraint = "equality"`; near 1 the liquid boils. Range: 0 to 10.
    pub strength: f32,
    /// The paper's |Δq|/h, the distance at which the term reaches `strength`. Range: 0 to 0.9.
    pub reference: f32,
    /// The paper's exponent n. Range: 1 to 12.
    pub exponent: u32,
}

impl Default for ArtificialPressure {
    fn default() -> Self {
        Self { strength: 0.1, reference: 0.2, exponent: 4 }
    }
}

/// Surface tension and wetting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceTension {
    /// Surface tension σ [N/m]: water 0.072, oil 0.03, mercury 0.49. It rounds drops and draws sheets together; what it does
    /// is visible up to a size of about √(σ/(ρ g)), 3 mm for water. A value far above the liquid's own gives large splashes
    /// the look of small ones. Substeps become shorter with its square root. Range: 0 to 1000.
    pub coefficient: f32,
    /// Contact angle θ of a drop on the colliders [°]: below 90 the liquid wets them and creeps along them, above it beads.
    /// Range: 0 to 180.
    pub contact_angle: f32,
}

impl Default for SurfaceTension {
    fn default() -> Self {
        Self { coefficient: 0.072, contact_angle: 90.0 }
    }
}

/// Vorticity confinement, [pbf] Eqs. 15–16.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct VorticityConfinement {
    /// The paper's ε over √(g₀ · spacing), with g₀ = 9.81 m/s². A larger value whips splashes up: on a dam break, 0.05 adds
    /// 0.03 % of the energy per frame, which is invisible, 0.5 adds 0.2 %, 2 adds 2 % and frays the surface. The term
    /// never returns more energy than the liquid has lost since the start, and leaves alone rotation that is slow against gravity in a
    /// substep. Range: 0 to 10.
    pub strength: f32,
}

impl Default for VorticityConfinement {
    fn default() -> Self {
        Self { strength: 0.5 }
    }
}

/// Micropolar model ([bender17]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Micropolar {
    /// The paper's transfer coefficient ν_t over spacing · √(g₀ · spacing), with g₀ = 9.81 m/s²; 1 is 0.009 m²/s at a spacing of
    /// 2 cm. With a larger value eddies last longer. On a dam break, 0.5 returns 5 % of the energy within a second; at 1 the
    /// liquid boils: it dilates by 1 to 2 %, and twice as many particles scatter. The term never returns more energy than the
    /// liquid has lost since the start. Range: 0 to 10.
    pub transfer: f32,
    /// The paper's viscosity ζ of the microrotation over its inertia Θ, in the same unit. With 0 single particles spin by
    /// themselves; with a larger value only larger eddies are driven, and less. Range: 0 to 10.
    pub viscosity: f32,
}

impl Default for Micropolar {
    fn default() -> Self {
        Self { transfer: 0.5, viscosity: 0.1 }
    }
}

/// Viscosity, solved implicitly ([weiler18]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ImplicitViscosity {
    /// Dynamic viscosity μ [Pa·s]: water 1e-3, olive oil 0.1, glycerine 1, honey 10, peanut butter 250, tar 1e4. A larger value
    /// flows more slowly, folds and piles up; with a smaller one than the spacing resolves, the picture is that of water.
    /// The result does not depend on the substep. Sources and emitters may have their own `viscosity`. Range: above 0, at most 1e8.
    pub dynamic: f32,
    /// Residual at which the solve stops, relative to the change of velocity by viscosity [1]. A larger value is faster: 0.2 takes
    /// half of the iterations of the default, with fronts of thick liquids within 0.3 %. Momentum is conserved with any. Range: above 0, at most 0.5.
    #[serde(default = "defaults::viscosity_tolerance")]
    pub tolerance: f32,
    /// Most iterations of a solve. With too few, thick liquids flow as if they were thinner; the frame's record counts the
    /// solves that stopped above `tolerance`. Range: 1 to 100000.
    #[serde(default = "defaults::viscosity_iterations")]
    pub max_iterations: u32,
}

/// XSPH viscosity, [pbf] Eq. 17.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Xsph {
    /// The paper's c: fraction by which a particle's velocity approaches the mean of its neighbours in each substep. Its
    /// effect depends on the substep; for honey or oil, see `liquid.viscosity`. Range: 0 to 1.
    #[cfg_attr(feature = "presets", schemars(extend("former" = "liquid.viscosity.strength")))]
    pub strength: f32,
    /// Fraction added to `strength` for neighbours at rest relative to each other, so that still water is still; half of it acts
    /// at two fifths of the velocity that gravity adds in a substep, which the solver cannot resolve; without gravity, none. Without it a
    /// pool jitters at 9 mm/s. Range: 0 to 0.5.
    pub rest: f32,
}

impl Default for Xsph {
    fn default() -> Self {
        Self { strength: 0.01, rest: 0.4 }
    }
}

/// A volume filled with liquid when the shot starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LiquidSource {
    /// The volume to fill: any shape but `plane` and `tank`, which are unbounded. A box is filled from its lower corner,
    /// a mesh on the seeding lattice through the world's origin, any other shape symmetrically about its centre.
    pub shape: Shape,
    /// Velocity at the start [m/s].
    #[serde(default)]
    pub velocity: [f32; 3],
    /// Largest random displacement of the particles from the seeding lattice along each axis, in spacings [1]; absent: none. Splashes then
    /// have the symmetry of the seeding lattice: a crown has that of a square. 0.25 removes most of it, if the drop and the pool have it. Before the
    /// first substep the density of all liquid is corrected, in up to sixty iterations, which makes the source larger, by a tenth of a
    /// spacing across. Weight and tension close that within a few frames: deep liquid falls by it, and 50 spacings of 2 cm then move by
    /// 0.1 m/s, 100 by 0.4. Free fall and weightless liquid keep it. Range: above 0, at most 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter: Option<f32>,
    /// Dynamic viscosity of this source's liquid [Pa·s], which needs the table `liquid.viscosity`; absent: the table's `dynamic`.
    /// Liquids do not mix: each particle keeps its viscosity. The shear stress is continuous from one to another,
    /// so that the thinner one shears faster. Ratios below 1e-12 count as that.
    /// Range: above 0, at most 1e8.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viscosity: Option<f32>,
    /// Colour of this source's liquid: linear red, green and blue [1]. Surfaces have it as the vertex attribute `color`, the mean of
    /// the particles around a vertex. If another source or emitter has a colour and this one has none, it is 0.8 of each. Meshes follow a
    /// change without a new simulation, if the frames have the channel `source`, as they have once a source is coloured. Range: 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
}

mod defaults {
    pub(super) fn density() -> f32 {
        1000.0
    }
    pub(super) fn kernel_radius() -> f32 {
        2.0
    }
    pub(super) fn max_iterations() -> u32 {
        60
    }
    pub(super) fn cfl() -> f32 {
        0.8
    }
    pub(super) fn min_substeps() -> u32 {
        8
    }
    pub(super) fn max_substeps() -> u32 {
        100
    }
    pub(super) fn softening() -> f32 {
        0.01
    }
    pub(super) fn viscosity_tolerance() -> f32 {
        1e-3
    }
    pub(super) fn viscosity_iterations() -> u32 {
        1000
    }
}
