//! What a user chooses of a stage.

use super::{geometry::NameScheme, space::StageSpace};
use serde::{Deserialize, Serialize};

/// What a user chooses of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageParams {
    /// Axes and units.
    pub space: StageSpace,
    /// Whose names primvars have in addition to those of the schemas.
    pub names: NameScheme,
}
