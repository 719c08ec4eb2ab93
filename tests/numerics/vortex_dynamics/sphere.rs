//! Hill's spherical vortex.

use super::*;

/// Hill's vortex of radius 1 and speed 1: what is inside of each cell of a lattice, its strength integrated over 6³ parts.
fn hill(spacing: f64, core: f64) -> Vortons {
    const PARTS: i32 = 6;
    let mut vortons = lattice(spacing, [1.0 + spacing; 3], core, |_| Vector3::zeros());
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
