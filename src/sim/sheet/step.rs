//! One substep, and the account of a frame.

use super::{
    Integrator, SheetRecord, Sheets,
    bonds::Whole,
    explicit, hold,
    implicit::{self, Matrix},
    lanes::Vectors,
    overshoot,
    solids::{self, Push},
    springs::{self, Blocks, Forces, Linear, Sum},
    table::Table,
};
use crate::{
    math::wide::WIDTH,
    par,
    sim::{Diverged, record::Clock},
};

impl Sheets {
    /// Advances from `now` [s] by `dt` [s].
    pub(super) fn substep(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<(), Diverged> {
        if let Some(contact) = &mut self.contact {
            contact.begin_substep(&self.x);
        }
        let lost = clock.time("sheet_step", || match self.params.common.solver.integrator {
            Integrator::Symplectic => self.symplectic(now, dt),
            Integrator::Implicit => self.implicit(now, dt, record),
        });
        if let Some(eight) = lost {
            let alive = |i: &usize| {
                let largest = self.x.get(*i).amax().max(self.v.get(*i).amax());
                largest < super::ABSURD
                    && self.x.get(*i).sum().is_finite()
                    && self.v.get(*i).sum().is_finite()
            };
            let points = eight * WIDTH..self.len().min((eight + 1) * WIDTH);
            let point = points.clone().find(|i| !alive(i)).unwrap_or(points.start);
            let what = format!("is at {:?} with {:?} m/s", self.x.get(point), self.v.get(point));
            let try_next =
                "a smaller sheets.solver.courant, more sheets.solver.substeps or slower pins and forces";
            return Err(self.diverged(record.substeps, point, what, try_next));
        }
        self.lead(now + dt, dt);
        self.keep_out(now, dt, clock, record);
        Ok(())
    }

    /// Puts points where bonds, solids and other sheets let them be, at the end of the substep from `now` [s] of `dt` [s].
    pub(super) fn keep_out(&mut self, now: f64, dt: f64, clock: &mut Clock, record: &mut SheetRecord) {
        self.unite();
        if !self.solids.is_empty() {
            record.caught += clock.time("sheet_solids", || self.put_back(now, dt));
        }
        // Solids have the last word: what contact pushes into one comes out again.
        if self.resolve_contact(now, dt, clock, record) {
            self.unite();
            if !self.solids.is_empty() {
                record.caught += clock.time("sheet_solids", || self.put_back(now, dt));
            }
        }
    }

    /// Puts points that are held exactly where they are to be.
    fn lead(&mut self, then: f64, dt: f64) {
        for pin in self.held.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(then - dt)) {
            let (i, place) = (pin.point as usize, pin.place(then));
            self.v.set(i, (place - self.x.get(i)) / dt as f32);
            self.x.set(i, place);
        }
    }

    /// Puts together what bonds hold exactly.
    fn unite(&mut self) {
        let Self { bonds, inverse, x, v, low, .. } = self;
        if bonds.is_empty() {
            return;
        }
        bonds.unite(inverse, &mut Whole { value: v, low: None });
        // What rounding took belongs to a place.
        bonds.unite(inverse, &mut Whole { value: x, low: Some(low) });
    }

    fn put_back(&mut self, now: f64, dt: f64) -> u64 {
        let placed = solids::placed(&self.solids, self.params.common.off(), now, now + dt);
        let mobility = self.inverse.as_flattened();
        let friction = self.params.common.friction;
        solids::put_back(&placed, friction, mobility, [&mut self.x, &mut self.v, &mut self.low], dt as f32)
    }

    /// Gathers the forces on all points but those of damping; returns the pushes of solids among them. Pins and solids are where they will
    /// be at the end of the substep.
    fn gather(&mut self, now: f64, dt: f64) -> Vec<Push> {
        let Self { x, force, springs, plates, .. } = self;
        force.clear();
        springs::add_forces(springs, x, force);
        if let Some(plates) = plates {
            springs::add_linear(plates, x, 1.0, force);
        }
        self.gather_rest(now, dt, 1)
    }

    /// Adds the forces on all points but those of springs and plates; returns the pushes of solids among them. Pins and solids are where
    /// they are at one `end` of the substep.
    fn gather_rest(&mut self, now: f64, dt: f64, end: usize) -> Vec<Push> {
        let Self { x, force, held, joined, .. } = self;
        hold::add_forces(held, joined, [now, now + end as f64 * dt], x, force);
        for (i, outside) in self.outside.iter().enumerate() {
            force.add(i, *outside);
        }
        let pushes = match (&self.params.common.repulsion, &self.around) {
            (Some(repulsion), Some(around)) if !self.solids.is_empty() => {
                let placed = solids::placed(&self.solids, 0.0, now, now + dt);
                solids::pushes(repulsion, (&placed, end), around, (&*x, &self.area), dt as f32)
            }
            _ => Vec::new(),
        };
        for push in &pushes {
            force.add(push.point as usize, push.force);
        }
        pushes
    }

