//! Corrections of which only a part is kept: the last of a substep, which would end below the target.

use super::{
    correction::map_columns,
    rigid::RigidSide,
    rigid_pairs::NO_PAIR,
    setup::SolverSetup,
    solve::{SavedState, Solver},
};
use crate::{math::Vec3, par};

impl Solver {
    /// Keeps the state before a correction, for [`Solver::shorten_correction`].
    pub(super) fn save_state(&mut self) {
        let SavedState { p, wall_push, ratio, work, pin_work } = &mut self.before;
        for (to, from) in [(p, &self.p), (wall_push, &self.wall_push)] {
            to.resize(from.len(), Vec3::zeros());
            par::fill(to, |i| from[i]);
        }
        ratio.clone_from(&self.ratio);
        (*work, *pin_work) = (self.work, self.pin_work);
    }

    /// Keeps the part `kept` (0 to 1) of the correction since [`Solver::save_state`].
    pub(super) fn shorten_correction(&mut self, kept: f64, setup: &SolverSetup<'_>) {
        let Self { p, wall_push, rigid, ratio, built_at, clearance, before, .. } = self;
        let RigidSide { first_pair, projection: all_projections, stale: rigid_stale, .. } = rigid;
        let (first_pair, rigid_stale) = (&**first_pair, *rigid_stale);
        let part = kept as f32;
        let between = |from: Vec3, to: Vec3| from + (to - from) * part;
        par::update(wall_push, |i, total| *total = between(before.wall_push[i], *total));
        par::update(ratio, |i, ratio| *ratio = before.ratio[i] + (*ratio - before.ratio[i]) * part);
        self.work = before.work + (self.work - before.work) * kept;
        self.pin_work = before.pin_work + (self.pin_work - before.pin_work) * kept;
        // A straight line between two places outside of a solid may lead through it.
        let project = |start: usize, p: &mut [Vec3], wall_push: &mut [Vec3], projection: &mut [Vec3]| {
            let (mut touching, mut work) = (0, 0.0);
            projection.fill(Vec3::zeros());
            for (k, p) in p.iter_mut().enumerate() {
                let i = start + k;
                let x = between(before.p[i], *p);
                *p = x;
                let may_touch = setup.is_near_solid(clearance[i], (x - built_at[i]).norm_squared());
                // Bodies may have gone back farther than distances allow for.
                if may_touch || rigid_stale && first_pair.get(i).is_some_and(|&first| first != NO_PAIR) {
                    let (free, touches) = setup.walls.collide(before.p[i], x);
                    if let Some(push) = wall_push.get_mut(k) {
                        *push += free - x;
                    }
                    if let Some(projection) = projection.get_mut(k) {
                        *projection = free - x;
                    }
                    work += setup.walls.work(x, free);
                    touching += u64::from(touches);
                    *p = free;
                }
            }
            (touching, work)
        };
        let partials = map_columns(p, wall_push, all_projections, project);
        for (touching, work) in partials {
            self.unresolved_contacts += touching;
            self.work += if setup.walls.has_moving_solids() { work } else { 0.0 };
        }
        self.restore_pins();
        // Particles have gone back from where the lists may have been built.
        self.check_skin(setup.rest);
    }
}
