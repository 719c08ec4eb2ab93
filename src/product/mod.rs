//! The products: what is made of the frames of a cache or of a sequence of files. Each is one folder.

mod mesh_files;
pub mod point_cache;
pub mod points;
pub mod sheet_mesh;
pub mod surface;
pub mod volume;
