//! How far cores reach.

use super::{
    Kernel,
    chain::{Ball, Chain, Gaussian, RosenheadMoore, WinckelmansLeonard},
    index::MAX_ORDER,
    lanes::{Eight, Lanes, splat},
};

/// The part of a core's vorticity that lies beyond a plane `t` cores away: ½ at 0, 0 far off.
///
/// Blobs side by side in a plane move the air beside it by t G(t) of what a sheet does, so this is (1 − t G(t))/2.
pub fn beyond(kernel: Kernel, t: f32) -> f32 {
    let potential = match kernel {
        Kernel::Ball => potential::<Ball>(t),
        Kernel::RosenheadMoore => potential::<RosenheadMoore>(t),
        Kernel::WinckelmansLeonard => potential::<WinckelmansLeonard>(t),
        Kernel::Gaussian => potential::<Gaussian>(t),
    };
    0.5 * (1.0 - t * potential)
}

/// G of a core of 1.
fn potential<C: Chain>(t: f32) -> f32 {
    let mut chain = [splat::<Eight>(0.0); MAX_ORDER + 1];
    C::chain(splat::<Eight>(t * t), splat::<Eight>(1.0), 0, &mut chain);
    chain[0].row()[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_beyond_a_plane_is_the_integral_of_the_core() {
        for kernel in [Kernel::Ball, Kernel::RosenheadMoore, Kernel::WinckelmansLeonard, Kernel::Gaussian] {
            // Vorticity of a core at a distance, times 4π: −(G″ + 2 G′/r).
            let density = |r: f64| match kernel {
                Kernel::Ball => f64::from(u8::from(r < 1.0)) * 3.0,
                Kernel::RosenheadMoore => 3.0 * (r * r + 1.0).powf(-2.5),
                Kernel::WinckelmansLeonard => 7.5 * (r * r + 1.0).powf(-3.5),
                Kernel::Gaussian => (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * r * r).exp(),
            };
            for t in [0.0, 0.3, 0.9, 2.0] {
                // ∫ over z > t of ∫ 2πs ω ds dz = ½ ∫ over r > t of r (r − t) 4πω dr.
                let step = 1e-3;
                let found: f64 = (0..200_000)
                    .map(|i| t + (f64::from(i) + 0.5) * step)
                    .map(|r| 0.5 * r * (r - t) * density(r) * step)
                    .sum();
                let told = f64::from(beyond(kernel, t as f32));
                assert!((told - found).abs() < 3e-3, "{kernel:?} {t}: {told} for {found}");
            }
        }
    }
}
