//! Radial smoothing kernels W(r, h) [1/m³] with compact support h [m].
//!
//! *Method* Poly6 and Spiky: [mcg03] Eqs. 20–21, the pair that [pbf] uses; cubic spline: [monaghan92], scaled
//! so that its support ends at h. *Departs from the paper*: none.
//! Every kernel here integrates to 1 over its support; gradients are with respect to the first argument.

use super::Vec3;
use std::f32::consts::PI;

/// The Poly6 kernel, used for density.
#[derive(Clone, Copy, Debug)]
pub struct Poly6 {
    h2: f32,
    scale: f32,
}

impl Poly6 {
    /// A kernel of support `h` [m], `h` > 0.
    pub fn new(h: f32) -> Self {
        Self { h2: h * h, scale: 315.0 / (64.0 * PI * h.powi(9)) }
    }

    /// W at the squared distance `r2` [m²].
    #[inline]
    pub fn value(&self, r2: f32) -> f32 {
        let d = (self.h2 - r2).max(0.0);
        self.scale * d * d * d // [mcg03] Eq. 20
    }
}

/// The gradient of the Spiky kernel, used for corrections.
#[derive(Clone, Copy, Debug)]
pub struct SpikyGradient {
    h: f32,
    scale: f32,
}

impl SpikyGradient {
    /// A kernel of support `h` [m], `h` > 0.
    pub fn new(h: f32) -> Self {
        Self { h, scale: -45.0 / (PI * h.powi(6)) }
    }

    /// ∇W [1/m⁴] for the offset `d` = x_i − x_j. Zero at the centre, where the direction is undefined.
    #[inline]
    pub fn value(&self, d: Vec3) -> Vec3 {
        let r = d.norm();
        if r >= self.h || r == 0.0 {
            return Vec3::zeros();
        }
        let q = self.h - r;
        d * (self.scale * q * q / r) // [mcg03] Eq. 21, differentiated
    }
}

/// The cubic spline of [monaghan92] with support `h`.
#[derive(Clone, Copy, Debug)]
pub struct CubicSpline {
    h: f32,
    scale: f32,
}

impl CubicSpline {
    /// A kernel of support `h` [m], `h` > 0.
    pub fn new(h: f32) -> Self {
        Self { h, scale: 8.0 / (PI * h.powi(3)) }
    }

    /// W at the distance `r` [m].
    #[inline]
    pub fn value(&self, r: f32) -> f32 {
        let q = r / self.h;
        if q >= 1.0 {
            0.0
        } else if q > 0.5 {
            let t = 1.0 - q;
            self.scale * 2.0 * t * t * t
        } else {
            self.scale * (1.0 + 6.0 * q * q * (q - 1.0))
        }
    }

    /// ∇W [1/m⁴] for the offset `d` = x_i − x_j.
    #[inline]
    pub fn gradient(&self, d: Vec3) -> Vec3 {
        let r = d.norm();
        let q = r / self.h;
        if q >= 1.0 || r == 0.0 {
            return Vec3::zeros();
        }
        let slope = if q > 0.5 { -6.0 * (1.0 - q) * (1.0 - q) } else { 6.0 * q * (3.0 * q - 2.0) };
        d * (self.scale * slope / (self.h * r))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ f(r) 4πr² dr over [0, h] by the midpoint rule.
    fn integral(h: f32, f: impl Fn(f64) -> f64) -> f64 {
        let n = 20_000;
        let step = f64::from(h) / f64::from(n);
        (0..n)
            .map(|i| {
                let r = (f64::from(i) + 0.5) * step;
                f(r) * 4.0 * std::f64::consts::PI * r * r * step
            })
            .sum()
    }

    #[test]
    fn kernels_integrate_to_one() {
        for h in [0.01_f32, 1.0, 20.0] {
            let poly6 = Poly6::new(h);
            assert!((integral(h, |r| f64::from(poly6.value((r * r) as f32))) - 1.0).abs() < 1e-4);
            let cubic = CubicSpline::new(h);
            assert!((integral(h, |r| f64::from(cubic.value(r as f32))) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn gradients_are_the_slopes_of_their_kernels() {
        let h: f32 = 0.7;
        let spiky_value = |r: f32| 15.0 / (PI * h.powi(6)) * (h - r).powi(3);
        let cubic = CubicSpline::new(h);
        for r in [0.05_f32, 0.2, 0.34, 0.36, 0.6] {
            let e = 1e-3;
            let slope = (spiky_value(r + e) - spiky_value(r - e)) / (2.0 * e);
            assert!((SpikyGradient::new(h).value(Vec3::new(r, 0.0, 0.0)).x / slope - 1.0).abs() < 1e-3);
            let slope = (cubic.value(r + e) - cubic.value(r - e)) / (2.0 * e);
            assert!((cubic.gradient(Vec3::new(0.0, r, 0.0)).y / slope - 1.0).abs() < 1e-2, "r {r}");
        }
        assert_eq!(cubic.gradient(Vec3::zeros()), Vec3::zeros());
    }
}
