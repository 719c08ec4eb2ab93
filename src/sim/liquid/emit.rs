//! Emission: particles in nozzles are moved, and others enter, at the start of each substep.
//!
//! *Method*: see `inflow/mod.rs`.

use super::{
    Diverged, FlowRecord, Liquid, LiquidRecord, NAME,
    energy::energy,
    inflow::{Emitter, EmitterStep, Inflow, LayerPoint, MIN_SOLID_DISTANCE, is_free, leads_into_solid},
    solve::Pin,
};
use crate::{math::Vec3, par, space::CellGrid};

/// Distance from a solid at which a particle in a nozzle is let go, in spacings. It is below [`MIN_SOLID_DISTANCE`], so that rounding
/// lets none go.
const RELEASE_DISTANCE: f32 = 0.45;

/// Smallest distance to another particle of a nozzle at which a particle enters, in spacings, as for sources.
const MIN_NOZZLE_SEPARATION: f32 = 0.9;

/// The same to a free particle: liquid in front of a nozzle is pushed away. At 0.5 liquid that rests at a nozzle, half a spacing from
/// its wall, blocks it for good, since nothing enters that would push it. Where a nozzle points at a solid, the larger distance holds: a jet
/// pressed into a gap of one and a half spacings is thrown out otherwise.
const MIN_FREE_SEPARATION: f32 = 0.25;

/// Most particles of a liquid: neighbour lists index them.
const MAX_PARTICLES: f64 = 2_147_483_648.0;

/// Most particles that enter in one substep: 560 MB.
const MAX_ENTERING: f64 = 1e7;

/// Most particles of a shot: ids have 32 bits.
const MAX_IDS: f64 = 4_294_967_295.0;

/// A particle that is about to enter.
struct Entering {
    point: LayerPoint,
    start: Vec3,
    end: Vec3,
}

impl Liquid {
    /// Moves the particles in the nozzles and adds those that enter, from `from` [s] over `dt` [s].
    ///
    /// # Errors
    /// If there are too many particles.
    pub(super) fn emit(&mut self, from: f64, dt: f32, record: &mut LiquidRecord) -> Result<(), Diverged> {
        self.solver.pins.clear();
        let Some(flow) = &mut record.flow else { return Ok(()) };
        let Some(mut inflow) = self.inflow.take() else { return Ok(()) };
        let to = self.walls.now();
        let steps: Vec<EmitterStep> =
            inflow.emitters.iter_mut().map(|emitter| emitter.advance(from, to)).collect();
        self.move_nozzles(&inflow, &steps, dt, flow);
        let mut result = Ok(());
        for (index, (emitter, step)) in inflow.emitters.iter().zip(&steps).enumerate() {
            let count = emitter.entering_count(step.length);
            let all = [self.x.len() as f64 + count, f64::from(self.next_id) + count];
            if count > MAX_ENTERING || all[0] > MAX_PARTICLES || all[1] > MAX_IDS {
                let what = format!(
                    "would be followed by {count:.1e} more in one substep; at most {MAX_ENTERING:.0e} may, and ids have 32 bits"
                );
                let particle = self.next_id.saturating_sub(1);
                let try_next = "a larger liquid.spacing, a smaller rate or fewer frames";
                result = Err(Diverged { system: NAME, substep: record.substeps, particle, what, try_next });
                break;
            }
            let entering =
                self.entering(emitter, step, [inflow.spacing, inflow.nozzle_length as f32, dt], flow, index);
            flow.emitted[index] += entering.len() as u64;
            self.add_particles(index, emitter, &entering, [from, f64::from(dt)]);
        }
        self.inflow = Some(inflow);
        self.solver.pins.sort_unstable_by_key(|pin| pin.particle);
        result
    }

    /// Moves the particles that are in nozzles by a substep of `dt` [s], or lets them go.
    fn move_nozzles(&mut self, inflow: &Inflow, steps: &[EmitterStep], dt: f32, flow: &mut FlowRecord) {
        let mut added = 0.0;
        for i in 0..self.nozzle.len() {
            let Some(column) = self.nozzle[i].checked_sub(1) else { continue };
            let owner = inflow.emitters.partition_point(|emitter| emitter.first_column <= column) - 1;
            let (emitter, step) = (&inflow.emitters[owner], &steps[owner]);
            let (point, place) = emitter.point_at((column - emitter.first_column) as usize, self.x[i], step);
            let target = emitter.position(point, step.length[1], &step.pose[1]);
            let is_on = step.length[1] > step.length[0];
            let flow_direction = emitter.flow_direction(&step.pose[1]);
            // One that goes on towards a solid would be pressed onto those that the solid has stopped.
            let left = (inflow.nozzle_length - place).max(0.0) as f32;
            let is_free = is_free(&self.walls, target, flow_direction, RELEASE_DISTANCE, inflow.spacing)
                && !leads_into_solid(&self.walls, target, flow_direction, left, inflow.spacing);
            if is_on && is_free && place < inflow.nozzle_length {
                added += self.pin(i, target, dt);
            } else {
                flow.released_early += u64::from(is_on && !is_free);
                self.nozzle[i] = 0;
            }
        }
        self.first_energy += added;
    }

