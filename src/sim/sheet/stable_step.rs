//! Longest stable time step of the symplectic integrator.
//!
//! *Method*: an oscillator of frequency ω and damping γ (of its velocity) stays bounded if ω² Δt² + 2 γ Δt <
//! 4. Gershgorin's circles [golub13] bound the eigenvalues of M⁻¹K row by row: by what the springs of a point
//! can add to its row, over its mass.
//!
//! The bound holds for all positions. Across a spring the derivative is k (1 − ℓ/|d|), below k for any
//! length; it is negative in compression, where nothing oscillates. So it changes only with what holds the
//! points. On a grid that is taut in both directions it is sharp, on a slack one shorter by √2.
//!
//! Symbols: k_ij → entries of the tables, m_i → `mass`.

use super::{
    constraints::{JointPair, PinnedPoint},
    params::Repulsion,
    sliced_ellpack::{self, SlicedEllpack},
};
use crate::par;

/// Sums over the rows of all points: stiffness [N/m] and damping [N·s/m].
pub(super) struct RowSums {
    rows: Vec<[f64; 2]>,
}

impl RowSums {
    /// Row sums of springs and plates for `count` points.
    pub(super) fn new(springs: &SlicedEllpack, plates: Option<&SlicedEllpack>, count: usize) -> Self {
        let mut rows = vec![[0.0; 2]; count];
        let sums = sliced_ellpack::row_sums(springs, count);
        par::update(&mut rows, |i, row| {
            let [size, _, damping] = sums[i];
            *row = [2.0 * size, 2.0 * damping];
        });
        if let Some(plates) = plates {
            let sums = sliced_ellpack::row_sums(plates, count);
            par::update(&mut rows, |i, row| {
                let [size, signed, _] = sums[i];
                row[0] += size + signed.abs();
            });
        }
        Self { rows }
    }

    /// Adds the pins and joints that hold at a time [s].
    pub(super) fn add_pins_and_joints(&mut self, pins: &[PinnedPoint], joints: &[JointPair], time: f64) {
        for pin in pins.iter().filter(|pin| pin.holds(time)) {
            self.rows[pin.point as usize][0] += f64::from(pin.stiffness.unwrap_or(0.0));
        }
        for joint in joints.iter().filter(|joint| joint.holds(time)) {
            joint
                .ends
                .iter()
                .for_each(|&i| self.rows[i as usize][0] += 4.0 * f64::from(joint.stiffness.unwrap_or(0.0)));
        }
    }

    /// Adds the largest stiffness of repulsion by solids.
    pub(super) fn add_repulsion(&mut self, repulsion: &Repulsion, solids: usize, area: &[f32]) {
        let max_stiffness = f64::from(repulsion.energy) / f64::from(repulsion.range).powi(2);
        par::update(&mut self.rows, |i, row| row[0] += solids as f64 * max_stiffness * f64::from(area[i]));
    }

    /// The longest stable time step [s] and the point that limits it; infinite if none does. Points that
    /// cannot move set no limit.
    pub(super) fn max_stable_step(&self, mass: &[f32], mobility: &[f32]) -> (f64, usize) {
        let longest = |i: usize| {
            if mobility[i] == 0.0 || self.rows[i] == [0.0; 2] {
                return f64::INFINITY;
            }
            let [lambda, gamma] = self.rows[i].map(|sum| sum / f64::from(mass[i]));
            // The root of λ Δt² + 2 γ Δt = 4.
            4.0 / (gamma + (gamma * gamma + 4.0 * lambda).sqrt())
        };
        let (i, max) = par::max(mass.len(), |i| -longest(i) as f32).unwrap_or((0, f32::NEG_INFINITY));
        (f64::from(-max), i)
    }
}
