//! The job that makes products of frames.

use super::{Control, RunError, solids};
use crate::{
    frame::StreamKind,
    job::batch::{BatchSummary, Source},
    product::{self, ProductInput, ProductRequest, ProductSelection},
    scene::Scene,
    sim::registry::ALL,
};

/// Makes the selected products of a request one after the other, and passes what was made of each to `done`.
///
/// Files that were made of the same frames with the same settings are kept, unless the request forces them. Frames that are
/// missing between the first and the last are reported. Files of a sequence keep their numbers; one without particles gives
/// empty files, since a sequence may start before its liquid does.
///
/// # Errors
/// Frames that cannot be read or made, need more memory than the request allows, or are missing, are left out and reported
/// together at the end ([`RunError::SomeFailed`]). Errors of a single file, also that it has no particles, are the job's
/// error; a folder or disk that refuses to be written ends the job at once.
pub(crate) fn make_products(
    selection: ProductSelection,
    request: &ProductRequest,
    control: Control,
    done: &mut dyn FnMut(&BatchSummary),
) -> Result<(), RunError> {
    let products = product::selected(selection, request)?;
    let uses_solids = products.iter().any(|product| product.uses_solids(request.settings));
    // So does the velocity of tracers.
    let is_of_streams = products.iter().any(|product| product.is_of_streams());
    let needs_solids = |scene: &&Scene| uses_solids || is_of_streams && has_tracers(scene);
    let scene = match (request.scene.filter(needs_solids), request.input) {
        (Some(scene), ProductInput::Frames(Source::Cache(folder))) => {
            Some(solids::fill(scene, Some(folder), control.reporter)?)
        }
        _ => None,
    };
    let request = ProductRequest { scene: scene.as_ref().or(request.scene), ..*request };
    product::make(&products, &request, control, done)
}

fn has_tracers(scene: &Scene) -> bool {
    let systems = ALL.iter().filter(|system| system.is_present(scene));
    systems.flat_map(|system| system.stream_kinds()).any(|&kind| kind == StreamKind::Tracers)
}
