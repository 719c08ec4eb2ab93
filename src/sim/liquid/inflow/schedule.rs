//! When an emitter or an outflow is on, and how much flows.
//!
//! *Method*: the rate is piecewise linear, so that its integral over a substep is a sum of trapezoids between keyframes and switching
//! times, exact up to rounding for any length of the substep.

use super::{FrameRange, LiquidEmitter};
use crate::sim::Timeline;

/// The times in which something is on [s], ascending and apart.
#[derive(Clone, Debug)]
pub(in crate::sim::liquid) struct OnTimes(Vec<[f64; 2]>);

impl OnTimes {
    /// The times of ranges of frames; without a range, all times.
    pub(in crate::sim::liquid) fn new(ranges: &[FrameRange], timeline: Timeline) -> Self {
        let time = |frame: Option<u32>, default: f64| frame.map_or(default, |frame| timeline.time(frame));
        let span =
            |range: &FrameRange| [time(range.start, f64::NEG_INFINITY), time(range.end, f64::INFINITY)];
        let always = ranges.is_empty().then_some([f64::NEG_INFINITY, f64::INFINITY]);
        Self(ranges.iter().map(span).chain(always).collect())
    }

    /// Whether it is on at `time` [s].
    pub(in crate::sim::liquid) fn contains(&self, time: f64) -> bool {
        self.0.iter().any(|&[start, end]| start <= time && time < end)
    }

    /// The parts of the time from `from` to `to` [s] in which it is on.
    fn within(&self, from: f64, to: f64) -> impl Iterator<Item = [f64; 2]> {
        self.0
            .iter()
            .map(move |&[start, end]| [start.max(from), end.min(to)])
            .filter(|[start, end]| start < end)
    }
}

/// Speed of a flow over time.
#[derive(Clone, Debug)]
pub(super) struct Schedule {
    on: OnTimes,
    /// Times [s] and speeds [m/s], ascending; at least one.
    keys: Vec<[f64; 2]>,
}

impl Schedule {
    /// The flow of an emitter whose cross-section has an `area` [m²].
    pub(super) fn new(params: &LiquidEmitter, area: f64, timeline: Timeline) -> Self {
        let speed = |rate: f32| if area > 0.0 { f64::from(rate) / area } else { 0.0 };
        let keys = match (params.velocity, params.rate) {
            (Some(velocity), _) => {
                let square: f64 = velocity.iter().map(|&c| f64::from(c).powi(2)).sum();
                vec![[0.0, square.sqrt()]]
            }
            (None, Some(rate)) => vec![[0.0, speed(rate)]],
            (None, None) => {
                let key = |key: &super::RateKeyframe| [timeline.time(key.frame), speed(key.rate)];
                let keys: Vec<_> = params.rate_keyframes.iter().map(key).collect();
                if keys.is_empty() { vec![[0.0; 2]] } else { keys }
            }
        };
        Self { on: OnTimes::new(&params.on, timeline), keys }
    }

    /// Speed at `time` [s] if the flow is on [m/s].
    fn speed(&self, time: f64) -> f64 {
        let after = self.keys.partition_point(|key| key[0] <= time);
        match (after.checked_sub(1).map(|before| self.keys[before]), self.keys.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * ((time - a[0]) / (b[0] - a[0])),
            (Some(key), None) => key[1],
            (None, key) => key.map_or(0.0, |key| key[1]),
        }
    }

    /// Times from `from` to `to` [s] between which the speed is linear.
    fn breaks(&self, [from, to]: [f64; 2]) -> impl Iterator<Item = f64> {
        let inner = self.keys.iter().map(|key| key[0]).filter(move |&time| from < time && time < to);
        std::iter::once(from).chain(inner).chain(std::iter::once(to))
    }

    /// Length that flows from `from` to `to` [s]: the integral of the speed [m].
    pub(super) fn length(&self, from: f64, to: f64) -> f64 {
        let mut length = 0.0;
        for span in self.on.within(from, to) {
            let times: Vec<f64> = self.breaks(span).collect();
            length += times
                .windows(2)
                .map(|pair| 0.5 * (self.speed(pair[0]) + self.speed(pair[1])) * (pair[1] - pair[0]))
                .sum::<f64>();
        }
        length
    }

    /// Largest speed from `from` to `to` [s], while the flow is on [m/s].
    pub(super) fn max_speed(&self, from: f64, to: f64) -> f64 {
        let spans = self.on.within(from, to);
        spans.flat_map(|span| self.breaks(span)).map(|time| self.speed(time)).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(text: &str) -> Schedule {
        let shape = "shape = { sphere = { center = [0, 0, 0], radius = 1 } }\n";
        let params: LiquidEmitter = crate::from_toml(&format!("{shape}{text}"));
        Schedule::new(&params, 2.0, Timeline { fps: 10.0, first: 1 })
    }

    #[test]
    fn the_length_is_the_integral_of_the_rate_over_the_times_in_which_it_is_on() {
        // 0 to 4 m³/s from 0 to 1 s through 2 m², then 1 m³/s.
        let keys = "rate_keyframes = [{ frame = 1, rate = 0 }, { frame = 11, rate = 4 }, { frame = 21, rate = 1 }]\n";
        let always = schedule(keys);
        for (from, to, expected) in [
            (0.0, 1.0, 1.0),
            (0.0, 0.5, 0.25),
            (1.0, 2.0, 1.25),
            (0.5, 2.0, 0.75 + 1.25),
            (2.0, 10.0, 4.0),
            (-3.0, 0.0, 0.0),
        ] {
            assert!((always.length(from, to) - expected).abs() < 1e-12, "{from} to {to}");
        }
        let parts: f64 =
            (0..1000).map(|k| always.length(f64::from(k) * 0.003, f64::from(k + 1) * 0.003)).sum();
        assert!((parts - always.length(0.0, 3.0)).abs() < 1e-12);
        assert_eq!(always.max_speed(0.2, 3.0), 2.0);
        assert_eq!(always.max_speed(2.5, 3.0), 0.5);
        let ranges =
            schedule(&format!("{keys}on = [{{ end = 6 }}, {{ start = 21, end = 31 }}, {{ start = 41 }}]"));
        for (from, to, expected) in
            [(0.0, 2.0, 0.25), (0.0, 5.0, 0.25 + 0.5 + 0.5), (3.0, 4.0, 0.0), (4.0, 9.0, 2.5)]
        {
            assert!((ranges.length(from, to) - expected).abs() < 1e-12, "{from} to {to}");
        }
        assert_eq!((ranges.max_speed(0.6, 1.9), ranges.max_speed(0.0, 0.5)), (0.0, 1.0));
        assert!(ranges.on.contains(0.4) && !ranges.on.contains(0.5) && ranges.on.contains(2.0));
        assert_eq!(schedule("velocity = [0, 3, 4]").length(1.0, 3.0), 10.0);
    }
}
