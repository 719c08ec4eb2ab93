//! The six velocities of a rigid body that is solved together with the constraints of particles at it; see `rigid.rs`.

use crate::{math::Vec3, solid::RigidBody};
use nalgebra::{Vector3, Vector6};

/// Direction of a constraint between a particle and a body, (∇, r × ∇).
pub(super) type Lever = [f64; 6];

/// Mass and inertia of a body over the mass of a particle, with what constraints of particles add, and the right side.
#[derive(Clone, Debug)]
pub(super) struct BodySystem {
    matrix: [[f64; 6]; 6],
    right: Lever,
}

impl BodySystem {
    pub(super) fn zero() -> Self {
        Self { matrix: [[0.0; 6]; 6], right: [0.0; 6] }
    }

    /// Adds a constraint along `lever` with the inverse `weight` of its diagonal, and a `value` of its own.
    pub(super) fn add(&mut self, lever: &Lever, weight: f64, value: f64) {
        for (row, a) in self.matrix.iter_mut().zip(lever) {
            for (entry, b) in row.iter_mut().zip(lever) {
                *entry += weight * a * b;
            }
        }
        for (sum, a) in self.right.iter_mut().zip(lever) {
            *sum += value * a;
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        for (row, more) in self.matrix.iter_mut().zip(&other.matrix) {
            row.iter_mut().zip(more).for_each(|(entry, more)| *entry += more);
        }
        self.right.iter_mut().zip(&other.right).for_each(|(sum, more)| *sum += more);
    }

    /// Displacement of the body that solves the system, with particles of `mass` [kg].
    pub(super) fn solve(mut self, body: &RigidBody, mass: f64) -> Lever {
        let own = body.mass_matrix() / mass;
        for (i, row) in self.matrix.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(j, entry)| *entry += own[(i, j)]);
        }
        cholesky(self.matrix, self.right)
    }
}

/// Iterations of [`yield_to`] at most; they end earlier, once the contacts that push are those of the last full step.
const MAX_YIELD_ITERATIONS: u32 = 50;

/// Bisections of a step.
const MAX_BISECTIONS: u32 = 40;

/// What a body with contacts yields to them, given their levers l and pushes a: q of the minimum of ½ Σ max(0, a − l·q)² + ½ q·M q, with M over the `mass` of
/// a particle [kg]. A contact that the body leaves does not pull, and M q = Σ l max(0, a − l·q) is what contacts give.
///
/// *Method*: Newton's method with the contacts that push, and the exact minimum along its steps, as the function is convex.
pub(super) fn yield_to(contacts: &[(Lever, f64)], body: &RigidBody, mass: f64) -> Lever {
    let mass_matrix = body.mass_matrix() / mass;
    let mut at = Vector6::zeros();
    let left = |q: &Vector6<f64>, (lever, along): &(Lever, f64)| along - Vector6::from(*lever).dot(q);
    let pushes = |q: &Vector6<f64>| -> Vec<bool> { contacts.iter().map(|row| left(q, row) > 0.0).collect() };
    let mut pushing = pushes(&at);
    for _ in 0..MAX_YIELD_ITERATIONS {
        let mut system = BodySystem::zero();
        for ((lever, along), _) in contacts.iter().zip(&pushing).filter(|(_, pushes)| **pushes) {
            system.add(lever, 1.0, *along);
        }
        let step = Vector6::from(system.solve(body, mass)) - at;
        let slope = |t: f64| {
            let q = at + step * t;
            let pushed = |row: &(Lever, f64)| left(&q, row).max(0.0) * Vector6::from(row.0).dot(&step);
            step.dot(&(mass_matrix * q)) - contacts.iter().map(pushed).sum::<f64>()
        };
        let mut part = 1.0;
        // Rounding alone is no reason for a shorter step.
        if slope(1.0) > 1e-9 * slope(0.0).abs() {
            let [mut low, mut high] = [0.0, 1.0];
            for _ in 0..MAX_BISECTIONS {
                part = 0.5 * (low + high);
                if slope(part) > 0.0 { high = part } else { low = part }
            }
        }
        at += step * part;
        let now = pushes(&at);
        if part == 1.0 && now == pushing {
            break;
        }
        pushing = now;
    }
    at.into()
}

