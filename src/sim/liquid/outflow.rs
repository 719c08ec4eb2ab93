//! Outflow: volumes and open sides that remove particles.
//!
//! *Method*: at the end of each substep, particles inside a volume that is on, or outside the domain, are removed. A particle is counted
//! once, by the first volume that it is in; else by the side that it is farthest beyond, of those that are open if any is.
//! *Limits*: a substep moves particles by up to `cfl` spacings, so that they may pass a volume thinner than that.

use super::{
    Liquid, LiquidOutflow, LiquidParams, LiquidRecord,
    energy::energy,
    inflow::{LiquidDomain, OnTimes},
};
use crate::{
    math::Vec3,
    par,
    sim::Timeline,
    solid::{Motion, Pose, Shape},
};

/// The volumes and sides that remove particles.
#[derive(Debug)]
pub(super) struct Outflow {
    volumes: Vec<Volume>,
    domain: Option<LiquidDomain>,
}

#[derive(Debug)]
struct Volume {
    shape: Shape,
    motion: Option<Motion>,
    on: OnTimes,
}

/// Number of a particle that stays; others have the number of their exit plus one: volumes, then sides, then none of these.
const STAYS: u32 = 0;

impl Outflow {
    /// The outflow of a preset; `None` without any.
    pub(super) fn new(params: &LiquidParams, timeline: Timeline) -> Option<Self> {
        let volume = |params: &LiquidOutflow| Volume {
            shape: params.shape.clone(),
            motion: Motion::new(&params.keyframes, params.interpolation, timeline.fps, timeline.first),
            on: OnTimes::new(&params.on, timeline),
        };
        let volumes: Vec<Volume> = params.outflow.iter().map(volume).collect();
        let domain = params.domain.clone();
        (!volumes.is_empty() || domain.is_some()).then_some(Self { volumes, domain })
    }

    /// The volumes that are on at `time` [s], with their numbers and poses.
    fn open_volumes(&self, time: f64) -> Vec<(u32, &Shape, Pose)> {
        let pose =
            |volume: &Volume| volume.motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time));
        let volumes = (0..).zip(&self.volumes).filter(|(_, volume)| volume.on.contains(time));
        volumes.map(|(number, volume)| (number, &volume.shape, pose(volume))).collect()
    }

    /// Number of volumes.
    pub(super) fn volume_count(&self) -> usize {
        self.volumes.len()
    }

    /// Whether a particle at `x` is removed at `time` [s].
    pub(super) fn removes(&self, x: Vec3, time: f64) -> bool {
        self.exit(x, &self.open_volumes(time)) != STAYS
    }

    /// The exit of a particle at `x`.
    fn exit(&self, x: Vec3, volumes: &[(u32, &Shape, Pose)]) -> u32 {
        let inside = volumes.iter().find(|(_, shape, pose)| shape.signed_distance(pose.to_local(x)) < 0.0);
        if let Some((number, ..)) = inside {
            return 1 + number;
        }
        let Some(domain) = &self.domain else { return STAYS };
        let beyond = |side: usize| {
            let axis = side / 2;
            if side % 2 == 0 { domain.min[axis] - x[axis] } else { x[axis] - domain.max[axis] }
        };
        let farthest = |sides: &mut dyn Iterator<Item = usize>| {
            let out = sides.filter(|&side| beyond(side) > 0.0);
            out.fold(None, |most: Option<usize>, side| match most {
                Some(most) if beyond(most) >= beyond(side) => Some(most),
                _ => Some(side),
            })
        };
        let first_side = 1 + self.volumes.len() as u32;
        if let Some(side) = farthest(&mut domain.open.iter().map(|side| side.index())) {
            return first_side + side as u32;
        }
        if farthest(&mut (0..6)).is_some() { first_side + 6 } else { STAYS }
    }
}

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
