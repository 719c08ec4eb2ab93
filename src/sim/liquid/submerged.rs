//! Bodies that start inside the liquid, and move too slowly in it.
//!
//! *Method*: liquid that rests in the rows in which it was seeded flows around a body only where the kernel is wide enough (docs/decisions/048).
//! Limits: what is inside the sources is judged by the corners of the box around a body, of a mesh that of its distance field, and by the
//! ends of a ball along the axes.

use super::{LiquidParams, LiquidSource, SubmergedBody};
use crate::{
    math::Vec3,
    solid::{Pose, RigidBody, Shape, Solid},
};

/// Support of the kernel in spacings from which on bodies move through liquid that rests in its rows. With 2, a ball of twice the
/// density of viscous liquid slows down until it stays; with 2.2 it sinks at 0.9 of its speed with 2.5. In water a ball of half the density and 4
/// spacings of radius rises by 0.2 of the distance in theory with 2, and by 0.75 of it with 2.2.
pub(super) const FREE_KERNEL_RADIUS: f32 = 2.2;

/// Inner radius in spacings from which on a body is not named.
const SUFFICIENT_SPACINGS: f64 = 20.0;

/// Whether a shape at a pose is inside the sources.
fn is_submerged(shape: &Shape, pose: Pose, sources: &[LiquidSource]) -> bool {
    let Some((low, high)) = shape.bounds() else { return false };
    let (center, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let outermost: Vec<Vec3> = match shape {
        Shape::Sphere { .. } => {
            (0..3).flat_map(|axis| [-1.0, 1.0].map(|side| Vec3::ith(axis, side * half[axis]))).collect()
        }
        _ => (0..8_u8)
            .map(|corner| half.map_with_location(|axis, _, h| if corner >> axis & 1 == 1 { h } else { -h }))
            .collect(),
    };
    outermost.into_iter().all(|offset| {
        let x = pose.to_world(center + offset);
        sources.iter().any(|source| source.shape.signed_distance(x) <= 0.0)
    })
}

/// The smallest of the bodies that start inside the sources, if the kernel is narrow, and the body is small, but not thin.
pub(super) fn submerged_body(
    params: &LiquidParams,
    (solids, bodies): (&[Solid], &[RigidBody]),
) -> Option<SubmergedBody> {
    if params.kernel_radius >= FREE_KERNEL_RADIUS {
        return None;
    }
    let mut found: Option<SubmergedBody> = None;
    for ((index, solid), body) in (0..).zip(solids).zip(bodies) {
        let spacings = f64::from(solid.shape.inner_radius() / params.spacing);
        let is_listed =
            2.0 * spacings >= f64::from(params.kernel_radius - 1.0) && spacings < SUFFICIENT_SPACINGS;
        if is_listed && is_submerged(&solid.shape, body.pose(), &params.source) {
            let others = found.map_or(0, |found| found.others + 1);
            let smallest = found.filter(|found| found.spacings <= spacings);
            let smallest = smallest.unwrap_or(SubmergedBody { index, others, spacings });
            found = Some(SubmergedBody { others, ..smallest });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::{
            Timeline, World,
            liquid::{ImplicitViscosity, Liquid},
        },
        solid::{BodyState, MassProperties},
    };

    /// A body at a position, turned by 45 degrees about z.
    fn turned_body((shape, position): (Shape, [f32; 3])) -> (Solid, RigidBody) {
        let state = BodyState {
            position: position.into(),
            rotation: (Vec3::z() * 0.382_683_43, 0.923_879_5),
            velocity: Vec3::zeros(),
            angular_velocity: Vec3::zeros(),
        };
        let body = RigidBody::new(MassProperties::new(&shape, 500.0).unwrap(), &state).unwrap();
        (Solid::fixed(shape), body)
    }

    /// What is listed of bodies in water with a spacing of 10 cm, from 0 to 2 m in two sources: index, number of others and spacings.
    fn listed(
        bodies: Vec<(Shape, [f32; 3])>,
        kernel_radius: f32,
        viscosity: Option<f32>,
    ) -> Option<(u32, u32, f64)> {
        let half = |low: f32, high: f32| LiquidSource {
            shape: Shape::Box { min: [low, 0.0, 0.0], max: [high, 2.0, 2.0] },
            velocity: [0.0; 3],
            jitter: None,
            viscosity: None,
            color: None,
        };
        let viscosity =
            viscosity.map(|dynamic| ImplicitViscosity { dynamic, tolerance: 1e-3, max_iterations: 100 });
        let source = vec![half(0.0, 1.0), half(1.0, 2.0)];
        let params = LiquidParams { source, kernel_radius, viscosity, ..LiquidParams::new(0.1) };
        let (solids, bodies): (Vec<_>, Vec<_>) = bodies.into_iter().map(turned_body).unzip();
        let world = World { gravity: Vec3::z() * -9.81, solids: Vec::new() };
        let liquid = Liquid::seed(params, &world, (&solids, &bodies), Timeline::default());
        let found = liquid.expect("the sources hold particles").seeded.submerged_body?;
        Some((found.index, found.others, found.spacings.round()))
    }

    #[test]
    fn small_bodies_that_start_inside_the_sources_are_listed() {
        let ball = |radius: f32| Shape::Sphere { center: [0.0; 3], radius };
        let block = |min: [f32; 3], max: [f32; 3]| Shape::Box { min, max };
        let (middle, high) = ([1.0; 3], [1.0, 1.0, 1.64]);
        let three = vec![(ball(0.5), middle), (ball(0.3), high), (ball(0.4), middle)];
        assert_eq!(listed(three.clone(), 2.0, None), Some((1, 2, 3.0)));
        assert_eq!(listed(three.clone(), 2.1, Some(0.001)), Some((1, 2, 3.0)));
        assert_eq!(listed(three.clone(), 2.0, Some(1e4)), None);
        assert_eq!(listed(three, 2.2, None), None);
        // A tenth of it is above the surface; so small that it is thin; none.
        assert_eq!(listed(vec![(ball(0.3), [1.0, 1.0, 1.76])], 2.0, None), None);
        assert_eq!(listed(vec![(ball(0.04), middle)], 2.0, None), None);
        assert_eq!(listed(Vec::new(), 2.0, None), None);
        // Turned by 45 degrees, a board along its own x is inside where its origin is, and another shifted one is not.
        let board = block([0.0, -0.2, -0.2], [1.2, 0.2, 0.2]);
        assert_eq!(listed(vec![(board.clone(), [0.5, 0.5, 1.0])], 2.0, None), Some((0, 0, 2.0)));
        assert_eq!(listed(vec![(board, [1.5, 1.5, 1.0])], 2.0, None), None);
    }

    #[test]
    fn large_bodies_are_not_listed() {
        let source = LiquidSource {
            shape: Shape::Box { min: [0.0; 3], max: [10.0; 3] },
            velocity: [0.0; 3],
            jitter: None,
            viscosity: None,
            color: None,
        };
        let params = LiquidParams { source: vec![source], ..LiquidParams::new(0.1) };
        for (radius, is_listed) in [(1.9, true), (2.1, false)] {
            let (solid, body) = turned_body((Shape::Sphere { center: [0.0; 3], radius }, [5.0; 3]));
            let found = submerged_body(&params, (&[solid], &[body]));
            assert_eq!(found.is_some(), is_listed, "{radius}");
        }
    }
}
