//! Volume files: fog, level set, velocity and temperature grids of particles and of tracers, also retimed.

mod file;
mod folder;
mod memory;
mod particle_grids;
mod product;
mod retime;
mod settings;
mod tracer_grids;
mod tracers;
mod writer;

pub(super) use folder::VolumeFile;
pub(crate) use settings::Surroundings;
pub(in crate::product) use tracers::no_velocity;
