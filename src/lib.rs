//! Meniscus: an offline production-effects tool.
//!
//! A shot is a short text preset. It is simulated frame by frame into a cache on disk; the cache is turned
//! into watertight meshes in batch; the meshes open as a sequence in Blender.
//!
//! Data flows one way: scene text → [`scene`] → [`sim`] → [`frame::Frame`] → [`cache`] → [`grid`] → [`sdf`] →
//! [`mesh`] → [`export`]. The modules below are listed in that order, and a module uses only modules above it
//! (`tests/architecture.rs` enforces this). Everything is SI; axes are right-handed with Z up; faces wind
//! counter-clockwise seen from outside.

pub mod par;

pub mod math;

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

pub mod preset;

pub mod job;

pub mod sim;

pub mod scene;

pub mod run;

pub mod cli;
