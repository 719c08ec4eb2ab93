//! The six velocities of a rigid body that is solved together with the constraints of particles at it; see `rigid.rs`.

use crate::{math::Vec3, solid::RigidBody};
use nalgebra::{Matrix3, Vector3};

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
        let inertia = body.world_inverse_inertia().try_inverse().unwrap_or_else(Matrix3::zeros);
        for axis in 0..3 {
            self.matrix[axis][axis] += body.mass() / mass;
            for other in 0..3 {
                self.matrix[3 + axis][3 + other] += inertia[(axis, other)] / mass;
            }
        }
        cholesky(self.matrix, self.right)
    }
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
}
