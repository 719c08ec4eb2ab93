//! The registry: every system of the tool.

use super::{
    coupling::job::Couplings,
    liquid::job::Liquid,
    record::SeedReport,
    rigid::job::Bodies,
    scene::Scene,
    sheet::job::Sheets,
    smoke::job::Smoke,
    system::{self, System},
};

/// Every system, in the order in which they are checked and reported.
pub(crate) static ALL: [&dyn System; 5] = [&Liquid, &Smoke, &Sheets, &Bodies, &Couplings];

/// What seeding left out or could not do, as warnings.
pub(crate) fn seeding_warnings(seeds: &SeedReport) -> Vec<String> {
    ALL.iter().flat_map(|system| system.seeding_warnings(seeds)).collect()
}

/// The files of all meshes of a scene, each with its dotted key.
pub(crate) fn mesh_files(scene: &Scene) -> Vec<(String, &str)> {
    let colliders = scene.world.collider.iter().enumerate();
    let colliders = colliders.map(|(i, collider)| (format!("world.collider.{i}.shape"), &collider.shape));
    let forces = scene.force.iter().enumerate();
    let forces = forces.filter_map(|(i, force)| Some((format!("force.{i}.shape"), force.shape.as_ref()?)));
    let systems = ALL.iter().flat_map(|system| system.mesh_files(scene));
    colliders.chain(forces).flat_map(system::mesh_files).chain(systems).collect()
}
