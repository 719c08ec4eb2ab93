//! An emitter: a seeding lattice that moves through a nozzle.
//!
//! *Method*: layers of the seeding lattice, a spacing or a little more apart (`nozzle.rs`), move with the flow in the nozzle's own
//! coordinates. How far they have moved is the integral of the speed over time, in double precision and part of the state. A layer
//! enters a column when half of it has passed the column's front, so that the volume is that of the flow within a layer at any time,
//! and places depend on the length alone: neither the substep nor a change of the rate opens a gap or lets layers overlap.
//!
//! Symbols: flow length L → `length` [m]; distance of layers d → `layer_distance` [m]; column c has layer k at
//! L − (k + ½ + shift of c) d beyond the reference plane → [`Emitter::place`].

use super::{
    LiquidEmitter,
    nozzle::{Column, Nozzle, layer_distance},
    schedule::Schedule,
};
use crate::{
    math::Vec3,
    sim::{Timeline, liquid::calibration::RestState},
    solid::{Motion, Pose},
};

/// An emitter with its state.
#[derive(Clone, Debug)]
pub(in crate::sim::liquid) struct Emitter {
    pub(in crate::sim::liquid) nozzle: Nozzle,
    schedule: Schedule,
    motion: Option<Motion>,
    /// Volume of a layer over the distance between layers [m²].
    pub(in crate::sim::liquid) area: f64,
    /// Distance of the farthest point of the nozzle from its own origin [m].
    reach: f32,
    layer_distance: f64,
    /// Number of its first column among those of all emitters.
    pub(in crate::sim::liquid) first_column: u32,
    /// Length that has flowed [m]: the state.
    pub(in crate::sim::liquid) length: f64,
}

/// What an emitter does in a substep.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim::liquid) struct EmitterStep {
    /// Flow length at the start and at the end [m].
    pub(in crate::sim::liquid) length: [f64; 2],
    /// Poses at the start and at the end.
    pub(in crate::sim::liquid) pose: [Pose; 2],
}

/// A point of the moving seeding lattice.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim::liquid) struct LayerPoint {
    /// Column, among those of the emitter.
    pub(in crate::sim::liquid) column: usize,
    pub(in crate::sim::liquid) layer: i64,
}

impl Emitter {
    /// The emitter of a preset, for particles of a rest state; its columns are numbered from `first_column` on.
    pub(in crate::sim::liquid) fn new(
        params: &LiquidEmitter,
        rest: &RestState,
        timeline: Timeline,
        first_column: u32,
    ) -> Self {
        let (spacing, layer_distance) = (f64::from(rest.spacing), layer_distance(rest));
        let nozzle = Nozzle::new(&params.shape, params.flow_direction().unwrap_or_default(), spacing);
        // A layer has the volume of its particles.
        let area = nozzle.columns.len() as f64 * spacing.powi(3) / layer_distance;
        Self {
            schedule: Schedule::new(params, area, timeline),
            area,
            motion: Motion::new(&params.keyframes, params.interpolation, timeline.fps, timeline.first),
            reach: params.shape.reach(),
            nozzle,
            layer_distance,
            first_column,
            length: 0.0,
        }
    }

    /// Advances the flow from `from` to `to` [s].
    pub(in crate::sim::liquid) fn advance(&mut self, from: f64, to: f64) -> EmitterStep {
        let before = self.length;
        self.length += self.schedule.length(from, to);
        EmitterStep { length: [before, self.length], pose: [self.pose(from), self.pose(to)] }
    }

