//! The error of induced velocities, measured at some of the targets.

use super::{Kernel, Method, OutOfRange, Quantity, Targets, Vortons, induced};
use crate::math::Vec3;

/// The relative L2 error of the velocities `found` at `targets`, compared with the sum over all pairs at up to `samples` of
/// them; 0 where all velocities are. The time is proportional to `samples` times the number of vortons.
///
/// # Errors
/// [`OutOfRange`] as of [`induced`].
///
/// # Panics
/// If there are not as many velocities as targets.
pub fn sampled_error(
    vortons: &Vortons,
    targets: Targets<'_>,
    kernel: Kernel,
    found: &[Vec3],
    samples: usize,
) -> Result<f64, OutOfRange> {
    let points = targets.positions(vortons);
    assert_eq!(points.len(), found.len(), "a velocity for every target");
    // The samples are distributed evenly over the targets.
    let samples = samples.min(points.len());
    let chosen: Vec<usize> = (0..samples).map(|k| k * points.len() / samples).collect();
    let at: Vec<Vec3> = chosen.iter().map(|&i| points[i]).collect();
    let exact = induced(vortons, Targets::Points(&at), Quantity::Velocity, kernel, Method::Direct)?.velocity;
    let (mut error, mut whole) = (0.0, 0.0);
    for (&i, exact) in chosen.iter().zip(&exact) {
        error += f64::from((found[i] - exact).norm()).powi(2);
        whole += f64::from(exact.norm()).powi(2);
    }
    // NaN is not 0.
    Ok(if error == 0.0 { 0.0 } else { (error / whole).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_in_a_velocity_is_reported_as_nan() {
        let vortons = Vortons {
            position: vec![Vec3::zeros(), Vec3::x()],
            strength: vec![Vec3::z(); 2],
            core: vec![0.1; 2],
        };
        let at =
            |found: &[Vec3]| sampled_error(&vortons, Targets::Vortons, Kernel::Gaussian, found, 2).unwrap();
        let exact = induced(&vortons, Targets::Vortons, Quantity::Velocity, Kernel::Gaussian, Method::Direct)
            .unwrap()
            .velocity;
        assert_eq!(at(&exact), 0.0);
        assert!(at(&[Vec3::repeat(f32::NAN), exact[1]]).is_nan());
        assert!((at(&[exact[0] * 1.1, exact[1] * 1.1]) - 0.1).abs() < 1e-6);
    }
}
