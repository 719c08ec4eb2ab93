//! Impulses between what touches.
//!
//! *Method*: inelastic impulses along the normal and Coulomb's friction across it ([bridson02], its repulsions), between the points of a feature in the
//! shares w of where the two are closest: the relative velocity is Σ w v, an impulse J gives w J/m to each point, and ends
//! a speed u by J = −u/Σ (w²/m). Pairs follow one another, and again, until nothing changes.
//! *Departs from the paper*: no springs push apart what is closer than the thickness; a part of what lacks is added to places and not to
//! velocities, so that it is no energy. What is further than the thickness may come as close as that within the substep, and no closer. An
//! impulse may be taken back by a later one as long as its sum pushes (so that the sum is the solution of all).
//!
//! Why energy does not grow: sums J ≥ 0 lower ½ Jᵀ A J + Jᵀ (u − b), and b, the speed that is left to what has not met yet, is not positive.
//!
//! Solids take part: what is pushed into one is pushed back in the same rounds, or the layer between would give way.
//!
//! Momentum: w of either side sum to ±1, and the two closest points lie along J, so that neither momentum nor angular momentum changes. Friction acts across
//! the thickness d between the two, and turns them by J d; what is pushed apart while it slides by u changes by m δ u.
//!
//! Limits: pairs one after another, on one thread.

use super::{closest::Double, pairs::Near};

/// Rounds over all pairs at most. Resting layers need 3 to 10; what is left is there in the next substep.
const ROUNDS: u32 = 24;

/// The largest change of a way by a round that ends them, in parts of the thickness. At 1e-3 a sheet creeps on a slope that friction should hold;
/// at 1e-5 there are half as many rounds again and the same pictures.
const ENOUGH: f64 = 1e-4;

/// The part of what lacks to the thickness that a substep adds. At 1 a stack jitters as each pair undoes the other's; at 0.02 what was
/// pressed together is seen to swell.
const RETURN: f64 = 0.1;

/// The part of the thickness that is as good as all of it. Impulses end within a tenth of this of the whole; were the rest pushed apart as well, sheets
/// that slide on each other would lose angular momentum, 1.6e-5 of it at 20 m/s.
const WHOLE: f64 = 0.99;

/// A point that touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    pub(super) point: u32,
    /// 1/m [1/kg].
    pub(super) mobility: f64,
    /// Its place at the start of the substep.
    pub(super) start: Double,
    /// Its way in the substep, and its velocity at the end.
    pub(super) way: Double,
    pub(super) velocity: Double,
    /// A solid close by.
    pub(super) wall: Option<Wall>,
}

/// A solid beside a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    /// How far it is after a way of `from` [m], and in which direction away from it.
    pub(super) distance: f64,
    pub(super) from: Double,
    pub(super) normal: Double,
    /// Its own velocity [m/s].
    pub(super) velocity: Double,
    /// How far it has pushed the point back [m], and by how much it has slowed it [m/s].
    pushed: f64,
    slowed: Double,
}

impl Wall {
    pub(super) fn new(distance: f64, from: Double, normal: Double, velocity: Double) -> Self {
        Self { distance, from, normal, velocity, pushed: 0.0, slowed: Double::zeros() }
    }

    /// How deep a point is in it after a way [m].
    pub(super) fn depth(&self, way: Double) -> f64 {
        -self.distance - (way - self.from).dot(&self.normal)
    }
}

impl Body {
    /// Takes back what contact has pushed into a solid, with friction. A push may be taken back as those of pairs may.
    fn stop(&mut self, friction: f64, dt: f64) {
        let (Some(wall), true) = (&mut self.wall, self.mobility > 0.0) else { return };
        let pushed = (wall.pushed + wall.depth(self.way)).max(0.0);
        let mut change = wall.normal * ((pushed - wall.pushed) / dt);
        wall.pushed = pushed;
        if friction > 0.0 {
            let slip = self.velocity - wall.velocity;
            let mut slowed = wall.slowed - (slip - wall.normal * slip.dot(&wall.normal));
            let (most, size) = (friction * pushed / dt, slowed.norm());
            if size > most {
                slowed *= most / size;
            }
            change += slowed - wall.slowed;
            wall.slowed = slowed;
        }
        self.velocity += change;
        self.way += change * dt;
    }
}

