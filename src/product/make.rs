//! Makes products: those of a preset, or those of a verb of the command line.

use super::{
    interface::Product,
    registry::ALL,
    request::{ProductInput, ProductRequest, ProductSettings},
};
use crate::job::{Control, RunError, batch::BatchSummary};

/// Which products are made.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ProductSelection {
    /// All that the settings request.
    Requested,
    /// The products of a verb that the settings request and that accept a stream of the input.
    Verb(&'static str),
}

/// Whether these settings request any product.
pub(crate) fn is_any_requested(settings: &ProductSettings) -> bool {
    ALL.into_iter().any(|product| product.is_requested(settings))
}

/// Makes products one after the other, and passes what was made of each to `done`. Frames that fail in one product do not keep
/// the others from being made.
///
/// # Errors
/// The first failure of a product; [`RunError::Request`] if no product of a verb accepts a stream of the input.
pub(crate) fn make(
    products: &[&dyn Product],
    request: &ProductRequest,
    control: Control,
    done: &mut dyn FnMut(&BatchSummary),
) -> Result<(), RunError> {
    let mut failed = None;
    for product in products {
        match product.make(request, control) {
            Ok(summary) => done(&summary),
            Err(why @ RunError::SomeFailed { .. }) => failed = failed.or(Some(why)),
            Err(why) => return Err(failed.unwrap_or(why)),
        }
    }
    failed.map_or(Ok(()), Err)
}

/// The selected products of a request.
///
/// # Errors
/// If a verb has none that accepts the input.
pub(crate) fn selected(
    selection: ProductSelection,
    request: &ProductRequest,
) -> Result<Vec<&'static dyn Product>, RunError> {
    let requested = ALL.into_iter().filter(|product| product.is_requested(request.settings));
    match selection {
        ProductSelection::Requested => Ok(requested.collect()),
        ProductSelection::Verb(verb) => {
            accepting(verb, requested.filter(|product| product.verb() == verb).collect(), request)
        }
    }
}

/// The products that accept a stream of the input; all where that cannot be known before frames are read.
///
/// # Errors
/// If there are none.
fn accepting<'a>(
    verb: &str,
    products: Vec<&'a dyn Product>,
    request: &ProductRequest,
) -> Result<Vec<&'a dyn Product>, RunError> {
    let ProductInput::Frames(source) = request.input else { return Ok(products) };
    // What is made of no stream may be made of a folder without frames.
    if products.iter().all(|product| !product.is_of_streams()) {
        return Ok(products);
    }
    let frames = source.frames(request.batch.selection.as_ref())?;
    // All frames of a cache have the streams of the first that can be read.
    let Some(streams) = frames.iter().find_map(|(_, path)| source.streams(path.as_deref()?)) else {
        return Ok(products);
    };
    let accepts = |product: &dyn Product| streams.iter().any(|&(_, kind)| product.accepts(kind));
    let can_be_made = |product: &&dyn Product| !product.is_of_streams() || accepts(*product);
    let accepting: Vec<&dyn Product> = products.iter().copied().filter(can_be_made).collect();
    if !accepting.is_empty() {
        return Ok(accepting);
    }
    let list = |mut words: Vec<String>| {
        words.dedup();
        words.join(" or ")
    };
    let inputs = list(products.iter().map(|product| product.input().to_owned()).collect());
    let others = ALL.into_iter().filter(|&other| accepts(other));
    let others = list(others.map(|other| format!("`meniscus {}`", other.verb())).collect());
    let next = if others.is_empty() { String::new() } else { format!("; try {others}") };
    Err(RunError::Request(format!("no {inputs} in this cache, which `meniscus {verb}` needs{next}")))
}
