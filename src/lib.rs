//! Meniscus: an offline production-effects tool, as a library.
//!
//! It simulates liquid (position based fluids), smoke (vortex particles) and sheets (springs), keeps every frame in a
//! cache, and turns particles into watertight meshes and OpenVDB volumes, on all cores of a CPU.
//!
//! Meshing particles takes three lines:
//!
//! ```
//! use meniscus::{
//!     control::CancelToken,
//!     export::ply,
//!     frame::{Stream, StreamKind},
//!     math::Vec3,
//!     mesh::{self, SurfaceParams},
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A block of 10 × 10 × 10 particles, 5 cm apart.
//! let (n, spacing) = (10, 0.05);
//! let positions: Vec<Vec3> = (0..n * n * n)
//!     .map(|i| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / (n * n)) as f32) * spacing)
//!     .collect();
//! let particles = Stream::new("particles", StreamKind::Particles, positions.len()).with("position", positions);
//!
//! let surface = mesh::reconstruct(&particles, spacing, &SurfaceParams::default(), &CancelToken::new())?;
//! assert!(surface.check.is_sound(), "closed, manifold, oriented outwards");
//! # let folder = std::env::temp_dir().join(format!("meniscus-doc-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let path = folder.join("block.ply");
//! ply::write(&surface.mesh, &path, &[])?;
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok(())
//! # }
//! ```
//!
//! # Where to start
//!
//! | to do | types |
//! |---|---|
//! | mesh particles | [`import::read_particles`], [`mesh::reconstruct`], [`mesh::SurfaceParams`], [`export::ply`] |
//! | simulate a preset | [`scene::Scene`], [`sim::Simulation`], [`frame::Frame`] |
//! | simulate without a preset | [`sim::Systems`], [`sim::liquid::LiquidParams::new`], [`sim::World`], [`solid::Shape`] |
//! | read a cache | [`cache::list`], [`cache::read_frame`], [`frame::Stream`] |
//! | write a volume | [`field::density`], [`export::vdb`] |
//!
//! A [`control::CancelToken`], passed as the watch of [`sim::Simulation::advance`] or to [`mesh::reconstruct`], cancels them
//! from another thread.
//!
//! `examples/` holds programs that mesh particles, simulate a preset and read a cache.
//!
//! # Guarantees
//!
//! - The same input gives the same bytes for any number of threads and on any CPU.
//! - Meshes of [`mesh::reconstruct`] are closed, manifold and oriented outwards; its report lists exceptions.
//! - A frame is the whole state: a simulation restored from one continues with the same bits.
//! - Files appear under their names whole or not at all.
//!
//! # Not guaranteed
//!
//! - The API may change in any version before 1.0; files of a later version of the cache are refused.
//! - Parameters out of their documented ranges panic; [`scene`] reports them as diagnostics instead.
//! - Bytes may differ between versions.
//!
//! # Features
//!
//! | feature | adds |
//! |---|---|
//! | `cli` (default) | the binary and the module `cli` |
//! | `presets` (default) | presets (the module `scene`) and, without an API, the jobs that run them |
//! | `npz`, `vtk`, `vdb` (default) | readers of NPZ, VTK XML and OpenVDB files |
//!
//! # Conventions
//!
//! Everything is SI; axes are right-handed with Z up; faces wind counter-clockwise seen from outside. A module uses only
//! modules above it in the list below, and files do not import each other in a circle (`tests/architecture/`).

// Jobs and the command line use what is dead code without them.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]

pub mod par;

pub mod math;

pub mod simd;

pub mod frame;

pub mod control;

pub mod space;

pub mod grid;

pub mod sdf;

pub mod solid;

pub mod cache;

pub mod field;

pub mod mesh;

pub mod import;

pub mod export;

#[cfg(feature = "presets")]
mod image;

#[cfg(feature = "presets")]
mod preset;

#[cfg(feature = "presets")]
mod job;

pub mod sim;

#[cfg(feature = "presets")]
mod product;

#[cfg(feature = "presets")]
pub mod scene;

#[cfg(feature = "presets")]
mod run;

#[cfg(feature = "presets")]
mod farm;

#[cfg(feature = "cli")]
pub mod cli;

#[cfg(all(feature = "cli", any(test, feature = "fuzzing")))]
#[doc(hidden)]
pub mod untrusted;

/// Whether the long studies run too (`tools/soak/run`).
#[cfg(test)]
fn is_soak() -> bool {
    std::env::var_os("MENISCUS_SOAK").is_some()
}

/// A table of a preset as the program reads it: by way of its JSON, so that the tests compile no reader of TOML for each type.
#[cfg(test)]
fn from_toml<T: serde::de::DeserializeOwned>(text: &str) -> T {
    let table: serde_json::Value = toml::from_str(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    serde_json::from_value(table).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
