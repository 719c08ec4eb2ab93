//! The extent of cores.

use super::{
    Kernel,
    index::MAX_ORDER,
    kernels::{Ball, Gaussian, RadialKernel, RosenheadMoore, WinckelmansLeonard},
};
use crate::simd::{Lanes, ScalarLanes, splat};

/// The fraction of the vorticity of a core that lies beyond a plane at a distance of `t` cores: ½ at 0, 0 far
/// away.
///
/// A plane layer of vortons induces t G(t) of the velocity of a vortex sheet, so this is (1 − t G(t))/2.
pub(crate) fn fraction_beyond_plane(kernel: Kernel, t: f32) -> f32 {
    let potential = match kernel {
        Kernel::Ball => potential::<Ball>(t),
        Kernel::RosenheadMoore => potential::<RosenheadMoore>(t),
        Kernel::WinckelmansLeonard => potential::<WinckelmansLeonard>(t),
        Kernel::Gaussian => potential::<Gaussian>(t),
    };
    0.5 * (1.0 - t * potential)
}

/// G for a core of 1.
fn potential<K: RadialKernel>(t: f32) -> f32 {
    let mut derivatives = [splat::<ScalarLanes>(0.0); MAX_ORDER + 1];
    K::derivatives(splat::<ScalarLanes>(t * t), splat::<ScalarLanes>(1.0), 0, &mut derivatives);
    derivatives[0].to_array()[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fraction_beyond_a_plane_is_the_integral_of_the_core() {
        for kernel in [Kernel::Ball, Kernel::RosenheadMoore, Kernel::WinckelmansLeonard, Kernel::Gaussian] {
            // The vorticity of a core at a distance, times 4π: −(G″ + 2 G′/r).
            let density = |r: f64| match kernel {
                Kernel::Ball => f64::from(u8::from(r < 1.0)) * 3.0,
                Kernel::RosenheadMoore => 3.0 * (r * r + 1.0).powf(-2.5),
                Kernel::WinckelmansLeonard => 7.5 * (r * r + 1.0).powf(-3.5),
                Kernel::Gaussian => (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * r * r).exp(),
            };
            for t in [0.0, 0.3, 0.9, 2.0] {
                // ∫ over z > t of ∫ 2πs ω ds dz = ½ ∫ over r > t of r (r − t) 4πω dr.
                let step = 1e-3;
                let exact: f64 = (0..200_000)
                    .map(|i| t + (f64::from(i) + 0.5) * step)
                    .map(|r| 0.5 * r * (r - t) * density(r) * step)
                    .sum();
                let found = f64::from(fraction_beyond_plane(kernel, t as f32));
                assert!((found - exact).abs() < 3e-3, "{kernel:?} {t}: {found} for {exact}");
            }
        }
    }
}
