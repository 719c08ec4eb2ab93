//! Wedges: variants of a shot, one for each combination of some settings.

mod list;

pub(crate) use list::{Wedge, WedgeList};
