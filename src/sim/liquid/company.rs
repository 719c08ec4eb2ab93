//! What shares the liquid's substeps, and pushes its particles as it is pushed by them.

use crate::{
    math::Vec3,
    sim::{Diverged, record::Clock},
    space::CellGrid,
};

/// The particles in a substep.
pub(in crate::sim) struct Particles<'a> {
    /// Where the substep began [m].
    pub(in crate::sim) from: &'a [Vec3],
    /// Where it leads [m].
    pub(in crate::sim) to: &'a mut [Vec3],
    /// The cells they were sorted into, …
    pub(in crate::sim) grid: &'a CellGrid,
    /// … when they were there [m].
    pub(in crate::sim) sorted_at: &'a [Vec3],
    /// Where a particle gets that is to move from one place to another: solids keep it out.
    pub(in crate::sim) free: &'a (dyn Fn(Vec3, Vec3) -> Vec3 + Sync),
}

/// What shares the liquid's substeps.
pub(in crate::sim) trait Company {
    /// The speed of its fastest point [m/s].
    fn fastest(&self) -> f64;

    /// How many equal substeps it asks for in the rest of a frame: `left` [s], from `now` [s] on, of `seconds`.
    ///
    /// # Errors
    /// If they are more than are allowed, `done` counted.
    fn substeps_left(&mut self, now: f64, left: f64, seconds: f64, done: u32) -> Result<u32, Diverged>;

    /// Advances from `now` [s] by `dt` [s] as if alone.
    ///
    /// # Errors
    /// If it leaves what can be computed.
    fn advance_alone(&mut self, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged>;

    /// Finds what may touch in this substep.
    fn meet(&mut self, particles: &Particles<'_>, clock: &mut Clock);

    /// Pushes those particles and itself apart that are too near. Whether any was.
    fn press(&mut self, particles: &mut Particles<'_>, clock: &mut Clock) -> bool;

    /// Ends the substep: the last pushes, after which no particle is on another side than it was. Returns what it did to the liquid [J].
    fn part(&mut self, particles: &mut Particles<'_>, clock: &mut Clock) -> f64;

    /// Rubs, once velocities [m/s] are known.
    fn rub(&mut self, v: &mut [Vec3], clock: &mut Clock);
}
