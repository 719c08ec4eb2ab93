//! One time step of sheets, and the record of a frame.

use super::{
    Integrator, SheetRecord, Sheets,
    exact_joints::CompensatedVectors,
    explicit,
    implicit::{self, Matrix},
    overshoot::{self, EnergyBalance},
    pins_and_joints,
    sliced_ellpack::SlicedEllpack,
    solids::{self, PlacedSolid, RepulsionForce},
    springs::{self, Blocks, ForceSum, LinearTerms, SpringForces},
    vectors::Vectors,
};
use crate::{
    par,
    sim::{Diverged, clock::Clock},
    simd::LANES,
    solid::{BodySurface, Pose},
};

impl Sheets {
    /// Advances from `now` [s] by `dt` [s]. Returns the balance of the step, before anything pushed the sheets.
    pub(super) fn substep(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<EnergyBalance, Diverged> {
        let before = self.forces.is_some().then(|| self.x.clone());
        if let Some(contact) = &mut self.contact {
            contact.begin_substep(&self.x);
        }
        let (diverged, balance) = clock.time("sheet_step", || match self.params.common.solver.integrator {
            Integrator::Symplectic => (self.step_symplectic(now, dt), EnergyBalance::default()),
            Integrator::Implicit => self.step_implicit(now, dt, record),
        });
        if let Some(eight) = diverged {
            let is_finite = |i: &usize| {
                let largest = self.x.get(*i).amax().max(self.v.get(*i).amax());
                largest < super::DIVERGENCE_LIMIT
                    && self.x.get(*i).sum().is_finite()
                    && self.v.get(*i).sum().is_finite()
            };
            let points = eight * LANES..self.len().min((eight + 1) * LANES);
            let point = points.clone().find(|i| !is_finite(i)).unwrap_or(points.start);
            let what = format!("is at {:?} with {:?} m/s", self.x.get(point), self.v.get(point));
            let try_next =
                "a smaller sheets.solver.courant, more sheets.solver.substeps or slower pins and forces";
            return Err(self.diverged(record.substeps, point, what, try_next));
        }
        self.move_pins(now + dt, dt);
        self.resolve_collisions(now, dt, clock, record);
        if let Some(before) = before {
            clock.time("sheet_account", || self.account_forces(&before, record));
        }
        Ok(balance)
    }

    /// Applies exact joints, collisions with solids and contact of sheets at the end of the substep from
    /// `now` [s] of `dt` [s].
    pub(super) fn resolve_collisions(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) {
        self.project();
        if !self.solids.is_empty() {
            record.projected_out += clock.time("sheet_solids", || self.project_out(now, dt));
        }
        // Solids are resolved last: what contact pushes into one is projected out again.
        if self.resolve_contact(now, dt, clock, record) {
            self.project();
            if !self.solids.is_empty() {
                record.projected_out += clock.time("sheet_solids", || self.project_out(now, dt));
            }
        }
    }

    /// Moves exactly pinned points to their places.
    fn move_pins(&mut self, then: f64, dt: f64) {
        for pin in self.pins.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(then - dt)) {
            let (i, place) = (pin.point as usize, pin.place(then));
            self.v.set(i, (place - self.x.get(i)) / dt as f32);
            self.x.set(i, place);
        }
    }

    /// Projects positions and velocities to what exact joints allow.
    fn project(&mut self) {
        let Self { exact_joints, inverse, x, v, low, .. } = self;
        if exact_joints.is_empty() {
            return;
        }
        exact_joints.project(inverse, &mut CompensatedVectors { value: v, low: None });
        // Rounding errors belong to positions.
        exact_joints.project(inverse, &mut CompensatedVectors { value: x, low: Some(low) });
    }

    fn project_out(&mut self, now: f64, dt: f64) -> u64 {
        let placed = solids::place_solids(&self.solids, self.params.common.solid_clearance(), now, now + dt);
        let mobility = self.inverse.as_flattened();
        let friction = self.params.common.friction;
        solids::project_out(&placed, friction, mobility, [&mut self.x, &mut self.v, &mut self.low], dt as f32)
    }

