//! Outflow: volumes and open sides that remove particles.
//!
//! *Method*: at the end of each substep, particles inside a volume that is on, or outside the domain, are removed. A particle is counted
//! once, by the first volume that it is in; else by the side that it is farthest beyond, of those that are open if any is.
//! *Limits*: a substep moves particles by up to `cfl` spacings, so that they may pass a volume thinner than that.

use super::{
    LiquidOutflow, LiquidParams,
    inflow::{LiquidDomain, OnTimes},
};
use crate::{
    math::Vec3,
    sim::Timeline,
    solid::{Motion, Pose, Shape},
};

/// The volumes and sides that remove particles.
#[derive(Debug)]
pub(super) struct Outflow {
    pub(super) volumes: Vec<Volume>,
    domain: Option<LiquidDomain>,
}

/// A volume that removes particles.
#[derive(Debug)]
pub(super) struct Volume {
    shape: Shape,
    motion: Option<Motion>,
    on: OnTimes,
}

/// Number of a particle that stays; others have the number of their exit plus one: volumes, then sides, then none of these.
pub(super) const STAYS: u32 = 0;

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
    pub(super) fn open_volumes(&self, time: f64) -> Vec<(u32, &Shape, Pose)> {
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
    pub(super) fn exit(&self, x: Vec3, volumes: &[(u32, &Shape, Pose)]) -> u32 {
        let inside = volumes.iter().find(|(_, shape, pose)| shape.signed_distance(pose.to_local(x)) < 0.0);
        if let Some((number, ..)) = inside {
            return 1 + number;
        }
        let Some(domain) = &self.domain else { return STAYS };
        let beyond = |side: usize| {
            let axis = side / 2;
            if side.is_multiple_of(2) { domain.min[axis] - x[axis] } else { x[axis] - domain.max[axis] }
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
