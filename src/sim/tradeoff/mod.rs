//! What a tradeoff compares: settings of systems and products, and the runs that measure them.

mod folder;
mod knob;
mod measure;
mod runs;
mod subject;

pub(crate) use folder::{Jobs, Made, RunFolder, remove};
pub(crate) use knob::{Axis, Change, Knob, multiples, refine, refined};
#[cfg(test)]
pub(crate) use measure::tests::values;
pub(crate) use measure::{ComparedRun, FrameSample, Measure, ProductRecord, Run, pairs, rms};
pub(crate) use runs::tradeoff;
pub(crate) use subject::{ProductRuns, ProductSource, Runs, Subject, Sweep, SystemRuns, TradeoffJob};
