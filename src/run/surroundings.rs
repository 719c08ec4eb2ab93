//! The air around the smoke of a shot.

use super::{Control, RunError, ShotFolder, Surroundings, simulate, solids};
use crate::scene::Scene;

/// What moves the smoke of a shot; `None` if it has none. Samples of meshes are read from `folder`, or written there.
///
/// # Errors
/// If a mesh cannot be sampled.
pub fn surroundings(
    scene: &Scene,
    folder: &ShotFolder,
    control: Control,
) -> Result<Option<Surroundings>, RunError> {
    if scene.smoke.is_none() {
        return Ok(None);
    }
    let scene = solids::fill(scene, Some(folder), control.reporter)?;
    let world = simulate::world(&scene);
    Ok(scene.systems().smoke.map(|smoke| Surroundings { smoke, world }))
}
