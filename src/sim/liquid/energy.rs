//! Mechanical energy of the liquid, and its upper bound.
//!
//! *Method*: not from the paper. A position correction that removes an error of earlier substeps counts as velocity, so a
//! solve far from convergence adds energy: 32 layers at three iterations and 21 ms reached 2.7 times their energy and a
//! fountain of three times their height. The true motion gains only the work of moving solids. Each contact with one is an
//! impulse, m δ/dt for a projection by δ, and its work is the impulse times the surface's velocity. In an inelastic contact
//! the liquid gains at most this work. What it exchanges with sheets counts as well (`coupling/liquid_sheet.rs`). Energy above
//! the shot's first energy, that work, and the energy that lifts everything by one spacing is removed from the velocities
//! relative to the mean, which conserves momentum. Only if these are too small it is removed from the mean, as when a whole
//! column has been thrown.

use crate::{math::Vec3, par};

/// g₀ [m/s²], for the slack of the bound.
const STANDARD_GRAVITY: f64 = 9.81;

/// Mechanical energy Σ m (½ v² − g·x) [J]; without velocities, the potential energy.
pub(super) fn energy(v: &[Vec3], x: &[Vec3], gravity: Vec3, mass: f64) -> f64 {
    let kinetic = par::sum(v.len(), |i| 0.5 * f64::from(v[i].norm_squared()));
    let dot = |x: Vec3| (0..3).map(|axis| f64::from(gravity[axis]) * f64::from(x[axis])).sum::<f64>();
    mass * (kinetic - par::sum(x.len(), |i| dot(x[i])))
}

/// Energy by which `count` particles of `mass` [kg] may exceed their first energy [J]: contracting surfaces and settling
/// seeding lattices release a little, and without slack a drop at rest in zero gravity could never move.
pub(super) fn slack(count: usize, mass: f64, spacing: f32) -> f64 {
    count as f64 * mass * STANDARD_GRAVITY * f64::from(spacing)
}

/// Removes `excess` [J] from the velocities relative to the mean, and what remains from the mean.
pub(super) fn take(excess: f64, v: &mut [Vec3], mass: f64) {
    let count = v.len() as f64;
    let velocities = &*v;
    let mean: Vec<f64> =
        (0..3).map(|axis| par::sum(v.len(), |i| f64::from(velocities[i][axis])) / count).collect();
    let mean = Vec3::new(mean[0] as f32, mean[1] as f32, mean[2] as f32);
    let relative = 0.5 * mass * par::sum(v.len(), |i| f64::from((velocities[i] - mean).norm_squared()));
    let common = 0.5 * mass * count * f64::from(mean.norm_squared());
    let left = |from: f64, taken: f64| {
        if from > 0.0 { ((from - taken) / from).clamp(0.0, 1.0).sqrt() as f32 } else { 1.0 }
    };
    let (apart, together) = (left(relative, excess), left(common, excess - relative));
    par::update(v, |_, v| *v = mean * together + (*v - mean) * apart);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removing_energy_conserves_momentum_while_it_can() {
        let mut v: Vec<Vec3> = (0..50).map(|i| Vec3::new(i as f32, 3.0, (i % 7) as f32)).collect();
        let sum = |v: &[Vec3]| v.iter().sum::<Vec3>();
        let (momentum, before) = (sum(&v), energy(&v, &[], Vec3::zeros(), 2.0));
        take(1000.0, &mut v, 2.0);
        assert!((energy(&v, &[], Vec3::zeros(), 2.0) - (before - 1000.0)).abs() < 0.01);
        assert!((sum(&v) - momentum).norm() < 1e-3);
        let before = energy(&v, &[], Vec3::zeros(), 2.0);
        let common = momentum.norm_squared() as f64 / 50.0;
        take(before - 0.25 * common, &mut v, 2.0);
        assert!(
            v.iter().all(|v| (v - momentum / 100.0).norm() < 1e-3),
            "half the mean speed is left: {:?}",
            v[0]
        );
        take(1e9, &mut v, 2.0);
        assert!(v.iter().all(|v| *v == Vec3::zeros()));
    }
}
