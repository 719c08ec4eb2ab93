//! The contacts of a pair of surfaces that are solved.
//!
//! *Method*: contacts of about one normal are a patch. Of its contacts that touch, and of those that are still open, the deepest is kept, and those at the
//! rim: any distribution of pressure over a flat patch has the sum and the moment of one over its rim. With hundreds of contacts in a patch each sweep
//! took 15 times as long.
//! Limits: friction against a turn about the normal acts at the rim, where its arm is longer than under an even pressure. Some thousand inner
//! radii from the origin the rounding of gaps divides a flat patch.

use super::contact::Contact;
use nalgebra::Vector3;

/// Cosine between normals of one patch.
const PATCH_COSINE: f64 = 0.95;

/// Gap over that of the deepest contact up to which contacts touch with it, over the inner radius. With 0.01 the edges of a mesh, which its
/// voxels round, took the place of contacts that touch.
const TOUCHING_GAP: f64 = 1e-3;

/// Directions in which the rim is found, and their opposites.
const DIRECTIONS: [[f64; 2]; 4] = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0]];

/// Removes contacts from `first` on, which are those of one pair, that are neither the deepest of a patch nor at its rim.
pub(super) fn keep_rim(contacts: &mut Vec<Contact>, first: usize) {
    let mut left: Vec<Contact> = contacts.split_off(first);
    while let Some(deepest) = largest(&left, |contact| -contact.gap) {
        let deepest = left.swap_remove(deepest);
        let limit = deepest.gap + TOUCHING_GAP * deepest.inner_radius;
        let (mut touching, mut open, mut others) = (vec![deepest], Vec::new(), Vec::new());
        for contact in left {
            let is_of_patch = contact.normal.dot(&deepest.normal) > PATCH_COSINE;
            match (is_of_patch, contact.gap <= limit) {
                (false, _) => others.push(contact),
                (true, true) => touching.push(contact),
                (true, false) => open.push(contact),
            }
        }
        for part in [touching, open] {
            contacts.extend(rim(&part, &deepest.normal).into_iter().map(|k| part[k]));
        }
        left = others;
    }
}

/// The deepest of contacts of one normal, and those that are farthest in the directions across it.
fn rim(contacts: &[Contact], n: &Vector3<f64>) -> Vec<usize> {
    let across = Vector3::ith(n.iamin(), 1.0).cross(n).normalize();
    let along = n.cross(&across);
    let mut kept: Vec<usize> = largest(contacts, |contact| -contact.gap).into_iter().collect();
    for [a, b] in DIRECTIONS {
        let direction = across * a + along * b;
        kept.extend(largest(contacts, |contact| contact.arms[0].dot(&direction)));
        kept.extend(largest(contacts, |contact| -contact.arms[0].dot(&direction)));
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// The first contact with the largest value.
fn largest(contacts: &[Contact], value: impl Fn(&Contact) -> f64) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (k, contact) in contacts.iter().enumerate() {
        let value = value(contact);
        if best.is_none_or(|(_, largest)| value > largest || largest.is_nan()) {
            best = Some((k, value));
        }
    }
    best.map(|(k, _)| k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::Vec3,
        sim::rigid::{
            contact::find,
            obstacle::{Obstacle, Placed},
        },
        solid::{MassProperties, RigidBody, Shape, Solid},
    };

    /// Contacts of a box of half a metre, turned by `turn` about z, that lies on a plane at the top of `ground`.
    fn contacts(turn: f64, ground: Shape) -> Vec<Contact> {
        let shape = Shape::Box { min: [-0.5; 3], max: [0.5; 3] };
        let half = 0.5 * turn;
        let state = crate::solid::BodyState {
            position: Vec3::new(0.0, 0.0, 0.5),
            rotation: (Vec3::z() * half.sin() as f32, half.cos() as f32),
            velocity: Vec3::zeros(),
            angular_velocity: Vec3::zeros(),
        };
        let mut body = RigidBody::new(MassProperties::new(&shape, 1.0).unwrap(), &state).unwrap();
        body.start_substep(0.01, Vector3::z() * -9.81);
        let obstacle = Obstacle::new(&shape, 0.0, 0.0);
        let placed = Placed::body(&obstacle, &body);
        let colliders = Obstacle::collider(&Solid::fixed(ground));
        let mut found = Vec::new();
        for collider in &colliders {
            let first = found.len();
            find((0, &placed), (None, &collider.place(0.0, 0.01, &[])), 0.01, &mut found);
            keep_rim(&mut found, first);
        }
        found
    }

    #[test]
    fn a_face_keeps_its_corners_and_a_body_in_a_corner_its_three_faces() {
        for turn in [0.0, 0.3, std::f64::consts::FRAC_PI_4] {
            let found = contacts(turn, Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] });
            assert!((4..=9).contains(&found.len()), "{} contacts", found.len());
            for k in 0..4_u32 {
                let angle = turn + std::f64::consts::FRAC_PI_4 + f64::from(k) * std::f64::consts::FRAC_PI_2;
                let corner =
                    Vector3::new(angle.cos(), angle.sin(), 0.0) * 0.5_f64.sqrt() - Vector3::z() * 0.5;
                assert!(
                    found.iter().any(|contact| (contact.arms[0] - corner).norm() < 1e-3),
                    "no corner at {corner}"
                );
            }
        }
        let found = contacts(0.0, Shape::Tank { min: [-0.5, -0.5, 0.0], max: [3.0; 3] });
        for axis in 0..3 {
            let count = found.iter().filter(|contact| contact.normal[axis] > 0.99).count();
            assert!((4..=9).contains(&count), "{count} along {axis}");
        }
        assert!(found.iter().all(|contact| contact.normal.max() > 0.99));
    }

    #[test]
    fn the_deepest_is_kept_and_so_are_finite_contacts_next_to_nan() {
        let flat = || contacts(0.2, Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] });
        let mut found = flat();
        let mut deep = found[0];
        (deep.arms[0], deep.gap) = (Vector3::new(0.01, 0.02, -0.5), -0.1);
        found.insert(2, deep);
        keep_rim(&mut found, 0);
        assert!(found.iter().any(|contact| contact.gap == -0.1));
        let mut found = flat();
        let finite: Vec<_> = found[2..].iter().map(|contact| contact.arms[0]).collect();
        found[0].gap = f64::NAN;
        found[1].normal *= f64::NAN;
        keep_rim(&mut found, 0);
        for arm in finite {
            assert!(found.iter().any(|contact| contact.arms[0] == arm), "{arm} is gone");
        }
    }

    #[test]
    fn what_touches_is_kept_within_a_rim_that_is_open() {
        // Two rails under the middle, of which one has eight contacts.
        let mut found = contacts(0.0, Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] });
        found.iter_mut().for_each(|contact| contact.gap = 0.05);
        let rails: Vec<_> = (0..16_u32)
            .map(|k| {
                let x = if k % 2 == 0 { -0.1 } else { 0.1 };
                Vector3::new(x, 0.04 * f64::from(k / 2) - 0.14, -0.5)
            })
            .collect();
        let touching = rails.iter().map(|&arm| {
            let mut contact = found[0];
            (contact.arms[0], contact.gap) = (arm, 1e-4);
            contact
        });
        let touching: Vec<_> = touching.collect();
        found.extend(touching);
        keep_rim(&mut found, 0);
        for end in [rails[0], rails[1], rails[14], rails[15]] {
            assert!(found.iter().any(|contact| contact.arms[0] == end), "no contact at {end}");
        }
        assert!(found.len() <= 18, "{} contacts", found.len());
    }
}
