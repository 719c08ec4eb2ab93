//! Rectangular source panels of constant density: the sources of boxes and of other solids with edges.
//!
//! *Method*: the induced velocity has a closed form ([hess67]): along the normal the solid angle of the panel, along its sides
//! the integrals of 1/r over the other two sides, which are inverse hyperbolic sines.
//! *Departs from the paper*: the integrals along an edge are unbounded there. Here their distance from an edge is at least
//! `soft`, so that velocities and gradients are those a fraction of a panel off. Far away a panel is a point source.
//!
//! Symbols: a, b → offsets from the borders along the two sides [m], z → height above the panel, h² → a² + z² + soft² [m²].
//! Limits: leakage between the centres is a few per cent on faces and more at edges, where the density ought to be unbounded.

use crate::{
    math::{
        Vec3,
        elementary::{asinh, atan},
    },
    sim::vortex::Gradient,
    solid::Pose,
};

/// Distance from which a panel counts as a point source, over its longer side: the error is less than 1 %.
const MIN_POINT_DISTANCE: f32 = 4.0;

/// Depth below a panel down to which a point still counts as outside, over its width: rounding puts some points of a face there.
const SURFACE_TOLERANCE: f32 = 1e-3;

/// A rectangular source panel of constant density.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    /// Centre [m].
    pub(super) middle: Vec3,
    /// Unit vectors along the sides, and out of the solid.
    pub(super) axes: [Vec3; 3],
    /// Half lengths of the sides [m].
    pub(super) half: [f32; 2],
    /// Smallest distance from the edges in the integrals [m].
    pub(super) soft: f32,
}

impl Tile {
    /// This panel in a solid's pose.
    pub(super) fn placed(&self, pose: &Pose) -> Self {
        Self { middle: pose.to_world(self.middle), axes: self.axes.map(|axis| pose.rotation * axis), ..*self }
    }

    /// This panel of a solid that is `scale` times as large.
    pub(super) fn scaled(&self, scale: f32) -> Self {
        Self {
            middle: self.middle * scale,
            axes: self.axes,
            half: self.half.map(|half| half * scale),
            soft: self.soft * scale,
        }
    }

    /// This panel under a reflection of positions and directions.
    pub(super) fn turned(&self, place: impl Fn(Vec3) -> Vec3, direction: impl Fn(Vec3) -> Vec3) -> Self {
        Self { middle: place(self.middle), axes: self.axes.map(direction), ..*self }
    }

    /// A point on the panel near one of its borders, which `number` selects.
    pub(super) fn near_border(&self, number: usize) -> Vec3 {
        let side = number % 2;
        let along = if (number / 2).is_multiple_of(2) { 0.8 } else { -0.8 };
        self.middle + self.axes[side] * (along * self.half[side])
    }

    /// Area of the panel [m²].
    pub(super) fn area(&self) -> f32 {
        4.0 * self.half[0] * self.half[1]
    }

    /// Distance from which it counts as a point source [m].
    pub(super) fn point_distance(&self) -> f32 {
        2.0 * MIN_POINT_DISTANCE * self.half[0].max(self.half[1])
    }

    /// The offset of `x` from the centre: `Ok` where the panel counts as a point.
    #[inline]
    fn far(&self, x: Vec3) -> Result<Vec3, Vec3> {
        let d = x - self.middle;
        if d.norm_squared() > self.point_distance().powi(2) { Ok(d) } else { Err(d) }
    }

    /// Velocity that a density of 4π induces at `x` [1].
    pub(super) fn flow(&self, x: Vec3) -> Vec3 {
        let d = match self.far(x) {
            Ok(d) => return d * (self.area() / d.norm().powi(3)),
            Err(d) => d,
        };
        let near = Near::new(self, d);
        let [a, b] = [near.a, near.b];
        // The solid angle [hess67], of a corner: the arc tangent of ab/zr.
        let z = near.z.abs().max(SURFACE_TOLERANCE * self.soft);
        let corner = |a: f32, b: f32| atan(a * b / (z * (a * a + b * b + z * z).sqrt()));
        let angle = corner(a[0], b[0]) - corner(a[0], b[1]) - corner(a[1], b[0]) + corner(a[1], b[1]);
        let outside = near.z >= -SURFACE_TOLERANCE * self.half[0].min(self.half[1]);
        let line = |h2: f32, ends: [f32; 2]| {
            let h = h2.sqrt();
            asinh(ends[0] / h) - asinh(ends[1] / h)
        };
        let [ha, hb] = near.squares(self.soft);
        self.axes[0] * (line(ha[1], b) - line(ha[0], b))
            + self.axes[1] * (line(hb[1], a) - line(hb[0], a))
            + self.axes[2] * if outside { angle } else { -angle }
    }

