//! What remeshing did to the vortons of a shot, in sum, and what of it is reported.

use crate::sim::{smoke::SmokeRecord, vortex::flow::FlowReport};

/// The impulse lost in remeshing, as a part of what the strengths could have, above which it is reported. Below, a ring is
/// slower or faster by no more than this; built-in shots lose less than a thousandth.
const MAX_IMPULSE_LOSS: f64 = 0.01;

/// Impulse changed so that no vortex line ends at a solid, above which it is reported. A solid changes the air's impulse as well;
/// where remeshing does as much as this, what is left of an eddy next to one is made by the grid.
const MAX_IMPULSE_CHANGE: f64 = 0.1;

/// The part of total circulation that a remeshing redistributes, on average, above which it is reported: fringes of built-in
/// shots have 0.2 to 0.3 % of it. With 9 % a ring of 700 vortons had 49 after forty remeshings.
const MAX_REDISTRIBUTION: f64 = 0.02;

/// The part of vortons too wide for the remeshing grid above which it is reported. They lose their overlap, and nothing
/// restores it.
const MAX_WIDE_PART: f64 = 0.01;

/// Sums over the remeshings of a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct RemeshTotals {
    count: u32,
    /// Vortons remeshed, about: those before the first remeshing of a frame stand for all of it.
    remeshed: f64,
    wide: f64,
    unsolved: u32,
    redistributed: f64,
    /// Impulses [m⁴/s], and the largest that the strengths could have.
    lost: f64,
    turned: f64,
    reach: f64,
}

impl RemeshTotals {
    fn add(&mut self, flow: &FlowReport) {
        let Some(sum) = &flow.remesh else { return };
        self.count += flow.remeshed;
        self.remeshed += f64::from(sum.before) * f64::from(flow.remeshed);
        self.wide += f64::from(sum.wide);
        self.unsolved += sum.unconverged;
        self.redistributed += sum.redistributed;
        self.lost += sum.lost_impulse;
        self.turned += sum.impulse_change_at_solids;
        self.reach = self.reach.max(sum.impulse_scale);
    }

    fn warnings(&self) -> Vec<String> {
        let Self { count, unsolved, .. } = *self;
        let above = |part: f64, limit: f64, what: &str| {
            // NaN is reported too.
            (part > limit || part.is_nan()).then(|| format!("{:.1} % {what}", 100.0 * part))
        };
        let part = |of: f64, all: f64| if of == 0.0 { 0.0 } else { of / all };
        let lines = [
            above(
                part(self.lost, self.reach),
                MAX_IMPULSE_LOSS,
                &format!(
                    "of the smoke's impulse was lost in {count} remeshings, with low-circulation vortons that have no neighbours \
                     (lower smoke.flow.remesh.weak)"
                ),
            ),
            above(
                part(self.turned, self.reach),
                MAX_IMPULSE_CHANGE,
                &format!(
                    "of the smoke's impulse was changed in {count} remeshings so that no vortex line ends at a solid (lower \
                     smoke.spacing)"
                ),
            ),
            above(
                part(self.redistributed, f64::from(count)),
                MAX_REDISTRIBUTION,
                &format!(
                    "of total circulation was redistributed from low-circulation vortons and out of solids in each of {count} \
                     remeshings (lower smoke.flow.remesh.weak)"
                ),
            ),
            above(
                part(self.wide, self.remeshed),
                MAX_WIDE_PART,
                "of the vortons were not remeshed, with cores more than 2.2 times as wide as the grid's (raise \
                 smoke.flow.remesh.spacing)",
            ),
            (unsolved > 0).then(|| {
                format!(
                    "{unsolved} of {count} remeshings kept divergence after 50 iterations of its solver (lower \
                     smoke.flow.strain)"
                )
            }),
        ];
        lines.into_iter().flatten().collect()
    }
}

/// Warnings about the remeshings of all frames.
pub(super) fn warnings<'a>(records: impl Iterator<Item = &'a SmokeRecord>) -> Vec<String> {
    let mut totals = RemeshTotals::default();
    records.for_each(|record| totals.add(&record.flow));
    totals.warnings()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::vortex::flow::RemeshReport;

    #[test]
    fn small_parts_are_not_reported_and_large_ones_are_by_name() {
        let quiet = RemeshReport {
            before: 1000,
            redistributed: 0.005,
            lost_impulse: 1e-4,
            impulse_change_at_solids: 1e-3,
            impulse_scale: 1.0,
            ..RemeshReport::default()
        };
        let record = |remeshed: u32, remesh: Option<RemeshReport>| SmokeRecord {
            flow: FlowReport { remeshed, remesh, ..FlowReport::default() },
            ..SmokeRecord::default()
        };
        assert!(warnings([].iter()).is_empty());
        let first = record(1, Some(quiet));
        let found = warnings([&first, &record(0, None)].into_iter());
        assert!(found.is_empty(), "{found:?}");
        let reported = |change: &dyn Fn(&mut RemeshReport)| {
            let mut loud = quiet;
            change(&mut loud);
            warnings([&first, &record(1, Some(loud))].into_iter())
        };
        for (lines, words) in [
            (reported(&|sum| sum.lost_impulse = 0.02), "2.0 % of the smoke's impulse was lost in 2"),
            (
                reported(&|sum| sum.impulse_change_at_solids = 0.2),
                "20.1 % of the smoke's impulse was changed",
            ),
            (reported(&|sum| sum.redistributed = 0.495), "25.0 % of total circulation was redistributed"),
            (reported(&|sum| sum.wide = 100), "5.0 % of the vortons were not remeshed"),
            (reported(&|sum| sum.unconverged = 1), "1 of 2 remeshings kept divergence"),
            (reported(&|sum| sum.lost_impulse = f64::NAN), "NaN % of the smoke's impulse was lost"),
        ] {
            assert!(lines.len() == 1 && lines[0].starts_with(words), "{lines:?} for {words}");
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_read_back_from_a_log() {
        let remesh = RemeshReport { lost_impulse: f64::NAN, impulse_scale: 1.0, ..RemeshReport::default() };
        let flow = FlowReport { remeshed: 1, remesh: Some(remesh), ..FlowReport::default() };
        let text = serde_json::to_string(&SmokeRecord { flow, ..SmokeRecord::default() }).unwrap();
        let found = warnings([serde_json::from_str(&text).unwrap()].iter());
        assert!(found.len() == 1 && found[0].starts_with("NaN %"), "{found:?}");
    }
}
