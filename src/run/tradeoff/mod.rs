//! Work against precision on the user's own shot: which settings are worth their time.
//!
//! *Method*: every setting of a sweep (`sweep`) is run on the same frames, and so is a reference that is finer than all
//! of them (`knobs`) and a refinement of that. The Pareto front and its knee ([`pareto`]) name the settings to consider.
//! What is run and compared is the simulation of a liquid ([`liquid`]), of smoke ([`smoke`]) or of sheets ([`sheet`]), whose runs are kept by `runs`, or
//! the surfaces of particles that are there ([`surface`]).

mod cells;
mod knobs;
pub mod liquid;
mod page;
pub mod pareto;
mod plot;
mod runs;
pub mod sheet;
pub mod smoke;
pub mod surface;
mod sweep;
mod table;

pub use knobs::Subject;
pub use page::rows;
pub use sweep::{Ground, Request, Setting, Sweep, Vary};
pub use table::{Compared, Line, Table};

use serde::Serialize;

/// A middle and its range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The median.
    pub median: f64,
    /// The smallest.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Of some values; `None` of none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let half = sorted.len() / 2;
        let median =
            if sorted.len() % 2 == 1 { sorted[half] } else { 0.5 * (sorted[half - 1] + sorted[half]) };
        Some(Self { median, min, max })
    }
}

#[cfg(test)]
mod tests {
    use super::Spread;

    #[test]
    fn spreads_have_the_middle_value() {
        assert_eq!(Spread::of(&[]), None);
        assert_eq!(Spread::of(&[3.0, 1.0, 2.0]), Some(Spread { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(Spread::of(&[4.0, 1.0]).unwrap().median, 2.5);
    }
}