/// A pair whose points are numbers of bodies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touch {
    pub(super) near: Near,
    pub(super) bodies: [usize; 4],
    /// 1/Σ (w²/m) [kg]; zero where nothing can move.
    mass: f64,
    /// Sums of impulses [N s].
    normal: f64,
    tangent: Double,
}

impl Touch {
    pub(super) fn new(near: Near, bodies: [usize; 4], all: &[Body]) -> Self {
        let mobility: f64 = (0..4).map(|k| near.weights[k].powi(2) * all[bodies[k]].mobility).sum();
        let mass = if near.pushed && mobility > 0.0 { 1.0 / mobility } else { 0.0 };
        Self { near, bodies, mass, normal: 0.0, tangent: Double::zeros() }
    }

    /// Whether it was pushed apart.
    pub(super) fn pushes(&self) -> bool {
        self.normal > 0.0
    }

    fn apart(&self, of: impl Fn(usize) -> Double) -> Double {
        let w = self.near.weights;
        (0..4).map(|k| of(self.bodies[k]) * w[k]).sum()
    }

    /// Gives an impulse; what it moves is moved over `dt`.
    fn give(&self, impulse: Double, dt: f64, all: &mut [Body]) {
        for (k, &i) in self.bodies.iter().enumerate() {
            let body = &mut all[i];
            let change = impulse * (self.near.weights[k] * body.mobility);
            body.velocity += change;
            body.way += change * dt;
        }
    }

    /// Ends what is left of the approach, and slows sliding. Returns by how much the speed of the pair changed.
    fn collide(&mut self, friction: f64, dt: f64, all: &mut [Body]) -> f64 {
        let Near { normal, distance, thickness, .. } = self.near;
        let speed = self.apart(|i| all[i].velocity);
        let along = speed.dot(&normal);
        let allowed = -(distance - thickness).max(0.0) / dt;
        let sum = (self.normal - self.mass * (along - allowed)).max(0.0); // [bridson02], the inelastic I_c
        let mut impulse = normal * (sum - self.normal);
        self.normal = sum;
        if friction > 0.0 {
            let across = speed - normal * along;
            let mut tangent = self.tangent - across * self.mass;
            let (most, size) = (friction * sum, tangent.norm());
            if size > most {
                tangent *= most / size; // [bridson02], friction: at most μ of the normal impulse
            }
            impulse += tangent - self.tangent;
            self.tangent = tangent;
        }
        if impulse == Double::zeros() {
            return 0.0;
        }
        self.give(impulse, dt, all);
        impulse.norm() / self.mass
    }

    /// Moves apart what is closer than it should be, without a velocity. Returns by how much.
    fn part(&self, all: &mut [Body]) -> f64 {
        let Near { normal, distance, thickness, weights, .. } = self.near;
        let full = WHOLE * thickness;
        let goal = distance + (RETURN * (full - distance)).max(0.0);
        let lacks = goal.min(full) - distance - self.apart(|i| all[i].way).dot(&normal);
        if lacks <= 0.0 {
            return 0.0;
        }
        for (k, &i) in self.bodies.iter().enumerate() {
            let body = &mut all[i];
            body.way += normal * (weights[k] * body.mobility * self.mass * lacks);
        }
        lacks
    }
}

/// Ends approaches within a substep of `dt` [s] and moves apart what is too close, to within a part of `thickness` [m].
///
/// `friction` is between layers and with solids.
pub(super) fn solve(touches: &mut [Touch], all: &mut [Body], friction: [f64; 2], dt: f64, thickness: f64) {
    let enough = ENOUGH * thickness;
    for _ in 0..ROUNDS {
        all.iter_mut().for_each(|body| body.stop(friction[1], dt));
        let able = touches.iter_mut().filter(|touch| touch.mass > 0.0);
        let change = able.map(|touch| touch.collide(friction[0], dt, all)).fold(0.0, f64::max);
        if change * dt <= enough {
            break;
        }
    }
    for _ in 0..ROUNDS {
        for body in all.iter_mut().filter(|body| body.mobility > 0.0) {
            if let Some(wall) = &body.wall {
                body.way += wall.normal * wall.depth(body.way).max(0.0);
            }
        }
        let able = touches.iter().filter(|touch| touch.mass > 0.0);
        let change = able.map(|touch| touch.part(all)).fold(0.0, f64::max);
        if change <= enough {
            break;
        }
    }
}