    /// Whether anything but springs, plates and gravity can pull or push.
    fn has_other_forces(&self) -> bool {
        let soft = self.held.iter().any(|pin| pin.stiffness.is_some());
        let pushed = self.params.common.repulsion.is_some() && !self.solids.is_empty();
        soft || pushed
            || self.joined.iter().any(|joint| joint.stiffness.is_some())
            || !self.outside.is_empty()
    }

    fn symplectic(&mut self, now: f64, dt: f64) -> Option<usize> {
        let others = self.has_other_forces();
        let mut pushes = Vec::new();
        if others {
            self.force.clear();
            pushes = self.gather_rest(now, dt, 0);
        }
        let Self { x, next_x, low, springs: table, .. } = self;
        let x = &*x;
        let plates = self.plates.as_ref().map(|table| Linear { table, y: x, factor: 1.0 });
        let rest = others.then_some(&self.force);
        let drive = explicit::Drive {
            inverse: &self.inverse,
            drag: self.drag.as_deref(),
            gravity: self.gravity,
            dt: dt as f32,
            x,
            v: None,
        };
        let lost = if let Some(next_v) = &mut self.next_v {
            let forces = Sum { springs: Forces::<true> { table, x, v: &self.v }, plates, rest };
            let drive = explicit::Drive { v: Some(&self.v), ..drive };
            let lost = explicit::advance(&drive, &forces, next_x, next_v, low);
            std::mem::swap(&mut self.v, next_v);
            lost
        } else {
            let forces = Sum { springs: Forces::<false> { table, x, v: x }, plates, rest };
            explicit::advance(&drive, &forces, next_x, &mut self.v, low)
        };
        std::mem::swap(&mut self.x, &mut self.next_x);
        self.rub(&pushes, dt, false);
        lost
    }

    /// Friction of what was pushed.
    fn rub(&mut self, pushes: &[Push], dt: f64, solved: bool) {
        if let Some(friction) = self.params.common.friction.filter(|_| !pushes.is_empty()) {
            let Self { x, v, low, inverse, .. } = self;
            solids::rub(pushes, friction, inverse.as_flattened(), [x, v, low], (dt as f32, solved));
        }
    }

