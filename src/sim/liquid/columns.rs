//! The columns of the particles: sorted, extended and compacted together.

use super::{Liquid, micropolar::Microrotation, solve::Solver};
use crate::{math::Vec3, par};

impl Liquid {
    /// Sorts particles by the cells of the neighbour search, so that neighbours are close in memory. Unsorted, an iteration
    /// takes nearly twice as long.
    pub(super) fn sort(&mut self) {
        let Solver { grid, p, spare, multipliers, ratio, retained, .. } = &mut self.solver;
        let order = grid.order();
        for values in [&mut self.x, &mut self.v, p] {
            spare.resize(values.len(), Vec3::zeros());
            par::fill(spare, |i| values[order[i] as usize]);
            std::mem::swap(values, spare);
        }
        if let Some(Microrotation { spin, .. }) = &mut self.microrotation {
            spare.resize(spin.len(), Vec3::zeros());
            par::fill(spare, |i| spin[order[i] as usize]);
            std::mem::swap(spin, spare);
        }
        if let Some(forces) = &mut self.forces
            && forces.change.len() == order.len()
        {
            let change = &forces.change;
            spare.resize(change.len(), Vec3::zeros());
            par::fill(spare, |i| change[order[i] as usize]);
            std::mem::swap(&mut forces.change, spare);
        }
        for values in [&mut self.id, &mut self.source, &mut self.nozzle] {
            if !values.is_empty() {
                *values = order.iter().map(|&i| values[i as usize]).collect();
            }
        }
        if multipliers.len() == order.len() {
            ratio.resize(order.len(), 0.0);
            let applied = &mut multipliers.0.applied;
            par::fill(ratio, |i| applied[order[i] as usize]);
            std::mem::swap(applied, ratio);
        }
        for values in [&mut self.momentum.pressure, retained, &mut self.birth] {
            if !values.is_empty() {
                ratio.resize(order.len(), 0.0);
                par::fill(ratio, |i| values[order[i] as usize]);
                std::mem::swap(values, ratio);
            }
        }
        grid.settle();
        self.solver.renumber_pins(&self.nozzle);
    }

    /// Appends `count` particles at rest in the origin, with ids from `first_id` on.
    pub(super) fn append(&mut self, count: usize, [source, first_id]: [u32; 2], birth: f32) {
        let (before, after) = (self.x.len(), self.x.len() + count);
        self.x.resize(after, Vec3::zeros());
        self.v.resize(after, Vec3::zeros());
        self.id.extend(first_id..first_id + count as u32);
        self.nozzle.resize(after, 0);
        if let Some(Microrotation { spin, .. }) = &mut self.microrotation {
            spin.resize(after, Vec3::zeros());
        }
        if self.has_sources {
            self.source.resize(after, source);
        }
        if self.has_births {
            self.birth.resize(after, birth);
        }
        let Solver { multipliers, retained, .. } = &mut self.solver;
        if multipliers.len() == before {
            multipliers.resize(after);
        }
        for values in [&mut self.momentum.pressure, retained] {
            if !values.is_empty() {
                values.resize(after, 0.0);
            }
        }
    }

    /// Removes the particles for which `is_kept` is false; the others keep their order.
    pub(super) fn compact(&mut self, is_kept: &[bool]) {
        fn keep<T: Copy>(values: &mut Vec<T>, is_kept: &[bool]) {
            if values.len() == is_kept.len() {
                let mut flags = is_kept.iter();
                values.retain(|_| flags.next().is_some_and(|kept| *kept));
            }
        }
        keep(&mut self.x, is_kept);
        keep(&mut self.v, is_kept);
        keep(&mut self.birth, is_kept);
        for values in [&mut self.id, &mut self.source, &mut self.nozzle] {
            keep(values, is_kept);
        }
        if let Some(Microrotation { spin, .. }) = &mut self.microrotation {
            keep(spin, is_kept);
        }
        let Solver { multipliers, retained, .. } = &mut self.solver;
        if multipliers.len() == is_kept.len() {
            keep(&mut multipliers.0.applied, is_kept);
            multipliers.resize(self.x.len());
        }
        keep(&mut self.momentum.pressure, is_kept);
        keep(retained, is_kept);
        self.solver.pins.clear();
        self.solver.mark_as_stale();
    }
}
