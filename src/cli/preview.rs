//! `meniscus preview`.

use super::{
    live::Live,
    output::print,
    product::ProductVerb,
    product_args::{InputArgs, PreviewArgs},
};
use crate::{
    control::printable_path,
    run::{self, Control, PreviewParams, ProductSettings, Reporter, RunError, ShotFolder},
};

/// Draws shaded pictures of a cached shot.
pub(super) fn preview(args: &PreviewArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb { name: "preview", makes: "previews", ..ProductVerb::default() };
    let live = args.live.then(|| Live::new(control.reporter)).flatten();
    let request = |settings: &mut ProductSettings| {
        let shows_kept = live.is_some();
        let frames = args.frames.is_some() || args.follow.is_some();
        let params = PreviewParams { size: args.size, frames, particles: args.show, shows_kept };
        settings.preview = Some(params);
    };
    let input = InputArgs {
        inputs: vec![args.cache.to_string_lossy().into_owned()],
        output: args.output.clone(),
        frames: args.frames.clone(),
        max_memory: args.max_memory,
        follow: args.follow,
        force: args.force,
        ..InputArgs::default()
    };
    if args.live && live.is_none() {
        control.reporter.note("--live: stdout is no terminal that declares the graphics of kitty or sixel; pictures are in the files alone");
    }
    let reporter = live.as_ref().map_or(control.reporter, |live| live as &dyn Reporter);
    let made = verb.run(&input, None, request, Control { reporter, ..control });
    // A frame that cannot be drawn does not keep the others from being reported.
    if args.report && matches!(made, Ok(()) | Err(RunError::SomeFailed { .. })) {
        let shot = ShotFolder::around(&args.cache);
        let out = args.output.as_ref().map_or_else(|| shot.clone(), ShotFolder::new);
        print(&printable_path(&run::report(&shot, &out, control)?));
    }
    made
}
