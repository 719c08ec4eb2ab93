//! Parameters of whitewater.

use serde::{Deserialize, Serialize};

/// Spray, foam and bubbles of the liquid, made of its cached frames by `meniscus whitewater` and `meniscus shot` without simulating
/// the liquid again; absent: none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct WhitewaterParams {
    /// Factor of the number of particles [1]. Those of a smaller amount are among those of a larger one. Range: 0 to 1000.
    pub amount: f32,
    /// Amount that is simulated [1], at least `amount`: up to it, `amount` is changed within seconds, since frames are only
    /// filtered. Absent: `amount`. Range: 0 to 1000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_amount: Option<f32>,
    /// Particles that trapped air emits per second and square metre of liquid at full potential [1/(s m²)]. Range: 0 to 1000000000.
    pub trapped_air: f32,
    /// Speed at which neighbours of the liquid move towards each other, from none to full emission [m/s]: lower values foam in
    /// calmer liquid.
    pub trapped_air_speed: [f32; 2],
    /// Particles that wave crests emit per second and square metre of liquid at full potential [1/(s m²)]. Range: 0 to 1000000000.
    pub wave_crests: f32,
    /// Curvature of crests, from none to full emission [1]: the sum of [ihmsen12] over neighbours within two spacings. 0 is flat;
    /// the edge of a thin sheet has about 5.
    pub wave_crest_curvature: [f32; 2],
    /// Speed of the liquid whose kinetic energy gives none and full emission [m/s].
    pub speed: [f32; 2],
    /// Median radius of drops and bubbles [m]. Range: 0.000001 to 1000.
    pub radius: f32,
    /// Spread of the radius [1]: standard deviation of its logarithm, which is normal up to three deviations. 0 makes all equal.
    /// Range: 0 to 2.
    pub radius_spread: f32,
    /// Divergence of spray [1]: largest velocity of a drop across that of the liquid that emits it, relative to it. Range: 0 to 10.
    pub divergence: f32,
    /// Largest number of particles; further ones are not emitted, which is reported. Range: 1 to 100000000.
    pub max_particles: u32,
    /// Steps between two cached frames. With 1, a dam break has 15 % more foam and fewer bubbles than with 15; with 5, 2 %.
    /// Range: 1 to 1000.
    pub substeps: u32,
    /// Seed of the random numbers: another one gives other particles of the same distribution.
    pub seed: u32,
    /// Files of each frame.
    #[serde(skip_serializing_if = "are_default")]
    pub files: Vec<WhitewaterFormat>,
    /// Distance between the nodes of volume files [m]. Absent: the spacing of the liquid. Range: above 0, at most 1000000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel: Option<f32>,
    /// Drops in the air.
    pub spray: SprayParams,
    /// Particles on the surface.
    pub foam: FoamParams,
    /// Particles below the surface.
    pub bubbles: BubbleParams,
}

/// A file of whitewater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WhitewaterFormat {
    /// Points as binary PLY, which Blender shows.
    Ply,
    /// Volume fractions of spray, foam and bubbles as three grids of single precision in an OpenVDB file [1].
    Vdb,
    /// The points as NumPy arrays.
    Npz,
}

impl WhitewaterFormat {
    /// Every format.
    pub(crate) const ALL: [Self; 3] = [Self::Ply, Self::Vdb, Self::Npz];
}

/// Omits the default, so that hashes of shots from before this key stay the same.
fn are_default(files: &[WhitewaterFormat]) -> bool {
    *files == [WhitewaterFormat::Ply]
}

/// Drops in the air: they fall, and the air slows them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SprayParams {
    /// Factor of the number of particles that are spray where they are emitted [1]. Range: 0 to 1000.
    pub amount: f32,
    /// Mean time as spray until a particle is removed [s]. Range: above 0, at most 1000000.
    pub lifetime: f32,
    /// Rate at which the velocity relaxes to that of the air [1/s]. Drops fall at most at gravity / drag. Range: 0 to 1000000.
    pub drag: f32,
    /// Acceleration against gravity, relative to it [1]: 1 floats, as fine mist nearly does. Range: 0 to 100.
    pub buoyancy: f32,
}

/// Particles on the surface: they move with the liquid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct FoamParams {
    /// Factor of the number of particles that are foam where they are emitted [1]. Range: 0 to 1000.
    pub amount: f32,
    /// Mean time as foam until a particle is removed [s]: seconds for fresh water, ten and more for the sea.
    /// Range: above 0, at most 1000000.
    pub lifetime: f32,
    /// Rate at which the velocity relaxes to that of the liquid [1/s]: 100 moves with it. Range: 0 to 1000000.
    pub drag: f32,
    /// Acceleration against gravity, relative to it [1]. Range: 0 to 100.
    pub buoyancy: f32,
}