/// Solution of a positive definite system; zeros if it is singular.
fn cholesky(mut a: [[f64; 6]; 6], mut b: Lever) -> Lever {
    for i in 0..6 {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - dot;
            a[i][j] = if i == j { rest.sqrt() } else { rest / a[j][j] };
        }
    }
    if !(0..6).all(|i| a[i][i] > 0.0) {
        return [0.0; 6];
    }
    for i in 0..6 {
        let dot: f64 = (0..i).map(|k| a[i][k] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
    for i in (0..6).rev() {
        let dot: f64 = (i + 1..6).map(|k| a[k][i] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
    b
}

pub(super) fn lever(body: &RigidBody, x: Vec3, direction: Vec3) -> Lever {
    let direction: Vector3<f64> = direction.cast();
    let turn = (x.cast() - body.position()).cross(&direction);
    [direction.x, direction.y, direction.z, turn.x, turn.y, turn.z]
}

pub(super) fn dot(a: &Lever, b: &Lever) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::Random,
        solid::{BodyState, MassProperties, Shape},
    };

    #[test]
    fn a_positive_definite_system_is_solved() {
        let mut system = BodySystem::zero();
        for k in 0..9_u32 {
            let lever: Lever = std::array::from_fn(|axis| f64::from((k * 7 + axis as u32 * 5) % 11) - 4.0);
            system.add(&lever, 0.5 + f64::from(k), f64::from(k) - 2.0);
        }
        let solution = cholesky(system.matrix, system.right);
        for (row, right) in system.matrix.iter().zip(system.right) {
            assert!((dot(row, &solution) - right).abs() < 1e-9 * right.abs().max(1.0));
        }
        assert_eq!(cholesky([[0.0; 6]; 6], [1.0; 6]), [0.0; 6]);
    }

    #[test]
    fn what_a_body_yields_balances_the_contacts_that_push() {
        let random = Random::new([4, 5, 6]);
        let mut next = 0;
        let mut vector = || {
            next += 1;
            random.vector(next) - Vec3::repeat(0.5)
        };
        let mut left_behind = 0;
        for count in [1, 3, 8, 30, 200] {
            for density in [1e-4_f32, 1e-2, 1.0, 1e3] {
                for _ in 0..20 {
                    let shape = Shape::Sphere { center: [0.0; 3], radius: 0.5 };
                    let properties = MassProperties::new(&shape, f64::from(density)).unwrap();
                    let state = BodyState {
                        position: Vec3::zeros(),
                        rotation: (Vec3::zeros(), 1.0),
                        velocity: Vec3::zeros(),
                        angular_velocity: Vec3::zeros(),
                    };
                    let body = RigidBody::new(properties, &state).unwrap();
                    let mut contact =
                        || (lever(&body, vector(), vector().normalize()), f64::from(vector().x));
                    let contacts: Vec<(Lever, f64)> = (0..count).map(|_| contact()).collect();
                    let q = Vector6::from(yield_to(&contacts, &body, 1.0));
                    let mut given = Vector6::zeros();
                    for (lever, along) in &contacts {
                        let (lever, pushed) = (Vector6::from(*lever), *along > 0.0);
                        let push = (along - lever.dot(&q)).max(0.0);
                        left_behind += u32::from(pushed && push == 0.0);
                        given += lever * push;
                    }
                    let off = (body.mass_matrix() * q - given).norm();
                    let scale = contacts.iter().map(|(_, along)| along.abs()).sum::<f64>();
                    assert!(off < 1e-9 * scale, "{count} contacts, {density}: {off}");
                }
            }
        }
        assert!(left_behind > 100, "contacts open: {left_behind}");
    }
}
