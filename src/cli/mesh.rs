//! `meniscus mesh`.

use super::{product::ProductVerb, product_args::MeshArgs, shot::quality};
use crate::{
    run::{Control, RunError},
    scene::Quality,
};

/// Meshes a cache, particle files of any solver, or level sets.
pub(super) fn mesh(args: &MeshArgs, control: Control) -> Result<(), RunError> {
    let verb = ProductVerb {
        name: "mesh",
        makes: "a mesh",
        takes_files: true,
        keys: &["surface"],
        quality: args.quality.map(quality),
        file_quality: Some(Quality::Final),
        bounds: args.bounds,
    };
    verb.run(&args.input, None, |settings| settings.output.mesh.clone_from(&args.format), control)
}
