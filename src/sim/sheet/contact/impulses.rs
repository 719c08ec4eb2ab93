//! Contact impulses between sheets, with friction.
//!
//! *Method*: inelastic impulses along the normal and Coulomb friction across it ([bridson02], its
//! repulsions). They act on the points of two features with the weights w of their closest points. The
//! relative velocity is Σ w v. An impulse J changes the velocity of each point by w J/m, and removes a speed
//! u if J = −u/Σ (w²/m). Pairs are solved one after another (projected Gauss–Seidel) until nothing changes.
//! *Departs from the paper*: no springs push apart what is closer than the thickness. A part of the missing
//! distance is added to positions and not to velocities, so that it adds no energy. What is further apart
//! than the thickness may come as close as that within the substep, and no closer. A later iteration may
//! reduce an impulse as long as its sum pushes, so that the sums solve all constraints together.
//!
//! Why energy does not grow: the sums J ≥ 0 lower ½ Jᵀ A J + Jᵀ (u − b), and b, the speed left to pairs that
//! do not touch yet, is not positive.
//!
//! Solids take part: what is pushed into one is pushed back in the same iterations. Otherwise a layer between
//! would give way.
//!
//! Momentum: the weights w of either side sum to ±1, and the two closest points lie along J, so that neither
//! momentum nor angular momentum changes. Friction acts across the distance d between the two and turns them
//! by J d. A pair that is pushed apart by δ while it slides at u changes its angular momentum by m δ u.
//!
//! Limits: pairs are solved one after another, on one thread.

use super::{closest_points::Double, narrow_phase::ContactPair};

/// Iterations over all pairs at most. Resting layers need 3 to 10; the next substep continues with what is
/// left.
const MAX_ITERATIONS: u32 = 24;

/// Largest change of a displacement in an iteration at which the solver stops, in parts of the thickness. At
/// 1e-3 a sheet creeps on a slope on which friction should hold it. At 1e-5 there are half as many iterations
/// again and the pictures are the same.
const TOLERANCE: f64 = 1e-4;

/// The part of the distance missing to the thickness that a substep adds. At 1 a stack jitters, as each pair
/// undoes the correction of others. At 0.02 a compressed stack visibly swells.
const PROJECTION_FRACTION: f64 = 0.1;

/// The part of the thickness that counts as all of it. Impulses end within a tenth of the margin to the full
/// thickness. If the margin were pushed apart as well, sheets that slide on each other would lose angular
/// momentum, 1.6e-5 of it at 20 m/s.
const FULL_THICKNESS_FRACTION: f64 = 0.99;

/// A sheet point in contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    pub(super) point: u32,
    /// 1/m [1/kg].
    pub(super) mobility: f64,
    /// Position at the start of the substep.
    pub(super) start: Double,
    /// Displacement in the substep, and velocity at its end.
    pub(super) displacement: Double,
    pub(super) velocity: Double,
    /// The nearest solid, if it is close.
    pub(super) wall: Option<Wall>,
}

/// A solid close to a point, as a plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    /// Distance to the solid after a displacement of `reference` [m], and the direction away from it.
    pub(super) distance: f64,
    pub(super) reference: Double,
    pub(super) normal: Double,
    /// Velocity of the solid [m/s].
    pub(super) velocity: Double,
    /// Distance by which it has pushed the point out [m], and the change of velocity by friction [m/s].
    pushed_out: f64,
    friction_change: Double,
}

impl Wall {
    pub(super) fn new(distance: f64, reference: Double, normal: Double, velocity: Double) -> Self {
        Self { distance, reference, normal, velocity, pushed_out: 0.0, friction_change: Double::zeros() }
    }

    /// Depth of the point in the solid after a displacement [m].
    pub(super) fn depth(&self, displacement: Double) -> f64 {
        -self.distance - (displacement - self.reference).dot(&self.normal)
    }
}

impl Body {
    /// Pushes a point out of the solid, with friction. A later iteration may reduce the push, as it may
    /// reduce an impulse.
    fn resolve_wall(&mut self, friction: f64, dt: f64) {
        let (Some(wall), true) = (&mut self.wall, self.mobility > 0.0) else { return };
        let pushed_out = (wall.pushed_out + wall.depth(self.displacement)).max(0.0);
        let mut change = wall.normal * ((pushed_out - wall.pushed_out) / dt);
        wall.pushed_out = pushed_out;
        if friction > 0.0 {
            let slip = self.velocity - wall.velocity;
            let mut friction_change = wall.friction_change - (slip - wall.normal * slip.dot(&wall.normal));
            let (max, norm) = (friction * pushed_out / dt, friction_change.norm());
            if norm > max {
                friction_change *= max / norm;
            }
            change += friction_change - wall.friction_change;
            wall.friction_change = friction_change;
        }
        self.velocity += change;
        self.displacement += change * dt;
    }
}

