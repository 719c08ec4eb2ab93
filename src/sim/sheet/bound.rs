//! The longest substep with which the symplectic integrator is stable.
//!
//! *Method*: an oscillation of frequency ω and damping γ (of its velocity) stays bounded if ω² Δt² + 2 γ Δt < 4. Of the system M⁻¹K
//! Gershgorin's circles [golub13] give a bound row by row: what the springs of a point can add to its row, over its mass.
//!
//! The bound holds wherever the points are: across a spring the derivative is k (1 − ℓ/|d|), below k for any length, and negative in
//! compression, where nothing oscillates. So it changes only when what holds the points does. On a grid that is taut in both directions it is sharp,
//! on a slack one √2 too short.
//!
//! Symbols: k_ij → entries of the tables, m_i → `mass`.

use super::{
    hold::{Held, Joined},
    params::Repulsion,
    table::{self, Table},
};
use crate::par;

/// Σ of all that acts on a point: stiffness [N/m] and damping [N·s/m], of its whole row.
pub(super) struct Rows {
    rows: Vec<[f64; 2]>,
}

impl Rows {
    /// Of `count` points.
    pub(super) fn new(springs: &Table, plates: Option<&Table>, count: usize) -> Self {
        let mut rows = vec![[0.0; 2]; count];
        let sums = table::row_sums(springs, count);
        par::update(&mut rows, |i, row| {
            let [size, _, damping] = sums[i];
            *row = [2.0 * size, 2.0 * damping];
        });
        if let Some(plates) = plates {
            let sums = table::row_sums(plates, count);
            par::update(&mut rows, |i, row| {
                let [size, signed, _] = sums[i];
                row[0] += size + signed.abs();
            });
        }
        Self { rows }
    }

    /// Adds what holds points at a time [s].
    pub(super) fn hold(&mut self, held: &[Held], joined: &[Joined], time: f64) {
        for pin in held.iter().filter(|pin| pin.holds(time)) {
            self.rows[pin.point as usize][0] += f64::from(pin.stiffness.unwrap_or(0.0));
        }
        for joint in joined.iter().filter(|joint| joint.holds(time)) {
            joint
                .ends
                .iter()
                .for_each(|&i| self.rows[i as usize][0] += 4.0 * f64::from(joint.stiffness.unwrap_or(0.0)));
        }
    }

    /// Adds what solids push, at its hardest.
    pub(super) fn repel(&mut self, repulsion: &Repulsion, solids: usize, area: &[f32]) {
        let hardest = f64::from(repulsion.energy) / f64::from(repulsion.range).powi(2);
        par::update(&mut self.rows, |i, row| row[0] += solids as f64 * hardest * f64::from(area[i]));
    }

    /// The longest substep [s] and the point that asks for it; infinite if nothing does. Points of no mobility ask for nothing.
    pub(super) fn longest(&self, mass: &[f32], mobility: &[f32]) -> (f64, usize) {
        let longest = |i: usize| {
            if mobility[i] == 0.0 || self.rows[i] == [0.0; 2] {
                return f64::INFINITY;
            }
            let [lambda, gamma] = self.rows[i].map(|sum| sum / f64::from(mass[i]));
            // The root of λ Δt² + 2 γ Δt = 4.
            4.0 / (gamma + (gamma * gamma + 4.0 * lambda).sqrt())
        };
        let (i, most) = par::max(mass.len(), |i| -longest(i) as f32).unwrap_or((0, f32::NEG_INFINITY));
        (f64::from(-most), i)
    }
}
