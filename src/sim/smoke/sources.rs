//! Sources in solids and the velocity that they induce.
//!
//! *Method*: a point source of strength q induces q d/(4π r³), a source panel the integral of that (`tiles.rs`). With a plane,
//! the mirror image of each source is added (method of images).
//!
//! Symbols: q → `strength` [m³/s], d → offset from the source [m].
//! Limits: point sources are singular; they lie in solids, where the velocity is not needed. Source panels lie on faces or just
//! below; next to an edge corners of those below may be in the air.

use super::{
    point_sums::{self, PointSource},
    tiles::Tile,
};
use crate::{
    math::Vec3,
    sim::vortex::{Gradient, Vortons},
    solid::Pose,
};

/// A point source or a source panel.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    /// At a point [m].
    Point(Vec3),
    /// A rectangular source panel.
    Tile(Tile),
}

impl Source {
    /// This source in a solid's pose.
    pub(super) fn placed(&self, pose: &Pose) -> Self {
        match self {
            Self::Point(y) => Self::Point(pose.to_world(*y)),
            Self::Tile(tile) => Self::Tile(tile.placed(pose)),
        }
    }

    /// This source in a solid that is `scale` times as large.
    pub(super) fn scaled(&self, scale: f32) -> Self {
        match self {
            Self::Point(y) => Self::Point(y * scale),
            Self::Tile(tile) => Self::Tile(tile.scaled(scale)),
        }
    }

    /// Velocity that it and its mirror image induce at `x`: a point of 4π m³/s [1/m²], a panel of 4π m/s [1].
    #[inline]
    pub(super) fn flow(&self, x: Vec3, mirror: Option<(Vec3, f32)>) -> Vec3 {
        match self {
            Self::Point(y) => flow(x, *y, mirror),
            Self::Tile(tile) => {
                tile.flow(x) + mirror.map_or(Vec3::zeros(), |mirror| mirrored(tile, mirror).flow(x))
            }
        }
    }
}

/// Sources that keep the air out of solids.
#[derive(Clone, Debug, Default)]
pub(super) struct Sources {
    /// Points [m], and their q/4π [m³/s].
    pub(super) points: Vec<(Vec3, f32)>,
    /// Source panels, and their density over 4π [m/s].
    pub(super) tiles: Vec<(Tile, f32)>,
    pub(super) mirror: Option<(Vec3, f32)>,
    /// Vorticity of solids that turn and shed, as vortons.
    pub(super) spin: Vortons,
    /// Normal flow that is left at the panels, relative to that without sources.
    pub(super) residual: f64,
}

impl Sources {
    /// Adds the induced velocity at `points` [m/s].
    pub(super) fn add_velocity(&self, points: &[Vec3], velocity: &mut [Vec3]) {
        let tiles = self.with_images();
        let near = |number: usize, x: Vec3| tiles[number].0.flow(x) * tiles[number].1;
        point_sums::add_velocity(&self.far(&tiles), points, velocity, near);
    }

    /// Adds the gradient of the induced velocity at `points` [1/s].
    pub(super) fn add_gradient(&self, points: &[Vec3], gradient: &mut [Gradient]) {
        let tiles = self.with_images();
        let near = |number: usize, x: Vec3| tiles[number].0.strain(x) * tiles[number].1;
        point_sums::add_gradient(&self.far(&tiles), points, gradient, near);
    }

    /// Source panels as the points that they are far away, then point sources, both with their mirror images.
    fn far(&self, tiles: &[(Tile, f32)]) -> Vec<PointSource> {
        let tiles = tiles.iter().map(|(tile, q)| PointSource {
            at: tile.middle,
            strength: tile.area() * q,
            reach2: tile.point_distance().powi(2),
        });
        let point = |at: Vec3, strength: f32| PointSource { at, strength, reach2: 0.0 };
        let image = |&(y, q): &(Vec3, f32)| self.mirror.map(|mirror| point(reflect(y, mirror), q));
        let points = self.points.iter().map(|&(y, q)| point(y, q));
        tiles.chain(points).chain(self.points.iter().filter_map(image)).collect()
    }

    /// Source panels and their mirror images.
    fn with_images(&self) -> Vec<(Tile, f32)> {
        let images = self
            .mirror
            .iter()
            .flat_map(|mirror| self.tiles.iter().map(|&(tile, q)| (mirrored(&tile, *mirror), q)));
        self.tiles.iter().copied().chain(images).collect()
    }
}

/// Velocity that a point source of 4π at `y` and its mirror image induce at `x` [1/m²].
#[inline]
fn flow(x: Vec3, y: Vec3, mirror: Option<(Vec3, f32)>) -> Vec3 {
    let one = |d: Vec3| {
        let r2 = d.norm_squared();
        d / (r2 * r2.sqrt())
    };
    one(x - y) + mirror.map_or(Vec3::zeros(), |mirror| one(x - reflect(y, mirror)))
}

/// The mirror image of a source panel.
fn mirrored(tile: &Tile, mirror: (Vec3, f32)) -> Tile {
    tile.turned(|x| reflect(x, mirror), |v| v - mirror.0 * (2.0 * mirror.0.dot(&v)))
}

/// The mirror image of a point in a plane of this normal and offset [m].
pub(super) fn reflect(x: Vec3, (n, offset): (Vec3, f32)) -> Vec3 {
    x - n * (2.0 * (n.dot(&x) - offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sim::smoke::panels::panels, solid::Shape};

    #[test]
    fn gradients_are_those_of_the_velocity() {
        let cuboid = Shape::Box { min: [-0.1, -0.2, 0.1], max: [0.3, 0.2, 0.4] };
        let made = panels(&cuboid, 9.0);
        let tiles =
            made.iter().zip([0.3, -0.2, 0.5, 0.1, -0.4, 0.2]).filter_map(|(panel, q)| match panel.source {
                Some(Source::Tile(tile)) => Some((tile, q)),
                _ => None,
            });
        let tiles: Vec<(Tile, f32)> = tiles.collect();
        let sources = Sources {
            points: vec![(Vec3::new(0.1, 0.0, 0.2), 0.7), (Vec3::new(-0.3, 0.1, 0.1), -0.4)],
            tiles,
            mirror: Some((Vec3::z(), 0.0)),
            ..Sources::default()
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
        assert!(at(Vec3::new(0.3, 0.2, 0.0)).z.abs() < 1e-6, "no flow through the plane");
    }
}
