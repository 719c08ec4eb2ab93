//! What sheets tell of a frame.

use serde::Serialize;

/// What happened to the sheets in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SheetRecord {
    /// Points of all sheets.
    pub points: u64,
    /// Substeps taken.
    pub substeps: u32,
    /// Rounds of the conjugate gradients, over all substeps; 0 for the symplectic integrator.
    pub iterations: u32,
    /// Times conjugate gradients ended by their number above `tolerance`: once a substep, and once more where something leans on sheets.
    pub unconverged: u32,
    /// Largest residual that was left, as a part of the right side.
    pub residual: f64,
    /// Substeps of the implicit rule in which springs got more energy than its linearisation foresaw and its damping took: by more than a
    /// hundredth of all that they and the motion then had.
    pub overshot: u32,
    /// What they got in these substeps [J].
    pub overshot_energy: f64,
    /// ½ Σ m v² at the frame's end [J].
    pub kinetic_energy: f64,
    /// Energy of springs and plates at the frame's end [J].
    pub elastic_energy: f64,
    /// −Σ m g·x at the frame's end [J].
    pub potential_energy: f64,
    /// Largest strain of a spring, in parts of its rest length, at the frame's end; springs without rest length do not count.
    pub strain_max: f64,
    /// Springs with a rest length whose ends lie in one place at the frame's end: they have no direction, and push nowhere.
    pub folded: u64,
    /// Points that had slipped into a solid, or nearer than their clearance, and were put back, over all substeps.
    pub caught: u64,
    /// Points within a solid at the frame's end.
    pub inside_solids: u64,
    /// Faces within a solid at the frame's end where they are asked: at the middles of edges and diagonals, and of triangles.
    pub cut_faces: u64,
    /// How deep the deepest of these places is [m].
    pub cut_depth: f64,
    /// What contact between sheets did; absent without `[sheets.contact]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactRecord>,
}

/// What contact between sheets did in a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ContactRecord {
    /// Pairs of features that were kept apart, over all substeps.
    pub pairs: u64,
    /// Times that lists of what may meet were made.
    pub searches: u32,
    /// Points for which that was done again, since they had left their ways.
    pub renewed: u64,
    /// Points that had to move as one with what they met, over all substeps: impulses alone did not part them.
    pub held: u64,
    /// Pairs that could not be kept apart with certainty, over all substeps: what holds them goes different ways.
    pub unseparated: u64,
    /// Edges that go through faces at the frame's end.
    pub crossings: u64,
}