    /// Velocity gradient that a density of 4π induces at `x` [1/m].
    pub(super) fn strain(&self, x: Vec3) -> Gradient {
        let d = match self.far(x) {
            Ok(d) => return point_strain(d) * self.area(),
            Err(d) => d,
        };
        let near = Near::new(self, d);
        let [a, b] = [near.a, near.b];
        let [ha, hb] = near.squares(self.soft);
        // Of a line: the ends, and the derivative by half its squared distance.
        let ends = |h2: f32, ends: [f32; 2]| ends.map(|end| 1.0 / (end * end + h2).sqrt());
        let slope = |h2: f32, at: [f32; 2]| {
            let inverse = ends(h2, at);
            (at[0] * inverse[0] - at[1] * inverse[1]) / h2
        };
        let (ka, kb) = (ha.map(|h2| slope(h2, b)), hb.map(|h2| slope(h2, a)));
        let along = |h2: f32| {
            let [one, other] = ends(h2, b);
            one - other
        };
        let uu = a[0] * ka[0] - a[1] * ka[1];
        let vv = b[0] * kb[0] - b[1] * kb[1];
        let uv = along(ha[1]) - along(ha[0]);
        let (uz, vz) = (near.z * (ka[0] - ka[1]), near.z * (kb[0] - kb[1]));
        let local = Gradient::new(uu, uv, uz, uv, vv, vz, uz, vz, -(uu + vv));
        let turn = Gradient::from_columns(&self.axes);
        turn * local * turn.transpose()
    }
}

/// A point in a panel's coordinates.
struct Near {
    /// Offsets from the lower and the upper border along each side [m].
    a: [f32; 2],
    b: [f32; 2],
    z: f32,
}

impl Near {
    fn new(tile: &Tile, d: Vec3) -> Self {
        let [u, v, z] = tile.axes.map(|axis| axis.dot(&d));
        let [p, q] = tile.half;
        Self { a: [u + p, u - p], b: [v + q, v - q], z }
    }

    /// The squared distances of the borders' lines, at least `soft` each [m²].
    fn squares(&self, soft: f32) -> [[f32; 2]; 2] {
        [self.a, self.b].map(|of| of.map(|offset| offset * offset + self.z * self.z + soft * soft))
    }
}

/// The velocity gradient of a point source of 4π m³/s at an offset `d` from it [1/m³].
#[inline]
pub(super) fn point_strain(d: Vec3) -> Gradient {
    let r2 = d.norm_squared();
    let inverse = 1.0 / (r2 * r2.sqrt());
    (Gradient::identity() - d * d.transpose() * (3.0 / r2)) * inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile() -> Tile {
        let turn = nalgebra::Rotation3::from_euler_angles(0.4_f32, -0.7, 1.1);
        let axes = [0, 1, 2].map(|axis| turn * Vec3::ith(axis, 1.0));
        Tile { middle: Vec3::new(0.3, -0.2, 0.5), axes, half: [0.5, 0.3], soft: 1e-3 }
    }

    /// The sum over many point sources on the panel.
    fn summed(tile: &Tile, x: Vec3) -> Vec3 {
        let n = 200;
        let at = |i: usize| (2 * i + 1) as f32 / n as f32 - 1.0;
        let one = |i: usize, j: usize| {
            let y =
                tile.middle + tile.axes[0] * (at(i) * tile.half[0]) + tile.axes[1] * (at(j) * tile.half[1]);
            ((x - y) / (x - y).norm().powi(3)).cast::<f64>()
        };
        let sum: nalgebra::Vector3<f64> = (0..n * n).map(|at| one(at / n, at % n)).sum();
        (sum * f64::from(tile.area()) / (n * n) as f64).cast()
    }

    #[test]
    fn a_source_panel_induces_what_its_points_do() {
        let tile = tile();
        for local in
            [[0.1, 0.2, 0.2], [0.7, -0.1, 0.1], [0.6, 0.5, -0.3], [-0.4, 0.25, 0.15], [3.0, 2.0, 2.5]]
        {
            let x = tile.middle + (0..3).map(|axis| tile.axes[axis] * local[axis]).sum::<Vec3>();
            let (found, exact) = (tile.flow(x), summed(&tile, x));
            // Far away the panel is a point source.
            let allowed = if local[0] > 2.0 { 1e-2 } else { 5e-3 };
            assert!((found - exact).norm() < allowed * exact.norm(), "{local:?}: {found} for {exact}");
        }
        // On the panel, and a rounding error below: half of the flux goes to either side.
        for below in [0.0, 1e-6] {
            let out = tile.flow(tile.middle - tile.axes[2] * below).dot(&tile.axes[2]);
            assert!((out / (2.0 * std::f32::consts::PI) - 1.0).abs() < 1e-2, "{out}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_velocity() {
        for soft in [1e-3, 0.2] {
            let tile = Tile { soft, ..tile() };
            let e = 1e-2;
            for x in [[0.5, 0.3, 0.9], [1.2, -0.4, 0.1], [-0.5, 0.1, 0.2], [4.0, 2.0, 3.0]].map(Vec3::from) {
                let found = tile.strain(x);
                for (row, side) in tile.axes.iter().enumerate() {
                    let slope = (tile.flow(x + side * e) - tile.flow(x - side * e)) / (2.0 * e);
                    // Softening leaves the normal component as it is; the gradient is that of the others, without divergence.
                    for other in tile.axes.iter().take(if soft < 0.1 { 3 } else { 2 }) {
                        let (found, exact) = (other.dot(&(found * side)), other.dot(&slope));
                        let allowed = 0.02 * found.abs().max(0.1 * slope.norm());
                        assert!((found - exact).abs() < allowed, "{soft} {x} {row}: {found} for {exact}");
                    }
                }
                assert!(found.trace().abs() < 1e-4 * found.norm(), "{x}: {found}");
            }
        }
    }
}
