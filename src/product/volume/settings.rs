//! Settings of volumes.

use crate::{
    export::vdb::{VolumeGrid, VolumeParams},
    mesh::SurfaceParams,
    product::request::ProductSettings,
    sim::{
        World,
        scene::Scene,
        smoke::{ShotAir, Smoke},
    },
};

/// How particles and tracers become volumes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VolumeSettings {
    /// How particles become a density.
    pub(crate) surface: SurfaceParams,
    /// How grids are stored.
    pub(crate) volume: VolumeParams,
    /// Which grids a file has; at least one.
    pub(crate) grids: Vec<VolumeGrid>,
    /// What moves the smoke of the shot, if it has any: without it, smoke has no velocities.
    pub(crate) smoke: Option<Surroundings>,
}

/// Smoke and solids of a shot, which determine its air in addition to vortons.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Surroundings {
    /// Parameters of the smoke.
    pub(crate) smoke: Smoke,
    /// Solids and gravity.
    pub(crate) world: World,
}

impl Surroundings {
    /// What moves the smoke of a scene whose meshes are sampled; `None` if it has none.
    pub(crate) fn of(scene: &Scene) -> Option<Self> {
        scene.systems().smoke.map(|smoke| Self { smoke, world: scene.surroundings() })
    }

    /// Wind and solids of the shot, from which the air of every frame is made.
    pub(in crate::product) fn air(&self) -> ShotAir {
        ShotAir::new(&self.smoke, &self.world)
    }
}

impl VolumeSettings {
    /// These settings for frames of a scene whose meshes are sampled, if it is known.
    pub(super) fn new(settings: &ProductSettings, scene: Option<&Scene>) -> Self {
        let ProductSettings { surface, volume, output, .. } = settings;
        let mut grids = output.volume.clone();
        grids.sort_unstable();
        grids.dedup();
        let smoke = scene.and_then(Surroundings::of);
        Self { surface: surface.clone(), volume: volume.clone(), grids, smoke }
    }

    /// The air of the shot; `None` if no grid is requested that needs it.
    pub(super) fn air(&self) -> Option<ShotAir> {
        let around = self.smoke.as_ref().filter(|_| self.grids.iter().any(|grid| grid.is_of_air()));
        around.map(Surroundings::air)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn walls_and_air_are_made_for_grids_of_the_air_alone() {
        let params = crate::from_toml("spacing = 0.1");
        let smoke = Smoke { params, fps: 24.0, first: 1 };
        let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
        let settings = |grids: &[VolumeGrid]| VolumeSettings {
            surface: SurfaceParams::default(),
            volume: VolumeParams::default(),
            grids: grids.to_vec(),
            smoke: Some(Surroundings { smoke: smoke.clone(), world: world.clone() }),
        };
        assert!(settings(&[VolumeGrid::Density, VolumeGrid::Temperature]).air().is_none());
        assert!(settings(&[VolumeGrid::Density, VolumeGrid::Velocity]).air().is_some());
        assert!(settings(&[VolumeGrid::VectorPotential]).air().is_some());
    }
}