/// Particles below the surface: they rise, and the liquid carries them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct BubbleParams {
    /// Factor of the number of particles that are bubbles where they are emitted [1]. Range: 0 to 1000.
    pub amount: f32,
    /// Mean time as a bubble until a particle is removed [s]. Range: above 0, at most 1000000.
    pub lifetime: f32,
    /// Rate at which the velocity relaxes to that of the liquid [1/s]. Bubbles rise through liquid at rest at buoyancy × gravity / drag.
    /// Range: 0 to 1000000.
    pub drag: f32,
    /// Acceleration against gravity, relative to it [1]. Range: 0 to 100.
    pub buoyancy: f32,
}

impl Default for WhitewaterParams {
    fn default() -> Self {
        Self {
            amount: 1.0,
            max_amount: None,
            trapped_air: 4e5,
            trapped_air_speed: [0.4, 1.6],
            wave_crests: 4e5,
            wave_crest_curvature: [1.0, 4.0],
            speed: [0.7, 2.5],
            radius: 0.002,
            radius_spread: 0.4,
            divergence: 0.15,
            max_particles: 5_000_000,
            substeps: 4,
            seed: 0,
            files: vec![WhitewaterFormat::Ply],
            voxel: None,
            spray: SprayParams::default(),
            foam: FoamParams::default(),
            bubbles: BubbleParams::default(),
        }
    }
}

impl Default for SprayParams {
    fn default() -> Self {
        Self { amount: 1.0, lifetime: 4.0, drag: 0.8, buoyancy: 0.0 }
    }
}

impl Default for FoamParams {
    fn default() -> Self {
        Self { amount: 1.0, lifetime: 3.0, drag: 100.0, buoyancy: 0.0 }
    }
}

impl Default for BubbleParams {
    fn default() -> Self {
        Self { amount: 1.0, lifetime: 6.0, drag: 10.0, buoyancy: 0.25 }
    }
}

/// Kind of a particle. Numbers are those of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A drop in the air.
    Spray,
    /// On the surface.
    Foam,
    /// Below the surface.
    Bubble,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Spray, Self::Foam, Self::Bubble];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        ["spray", "foam", "bubbles"][self as usize]
    }
}

/// What the particles of a kind obey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KindParams {
    pub(super) amount: f32,
    pub(super) lifetime: f32,
    pub(super) drag: f32,
    pub(super) buoyancy: f32,
}

impl WhitewaterParams {
    /// The amount that is simulated.
    pub fn simulated_amount(&self) -> f32 {
        self.max_amount.unwrap_or(self.amount)
    }

    /// The largest amount of any kind, from which the others are thinned.
    pub(super) fn largest_amount(&self) -> f32 {
        let amounts = Kind::ALL.map(|kind| self.kind(kind).amount);
        self.simulated_amount() * amounts.into_iter().fold(0.0, f32::max)
    }

    /// The parameters of a kind.
    pub(super) fn kind(&self, kind: Kind) -> KindParams {
        let Self { spray, foam, bubbles, .. } = self;
        let (amount, lifetime, drag, buoyancy) = match kind {
            Kind::Spray => (spray.amount, spray.lifetime, spray.drag, spray.buoyancy),
            Kind::Foam => (foam.amount, foam.lifetime, foam.drag, foam.buoyancy),
            Kind::Bubble => (bubbles.amount, bubbles.lifetime, bubbles.drag, bubbles.buoyancy),
        };
        KindParams { amount, lifetime, drag, buoyancy }
    }

    /// The parameters that decide what is simulated: all but `amount`, which selects from it, and the files.
    pub fn simulated(&self) -> Self {
        let amount = self.simulated_amount();
        let Self { files, voxel, .. } = Self::default();
        Self { amount, max_amount: Some(amount), files, voxel, ..self.clone() }
    }

    /// The first range that is not from 0 to 10000, with an end at least 0.001 above its start; key and values.
    pub(crate) fn bad_range(&self) -> Option<(&'static str, [f32; 2])> {
        let ranges = [
            ("trapped_air_speed", self.trapped_air_speed),
            ("wave_crest_curvature", self.wave_crest_curvature),
            ("speed", self.speed),
        ];
        // Narrower ones, and squares of larger ones, are not resolved in single precision.
        let is_good = |[min, max]: &[f32; 2]| (0.0..=1e4).contains(max) && *min >= 0.0 && max - min >= 1e-3;
        ranges.into_iter().find(|(_, range)| !is_good(range))
    }
}
