//! What couplings tell of a frame.

use serde::Serialize;

/// What happened between coupled systems in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CouplingRecord {
    /// Between liquid and sheets, if they are coupled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub liquid: Option<LiquidOnSheets>,
    /// Between smoke and sheets, if they are coupled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokeOnSheets>,
}

/// What liquid and sheets did to each other.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LiquidOnSheets {
    /// Pairs of a particle and a face that pushed each other in the last substep.
    pub contacts: u64,
    /// What the liquid gave the sheets [N·s], contact alone; the liquid lost as much.
    pub impulse: [f64; 3],
    /// Work of sheets on the liquid [J], below zero where they yield: what the liquid's energy may rise by.
    pub work: f64,
    /// Rounds of contact that ended by their number of iterations or sweeps, over all substeps; what was left was for
    /// the next round, if there was one, and else shows in `crossed` and `put_back`.
    pub unfinished: u64,
    /// Particles that were put back to their side of a sheet alone, because nothing else kept them there, over all substeps: what these
    /// were pushed by, no sheet took.
    pub put_back: u64,
    /// Particles that got to the other side of a sheet, through a face.
    pub crossed: u64,
}

/// What smoke did to sheets.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SmokeOnSheets {
    /// Faces that felt the air.
    pub faces: u64,
    /// What the air gave the sheets [N·s].
    pub impulse: [f64; 3],
    /// The fastest air at a face [m/s].
    pub fastest: f64,
    /// Times a face's drag was cut, because it would have turned the motion round within a substep.
    pub cut: u64,
}
