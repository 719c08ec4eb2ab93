//! The density at the surface of filled space.
//!
//! A liquid at rest fills its cells of spacing³, so its surface lies half a spacing beyond the outermost layer of
//! particles. The threshold is the mean density of that plane for the cubic lattice that fills z ≤ 0, in the
//! measure that [`density`](super::density) uses, with the truncated neighbourhoods of the layers at the surface.

use super::density::kernel;

/// The density φ [–] half a spacing beyond a filled half-space, for a kernel of support `kernel_radius` [spacings].
///
/// # Panics
/// If `kernel_radius` is not above one half: the kernel would not reach the surface.
pub fn surface_threshold(kernel_radius: f32) -> f32 {
    assert!(kernel_radius > 0.5 && kernel_radius.is_finite(), "the kernel reaches the surface");
    let h = f64::from(kernel_radius);
    let n = h.ceil() as i32;

    // V_j W(0) of the layers z = 0, −1, … down to the last one the plane sees.
    let weights: Vec<f64> =
        (0..=n).map(|depth| 1.0 / lattice_sum(h, |z| z <= depth, [0.0, 0.0, 0.0])).collect();

    // Mean of φ over one cell of the plane z = ½, by the midpoint rule: a node every sixteenth of a spacing.
    let samples = 16;
    let mut mean = 0.0;
    for sample in 0..samples * samples {
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(samples);
        let (x, y) = (at(sample % samples), at(sample / samples));
        for (depth, weight) in weights.iter().enumerate() {
            let depth = depth as f64;
            mean += weight * lattice_sum(h, |z| z == 0, [x, y, 0.5 + depth]) / f64::from(samples * samples);
        }
    }
    mean as f32
}

/// Σ K(|x − j|/h) over the integer lattice points j whose third coordinate passes `layer`.
fn lattice_sum(h: f64, layer: impl Fn(i32) -> bool, x: [f64; 3]) -> f64 {
    let n = h.ceil() as i32 + 1;
    let mut sum = 0.0;
    for k in (-n..=n).filter(|&k| layer(k)) {
        for j in -n..=n {
            for i in -n..=n {
                let d2: f64 = [i, j, k].iter().zip(x).map(|(&a, b)| (f64::from(a) - b).powi(2)).sum();
                sum += f64::from(kernel((d2.sqrt() / h) as f32));
            }
        }
    }
    sum
}
