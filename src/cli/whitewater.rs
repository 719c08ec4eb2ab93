//! `meniscus whitewater`.

use super::{
    product::ProductVerb,
    product_args::{InputArgs, WhitewaterArgs},
};
use crate::run::{Control, ProductSettings, RunError};

/// Computes spray, foam and bubbles of a cached liquid.
pub(super) fn whitewater(args: &WhitewaterArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb {
        name: "whitewater",
        makes: "whitewater",
        keys: &["whitewater"],
        ..ProductVerb::default()
    };
    // A preset without the table gets the defaults.
    let request = |settings: &mut ProductSettings| {
        settings.whitewater.get_or_insert_default();
    };
    let input = InputArgs {
        inputs: vec![args.cache.to_string_lossy().into_owned()],
        output: args.output.clone(),
        frames: args.frames.clone(),
        set: args.set.clone(),
        max_memory: args.max_memory,
        force: args.force,
        ..InputArgs::default()
    };
    verb.run(&input, None, request, control)
}
