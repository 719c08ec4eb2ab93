//! Interface of a system that shares the liquid's substeps and exchanges impulses with its particles.

use super::CoupledBodies;
use crate::{
    math::Vec3,
    sim::{Diverged, clock::Clock},
    space::CellGrid,
};

/// The liquid's particles in a substep.
pub(in crate::sim) struct SubstepParticles<'a> {
    /// Positions at the start of the substep [m].
    pub(in crate::sim) start: &'a [Vec3],
    /// Predicted positions at its end, x* [m].
    pub(in crate::sim) predicted: &'a mut [Vec3],
    /// Cells of the neighbour search.
    pub(in crate::sim) grid: &'a CellGrid,
    /// Positions for which the cells were filled [m].
    pub(in crate::sim) sorted_at: &'a [Vec3],
    /// End of a particle's path from one position to another, with collisions against solids.
    pub(in crate::sim) collide: &'a (dyn Fn(Vec3, Vec3) -> Vec3 + Sync),
    /// Sums of the displacements by solids of each particle [m]; empty without rigid bodies.
    pub(in crate::sim) projection: &'a mut [Vec3],
}

impl SubstepParticles<'_> {
    /// Moves a particle to `wanted`, or to where solids let it come.
    pub(in crate::sim) fn move_to(&mut self, particle: usize, wanted: Vec3) {
        let end = (self.collide)(self.predicted[particle], wanted);
        self.predicted[particle] = end;
        if let Some(projection) = self.projection.get_mut(particle) {
            *projection += end - wanted;
        }
    }
}

/// What shares the liquid's substeps.
pub(in crate::sim) struct Partners<'a> {
    /// A coupled system.
    pub(in crate::sim) system: Option<&'a mut dyn CoupledSystem>,
    /// Rigid bodies.
    pub(in crate::sim) bodies: Option<&'a mut dyn CoupledBodies>,
}

/// A second borrow of the bodies.
pub(super) fn reborrow<'a>(
    bodies: &'a mut Option<&mut dyn CoupledBodies>,
) -> Option<&'a mut dyn CoupledBodies> {
    bodies.as_deref_mut().map(|bodies| bodies as &mut dyn CoupledBodies)
}

impl Partners<'_> {
    /// The bodies alone.
    pub(super) fn bodies_alone(&mut self) -> Partners<'_> {
        Partners { system: None, bodies: reborrow(&mut self.bodies) }
    }
}

/// What contacts of a coupled system have moved.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::sim) struct Pushed {
    pub(in crate::sim) particles: bool,
    pub(in crate::sim) bodies: bool,
}

/// A system coupled with the liquid.
pub(in crate::sim) trait CoupledSystem {
    /// Speed of the fastest point [m/s].
    fn max_speed(&self) -> f64;

    /// Number of equal substeps that the system needs for the `left` [s] that are left of a frame of `seconds`, from `now` [s] on.
    ///
    /// # Errors
    /// If these and the `done` substeps of the frame are more than the system's limit.
    fn substeps_left(&mut self, now: f64, left: f64, seconds: f64, done: u32) -> Result<u32, Diverged>;

    /// Advances from `now` [s] by `dt` [s] without contact.
    ///
    /// # Errors
    /// If the state diverges.
    fn advance_uncoupled(&mut self, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged>;

    /// Finds the pairs that may be in contact during the substep.
    fn detect_contacts(
        &mut self,
        particles: &SubstepParticles<'_>,
        bodies: Option<&dyn CoupledBodies>,
        clock: &mut Clock,
    );

    /// Projects violated contact constraints, on all sides.
    fn project_contacts(
        &mut self,
        particles: &mut SubstepParticles<'_>,
        bodies: Option<&mut dyn CoupledBodies>,
        clock: &mut Clock,
    ) -> Pushed;

    /// Ends a substep without particles: contacts with bodies alone.
    fn end_without_liquid(&mut self, bodies: &mut dyn CoupledBodies, clock: &mut Clock);

    /// Ends the substep: projects contacts for the last time and resolves crossings. `v_before` are the particles' velocities
    /// without contacts and pressure [m/s]. Returns the work on the liquid [J].
    fn end_substep(
        &mut self,
        particles: &mut SubstepParticles<'_>,
        bodies: Option<&mut dyn CoupledBodies>,
        v_before: &[Vec3],
        clock: &mut Clock,
    ) -> f64;

    /// Applies friction to the liquid's velocities [m/s] and to the system. Returns the work on the liquid [J].
    fn apply_friction(&mut self, v: &mut [Vec3], clock: &mut Clock) -> f64;
}