    /// Prescribes the motion of a particle to `target` over `dt` [s]. Returns the energy that it gains [J].
    fn pin(&mut self, i: usize, target: Vec3, dt: f32) -> f64 {
        let state = |v: Vec3, x: Vec3| energy(&[v], &[x], self.gravity, self.mass);
        let before = state(self.v[i], self.x[i]);
        let v = (target - self.x[i]) / dt;
        let gained = state(v, target) - before;
        self.v[i] = v;
        self.solver.pins.push(Pin { particle: i as u32, target });
        gained
    }

    /// The particles of an emitter that enter in a substep, without those whose place is not free.
    fn entering(
        &self,
        emitter: &Emitter,
        step: &EmitterStep,
        [spacing, length, dt]: [f32; 3],
        flow: &mut FlowRecord,
        index: usize,
    ) -> Vec<Entering> {
        let at = |point| Entering {
            point,
            start: emitter.position(point, step.length[0], &step.pose[0]),
            end: emitter.position(point, step.length[1], &step.pose[1]),
        };
        let mut entering: Vec<Entering> = emitter.entering(step.length).into_iter().map(at).collect();
        if entering.is_empty() {
            return entering;
        }
        let wanted = entering.len();
        let flow_direction = emitter.flow_direction(&step.pose[1]);
        entering.retain(|entering| {
            is_free(&self.walls, entering.end, flow_direction, MIN_SOLID_DISTANCE, spacing)
        });
        flow.blocked_by_solids[index] += (wanted - entering.len()) as u64;

        // Particles near the places, where they will be.
        let low =
            entering.iter().fold(Vec3::repeat(f32::INFINITY), |low, e| low.inf(&e.end)).add_scalar(-spacing);
        let high = entering
            .iter()
            .fold(Vec3::repeat(-f32::INFINITY), |high, e| high.sup(&e.end))
            .add_scalar(spacing);
        let is_near = |x: &Vec3| (0..3).all(|axis| low[axis] <= x[axis] && x[axis] <= high[axis]);
        let found = par::map_chunks(self.x.len(), par::CHUNK, |range| {
            let moved = range.map(|i| (self.x[i] + self.v[i] * dt, self.nozzle[i] != 0));
            moved.filter(|(x, _)| is_near(x)).collect::<Vec<_>>()
        });
        let (near, in_nozzle): (Vec<Vec3>, Vec<bool>) = found.into_iter().flatten().unzip();
        let grid = CellGrid::new(&near, spacing);
        let wanted = entering.len();
        entering.retain(|entering| {
            let mut is_free = true;
            let at_wall = leads_into_solid(&self.walls, entering.end, flow_direction, length, spacing);
            grid.for_each_within(&near, entering.end, MIN_NOZZLE_SEPARATION * spacing, |j, distance2| {
                let separation =
                    if in_nozzle[j] || at_wall { MIN_NOZZLE_SEPARATION } else { MIN_FREE_SEPARATION };
                is_free &= distance2 >= (separation * spacing).powi(2);
            });
            is_free
        });
        flow.blocked_by_liquid[index] += (wanted - entering.len()) as u64;
        entering
    }

    /// Adds the particles of emitter `index` that enter in a substep from `from` over `dt` [s].
    fn add_particles(
        &mut self,
        index: usize,
        emitter: &Emitter,
        entering: &[Entering],
        [from, dt]: [f64; 2],
    ) {
        if entering.is_empty() {
            return;
        }
        let mut added = 0.0;
        let source = (self.params.source.len() + index) as u32;
        let first = self.x.len();
        self.append(entering.len(), [source, self.next_id], (from + dt) as f32);
        self.next_id += entering.len() as u32;
        for (k, Entering { point, start, end }) in entering.iter().enumerate() {
            let i = first + k;
            self.x[i] = *start;
            self.v[i] = (end - start) / dt as f32;
            self.nozzle[i] = 1 + emitter.first_column + point.column as u32;
            added += energy(&[self.v[i]], &[self.x[i]], self.gravity, self.mass);
            added += self.pin(i, *end, dt as f32);
        }
        self.first_energy += added;
    }
}