    /// Where the nozzle is at `time` [s].
    pub(in crate::sim::liquid) fn pose(&self, time: f64) -> Pose {
        self.motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time))
    }

    /// Unit vector along the flow in a pose.
    pub(in crate::sim::liquid) fn flow_direction(&self, pose: &Pose) -> Vec3 {
        pose.rotation * self.nozzle.direction.cast::<f32>()
    }

    /// Bound of the speed of the liquid in the nozzle from `from` to `to` [m/s], while the flow is on.
    pub(in crate::sim::liquid) fn max_speed(&self, from: f64, to: f64) -> f64 {
        let flow = self.schedule.max_speed(from, to);
        let motion = self.motion.as_ref().map_or(0.0, |motion| motion.fastest(from, to, self.reach));
        if flow > 0.0 { flow + motion } else { 0.0 }
    }

    /// Length that flows from `from` to `to` [s] [m].
    pub(in crate::sim::liquid) fn flow_length(&self, from: f64, to: f64) -> f64 {
        self.schedule.length(from, to)
    }

    /// Distance of a point beyond the reference plane at a flow length [m].
    fn place(&self, point: LayerPoint, length: f64) -> f64 {
        length - (point.layer as f64 + 0.5 + self.nozzle.columns[point.column].shift) * self.layer_distance
    }

    /// The last layer that has entered a column at a flow length [m].
    fn last_layer(&self, column: Column, length: f64) -> i64 {
        ((length + column.depth) / self.layer_distance - 0.5 - column.shift).floor() as i64
    }

    /// Number of particles that enter while the flow length grows from `from` to `to` [m].
    pub(in crate::sim::liquid) fn entering_count(&self, [from, to]: [f64; 2]) -> f64 {
        let count = |&column: &Column| {
            self.last_layer(column, to).saturating_sub(self.last_layer(column, from)) as f64
        };
        self.nozzle.columns.iter().map(count).sum()
    }

    /// The points that enter while the flow length grows from `from` to `to` [m], layer by layer.
    pub(in crate::sim::liquid) fn entering(&self, [from, to]: [f64; 2]) -> Vec<LayerPoint> {
        let mut points: Vec<LayerPoint> = Vec::new();
        for (column, &at) in self.nozzle.columns.iter().enumerate() {
            let layers = self.last_layer(at, from) + 1..=self.last_layer(at, to);
            points.extend(layers.map(|layer| LayerPoint { column, layer }));
        }
        points.sort_by_key(|point| (point.layer, point.column));
        points
    }

    /// Position of a point of the seeding lattice at a flow length [m] and a pose.
    pub(in crate::sim::liquid) fn position(&self, point: LayerPoint, length: f64, pose: &Pose) -> Vec3 {
        let foot = self.nozzle.columns[point.column].foot;
        pose.to_world((foot + self.nozzle.direction * self.place(point, length)).cast())
    }

    /// The point of the seeding lattice in `column` that is at `x` at a flow length [m] and a pose, and its distance beyond the reference
    /// plane at another flow length [m].
    pub(in crate::sim::liquid) fn point_at(
        &self,
        column: usize,
        x: Vec3,
        step: &EmitterStep,
    ) -> (LayerPoint, f64) {
        let local = step.pose[0].to_local(x).cast::<f64>();
        let Column { foot, shift, .. } = self.nozzle.columns[column];
        let place = (local - foot).dot(&self.nozzle.direction);
        let layer = ((step.length[0] - place) / self.layer_distance - 0.5 - shift).round() as i64;
        let point = LayerPoint { column, layer };
        (point, self.place(point, step.length[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::Kernel;

    fn emitter(text: &str) -> Emitter {
        let rest = RestState::new(Kernel::Wendland, 0.02, 2.0);
        Emitter::new(&crate::from_toml(text), &rest, Timeline { fps: 24.0, first: 1 }, 0)
    }

    const BALL: &str = "shape = { sphere = { center = [0, 0, 1], radius = 0.1 } }\n";

    #[test]
    fn the_emitted_volume_is_that_of_the_rate_for_any_step() {
        for (shape, rate) in [
            (BALL, 0.013),
            ("shape = { disc = { center = [0, 0, 0], normal = [0, 1, 0], radius = 0.07 } }\n", 0.0371),
        ] {
            let direction = if shape == BALL { "direction = [1, 0, -2]\n" } else { "" };
            for steps in [1, 7, 96, 1001] {
                let mut emitter = emitter(&format!("{shape}{direction}rate = {rate}"));
                let (seconds, mut count) = (3.0, 0);
                for step in 0..steps {
                    let [from, to] = [step, step + 1].map(|k| seconds * f64::from(k) / f64::from(steps));
                    let step = emitter.advance(from, to);
                    let points = emitter.entering(step.length);
                    assert_eq!(points.len() as f64, emitter.entering_count(step.length));
                    count += points.len();
                }
                let volume = count as f64 * 0.02_f64.powi(3);
                let layer = emitter.nozzle.columns.len() as f64 * 0.02_f64.powi(3);
                assert!(
                    (volume - rate * seconds).abs() <= 0.501 * layer,
                    "{steps}: {volume} of {}",
                    rate * seconds
                );
            }
        }
    }

    #[test]
    fn the_seeding_lattice_is_found_again_from_positions_of_single_precision() {
        let text = "velocity = [0, 3, -4]\nkeyframes = [{ frame = 1, position = [100, 0, 0] }, { frame = 25, rotation = [0, 0, 700] }]";
        let mut emitter = emitter(&format!("{BALL}{text}"));
        let mut held: Vec<(LayerPoint, Vec3)> = Vec::new();
        for step in 0..200 {
            let [from, to] = [step, step + 1].map(|k| f64::from(k) * 0.0041);
            let step = emitter.advance(from, to);
            for (point, x) in &mut held {
                let (found, _) = emitter.point_at(point.column, *x, &step);
                assert_eq!(found.layer, point.layer);
                *x = emitter.position(*point, step.length[1], &step.pose[1]);
            }
            let enter = |point| (point, emitter.position(point, step.length[1], &step.pose[1]));
            held.extend(emitter.entering(step.length).into_iter().map(enter));
        }
        assert!(held.len() > 10_000, "{}", held.len());
        // All points that entered at any time are one seeding lattice, each place of which is taken once.
        let mut keys: Vec<_> = held.iter().map(|(point, _)| (point.column, point.layer)).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), held.len());
    }

    #[test]
    fn an_emitter_that_is_off_has_no_speed() {
        let emitter = emitter(&format!(
            "{BALL}velocity = [0, 0, -2]\non = [{{ start = 25 }}]\nkeyframes = [{{ frame = 1 }}, {{ frame = 49, position = [2, 0, 0] }}]"
        ));
        assert_eq!(emitter.max_speed(0.0, 0.9), 0.0);
        assert!((emitter.max_speed(0.9, 1.1) - 3.0).abs() < 1e-6);
        assert_eq!(emitter.flow_length(0.0, 1.5), 1.0);
    }
}
