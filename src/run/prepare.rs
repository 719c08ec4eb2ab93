//! Shot folders that are ready to be simulated by another process.

use super::{Control, Manifest, RunError, ShotFolder, simulate, solids, stale};
use crate::scene::Scene;

/// Writes the preset of `scene` and the files that it names into a shot folder, which
/// `meniscus simulate DIR/preset.toml -o DIR` then simulates on any machine.
///
/// # Errors
/// If the folder has frames of other settings ([`RunError::OtherSettings`]) or files of the user in their places, or cannot be
/// written.
pub(crate) fn prepare(scene: &Scene, folder: &ShotFolder, control: Control) -> Result<(), RunError> {
    simulate::refuse_foreign_preset(folder)?;
    solids::refuse_assets(scene, folder)?;
    stale::refuse_others(folder, scene)?;
    let _lock = Manifest::lock(folder, control)?;
    ShotFolder::write(folder.preset(), &(simulate::RECORD.to_owned() + &scene.to_toml()))?;
    solids::keep_assets(scene, folder)
}
