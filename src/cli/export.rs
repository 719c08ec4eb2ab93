//! `meniscus export`.

use super::{
    product::ProductVerb,
    product_args::{ExportArgs, InputArgs},
};
use crate::{
    export::SheetFormat,
    run::{Control, ProductSettings, RunError},
};

/// Writes the tracers of a cache as points, and its sheets as meshes or point caches.
pub(super) fn export(args: &ExportArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb { name: "export", makes: "an export", ..ProductVerb::default() };
    let formats = |settings: &mut ProductSettings| {
        // Formats and thickness are of sheets, and tracers are written if none is given.
        settings.points = args.format.is_empty() && args.thickness.is_none();
        settings.output.thickness = args.thickness;
        settings.output.sheet =
            if args.format.is_empty() { vec![SheetFormat::Pc2] } else { args.format.clone() };
    };
    let input = InputArgs {
        inputs: vec![args.cache.to_string_lossy().into_owned()],
        output: args.output.clone(),
        frames: args.frames.clone(),
        max_memory: args.max_memory,
        force: args.force,
        ..InputArgs::default()
    };
    verb.run(&input, None, formats, control)
}
