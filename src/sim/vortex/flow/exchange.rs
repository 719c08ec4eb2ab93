//! Diffusion by particle strength exchange and by core spreading.
//!
//! *Method*: particle strength exchange, [degond89]: dΓ_p/dt = (2ν/s²) Σ_q (V_p Γ_q − V_q Γ_p) ζ_s(x_p −
//! x_q), ζ a Gaussian whose standard deviation s along each axis is the core. Each pair conserves ΣΓ. Heun's
//! method integrates it in steps that are stable for the fastest exchange: ν dt/s² ≤ ½ on a uniform grid.
//! Core spreading, [leonard80]: dσ²/dt = 2ν for Gaussian cores.
//!
//! An eddy viscosity may be added to ν, by [smagorinsky63] with the core as the filter width.
//!
//! *Departs from the paper*: the smaller of two cores applies to both. The Gaussian is cut off at four
//! standard deviations, and ν is corrected for the second moment beyond. Volumes that overlap count as if
//! they just filled space.

use super::super::{Gradient, Kernel, Vortons};
use super::{
    Flow, Viscosity,
    gaussian_sums::{NeighbourSums, SECOND_MOMENT_WITHIN_CUTOFF, Weight},
};
use crate::{math::Vec3, par, sim::Diverged};

/// Exchange steps per substep at most: 5000 times the explicit limit. More are considered a mistake.
const MAX_EXCHANGE_STEPS: f64 = 1e4;

impl Flow {
    /// Diffuses strengths for `seconds` [s] by exchange with the viscosity `nu` of each vorton [m²/s].
    /// Returns the number of exchange steps.
    ///
    /// # Errors
    /// [`Diverged`] if that exceeds [`MAX_EXCHANGE_STEPS`].
    pub(super) fn exchange(&mut self, nu: &[f32], seconds: f64, substep: u32) -> Result<u32, Diverged> {
        if nu.iter().all(|&nu| nu == 0.0) {
            return Ok(0);
        }
        let exchange = Exchange::new(&self.vortons, &self.volume, nu);
        let mut rates = exchange.rates(&self.vortons.strength);
        let (at, fastest) = par::max(rates.len(), |i| rates[i].loss).expect("there are vortons");
        let steps = (f64::from(fastest) * seconds).ceil().max(1.0);
        if steps.is_nan() || steps > MAX_EXCHANGE_STEPS {
            return Err(Diverged {
                system: "smoke",
                substep,
                particle: self.id[at],
                what: format!("would take {steps:.0} steps of particle strength exchange"),
                try_next: "scheme = \"spreading\", a smaller nu or larger cores",
            });
        }
        let dt = (seconds / steps) as f32;
        for step in 0..steps as u32 {
            if step > 0 {
                rates = exchange.rates(&self.vortons.strength);
            }
            let mut predicted = self.vortons.strength.clone();
            par::update(&mut predicted, |i, strength| *strength += rates[i].strength * dt);
            let rates_at_end = exchange.rates(&predicted);
            par::update(&mut self.vortons.strength, |i, strength| {
                *strength += (rates[i].strength + rates_at_end[i].strength) * (0.5 * dt);
            });
        }
        Ok(steps as u32)
    }

    /// Spreads cores for `seconds` [s] with the viscosity `nu` of each vorton [m²/s].
    pub(super) fn spread_cores(&mut self, nu: &[f32], seconds: f64) {
        let rate = f64::from(core_spreading_rate(self.params.kernel)) * seconds;
        par::update(&mut self.vortons.core, |i, core| {
            *core = (f64::from(*core).powi(2) + rate * f64::from(nu[i])).sqrt() as f32
        });
    }

    /// The viscosity of every vorton [m²/s]: that of the air, and the eddy viscosity.
    pub(super) fn viscosities(&self, viscosity: &Viscosity, gradient: &[Gradient]) -> Vec<f32> {
        let mut nu = vec![viscosity.nu; self.vortons.len()];
        if let Some(constant) = viscosity.eddies {
            par::update(&mut nu, |i, nu| {
                let strain = (gradient[i] + gradient[i].transpose()) * 0.5;
                let rate = std::f32::consts::SQRT_2 * strain.norm(); // |S| = √(2 S:S)
                *nu += (constant * self.vortons.core[i]).powi(2) * rate; // (C Δ)² |S|, [smagorinsky63]
            });
        }
        nu
    }
}

/// Exchange between vortons at fixed positions.
struct Exchange<'a> {
    neighbours: NeighbourSums,
    volume: &'a [f32],
    /// √ν/√max(1, Σ V ζ) [m/√s]: pairs exchange by the geometric mean of both viscosities. Volumes that
    /// overlap count as if they just filled space.
    root_nu: Vec<f32>,
}

/// The rates of exchange of a vorton.
#[derive(Clone, Copy, Debug, Default)]
struct ExchangeRate {
    /// dΓ/dt [m³/s²].
    strength: Vec3,
    /// The fraction of its own strength that it loses per second [1/s].
    loss: f32,
}

impl<'a> Exchange<'a> {
    fn new(vortons: &Vortons, volume: &'a [f32], nu: &[f32]) -> Self {
        let neighbours = NeighbourSums::new(vortons);
        let filled = neighbours.sums(Weight::Density, |q| [volume[q], 0.0, 0.0, 0.0]);
        let mut root_nu = vec![0.0; filled.len()];
        par::fill(&mut root_nu, |p| (nu[p] / filled[p][0].max(1.0)).sqrt());
        Self { neighbours, volume, root_nu }
    }

    fn rates(&self, strength: &[Vec3]) -> Vec<ExchangeRate> {
        let sums = self.neighbours.sums(Weight::Diffusion, |q| {
            let g = strength[q] * self.root_nu[q];
            [g.x, g.y, g.z, self.volume[q] * self.root_nu[q]]
        });
        let mut rates = vec![ExchangeRate::default(); strength.len()];
        par::fill(&mut rates, |p| {
            let [x, y, z, volume] = sums[p];
            let scale = 2.0 / SECOND_MOMENT_WITHIN_CUTOFF * self.root_nu[p];
            let exchanged = Vec3::new(x, y, z) * self.volume[p] - strength[p] * volume; // [degond89]
            // The sum includes the vorton itself, with which it exchanges nothing.
            let own = self.volume[p] * self.root_nu[p] * self.neighbours.weight_of_itself(p);
            ExchangeRate { strength: exchanged * scale, loss: (volume - own).max(0.0) * scale }
        });
        rates
    }
}

/// dσ²/dt over ν, with which the mean square radius of the vorticity grows by 6ν. That of the Rosenhead–Moore
/// kernel is infinite: its cores grow like Gaussian cores that give thin rings the same speed.
pub(super) fn core_spreading_rate(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::Gaussian => 2.0,
        Kernel::WinckelmansLeonard => 4.0,
        Kernel::Ball => 10.0,
        Kernel::RosenheadMoore => 2.246, // 2 e^(ln 2 − γ), as ln σ + C is the same
    }
}
