//! What happened between coupled systems in a frame.

use serde::{Deserialize, Serialize};

/// Record of all couplings over a frame. It is the same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct CouplingRecord {
    /// Between liquid and sheets, if they are coupled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub liquid: Option<LiquidSheetRecord>,
    /// Between smoke and sheets, if they are coupled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<WindRecord>,
    /// Between rigid bodies and sheets, if there are both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BodySheetRecord>,
}

/// Contact between rigid bodies and sheets over a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct BodySheetRecord {
    /// Most contacts with an impulse in a substep, each of a point and a body.
    pub contacts: u64,
    /// Contact solves that reached their iteration limit, over all substeps. The next solve reduces the remaining error.
    pub unconverged: u64,
    /// Largest depth of a point in a body after the solves of a substep, over the body's inner radius. Such points are moved to the
    /// surface without an impulse.
    pub penetration: f64,
}

/// Contact between liquid and sheets over a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct LiquidSheetRecord {
    /// Contacts with an impulse in the last substep, each of a particle and a face.
    pub contacts: u64,
    /// Impulse of contacts on the sheets [N·s]; the liquid receives the opposite.
    pub impulse: [f64; 3],
    /// Work of sheets on the liquid [J], negative where they yield. The liquid's energy may rise by it.
    pub work: f64,
    /// Contact solves that reached their iteration limit, over all substeps. The next solve reduces the remaining error; after
    /// the last one it shows in `crossed` and `projected_back`.
    #[serde(rename = "unfinished")]
    pub unconverged: u64,
    /// Particles that were projected back to their side of a sheet alone, over all substeps. No sheet received the opposite
    /// impulse.
    #[serde(rename = "put_back")]
    pub projected_back: u64,
    /// Particles that crossed a face to the other side of a sheet.
    pub crossed: u64,
}

/// Drag of the air on sheets over a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct WindRecord {
    /// Faces that feel the air.
    pub faces: u64,
    /// Impulse of the air on the sheets [N·s].
    pub impulse: [f64; 3],
    /// Speed of the fastest air at a face [m/s].
    #[serde(rename = "fastest")]
    pub max_speed: f64,
    /// Faces whose drag was limited, because it would have reversed their motion within a substep, over all substeps.
    #[serde(rename = "cut")]
    pub limited: u64,
}
