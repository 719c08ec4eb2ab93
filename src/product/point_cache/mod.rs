//! Point caches: a mesh and a PC2 file of its points in all frames, one pair a sheet.

mod writer;

pub(super) use writer::PointCache;
