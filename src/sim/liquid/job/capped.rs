//! What is reported of substeps that are longer than they may be.

use crate::sim::liquid::{LiquidParams, LiquidRecord};

/// That substeps were longer than they may be, and what to raise; none if they were not.
pub(super) fn why_capped<'a>(
    liquid: &LiquidParams,
    records: impl IntoIterator<Item = &'a LiquidRecord>,
) -> Option<String> {
    let limit = if liquid.surface_tension.is_some() { "liquid.cfl or surface tension" } else { "liquid.cfl" };
    let is_capped = records.into_iter().any(|record| record.cfl_capped > 0);
    is_capped.then(|| {
        format!(
            "substeps were longer than {limit} allows; raise liquid.max_substeps ({})",
            liquid.max_substeps
        )
    })
}
