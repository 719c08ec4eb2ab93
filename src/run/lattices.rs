//! What lattices did to the vortons of a shot, in sum, and what of it should not go unseen.

use super::{RunError, ShotFolder, log};
use crate::sim::vortex::flow::{FlowReport, RemeshReport};
use serde::Deserialize;

/// The impulse that was lost on lattices, of what the strengths could have, that is told. Below, a ring is slower or faster by no more
/// than this; built-in shots lose less than a thousandth.
const LOST: f64 = 0.01;

/// The same that was changed so that no vortex line ends at a solid. A solid pushes the air as well; where the lattice does as much
/// as this, what is left of a swirl beside one is the lattice's.
const TURNED: f64 = 0.1;

/// The part of all strength that a lattice hands on, on average, that is told: fringes of built-in shots have 0.2 to 0.3 % of it. With 9 %
/// a ring of 700 vortons had 49 after forty lattices.
const HANDED: f64 = 0.02;

/// The part of vortons too wide for lattices that is told. They lose their overlap, and nothing mends it.
const WIDE: f64 = 0.01;

/// Sums over the lattices of a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Lattices {
    count: u32,
    /// Vortons put on them, about: those before the first of a frame stand for all of it.
    put: f64,
    wide: f64,
    unsolved: u32,
    handed: f64,
    /// Impulses [m⁴/s], and what they are held against.
    lost: f64,
    turned: f64,
    reach: f64,
}

impl Lattices {
    /// Those of the frames in the folder's log.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(super) fn of_log(folder: &ShotFolder) -> Result<Self, RunError> {
        #[derive(Deserialize)]
        struct Line {
            #[serde(default)]
            smoke: Option<Smoke>,
        }
        #[derive(Deserialize)]
        struct Smoke {
            remeshed: u32,
            remesh: Option<RemeshReport>,
        }
        let mut sums = Self::default();
        for line in log::read::<serde_json::Value>(folder)? {
            match serde_json::from_value::<Line>(line) {
                Ok(Line { smoke: Some(Smoke { remeshed, remesh }) }) => sums.add(remeshed, remesh.as_ref()),
                Ok(_) => {}
                // What is no number is null in a log, and is told as no number.
                Err(_) => sums.lost = f64::NAN,
            }
        }
        Ok(sums)
    }

    /// Books a frame.
    pub(super) fn book(&mut self, flow: &FlowReport) {
        self.add(flow.remeshed, flow.remesh.as_ref());
    }

    fn add(&mut self, count: u32, sum: Option<&RemeshReport>) {
        let Some(sum) = sum else { return };
        self.count += count;
        self.put += f64::from(sum.before) * f64::from(count);
        self.wide += f64::from(sum.wide);
        self.unsolved += sum.unsolved;
        self.handed += sum.handed;
        self.lost += sum.lost;
        self.turned += sum.turned;
        self.reach = self.reach.max(sum.reach);
    }

    /// What is above what is told, a line each.
    pub(super) fn remarks(&self) -> Vec<String> {
        let Self { count, .. } = *self;
        let told = |part: f64, least: f64, what: &str| {
            // What is no number is told as well.
            (part > least || part.is_nan()).then(|| format!("{:.1} % {what}", 100.0 * part))
        };
        let part = |of: f64, all: f64| if of == 0.0 { 0.0 } else { of / all };
        let lines = [
            told(
                part(self.lost, self.reach),
                LOST,
                &format!("of the smoke's impulse was lost on {count} lattices with weak vortons that nobody near could stand for (a smaller smoke.flow.remesh.weak)"),
            ),
            told(
                part(self.turned, self.reach),
                TURNED,
                &format!("of the smoke's impulse was changed on {count} lattices so that no vortex line ends at a solid (a smaller smoke.spacing)"),
            ),
            told(
                part(self.handed, f64::from(count)),
                HANDED,
                &format!("of all strength was handed on by weak vortons and out of solids on each of {count} lattices (a smaller smoke.flow.remesh.weak)"),
            ),
            told(
                part(self.wide, self.put),
                WIDE,
                "of the vortons were left off the lattices, with cores more than 2.2 times as wide as theirs (a larger smoke.flow.remesh.spacing)",
            ),
            (self.unsolved > 0).then(|| {
                format!("{} of {count} lattices kept divergence that 50 rounds did not take out (a smaller smoke.flow.strain)", self.unsolved)
            }),
        ];
        lines.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn little_is_not_told_and_much_is_by_name() {
        let quiet = RemeshReport {
            before: 1000,
            handed: 0.005,
            lost: 1e-4,
            turned: 1e-3,
            reach: 1.0,
            ..RemeshReport::default()
        };
        let mut sums = Lattices::default();
        assert!(sums.remarks().is_empty(), "nothing is nothing");
        sums.add(1, Some(&quiet));
        sums.add(0, None);
        assert!(sums.remarks().is_empty(), "{:?}", sums.remarks());
        let told = |change: &dyn Fn(&mut RemeshReport)| {
            let mut loud = quiet;
            change(&mut loud);
            let mut sums = sums;
            sums.add(1, Some(&loud));
            sums.remarks()
        };
        for (lines, words) in [
            (told(&|sum| sum.lost = 0.02), "2.0 % of the smoke's impulse was lost on 2"),
            (told(&|sum| sum.turned = 0.2), "20.1 % of the smoke's impulse was changed"),
            (told(&|sum| sum.handed = 0.495), "25.0 % of all strength"),
            (told(&|sum| sum.wide = 100), "5.0 % of the vortons were left off"),
            (told(&|sum| sum.unsolved = 1), "1 of 2 lattices kept divergence"),
            (told(&|sum| sum.lost = f64::NAN), "NaN % of the smoke's impulse was lost"),
        ] {
            assert!(lines.len() == 1 && lines[0].starts_with(words), "{lines:?} for {words}");
        }
    }
}