/// A contact pair whose points are indices of bodies.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactConstraint {
    pub(super) pair: ContactPair,
    pub(super) bodies: [usize; 4],
    /// 1/Σ (w²/m) [kg]; zero where nothing can move.
    effective_mass: f64,
    /// Accumulated impulses [N s].
    normal_impulse: f64,
    tangent_impulse: Double,
}

impl ContactConstraint {
    pub(super) fn new(pair: ContactPair, indices: [usize; 4], bodies: &[Body]) -> Self {
        let mobility: f64 = (0..4).map(|k| pair.weights[k].powi(2) * bodies[indices[k]].mobility).sum();
        let effective_mass = if pair.is_active && mobility > 0.0 { 1.0 / mobility } else { 0.0 };
        Self { pair, bodies: indices, effective_mass, normal_impulse: 0.0, tangent_impulse: Double::zeros() }
    }

    /// Whether the pair was pushed apart.
    pub(super) fn is_pushing(&self) -> bool {
        self.normal_impulse > 0.0
    }

    /// Σ w v of a vector v that each body has: its difference between the two closest points.
    fn relative(&self, of: impl Fn(usize) -> Double) -> Double {
        let w = self.pair.weights;
        (0..4).map(|k| of(self.bodies[k]) * w[k]).sum()
    }

    /// Applies an impulse to velocities and, over `dt`, to displacements.
    fn apply_impulse(&self, impulse: Double, dt: f64, bodies: &mut [Body]) {
        for (k, &i) in self.bodies.iter().enumerate() {
            let body = &mut bodies[i];
            let change = impulse * (self.pair.weights[k] * body.mobility);
            body.velocity += change;
            body.displacement += change * dt;
        }
    }

    /// Removes the rest of the approach, and applies friction. Returns by how much the relative speed
    /// changed.
    fn collide(&mut self, friction: f64, dt: f64, bodies: &mut [Body]) -> f64 {
        let ContactPair { normal, distance, thickness, .. } = self.pair;
        let speed = self.relative(|i| bodies[i].velocity);
        let normal_speed = speed.dot(&normal);
        let allowed = -(distance - thickness).max(0.0) / dt;
        let sum = (self.normal_impulse - self.effective_mass * (normal_speed - allowed)).max(0.0); // [bridson02], the inelastic I_c
        let mut impulse = normal * (sum - self.normal_impulse);
        self.normal_impulse = sum;
        if friction > 0.0 {
            let slip = speed - normal * normal_speed;
            let mut tangent = self.tangent_impulse - slip * self.effective_mass;
            let (max, norm) = (friction * sum, tangent.norm());
            if norm > max {
                tangent *= max / norm; // [bridson02], friction: at most μ of the normal impulse
            }
            impulse += tangent - self.tangent_impulse;
            self.tangent_impulse = tangent;
        }
        if impulse == Double::zeros() {
            return 0.0;
        }
        self.apply_impulse(impulse, dt, bodies);
        impulse.norm() / self.effective_mass
    }

    /// Moves a pair apart that is closer than its thickness, without a velocity. Returns by how much.
    fn project(&self, bodies: &mut [Body]) -> f64 {
        let ContactPair { normal, distance, thickness, weights, .. } = self.pair;
        let full = FULL_THICKNESS_FRACTION * thickness;
        let goal = distance + (PROJECTION_FRACTION * (full - distance)).max(0.0);
        let missing = goal.min(full) - distance - self.relative(|i| bodies[i].displacement).dot(&normal);
        if missing <= 0.0 {
            return 0.0;
        }
        for (k, &i) in self.bodies.iter().enumerate() {
            let body = &mut bodies[i];
            body.displacement += normal * (weights[k] * body.mobility * self.effective_mass * missing);
        }
        missing
    }
}

/// Solves for impulses in a substep of `dt` [s], then moves apart what is closer than `thickness` [m].
///
/// `friction` holds the coefficients between layers and with solids.
pub(super) fn solve(
    constraints: &mut [ContactConstraint],
    bodies: &mut [Body],
    friction: [f64; 2],
    dt: f64,
    thickness: f64,
) {
    let tolerance = TOLERANCE * thickness;
    for _ in 0..MAX_ITERATIONS {
        bodies.iter_mut().for_each(|body| body.resolve_wall(friction[1], dt));
        let movable = constraints.iter_mut().filter(|constraint| constraint.effective_mass > 0.0);
        let change =
            movable.map(|constraint| constraint.collide(friction[0], dt, bodies)).fold(0.0, f64::max);
        if change * dt <= tolerance {
            break;
        }
    }
    for _ in 0..MAX_ITERATIONS {
        for body in bodies.iter_mut().filter(|body| body.mobility > 0.0) {
            if let Some(wall) = &body.wall {
                body.displacement += wall.normal * wall.depth(body.displacement).max(0.0);
            }
        }
        let movable = constraints.iter().filter(|constraint| constraint.effective_mass > 0.0);
        let change = movable.map(|constraint| constraint.project(bodies)).fold(0.0, f64::max);
        if change <= tolerance {
            break;
        }
    }
}