    fn implicit(&mut self, now: f64, dt: f64, record: &mut SheetRecord) -> Option<usize> {
        // What holds points stands in the blocks, and those held exactly begin with their speed.
        self.lead_speeds(now, dt);
        self.bonds.unite(&self.inverse, &mut Whole { value: &mut self.v, low: None });
        let pushes = self.gather(now, dt);
        let h = dt as f32;
        let mut held = self.held_blocks(now, dt);
        if held.is_empty() && !pushes.is_empty() {
            held = self.no_blocks();
        }
        for push in &pushes {
            implicit::add_along(&mut held, push.point as usize, h * h * push.stiffness, push.normal);
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
            joined,
            bonds,
            parts,
            low,
            next_x,
            ..
        } = self;
        force.update(|at, axes| {
            let v = v.eight(at);
            for (axis, out) in axes.into_iter().enumerate() {
                for lane in 0..WIDTH {
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
            held,
            joined: joined.iter().filter(|joint| joint.holds(now)).collect(),
            bonds,
            parts,
            dt: h,
        };
        let solver = &self.params.common.solver;
        let solved = matrix.solve(force, v, f64::from(solver.tolerance), solver.max_iterations);
        record.iterations += solved.iterations;
        record.residual = record.residual.max(solved.residual);
        record.unconverged += u32::from(solved.residual > f64::from(solver.tolerance));
        let made =
            overshoot::made(&overshoot::Substep { springs, x, mass, before: &before, after: v, dt: h });
        record.overshot += u32::from(made > 0.0);
        record.overshot_energy += made;

        // v is the new one; positions follow without further forces.
        let gravity = crate::math::Vec3::zeros();
        let drive = explicit::Drive { inverse, drag: None, gravity, dt: h, x, v: None };
        let lost = explicit::advance(&drive, &explicit::Nothing, next_x, v, low);
        std::mem::swap(x, next_x);
        self.rub(&pushes, dt, true);
        lost
    }

    /// Δt² of what soft pins do; empty if there are none.
    pub(super) fn held_blocks(&self, now: f64, dt: f64) -> Vec<Blocks> {
        let h = dt as f32;
        let mut held = Vec::new();
        for pin in self.held.iter().filter(|pin| pin.holds(now)) {
            let Some(stiffness) = pin.stiffness else { continue };
            if held.is_empty() {
                held = self.no_blocks();
            }
            implicit::add_all(&mut held, pin.point as usize, h * h * stiffness);
        }
        held
    }

    fn no_blocks(&self) -> Vec<Blocks> {
        par::repeated([[0.0; WIDTH]; 6], self.mass.len())
    }

    /// The left side of the implicit rule at the positions `x`.
    pub(super) fn matrix<'a>(&'a self, x: &'a Vectors, held: Vec<Blocks>, now: f64, dt: f64) -> Matrix<'a> {
        Matrix {
            springs: &self.springs,
            plates: self.plates.as_ref(),
            x,
            mass: &self.mass,
            inverse: &self.inverse,
            drag: self.drag.as_deref(),
            held,
            joined: self.joined.iter().filter(|joint| joint.holds(now)).collect(),
            bonds: &self.bonds,
            parts: &self.parts,
            dt: dt as f32,
        }
    }

    /// Gives points that are held exactly the speed of their way.
    fn lead_speeds(&mut self, now: f64, dt: f64) {
        for pin in self.held.iter().filter(|pin| pin.stiffness.is_none() && pin.holds(now)) {
            let i = pin.point as usize;
            self.v.set(i, (pin.place(now + dt) - self.x.get(i)) / dt as f32);
        }
    }

    /// What the record tells of the end of a frame, at `time` [s].
    pub(super) fn account(&self, time: f64, record: &mut SheetRecord) {
        let mass = self.mass.as_flattened();
        let kinetic = |i: usize| 0.5 * f64::from(mass[i]) * self.v.get(i).cast::<f64>().norm_squared();
        let gravity = self.gravity.cast::<f64>();
        let potential = |i: usize| -f64::from(mass[i]) * gravity.dot(&self.x.get(i).cast());
        record.kinetic_energy = par::sum(self.len(), kinetic);
        record.potential_energy = par::sum(self.len(), potential);
        let parts = par::map_chunks(self.len(), par::CHUNK, |range| {
            range.map(|i| stretch(&self.springs, &self.x, i)).fold(Stretch::default(), Stretch::and)
        });
        let all = parts.into_iter().fold(Stretch::default(), Stretch::and);
        record.strain_max = all.strain;
        record.folded = all.folded / 2;
        record.elastic_energy = all.energy;
        if let Some(plates) = &self.plates {
            record.elastic_energy += par::sum(self.len(), |i| bent(plates, &self.x, i));
        }
        let mobility = self.inverse.as_flattened();
        record.inside_solids = solids::inside(&self.solids, time, &self.x, mobility);
        (record.cut_faces, record.cut_depth) =
            solids::cut(&self.solids, time, (&self.x, mobility), self.all_faces());
    }
}

/// What the springs of a point say: each is asked from both ends.
#[derive(Clone, Copy, Debug, Default)]
struct Stretch {
    energy: f64,
    strain: f64,
    folded: u64,
}

impl Stretch {
    fn and(self, other: Self) -> Self {
        Self {
            energy: self.energy + other.energy,
            strain: self.strain.max(other.strain),
            folded: self.folded + other.folded,
        }
    }
}

fn stretch(table: &Table, x: &Vectors, i: usize) -> Stretch {
    let mut out = Stretch::default();
    for slot in table.of(i / WIDTH).0 {
        let (j, k, rest) =
            (slot.to(i / WIDTH, i % WIDTH), f64::from(slot.stiffness[i % WIDTH]), slot.rest[i % WIDTH]);
        if k == 0.0 {
            continue;
        }
        let length = (x.get(j).cast::<f64>() - x.get(i).cast()).norm();
        let longer = length - f64::from(rest);
        out.energy += 0.25 * k * longer * longer;
        if rest > 0.0 {
            out.strain = out.strain.max((longer / f64::from(rest)).abs());
            out.folded += u64::from(length == 0.0);
        }
    }
    out
}

/// The share of a point in the energy of plates: ½ xᵀ Q x = ¼ Σ k_ij |x_i − x_j|².
fn bent(table: &Table, x: &Vectors, i: usize) -> f64 {
    let share = |slot: &super::table::Slot| {
        let d = x.get(slot.to(i / WIDTH, i % WIDTH)).cast::<f64>() - x.get(i).cast();
        0.25 * f64::from(slot.stiffness[i % WIDTH]) * d.norm_squared()
    };
    table.of(i / WIDTH).0.iter().map(share).sum()
}
