//! Vortex particle method: advection, vortex stretching and diffusion of vortons.
//!
//! *Method*: [winckelmans93]. Vortons are advected by the velocity that all of them induce. Vortex stretching
//! changes their strengths by the velocity gradient, in the transpose form, which conserves ΣΓ:
//!
//! ```text
//! dx_p/dt = u(x_p)        dΓ_p/dt = (∇u)ᵀ Γ_p + viscosity + external contributions
//! ```
//!
//! [williamson80]'s third-order Runge–Kutta scheme advances positions and strengths together (`step.rs`), and
//! advects passive points, the tracers, in the same stages. The time step is limited by the largest gradient
//! and by the displacement of a vorton in cores. Diffusion follows, by particle strength exchange
//! (`exchange.rs`) or by core spreading, then relaxation (`relaxation.rs`). Where strain has deformed the
//! distribution of vortons, or cores overlap too little or too much (`overlap.rs`), remeshing replaces them
//! by vortons on a grid (`remesh.rs`).
//!
//! *Departs from the paper*: viscosity is a step of its own after each substep, at fixed positions. It is of
//! one order less in time than the other terms, but stable for any ν by substeps of its own. Cores of kernels
//! other than the Gaussian grow at the rate that gives the correct second moment.
//!
//! *Symbols*: ν → `nu` [m²/s], V → `volume` [m³], h → `spacing` [m]; others as in [`vortex`](super).
//!
//! *Limits*: no scheme of stretching conserves impulse and angular impulse exactly; the record of every frame
//! has their drift.

mod exchange;
mod gaussian_sums;
mod nodes;
mod overlap;
mod params;
mod population;
mod rates;
mod relaxation;
mod remesh;
mod report;
mod solenoidal;
mod step;

pub use params::{FlowParams, Relaxation, Remesh, Sum, Viscosity, ViscousScheme};
pub use rates::{ExternalEffects, NoExternalEffects, Rates, Stage};
pub use remesh::{Medium, RemeshReport};
pub use report::{Account, FlowReport, StepReport};
pub use step::SubstepLimits;

use super::{Method, OutOfRange, Quantity, Targets, Vortons, induced, invariants, sampled_error};
use crate::math::Vec3;

/// The state of moving vortons. All columns are of one length.
///
/// This is the whole state: with the same columns, `next_id`, `strained` and parameters a flow continues with
/// the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// The parameters of the motion.
    pub params: FlowParams,
    /// The vortons.
    pub vortons: Vortons,
    /// The volume of each vorton in particle strength exchange [m³].
    pub volume: Vec<f32>,
    /// A unique id of each vorton. Remeshing makes new vortons.
    pub id: Vec<u32>,
    /// The id of the next new vorton.
    pub next_id: u32,
    /// The strain since the last remeshing, 1: the sum of time steps, each times its largest velocity
    /// gradient.
    pub strained: f64,
}

impl Flow {
    /// A flow without vortons.
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

    /// A flow with the stored state of an earlier one.
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

    /// Appends vortons of these volumes [m³].
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
        // Ids wrap around after 2³²: the vortons with the first ids have been removed by then.
        self.id.extend((0..count as u32).map(|n| self.next_id.wrapping_add(n)));
        self.next_id = self.next_id.wrapping_add(count as u32);
    }

    /// Removes the vortons for which `keep(index)` is false; the others keep their order. Returns the number
    /// removed.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) -> usize {
        let kept: Vec<usize> = (0..self.vortons.len()).filter(|&i| keep(i)).collect();
        let removed = self.vortons.len() - kept.len();
        if removed > 0 {
            self.vortons.position = kept.iter().map(|&i| self.vortons.position[i]).collect();
            self.vortons.strength = kept.iter().map(|&i| self.vortons.strength[i]).collect();
            self.vortons.core = kept.iter().map(|&i| self.vortons.core[i]).collect();
            self.volume = kept.iter().map(|&i| self.volume[i]).collect();
            self.id = kept.iter().map(|&i| self.id[i]).collect();
        }
        removed
    }

    /// The velocity that the vortons induce at points [m/s].
    ///
    /// # Errors
    /// [`OutOfRange`] if a vorton or a point is out of range.
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

    /// The invariants, and the error of the velocity at the vortons if `samples` of them are to be summed
    /// over all pairs.
    ///
    /// # Errors
    /// [`OutOfRange`] if a vorton is out of range.
    pub fn account(&self, samples: Option<usize>) -> Result<Account, OutOfRange> {
        let (kernel, method) = (self.params.kernel, self.params.method());
        let error = match samples {
            None => None,
            Some(samples) => {
                let found = induced(&self.vortons, Targets::Vortons, Quantity::Velocity, kernel, method)?;
                Some(sampled_error(&self.vortons, Targets::Vortons, kernel, &found.velocity, samples)?)
            }
        };
        let tolerance = error.filter(|_| method != Method::Direct).map(|_| f64::from(self.params.error));
        Ok(Account { invariants: invariants(&self.vortons, kernel, method)?, error, tolerance })
    }
}