    /// Gathers the forces on all points without damping; returns the repulsion of solids among them. Pins and
    /// solids are at the end of the substep.
    fn gather_forces(&mut self, now: f64, dt: f64) -> Vec<RepulsionForce> {
        let Self { x, force, springs, plates, .. } = self;
        force.clear();
        springs::add_forces(springs, x, force);
        if let Some(plates) = plates {
            springs::add_linear(plates, x, 1.0, force);
        }
        self.gather_other_forces(now, dt, 1)
    }

    /// Adds the forces on all points other than those of springs and plates; returns the repulsion of solids
    /// among them. Pins and solids are at the start (`end` = 0) or the end (1) of the substep.
    fn gather_other_forces(&mut self, now: f64, dt: f64, end: usize) -> Vec<RepulsionForce> {
        self.add_field_forces(now, dt);
        let Self { x, force, pins, joints, .. } = self;
        pins_and_joints::add_forces(pins, joints, [now, now + end as f64 * dt], x, force);
        for (i, external) in self.external_forces.iter().enumerate() {
            force.add(i, *external);
        }
        let repulsion = match (&self.params.common.repulsion, &self.vertex_faces) {
            (Some(repulsion), Some(vertex_faces)) if !self.solids.is_empty() => {
                let placed = solids::place_solids(&self.solids, 0.0, now, now + dt);
                solids::repulsion_forces(
                    repulsion,
                    (&placed, end),
                    vertex_faces,
                    (&*x, &self.area),
                    dt as f32,
                )
            }
            _ => Vec::new(),
        };
        for push in &repulsion {
            force.add(push.point as usize, push.force);
        }
        repulsion
    }

    /// Whether there are forces other than those of springs, plates and gravity.
    fn has_other_forces(&self) -> bool {
        let soft = self.pins.iter().any(|pin| pin.stiffness.is_some());
        let pushed = self.params.common.repulsion.is_some() && !self.solids.is_empty();
        soft || pushed
            || self.joints.iter().any(|joint| joint.stiffness.is_some())
            || !self.external_forces.is_empty()
            || self.forces.is_some()
    }

    fn step_symplectic(&mut self, now: f64, dt: f64) -> Option<usize> {
        let others = self.has_other_forces();
        let mut repulsion = Vec::new();
        if others {
            self.force.clear();
            repulsion = self.gather_other_forces(now, dt, 0);
        }
        let Self { x, next_x, low, springs: table, .. } = self;
        let x = &*x;
        let plates = self.plates.as_ref().map(|table| LinearTerms { table, y: x, factor: 1.0 });
        let other = others.then_some(&self.force);
        let input = explicit::StepInput {
            inverse: &self.inverse,
            drag: self.drag.as_deref(),
            gravity: self.gravity,
            dt: dt as f32,
            x,
            v: None,
        };
        let diverged = if let Some(next_v) = &mut self.next_v {
            let forces = ForceSum { springs: SpringForces::<true> { table, x, v: &self.v }, plates, other };
            let input = explicit::StepInput { v: Some(&self.v), ..input };
            let diverged = explicit::advance(&input, &forces, next_x, next_v, low);
            std::mem::swap(&mut self.v, next_v);
            diverged
        } else {
            let forces = ForceSum { springs: SpringForces::<false> { table, x, v: x }, plates, other };
            explicit::advance(&input, &forces, next_x, &mut self.v, low)
        };
        std::mem::swap(&mut self.x, &mut self.next_x);
        self.apply_friction(&repulsion, dt, false);
        diverged
    }

    /// Applies friction to points with repulsion.
    fn apply_friction(&mut self, repulsion: &[RepulsionForce], dt: f64, report: bool) {
        if let Some(friction) = self.params.common.friction.filter(|_| !repulsion.is_empty()) {
            let Self { x, v, low, inverse, .. } = self;
            solids::apply_friction(
                repulsion,
                friction,
                inverse.as_flattened(),
                [x, v, low],
                (dt as f32, report),
            );
        }
    }

