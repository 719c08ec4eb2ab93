//! Where a point of a sheet touches a rigid body in a substep.
//!
//! *Method*: both move freely in the substep, and the path of the point relative to the body is taken as straight. Where it ends near the
//! surface and towards it, the normal there counts: an edge below which the sheet slides does not stop it. Where it ends deeper, as a taut
//! sheet under a heavy body does, or beyond the body, the normal at the end may point anywhere, and the contact is where the path enters
//! the body, found by steps of the signed distance.
//! Limits: the rotation of the body bends paths by the square of its angle. A path that is inside for less than a 64th of its length may not be
//! seen.

use crate::math::Vec3;

/// Distances over the body's inner radius: from the surface, within which a point has a contact though it does not reach the body, as others
/// may push it there; how deep a path may end with the normal at its end, or cut off an edge; and from the surface, at which a path has
/// reached it.
pub(super) const MARGIN: f32 = 0.1;
const SHALLOW: f32 = 0.03;
const REACHED: f32 = 1e-3;

/// Steps along a path at most.
const MAX_STEPS: u32 = 64;

/// The path of a point in the axes of a body with an inner `radius` [m].
pub(super) struct Path {
    pub(super) ends: [Vec3; 2],
    pub(super) radius: f32,
}

/// A contact in the axes of the body.
pub(super) struct Impact {
    /// Where the surface is touched, or almost.
    pub(super) place: Vec3,
    /// Distance of the end of the path from the tangent plane there, less a depth at the start, which needs no velocity to be left [m].
    pub(super) gap: f32,
    pub(super) normal: Vec3,
}

impl Path {
    /// Whether the path comes near a ball.
    pub(super) fn comes_near(&self, center: Vec3, radius: f32) -> bool {
        let [from, to] = self.ends;
        let d = to - from;
        let along = ((center - from).dot(&d) / d.norm_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        (from + d * along - center).norm() <= radius + MARGIN * self.radius
    }

    /// The contact with a body of which `contact` gives signed distance and normal; `None`: the point does not come near.
    pub(super) fn impact(&self, contact: impl Fn(Vec3) -> (f32, Vec3)) -> Option<Impact> {
        let [from, to] = self.ends;
        let (distance, normal) = contact(to);
        let start = contact(from).0;
        let at_end = Impact { place: to, gap: distance - start.min(0.0), normal };
        let is_near = (-SHALLOW * self.radius..=MARGIN * self.radius).contains(&distance);
        if is_near && normal.dot(&(to - from)) <= 0.0 {
            return Some(at_end);
        }
        self.entrance(contact).or((is_near || distance < 0.0).then_some(at_end))
    }

    /// Where the path reaches the surface before it enters the body; `None`: it does not.
    fn entrance(&self, contact: impl Fn(Vec3) -> (f32, Vec3)) -> Option<Impact> {
        let [from, to] = self.ends;
        let length = (to - from).norm();
        let (mut along, mut reached) = (0.0, None);
        for step in 0..=MAX_STEPS {
            let part = if along < length { along / length } else { 1.0 };
            let place = from + (to - from) * part;
            let (distance, normal) = contact(place);
            if distance <= REACHED * self.radius && reached.is_none() {
                // Where a point starts inside, the velocity of leaving would be that of an explosion.
                let kept = if step == 0 { distance.max(0.0) } else { distance };
                reached = Some(Impact { place, gap: kept + normal.dot(&(to - place)), normal });
            }
            if distance < -SHALLOW * self.radius {
                return reached;
            }
            if part == 1.0 {
                return None;
            }
            along += distance.abs().max(length / MAX_STEPS as f32);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Shape;

    fn impact(shape: &Shape, radius: f32, ends: [[f32; 3]; 2]) -> Option<Impact> {
        Path { ends: ends.map(Vec3::from), radius }.impact(|x| shape.contact(x))
    }

    #[test]
    fn a_path_through_a_body_touches_it_where_it_enters() {
        let ball = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
        let slab = Shape::Box { min: [-5.0, -5.0, -0.1], max: [5.0, 5.0, 0.1] };
        for (shape, radius, ends, place, normal, gap) in [
            // Beyond the centre, where the normal at the end would push on.
            (&ball, 1.0, [[0.0, 0.0, -2.0], [0.0, 0.0, 0.5]], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0], -1.5),
            // From inside: the depth at the start is kept.
            (&ball, 1.0, [[0.0, 0.0, -0.9], [0.0, 0.0, 0.5]], [0.0, 0.0, -0.9], [0.0, 0.0, -1.0], -1.4),
            // Shallow: at its end.
            (
                &ball,
                1.0,
                [[0.0, 0.0, -2.0], [0.6, 0.0, -0.785]],
                [0.6, 0.0, -0.785],
                [0.607, 0.0, -0.795],
                -0.012,
            ),
            // Through.
            (&slab, 0.1, [[3.0, 0.0, 2.0], [4.0, 0.0, -2.0]], [3.475, 0.0, 0.1], [0.0, 0.0, 1.0], -2.1),
            // Through, and near the other side.
            (&slab, 0.1, [[3.0, 0.0, 2.0], [3.0, 0.0, -0.105]], [3.0, 0.0, 0.1], [0.0, 0.0, 1.0], -0.205),
            (&ball, 1.0, [[0.0, 0.0, -2.0], [0.0, 0.0, 1.05]], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0], -2.05),
            // Near without reaching it.
            (&slab, 0.1, [[3.0, 0.0, 2.0], [3.0, 0.0, 0.105]], [3.0, 0.0, 0.105], [0.0, 0.0, 1.0], 0.005),
        ] {
            let found = impact(shape, radius, ends).expect("it touches");
            println!("{:?} {:?} {}", found.place, found.normal, found.gap);
            assert!((found.place - Vec3::from(place)).norm() < 1e-2, "{ends:?}: {:?}", found.place);
            assert!((found.normal - Vec3::from(normal)).norm() < 2e-3, "{ends:?}: {:?}", found.normal);
            assert!((found.gap - gap).abs() < 2e-3, "{ends:?}: {}", found.gap);
        }
        assert!(impact(&ball, 1.0, [[2.0, 0.0, -2.0], [1.2, 0.0, 2.0]]).is_none(), "it passes");
        let cube = Shape::Box { min: [-1.0; 3], max: [1.0; 3] };
        let beyond_the_edge = [[0.995, 0.0, 1.0005], [1.16, 0.0, 0.82]];
        assert!(impact(&cube, 1.0, beyond_the_edge).is_none(), "it leaves the top and does not enter");
        let grazing = impact(&slab, 0.1, [[-4.0, 0.0, 0.25], [4.0, 0.0, -0.25]]).expect("it goes through");
        assert!(grazing.normal.z > 0.99 && (grazing.gap + 0.35).abs() < 0.01, "{}", grazing.gap);
        assert!(impact(&ball, 1.0, [[3.0, 0.0, 0.0]; 2]).is_none(), "it is at rest elsewhere");
    }

    #[test]
    fn a_path_comes_near_what_lies_along_it() {
        let path = Path { ends: [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]].map(Vec3::from), radius: 1.0 };
        let near = |center: [f32; 3]| path.comes_near(center.into(), 1.0);
        assert!(near([2.0, 1.05, 0.0]) && near([-1.05, 0.0, 0.0]) && near([4.5, 0.9, 0.0]));
        assert!(!near([2.0, 1.15, 0.0]) && !near([-1.15, 0.0, 0.0]) && !near([5.0, 1.0, 0.0]));
    }
}
