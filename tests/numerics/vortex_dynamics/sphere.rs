//! Hill's spherical vortex.

use super::*;

/// Hill's vortex of radius 1 and speed 1: in each cell of a seeding lattice, its strength integrated over 6³ parts.
fn hill(spacing: f64, core: f64) -> Vortons {
    const PARTS: i32 = 6;
    let mut vortons = seeding_lattice(spacing, [1.0 + spacing; 3], core, |_| Vector3::zeros());
    for (x, strength) in vortons.position.iter().zip(&mut vortons.strength) {
        let mut sum = Vector3::zeros();
        for part in 0..PARTS.pow(3) {
            let step = Vector3::new(part % PARTS, part / PARTS % PARTS, part / (PARTS * PARTS));
            let at = x.cast() + step.map(|k| (f64::from(2 * k + 1) / f64::from(2 * PARTS) - 0.5) * spacing);
            if at.norm_squared() < 1.0 {
                // ω_φ = 7.5 U ρ/a².
                sum += Vector3::new(-at.y, at.x, 0.0) * 7.5;
            }
        }
        *strength = (sum * (spacing / f64::from(PARTS)).powi(3)).cast();
    }
    let kept: Vec<usize> = (0..vortons.len()).filter(|&i| vortons.strength[i] != Vec3::zeros()).collect();
    Vortons {
        position: kept.iter().map(|&i| vortons.position[i]).collect(),
        strength: kept.iter().map(|&i| vortons.strength[i]).collect(),
        core: kept.iter().map(|&i| vortons.core[i]).collect(),
    }
}

/// The velocity of Hill's vortex in air at rest far away: inside u_z = U + 3/2 U (1 − (2ρ² + z²)/a²), u_ρ = 3/2 U ρz/a², outside
/// U a³/2 (3z x − r² e_z)/r⁵, with U = a = 1.
fn exact(x: Vector3<f64>) -> Vector3<f64> {
    let r2 = x.norm_squared();
    if r2 > 1.0 {
        return (x * (3.0 * x.z) - Vector3::z() * r2) * (0.5 * r2.powf(-2.5));
    }
    let rho2 = x.x * x.x + x.y * x.y;
    Vector3::new(1.5 * x.x * x.z, 1.5 * x.y * x.z, 1.0 + 1.5 * (1.0 - 2.0 * rho2 - x.z * x.z))
}

/// Outside, round cores do not show, and the error is that of the moments of the ball on the seeding lattice.
#[test]
fn hills_field_is_found_with_second_order_inside_and_with_fourth_outside() {
    // Points in all directions, at least three cores of the coarsest seeding lattice from the surface.
    let at = |r: f64| {
        move |i: u32| {
            let (z, angle) = (f64::from(i) / 20.0 - 0.975, 2.4 * f64::from(i));
            let across = (1.0 - z * z).sqrt();
            Vector3::new(across * angle.cos(), across * angle.sin(), z) * (r * (0.5 + f64::from(i % 4) / 6.0))
        }
    };
    let inside: Vec<Vector3<f64>> = (0..40).map(at(0.6)).chain([Vector3::zeros()]).collect();
    let outside: Vec<Vector3<f64>> =
        (0..40).map(at(1.5)).map(|x| x.normalize() * x.norm().max(1.4)).collect();
    for (name, points, [low, high], most) in
        [("inside", inside, [1.7, 2.3], 1.25e-2), ("outside", outside, [3.0, 5.0], 4e-4)]
    {
        let errors = [0.2, 0.1, 0.05].map(|spacing| {
            let vortons = hill(spacing, 1.5 * spacing);
            let targets: Vec<Vec3> = points.iter().map(|x| x.cast()).collect();
            let found = induced(
                &vortons,
                Targets::Points(&targets),
                Quantity::Velocity,
                FlowParams::default().kernel,
                Method::Direct,
            )
            .unwrap();
            let (mut off, mut all) = (0.0, 0.0);
            for (x, u) in points.iter().zip(&found.velocity) {
                off += (u.cast() - exact(*x)).norm_squared();
                all += exact(*x).norm_squared();
            }
            (off / all).sqrt()
        });
        let orders = [0, 1].map(|k| (errors[k] / errors[k + 1]).log2());
        assert!(orders.iter().all(|order| (low..high).contains(order)), "{name}: {errors:?} {orders:?}");
        assert!(errors[2] < most, "{name}: {errors:?}");
    }
    // In the middle the air is two and a half times as fast as the vortex.
    assert!((exact(Vector3::zeros()).z - 2.5).abs() < 1e-12);
}

#[test]
fn hills_vortex_travels_at_its_speed_with_second_order() {
    let seconds = 0.2;
    let errors = [0.25, 0.125, 0.0833].map(|spacing| {
        let mut flow = flow(direct(), &hill(spacing, 1.5 * spacing), spacing.powi(3) as f32);
        advance(&mut flow, seconds);
        1.0 - center(&flow.vortons) / seconds
    });
    let order = |k: usize, ratio: f64| (errors[k] / errors[k + 1]).ln() / ratio.ln();
    let orders = [order(0, 2.0), order(1, 0.125 / 0.0833)];
    assert!(orders.iter().all(|order| (1.5..2.5).contains(order)), "{errors:?} {orders:?}");
    assert!(errors[2].abs() < 0.035, "{errors:?}");
}
