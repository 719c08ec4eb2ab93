//! Removal of particles that have left, at the end of each substep.
//!
//! *Method*: see `outflow.rs`.

use super::{Liquid, LiquidRecord, energy::energy, outflow::STAYS};
use crate::{math::Vec3, par};

impl Liquid {
    /// Removes particles that have left.
    pub(super) fn drain(&mut self, record: &mut LiquidRecord) {
        let Some(outflow) = &self.outflow else { return };
        let volumes = outflow.open_volumes(self.walls.now());
        let mut exits = vec![STAYS; self.x.len()];
        let x = &self.x;
        par::fill(&mut exits, |i| outflow.exit(x[i], &volumes));
        let Some(flow) = &mut record.flow else { return };
        let count = outflow.volumes.len();
        let (mut removed_x, mut removed_v) = (Vec::new(), Vec::new());
        for (i, exit) in exits.iter().enumerate() {
            let Some(exit) = exit.checked_sub(1).map(|exit| exit as usize) else { continue };
            match exit.checked_sub(count) {
                None => flow.removed[exit] += 1,
                Some(side) if side < 6 => flow.left_by_side[side] += 1,
                Some(_) => flow.left_by_accident += 1,
            }
            removed_x.push(self.x[i]);
            removed_v.push(self.v[i]);
        }
        if removed_x.is_empty() {
            return;
        }
        self.first_energy -= energy(&removed_v, &removed_x, self.gravity, self.mass);
        if let Some(microrotation) = &self.microrotation {
            let removed = |(spin, exit): (&Vec3, &u32)| (*exit != STAYS).then_some(*spin);
            let spin: Vec<Vec3> = microrotation.spin.iter().zip(&exits).filter_map(removed).collect();
            self.first_energy -= microrotation.energy_of(&spin, self.mass);
        }
        let is_kept: Vec<bool> = exits.iter().map(|&exit| exit == STAYS).collect();
        self.compact(&is_kept);
        self.solver.p.clone_from(&self.x);
        self.solver.renumber_pins(&self.nozzle);
    }
}
