//! Viscosity: particle strength exchange, and cores that grow.
//!
//! *Method*: [degond89]: dΓ_p/dt = (2ν/s²) Σ_q (V_p Γ_q − V_q Γ_p) ζ_s(x_p − x_q), ζ a Gaussian whose standard deviation s
//! along each axis is the core; ΣΓ is kept pair by pair. Rounds of Heun's rule, each as long as the fastest exchange allows:
//! ν dt/s² ≤ ½ on an even lattice. And [leonard80]: dσ²/dt = 2ν of Gaussian cores.
//!
//! Eddies finer than a core may add to ν, by [smagorinsky63] with the core as their width.
//!
//! *Departs from the paper*: of two cores the smaller counts for both; the Gaussian ends at four standard deviations, and what its
//! second moment loses there is given back to ν; volumes that overlap count as if they just filled space.

use super::super::{Gradient, Kernel, Vortons};
use super::{
    Flow, Viscosity,
    near::{MOMENT, Near, Weight},
};
use crate::{math::Vec3, par, sim::Diverged};

/// Rounds in a substep that are taken for meant: 5000 times the explicit limit.
const MOST_ROUNDS: f64 = 1e4;

impl Flow {
    /// Spreads strengths over `seconds` [s] by exchange with the viscosity `nu` of each [m²/s], and counts the rounds.
    ///
    /// # Errors
    /// [`Diverged`] if they are too many to be meant.
    pub(super) fn exchange(&mut self, nu: &[f32], seconds: f64, substep: u32) -> Result<u32, Diverged> {
        if nu.iter().all(|&nu| nu == 0.0) {
            return Ok(0);
        }
        let exchange = Exchange::new(&self.vortons, &self.volume, nu);
        let mut rates = exchange.rates(&self.vortons.strength);
        let (at, fastest) = par::max(rates.len(), |i| rates[i].own).expect("there are vortons");
        let rounds = (f64::from(fastest) * seconds).ceil().max(1.0);
        if rounds.is_nan() || rounds > MOST_ROUNDS {
            return Err(Diverged {
                system: "smoke",
                substep,
                particle: self.id[at],
                what: format!("would take {rounds:.0} rounds of viscous exchange"),
                try_next: "scheme = \"spreading\", a smaller nu or larger cores",
            });
        }
        let dt = (seconds / rounds) as f32;
        for round in 0..rounds as u32 {
            if round > 0 {
                rates = exchange.rates(&self.vortons.strength);
            }
            let mut ahead = self.vortons.strength.clone();
            par::update(&mut ahead, |i, strength| *strength += rates[i].strength * dt);
            let then = exchange.rates(&ahead);
            par::update(&mut self.vortons.strength, |i, strength| {
                *strength += (rates[i].strength + then[i].strength) * (0.5 * dt);
            });
        }
        Ok(rounds as u32)
    }

    /// Lets cores grow for `seconds` [s] with the viscosity `nu` of each [m²/s].
    pub(super) fn spread(&mut self, nu: &[f32], seconds: f64) {
        let rate = f64::from(spreading(self.params.kernel)) * seconds;
        par::update(&mut self.vortons.core, |i, core| {
            *core = (f64::from(*core).powi(2) + rate * f64::from(nu[i])).sqrt() as f32
        });
    }

    /// The viscosity of every vorton [m²/s]: the air's, and that of eddies finer than its core.
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

/// Exchange between vortons that do not move.
struct Exchange<'a> {
    near: Near,
    volume: &'a [f32],
    /// √ν/√max(1, Σ V ζ) [m/√s]: pairs exchange by the geometric mean of both viscosities, and where volumes overlap as if they just
    /// filled space.
    share: Vec<f32>,
}

/// What exchange does to a vorton.
#[derive(Clone, Copy, Debug, Default)]
struct Exchanged {
    /// dΓ/dt [m³/s²].
    strength: Vec3,
    /// The part of its own strength that it gives away a second [1/s].
    own: f32,
}

impl<'a> Exchange<'a> {
    fn new(vortons: &Vortons, volume: &'a [f32], nu: &[f32]) -> Self {
        let near = Near::new(vortons);
        let filled = near.sums(Weight::Density, |q| [volume[q], 0.0, 0.0, 0.0]);
        let mut share = vec![0.0; filled.len()];
        par::fill(&mut share, |p| (nu[p] / filled[p][0].max(1.0)).sqrt());
        Self { near, volume, share }
    }

    fn rates(&self, strength: &[Vec3]) -> Vec<Exchanged> {
        let sums = self.near.sums(Weight::Diffusion, |q| {
            let g = strength[q] * self.share[q];
            [g.x, g.y, g.z, self.volume[q] * self.share[q]]
        });
        let mut rates = vec![Exchanged::default(); strength.len()];
        par::fill(&mut rates, |p| {
            let [x, y, z, volume] = sums[p];
            let scale = 2.0 / MOMENT * self.share[p];
            let given = Vec3::new(x, y, z) * self.volume[p] - strength[p] * volume; // [degond89]
            // What it gives to itself is no exchange.
            let others = (volume - self.volume[p] * self.share[p] * self.near.own(p)).max(0.0);
            Exchanged { strength: given * scale, own: others * scale }
        });
        rates
    }
}

/// dσ²/dt over ν: what makes the mean square radius of the vorticity grow by 6ν. The Rosenhead–Moore kernel's is infinite; its
/// cores grow as those of Gaussians with which thin rings are as fast.
pub(super) fn spreading(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::Gaussian => 2.0,
        Kernel::WinckelmansLeonard => 4.0,
        Kernel::Ball => 10.0,
        Kernel::RosenheadMoore => 2.246, // 2 e^(ln 2 − γ), as ln σ + C is the same
    }
}
