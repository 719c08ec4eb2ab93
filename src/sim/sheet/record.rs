//! Records of the sheets: of their seeding and of a frame.

use crate::sim::force::ForceRecord;
use serde::{Deserialize, Serialize};

/// What seeding the sheets did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SheetSeeds {
    /// Points of all sheets.
    pub points: u32,
    /// Edges that go through faces of sheets; 0 without contact between sheets.
    pub crossings: u64,
    /// Points inside rigid bodies.
    pub inside_bodies: u64,
}

/// What happened to the sheets in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct SheetRecord {
    /// Points of all sheets.
    pub points: u64,
    /// Substeps taken.
    pub substeps: u32,
    /// Iterations of the conjugate gradients, over all substeps; 0 for the symplectic integrator.
    pub iterations: u32,
    /// Solves that reached `max_iterations` with a residual above `tolerance`: one a substep, and another
    /// where masses push sheets.
    pub unconverged: u32,
    /// Largest residual that was left, relative to the right side.
    pub residual: f64,
    /// Substeps of the implicit integrator in which springs gained more energy than its linearisation
    /// predicts and its damping takes: more than a hundredth of the energy of springs and motion.
    pub overshot: u32,
    /// Energy gained in these substeps [J].
    pub overshot_energy: f64,
    /// ½ Σ m v² at the frame's end [J].
    pub kinetic_energy: f64,
    /// Energy of springs and plates at the frame's end [J].
    pub elastic_energy: f64,
    /// −Σ m g·x at the frame's end [J].
    pub potential_energy: f64,
    /// Largest strain of a spring at the frame's end; springs without rest length do not count.
    pub strain_max: f64,
    /// Springs with a rest length whose ends coincide at the frame's end: they have no direction, and no
    /// force.
    pub folded: u64,
    /// Points that were projected out of a solid, or to their clearance from it, over all substeps.
    #[serde(rename = "caught")]
    pub projected_out: u64,
    /// Points inside a solid at the frame's end.
    pub inside_solids: u64,
    /// Faces inside a solid at the frame's end, tested at the middles of edges and diagonals, and of
    /// triangles.
    pub cut_faces: u64,
    /// Largest depth of these places [m].
    pub cut_depth: f64,
    /// Contact between sheets; absent without `[sheets.contact]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactRecord>,
    /// Force fields; absent without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forces: Option<ForceRecord>,
}

/// Contact between sheets in a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ContactRecord {
    /// Pairs of features that contact impulses kept apart, over all substeps.
    pub pairs: u64,
    /// Searches of the broad phase for all points.
    pub searches: u32,
    /// Points that were searched again, since they deviated from their predicted positions.
    pub renewed: u64,
    /// Points that moved in rigid impact zones, over all substeps: impulses alone did not separate them.
    #[serde(rename = "held")]
    pub in_impact_zones: u64,
    /// Pairs that were not proven separate, over all substeps: their points of zero mobility move in
    /// different directions.
    pub unseparated: u64,
    /// Edges that go through faces at the frame's end.
    pub crossings: u64,
}
