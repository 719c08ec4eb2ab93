//! Point sources, and how they move the air.
//!
//! *Method*: a source of q moves the air by q d/(4π r³); with a mirror, its twin beyond it does the same.
//!
//! Symbols: q → `strength` [m³/s], d → offset from the source [m].
//! Limits: a source is singular where it stands; sources stand in solids, where nothing is asked of them.

use crate::{math::Vec3, par, sim::vortex::Gradient};

/// Sources that keep the air out.
#[derive(Clone, Debug, Default)]
pub(super) struct Sources {
    /// Position [m] and q/4π [m³/s].
    pub(super) all: Vec<(Vec3, f32)>,
    pub(super) mirror: Option<(Vec3, f32)>,
    /// What is left of the flow through the panels, over what there was.
    pub(super) residual: f64,
}

impl Sources {
    /// Adds what they make the air move at `points` [m/s].
    pub(super) fn add_velocity(&self, points: &[Vec3], velocity: &mut [Vec3]) {
        if self.all.is_empty() {
            return;
        }
        par::update(velocity, |i, v| {
            for &(y, q) in &self.all {
                *v += flow(points[i], y, self.mirror) * q;
            }
        });
    }

    /// Adds its gradient at `points` [1/s].
    pub(super) fn add_gradient(&self, points: &[Vec3], gradient: &mut [Gradient]) {
        if self.all.is_empty() {
            return;
        }
        par::update(gradient, |i, gradient| {
            for &(y, q) in &self.all {
                *gradient += strain(points[i] - y) * q;
                if let Some(mirror) = self.mirror {
                    *gradient += strain(points[i] - reflect(y, mirror)) * q;
                }
            }
        });
    }
}

/// How a source of 4π at `y` moves the air at `x` [1/m²], with its mirrored twin.
#[inline]
pub(super) fn flow(x: Vec3, y: Vec3, mirror: Option<(Vec3, f32)>) -> Vec3 {
    let one = |d: Vec3| {
        let r2 = d.norm_squared();
        d / (r2 * r2.sqrt())
    };
    one(x - y) + mirror.map_or(Vec3::zeros(), |mirror| one(x - reflect(y, mirror)))
}

/// The gradient of that at an offset `d` from the source.
#[inline]
fn strain(d: Vec3) -> Gradient {
    let r2 = d.norm_squared();
    let inverse = 1.0 / (r2 * r2.sqrt());
    (Gradient::identity() - d * d.transpose() * (3.0 / r2)) * inverse
}

/// A point mirrored by a plane of this normal and offset [m].
pub(super) fn reflect(x: Vec3, (n, offset): (Vec3, f32)) -> Vec3 {
    x - n * (2.0 * (n.dot(&x) - offset))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_those_of_the_velocity() {
        let sources = Sources {
            all: vec![(Vec3::new(0.1, 0.0, 0.2), 0.7), (Vec3::new(-0.3, 0.1, 0.1), -0.4)],
            mirror: Some((Vec3::z(), 0.0)),
            residual: 0.0,
        };
        let (x, e) = (Vec3::new(0.5, 0.4, 0.6), 1e-2);
        let at = |x: Vec3| {
            let mut v = [Vec3::zeros()];
            sources.add_velocity(&[x], &mut v);
            v[0]
        };
        let mut gradient = [Gradient::zeros()];
        sources.add_gradient(&[x], &mut gradient);
        for axis in 0..3 {
            let step = Vec3::ith(axis, e);
            let slope = (at(x + step) - at(x - step)) / (2.0 * e);
            assert!((gradient[0].column(axis) - slope).norm() < 2e-3 * slope.norm(), "{axis}");
        }
        assert!(at(Vec3::new(0.3, 0.2, 0.0)).z.abs() < 1e-6, "nothing goes through the mirror");
    }
}
