//! `meniscus usd`.

use super::{
    product::ProductVerb,
    product_args::{InputArgs, UsdArgs},
};
use crate::{
    export::usd::{StageParams, StageSpace},
    run::{Control, ProductSettings, RunError},
};

/// Joins the files of a shot to a USD stage.
pub(super) fn usd(args: &UsdArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb { name: "usd", makes: "a stage", ..ProductVerb::default() };
    let space = StageSpace { up: args.up, scale: args.scale };
    let params = StageParams { space, names: args.names.unwrap_or_default() };
    let request = |settings: &mut ProductSettings| settings.usd = Some(params);
    let input = InputArgs {
        inputs: vec![args.shot.to_string_lossy().into_owned()],
        output: args.output.clone(),
        frames: args.frames.clone(),
        max_memory: args.max_memory,
        force: args.force,
        ..InputArgs::default()
    };
    verb.run(&input, None, request, control)
}
