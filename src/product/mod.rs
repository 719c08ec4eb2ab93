//! The products: what is made of the frames of a cache or of a sequence of files. Each is one folder.

mod check;
mod colliders;
mod colors;
mod interface;
mod make;
mod mesh_files;
mod point_cache;
mod points;
mod preview;
mod registry;
mod request;
mod sample;
mod sheet_mesh;
pub(crate) mod surface;
mod usd;
pub(crate) mod volume;
mod whitewater;

#[cfg(test)]
mod tests;

pub(crate) use check::check;
pub(crate) use make::make;
pub(crate) use make::{ProductSelection, is_any_requested, selected};
pub(crate) use preview::{ParticleLook, PreviewParams};
pub(crate) use registry::ALL;
pub(crate) use request::{ProductInput, ProductRequest, ProductSettings, Retime};
pub(crate) use sample::RequestedProducts;