    fn step_implicit(
        &mut self,
        now: f64,
        dt: f64,
        record: &mut SheetRecord,
    ) -> (Option<usize>, EnergyBalance) {
        // Soft pins are part of the blocks, and exactly pinned points start with their velocity.
        self.set_pin_velocities(now, dt);
        self.exact_joints.project(&self.inverse, &mut CompensatedVectors { value: &mut self.v, low: None });
        let repulsion = self.gather_forces(now, dt);
        let h = dt as f32;
        let mut blocks = self.pin_blocks(now, dt);
        if blocks.is_empty() && !repulsion.is_empty() {
            blocks = self.zero_blocks();
        }
        for push in &repulsion {
            implicit::add_along(&mut blocks, push.point as usize, h * h * push.stiffness, push.normal);
        }

        // M v₀ + Δt f(x₀), which takes the place of the forces.
        let Self {
            x,
            v,
            force,
            mass,
            inverse,
            gravity,
            drag,
            springs,
            plates,
            joints,
            exact_joints,
            free_parts,
            low,
            next_x,
            ..
        } = self;
        force.update(|at, axes| {
            let v = v.eight(at);
            for (axis, out) in axes.into_iter().enumerate() {
                for lane in 0..LANES {
                    out[lane] = mass[at][lane] * (v[axis][lane] + h * gravity[axis]) + h * out[lane];
                }
            }
        });
        let before = v.clone();
        let matrix = Matrix {
            springs,
            plates: plates.as_ref(),
            x,
            mass,
            inverse,
            drag: drag.as_deref(),
            blocks,
            joints: joints.iter().filter(|joint| joint.holds(now)).collect(),
            exact_joints,
            free_parts,
            dt: h,
        };
        let solver = &self.params.common.solver;
        let report = matrix.solve(force, v, f64::from(solver.tolerance), solver.max_iterations);
        record.iterations += report.iterations;
        record.residual = record.residual.max(report.residual);
        record.unconverged += u32::from(report.residual > f64::from(solver.tolerance));
        let balance =
            EnergyBalance::new(&overshoot::Substep { springs, x, mass, before: &before, after: v, dt: h });

        // v is the new velocity; positions follow without further forces.
        let gravity = crate::math::Vec3::zeros();
        let input = explicit::StepInput { inverse, drag: None, gravity, dt: h, x, v: None };
        let diverged = explicit::advance(&input, &explicit::NoForce, next_x, v, low);
        std::mem::swap(x, next_x);
        self.apply_friction(&repulsion, dt, true);
        (diverged, balance)
    }

    /// Δt² times the stiffness of soft pins; empty if there are none.
    pub(super) fn pin_blocks(&self, now: f64, dt: f64) -> Vec<Blocks> {
        let h = dt as f32;
        let mut blocks = Vec::new();
        for pin in self.pins.iter().filter(|pin| pin.holds(now)) {
            let Some(stiffness) = pin.stiffness else { continue };
            if blocks.is_empty() {
                blocks = self.zero_blocks();
            }
            implicit::add_all(&mut blocks, pin.point as usize, h * h * stiffness);
        }
        blocks
    }

    fn zero_blocks(&self) -> Vec<Blocks> {
        par::repeated([[0.0; LANES]; 6], self.mass.len())
    }

    /// Left side of the implicit equation at the positions `x`.
    pub(super) fn matrix<'a>(&'a self, x: &'a Vectors, blocks: Vec<Blocks>, now: f64, dt: f64) -> Matrix<'a> {
        Matrix {
            springs: &self.springs,
            plates: self.plates.as_ref(),
            x,
            mass: &self.mass,
            inverse: &self.inverse,
            drag: self.drag.as_deref(),
            blocks,
            joints: self.joints.iter().filter(|joint| joint.holds(now)).collect(),
            exact_joints: &self.exact_joints,
            free_parts: &self.free_parts,
            dt: dt as f32,
        }
    }

