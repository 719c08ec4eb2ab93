//! Vortons in motion.
//!
//! *Method*: [winckelmans93]. Vortons move with the velocity that all of them induce, and their strengths are stretched by its
//! gradient, in the transpose form, which keeps ΣΓ:
//!
//! ```text
//! dx_p/dt = u(x_p)        dΓ_p/dt = (∇u)ᵀ Γ_p + viscosity + what acts from outside
//! ```
//!
//! Positions and strengths advance together by [williamson80]'s third-order Runge–Kutta scheme (`step.rs`), and points that
//! drift along, the passengers, in the same stages. A substep is short enough for the largest gradient and for a vorton to
//! stay within its core. Viscosity follows, by particle strength exchange (`exchange.rs`) or by growing cores, then
//! relaxation (`relaxation.rs`). Where the flow has strained what they stand for, or they have parted or crowd (`overlap.rs`), they
//! are put back onto a lattice (`remesh.rs`).
//!
//! *Departs from the paper*: viscosity is a step of its own after each substep, at fixed positions: with one order less in time
//! than the rest, but stable for any ν by rounds of its own. Cores of kernels other than the Gaussian grow by the rate that suits
//! their second moment.
//!
//! *Symbols*: ν → `nu` [m²/s], V → `volume` [m³], h → `spacing` [m]; others as in [`vortex`](super).
//!
//! *Limits*: no scheme of stretching keeps impulse and angular impulse exactly; their drift is in the record of every frame.

mod exchange;
mod near;
mod nodes;
mod overlap;
mod params;
mod rates;
mod relaxation;
mod remesh;
mod report;
mod solenoidal;
mod step;
mod weak;

pub use params::{FlowParams, Relaxation, Remesh, Sum, Viscosity, ViscousScheme};
pub use rates::{Moment, Outside, Rates, Still};
pub use remesh::{Medium, MediumAt, RemeshReport};
pub use report::{Account, FlowReport, StepReport};
pub use step::Span;

use super::{OutOfRange, Quantity, Targets, Vortons, induced, invariants, sampled_error};
use crate::math::Vec3;

/// Vortons that move. All columns are of one length.
///
/// This is the whole state: with the same columns, `next_id`, `strained` and parameters a flow goes on with the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// How they move.
    pub params: FlowParams,
    /// The vortons.
    pub vortons: Vortons,
    /// The volume of each [m³]: what it stands for in particle strength exchange.
    pub volume: Vec<f32>,
    /// A number of each that no other ever had. Remeshing makes new vortons.
    pub id: Vec<u32>,
    /// The next number to give.
    pub next_id: u32,
    /// The strain since vortons last stood on a lattice, 1: each substep's length times its largest velocity gradient.
    pub strained: f64,
}

impl Flow {
    /// Without vortons.
    pub fn new(params: FlowParams) -> Self {
        Self {
            params,
            vortons: Vortons::default(),
            volume: Vec::new(),
            id: Vec::new(),
            next_id: 0,
            strained: 0.0,
        }
    }

    /// The state that a flow of these parameters had.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn restore(
        params: FlowParams,
        vortons: Vortons,
        volume: Vec<f32>,
        id: Vec<u32>,
        next_id: u32,
        strained: f64,
    ) -> Self {
        let count = vortons.len();
        assert!(
            [vortons.strength.len(), vortons.core.len(), volume.len(), id.len()].iter().all(|&n| n == count),
            "a column for every property"
        );
        Self { params, vortons, volume, id, next_id, strained }
    }

    /// Adds vortons of these volumes [m³] behind those that are there.
    ///
    /// # Panics
    /// If the columns differ in length, or there would be 2³² vortons or more.
    pub fn add(&mut self, more: &Vortons, volume: &[f32]) {
        let count = more.len();
        assert!([more.strength.len(), more.core.len(), volume.len()].iter().all(|&n| n == count));
        self.vortons.position.extend(&more.position);
        self.vortons.strength.extend(&more.strength);
        self.vortons.core.extend(&more.core);
        self.volume.extend(volume);
        assert!(u32::try_from(self.vortons.len()).is_ok(), "fewer than 2³² vortons");
        // After 2³² numbers they begin again: what had them is gone by then.
        self.id.extend((0..count as u32).map(|n| self.next_id.wrapping_add(n)));
        self.next_id = self.next_id.wrapping_add(count as u32);
    }

    /// Removes those that `keep(index)` refuses; the others keep their order. Returns how many went.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) -> usize {
        let kept: Vec<usize> = (0..self.vortons.len()).filter(|&i| keep(i)).collect();
        let gone = self.vortons.len() - kept.len();
        if gone > 0 {
            self.vortons.position = kept.iter().map(|&i| self.vortons.position[i]).collect();
            self.vortons.strength = kept.iter().map(|&i| self.vortons.strength[i]).collect();
            self.vortons.core = kept.iter().map(|&i| self.vortons.core[i]).collect();
            self.volume = kept.iter().map(|&i| self.volume[i]).collect();
            self.id = kept.iter().map(|&i| self.id[i]).collect();
        }
        gone
    }

    /// The velocity that the vortons induce at points [m/s].
    ///
    /// # Errors
    /// [`OutOfRange`] if a vorton or a point is outside what the sums can hold.
    pub fn velocity_at(&self, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        let FlowParams { kernel, .. } = self.params;
        let found = induced(
            &self.vortons,
            Targets::Points(points),
            Quantity::Velocity,
            kernel,
            self.params.method(),
        )?;
        Ok(found.velocity)
    }

    /// The invariants, and the evaluator's error at the vortons if `samples` of them are to be summed over all pairs.
    ///
    /// # Errors
    /// [`OutOfRange`] if a vorton is outside what the sums can hold.
    pub fn account(&self, samples: Option<usize>) -> Result<Account, OutOfRange> {
        let (kernel, method) = (self.params.kernel, self.params.method());
        let error = match samples {
            None => None,
            Some(samples) => {
                let found = induced(&self.vortons, Targets::Vortons, Quantity::Velocity, kernel, method)?;
                Some(sampled_error(&self.vortons, Targets::Vortons, kernel, &found.velocity, samples)?)
            }
        };
        Ok(Account { invariants: invariants(&self.vortons, kernel, method)?, error })
    }
}
