//! `meniscus colliders`.

use super::{
    product::ProductVerb,
    product_args::{CollidersArgs, InputArgs},
};
use crate::run::{Control, ProductSettings, RunError};

/// Writes the colliders of a shot as meshes with their motion.
pub(super) fn colliders(args: &CollidersArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb { name: "colliders", makes: "colliders", ..ProductVerb::default() };
    let request = |settings: &mut ProductSettings| settings.colliders = true;
    let input = InputArgs {
        inputs: vec![args.cache.to_string_lossy().into_owned()],
        output: args.output.clone(),
        frames: args.frames.clone(),
        max_memory: args.max_memory,
        force: args.force,
        ..InputArgs::default()
    };
    verb.run(&input, None, request, control)
}
