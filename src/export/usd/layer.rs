//! What all layers of a stage share: axes, units, frames a second.

use super::{
    crate_file::{CrateFile, Value},
    space::StageSpace,
};
use serde::Serialize;

/// What all layers of a stage share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct LayerSettings {
    /// Axes and units.
    pub(crate) space: StageSpace,
    /// Frames a second [1/s]: a layer of another number would be retimed by those that use it.
    pub(crate) fps: f64,
}

impl LayerSettings {
    /// The metadata of a layer with one prim, and of its first and last frame, if it has any.
    pub(super) fn fields(
        &self,
        file: &mut CrateFile,
        prim: &str,
        frames: Option<(u32, u32)>,
    ) -> Vec<(&'static str, Value)> {
        let mut fields = vec![
            ("defaultPrim", file.token(prim)),
            ("upAxis", file.token(self.space.up.token())),
            ("metersPerUnit", file.double(self.space.meters_per_unit())),
            ("timeCodesPerSecond", file.double(self.fps)),
            ("framesPerSecond", file.double(self.fps)),
        ];
        if let Some((first, last)) = frames {
            fields.push(("startTimeCode", file.double(first.into())));
            fields.push(("endTimeCode", file.double(last.into())));
        }
        fields
    }
}
