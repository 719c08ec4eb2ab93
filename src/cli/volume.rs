//! `meniscus volume`.

use super::{
    product::ProductVerb,
    product_args::{InputArgs, VolumeArgs},
};
use crate::{
    export::vdb::VolumeGrid,
    run::{Control, ProductSettings, Retime, RunError},
};

/// The only key of a system that changes volumes without simulating again.
const TRACERS: &str = "smoke.tracers";

/// Makes volumes of a cache, or of particle files of any solver.
pub(super) fn volume(args: &VolumeArgs, control: Control) -> Result<(), RunError> {
    let keys = &["surface", "volume", TRACERS];
    let verb =
        ProductVerb { name: "volume", makes: "a volume", takes_files: true, keys, ..ProductVerb::default() };
    let reseed = args.input.set.iter().any(|argument| argument.trim_start().starts_with(TRACERS));
    let factor = args.retime.unwrap_or(1.0);
    if !(factor.is_finite() && (1e-3..=1e3).contains(&factor)) {
        return Err(RunError::Request(format!("--retime {factor}: expected a number from 0.001 to 1000")));
    }
    let retime = (args.retime.is_some() || reseed).then_some(Retime { factor, reseed });
    let grids = |settings: &mut ProductSettings| {
        let requested = &mut settings.output.volume;
        if !args.grids.is_empty() {
            requested.clone_from(&args.grids);
        } else if requested.is_empty() {
            requested.extend(VolumeGrid::DEFAULT);
        }
    };
    let short = [("volume.precision", &args.precision), ("volume.compression", &args.compression)];
    let short = short.into_iter().filter_map(|(key, value)| Some(format!("{key}={}", value.as_ref()?)));
    let set = args.input.set.iter().cloned().chain(short).collect();
    verb.run(&InputArgs { set, ..args.input.clone() }, retime, grids, control)
}
