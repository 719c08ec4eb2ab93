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
    /// Substeps whose conjugate gradients ended at `max_iterations` above `tolerance`.
    pub unconverged: u32,
    /// Largest residual that was left, as a part of the right side.
    pub residual: f64,
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
    /// Points that had slipped into a solid and were put back to its surface, over all substeps.
    pub caught: u64,
    /// Points within a solid at the frame's end.
    pub inside_solids: u64,
}