    /// Gives exactly pinned points the velocity of their path.
    fn set_pin_velocities(&mut self, now: f64, dt: f64) {
        for pin in self.pins.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(now)) {
            let i = pin.point as usize;
            self.v.set(i, (pin.place(now + dt) - self.x.get(i)) / dt as f32);
        }
    }

    /// Completes the record at the end of a frame, at `time` [s], with rigid bodies there.
    pub(super) fn complete_record(
        &self,
        time: f64,
        bodies: &[(BodySurface<'_>, Pose)],
        record: &mut SheetRecord,
    ) {
        let mass = self.mass.as_flattened();
        let kinetic = |i: usize| 0.5 * f64::from(mass[i]) * self.v.get(i).cast::<f64>().norm_squared();
        let gravity = self.gravity.cast::<f64>();
        let potential = |i: usize| -f64::from(mass[i]) * gravity.dot(&self.x.get(i).cast());
        record.kinetic_energy = par::sum(self.len(), kinetic);
        record.potential_energy = par::sum(self.len(), potential);
        let free_parts = par::map_chunks(self.len(), par::CHUNK, |range| {
            range
                .map(|i| spring_state(&self.springs, &self.x, i))
                .fold(SpringState::default(), SpringState::and)
        });
        let all = free_parts.into_iter().fold(SpringState::default(), SpringState::and);
        record.strain_max = all.strain;
        record.folded = all.folded / 2;
        record.elastic_energy = all.energy;
        if let Some(plates) = &self.plates {
            record.elastic_energy += par::sum(self.len(), |i| plate_energy(plates, &self.x, i));
        }
        let mobility = self.inverse.as_flattened();
        let mut placed = solids::place_solids(&self.solids, 0.0, time, time);
        placed
            .extend(bodies.iter().map(|(surface, pose)| PlacedSolid::rigid(surface.shape, 0.0, [*pose; 2])));
        record.inside_solids = solids::count_inside(&placed, &self.x, mobility);
        (record.cut_faces, record.cut_depth) =
            solids::cut_faces(&placed, (&self.x, mobility), self.all_faces());
    }
}

/// Energy, strain and degenerate springs of a point: both ends count each spring.
#[derive(Clone, Copy, Debug, Default)]
struct SpringState {
    energy: f64,
    strain: f64,
    folded: u64,
}

impl SpringState {
    fn and(self, other: Self) -> Self {
        Self {
            energy: self.energy + other.energy,
            strain: self.strain.max(other.strain),
            folded: self.folded + other.folded,
        }
    }
}

fn spring_state(table: &SlicedEllpack, x: &Vectors, i: usize) -> SpringState {
    let mut out = SpringState::default();
    for slot in table.of(i / LANES).0 {
        let (j, k, rest) =
            (slot.to(i / LANES, i % LANES), f64::from(slot.stiffness[i % LANES]), slot.rest[i % LANES]);
        if k == 0.0 {
            continue;
        }
        let length = (x.get(j).cast::<f64>() - x.get(i).cast()).norm();
        let elongation = length - f64::from(rest);
        out.energy += 0.25 * k * elongation * elongation;
        if rest > 0.0 {
            out.strain = out.strain.max((elongation / f64::from(rest)).abs());
            out.folded += u64::from(length == 0.0);
        }
    }
    out
}

/// Energy of plates at a point: ½ xᵀ Q x = ¼ Σ k_ij |x_i − x_j|².
fn plate_energy(table: &SlicedEllpack, x: &Vectors, i: usize) -> f64 {
    let share = |slot: &super::sliced_ellpack::Slot| {
        let d = x.get(slot.to(i / LANES, i % LANES)).cast::<f64>() - x.get(i).cast();
        0.25 * f64::from(slot.stiffness[i % LANES]) * d.norm_squared()
    };
    table.of(i / LANES).0.iter().map(share).sum()
}
